"""Cases of the challenge in memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ldt_core.base.experiment import Experiment
from ldt_core.lab.challenge.case_plan import plan_case


@dataclass(frozen=True)
class Case:
    """A case in memory.

    Args:
        machine: keys of the machine file.
        experiments: recorded for the diagnosis.
        further: of the same machine, which the diagnosis does not see.
        truth: entry of the key.
    """

    machine: dict[str, Any]
    experiments: tuple[Experiment, ...]
    further: tuple[Experiment, ...]
    truth: dict[str, Any]


def make_case(kind: str, effects: Sequence[str] = (), *, seed: int, **asked: Any) -> Case:
    """As `plan_case`, with its experiments."""
    plan = plan_case(kind, effects, seed=(seed,), **asked)
    return Case(plan.machine, tuple(plan.experiments()), tuple(plan.further()), plan.truth)
