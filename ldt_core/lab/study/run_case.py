"""One run of a study: a case through the one loop, its figures written down."""

from __future__ import annotations

import time
from collections.abc import Collection
from typing import Any

import numpy as np

from ldt_core.base.errors import ExperimentError
from ldt_core.base.experiment import Experiment, Level, ModelRecord, Prediction, Signal, Step, rms
from ldt_core.lab.study.region import region_rmse
from ldt_core.lab.study.stream import Stream, stream
from ldt_core.lab.study.study_case import RunResult, StudyCase
from ldt_core.machine.machine_file import Machine, load_machine
from ldt_core.twin.detector_stage import DetectorStage
from ldt_core.twin.loop import Twin

DIGITS = 4  # of the series kept for a figure, which shows 0.1 mrad/s at the very best


class Scripted(DetectorStage):
    """Stage 2 by a list: positive in these experiments and negative in all others.

    Args:
        name: in the signal.
        alarms: numbers of experiments.
    """

    def __init__(self, name: str, alarms: Collection[int]) -> None:
        self.name = name
        self.alarms = frozenset(alarms)

    def step(self, experiment: Experiment, prediction: Prediction) -> Signal:
        """The signal for one experiment; only its number is looked at."""
        level = Level.POSITIVE if experiment.number in self.alarms else Level.NEGATIVE
        error = prediction.max_error(experiment)
        return Signal(experiment.number, level, self.name, prediction.model_version, error)


def run_case(case: StudyCase, machine: Machine | None = None) -> RunResult:
    """Take the stream of a case through a twin.

    Args:
        case: what to run.
        machine: that of the case, for a process that may not have the file.

    Raises:
        BadInput: a machine, model, detector or parameters that cannot be used.
    """
    machine = machine or load_machine(case.machine)
    given = stream(case, machine)
    detector = None if case.alarms is None else Scripted(case.detector, case.alarms)
    begin = time.thread_time()
    twin = Twin.from_settings(machine, case.resolved, detector)
    first = twin.model.record()
    steps = list(twin.steps(given.experiments, _refuse))
    seconds = time.thread_time() - begin
    return _result(case, given, steps, seconds, _estimates(machine, first, steps))


def _refuse(error: ExperimentError) -> None:
    raise error


def _estimates(machine: Machine, first: ModelRecord, steps: list[Step]) -> list[float | None]:
    """What wears, by the model that predicted each experiment, where it names a cause."""
    wear = machine.simulation.get("degradation") or {}
    present, found = first, []
    for step in steps:
        cause = present.parameters.get("cause") or {}
        same = cause.get("effect") == wear.get("effect")
        found.append(cause["parameters"].get(wear.get("parameter")) if cause and same else None)
        present = step.model or present
    return found


def _result(
    case: StudyCase,
    given: Stream,
    steps: list[Step],
    seconds: float,
    estimate: list[float | None],
) -> RunResult:
    learning = [s.prediction.residual(s.experiment) for s in steps]
    original = [s.original.residual(s.experiment) for s in steps]
    return RunResult(
        case=case,
        number=[s.experiment.number for s in steps],
        truth=list(given.truth),
        max_error=[s.signal.max_error for s in steps],
        original=[s.original.max_error(s.experiment) for s in steps],
        rmse=[rms(r) for r in learning],
        rmse_original=[rms(r) for r in original],
        level=[int(s.signal.level) for s in steps],
        action=[str(s.adaptation.action) for s in steps],
        learned_from=[0 if s.model is None else len(s.model.trained_on) for s in steps],
        region_rmse=[region_rmse(r, m) for r, m in zip(learning, given.region, strict=True)],
        region_rmse_original=[
            region_rmse(r, m) for r, m in zip(original, given.region, strict=True)
        ],
        kept={s.experiment.number: _series(s) for s in steps if s.experiment.number in case.keep},
        seconds=round(seconds, 3),
        estimate=estimate,
    )


def _series(step: Step) -> dict[str, list[float] | None]:
    rows: dict[str, Any] = {
        "time": step.experiment.time,
        "voltage": step.experiment.voltage,
        "speed": step.experiment.speed,
        "prediction": step.prediction.speed,
        "original": step.original.speed,
        "speed_std": step.prediction.speed_std,
    }
    return {n: None if row is None else np.round(row, DIGITS).tolist() for n, row in rows.items()}
