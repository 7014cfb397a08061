"""A run of the group robustness made by hand."""

from __future__ import annotations

from dataclasses import replace

from ldt_core.lab.study.robustness.robust_run import DEFAULT, RobustRun, RobustTask

COUNT = 20


def made(stream: str = "off_5mm", setup: str = DEFAULT, **other: object) -> RobustRun:
    """Wrong from the first of 20 experiments on, adapted at once."""
    error = [5.0] + [0.4] * (COUNT - 1)
    run = RobustRun(
        task=RobustTask(stream, setup, 0, COUNT),
        noise=0.1,
        changes=[1],
        max_error=error,
        original=[5.0] * COUNT,
        known=[0.4] * COUNT,
        late=error,
        rms_error=[2.0] + [0.1] * (COUNT - 1),
        level=[1] + [-1] * (COUNT - 1),
        state=["changed"] + ["holds"] * (COUNT - 1),
        action=["adapted"] + ["kept"] * (COUNT - 1),
        seconds=1.0,
        step_seconds=[0.5] + [0.01] * (COUNT - 1),
    )
    return replace(run, **other)
