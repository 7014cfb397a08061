"""One sealed case diagnosed, by a process that knows nothing of its key."""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.code_version import code_version
from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment
from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.diagnosis.holdout import free_run
from ldt_core.diagnosis.library import library
from ldt_core.effects import get_effect
from ldt_core.lab.challenge.comparators import COMPARATORS, compare
from ldt_core.lab.challenge.score.answer import DIAGNOSIS, Answer, Further
from ldt_core.lab.challenge.score.sealed import Sealed, read_sealed

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Task:
    """Who shall answer which case.

    Attributes:
        name: of the case.
        folder: of the case, as the workers see it.
        who: the diagnosis, or comparators.
        left_out: effect to do without.
    """

    name: str
    folder: Path
    who: tuple[str, ...]
    left_out: str | None = None


@functools.cache
def stamp(who: str = DIAGNOSIS) -> dict[str, str]:
    """What decides an answer: code and libraries."""
    known = dict(code_version())
    if who != DIAGNOSIS:
        try:
            known["pysindy"] = version("pysindy")
        except PackageNotFoundError:
            known["pysindy"] = "none"
    return known


def answer(task: Task) -> list[Answer]:
    """What a worker does: a failure of whoever answers is an answer too.

    Raises:
        BadInput: a case that cannot be read.
    """
    case = read_sealed(task.folder)
    effects = library(case.machine, without=[task.left_out] if task.left_out else [])
    if task.who == (DIAGNOSIS,):
        return [_diagnosed(case, effects)]
    wanted = {who: COMPARATORS[who] for who in task.who}
    return [
        Answer(who, found, _errors(case, predict), seconds, error=error)
        for who, found, predict, seconds, error in compare(
            wanted, case.machine, case.shown, effects
        )
    ]


def _diagnosed(case: Sealed, effects: Sequence[Any]) -> Answer:
    begin = time.process_time()
    try:
        diagnosis = diagnose(case.machine, case.shown, effects=effects, workers=1)
    except Exception as error:  # a crash is the worst of answers, and no reason to lose the others
        seconds, why = time.process_time() - begin, in_words(error)
        return Answer(DIAGNOSIS, None, (), seconds, case.seen(), why)
    seconds = time.process_time() - begin
    use = [(get_effect(e["effect"]), e["parameters"]) for e in diagnosis.effects]

    def predict(e: Experiment) -> Array:
        return free_run(case.machine, e, use)

    further = _errors(case, predict if use else None)
    return Answer(DIAGNOSIS, diagnosis.as_dict(), further, seconds, case.seen())


def _errors(case: Sealed, predict: Callable[[Experiment], Array] | None) -> tuple[Further, ...]:
    """Errors on the further experiments by the machine file and by what was found."""
    if predict is None:
        return ()
    found = []
    for e in case.further:
        before = float(np.sum((e.speed - free_run(case.machine, e)) ** 2))
        after = float(np.sum((e.speed - predict(e)) ** 2))
        if math.isfinite(before):
            found.append(Further(e.number, len(e), before, _finite(after)))
    return tuple(found)


def _finite(value: float) -> float:
    return value if math.isfinite(value) else math.inf


def in_words(error: Exception) -> str:
    """A failure in one line."""
    return str(error) if isinstance(error, LdtError) else f"{type(error).__name__}: {error}"
