"""The sealed cases of a folder, each answered by a process that knows nothing of its key."""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.code_version import code_version
from ldt_core.base.errors import BadInput, reason_of
from ldt_core.base.experiment import Experiment
from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.diagnosis.holdout import free_run
from ldt_core.diagnosis.library import library
from ldt_core.diagnosis.promise import promised
from ldt_core.effects import get_effect
from ldt_core.lab.challenge.comparators import COMPARATORS, compare
from ldt_core.lab.challenge.make import FURTHER, MACHINE, SHOWN
from ldt_core.lab.challenge.rig import ALIKE
from ldt_core.lab.challenge.score.answer import DIAGNOSIS, CaseAnswer, Further
from ldt_core.machine.machine_file import Machine, load_machine
from ldt_core.recording.bag import experiments


@dataclass(frozen=True)
class Sealed:
    """A case without its truth.

    Attributes:
        machine: as its file knows it.
        shown: experiments to diagnose.
        further: of the same machine, for what was promised; may be none.
    """

    machine: Machine
    shown: Sequence[Experiment]
    further: Sequence[Experiment]

    def seen(self) -> dict[str, Any]:
        """What of the case a score needs besides: physics, whether there is current, ranges."""
        ranges: dict[str, Sequence[np.ndarray]] = {
            "speed": [e.speed for e in self.shown],
            "voltage": [e.voltage for e in self.shown],
            "time": [e.time for e in self.shown],
            "experiment": [np.array([float(e.number)]) for e in self.shown],
        }
        return {
            "physics": self.machine.physics,
            "current": all(e.current is not None for e in self.shown),
            "range": {
                quantity: [min(float(v.min()) for v in rows), max(float(v.max()) for v in rows)]
                for quantity, rows in ranges.items()
            },
        }


def cases(folder: str | Path) -> dict[str, Path]:
    """Name to folder of every case, in order.

    Raises:
        BadInput: no cases there, or one that lacks its machine file or recording.
    """
    top, parts = Path(folder), (MACHINE, SHOWN)
    found = {}
    for path in sorted(top.iterdir()) if top.is_dir() else []:
        missing = [name for name in parts if not (path / name).exists()]
        if len(missing) == len(parts):
            continue
        if missing:
            raise BadInput(path, f"a case with {' and '.join(parts)}", f"no {missing[0]}")
        found[path.name] = path
    if not found:
        wanted = f"a folder of cases, each with {', '.join(parts)} and {FURTHER}"
        raise BadInput(folder, wanted, "none" if top.is_dir() else "no folder")
    return found


def read_sealed(folder: Path) -> Sealed:
    """A case from its folder.

    Raises:
        BadInput: a machine file or recording that cannot be read, or that do not fit each other.
    """
    machine = load_machine(folder / MACHINE)
    shown = experiments(folder / SHOWN).experiments
    further = []
    if (folder / FURTHER).exists():
        further = list(experiments(folder / FURTHER).experiments)
    for e in (*shown, *further):
        machine.check(e)
    return Sealed(machine, shown, further)


def check_entries(found: Mapping[str, Any], entries: Mapping[str, Any], folder: str | Path) -> None:
    """Refuse keys that are not those of these cases.

    Raises:
        BadInput: a case without an entry, or an entry without its case.
    """
    for name in found:
        if name not in entries:
            raise BadInput(f"{folder}, {name}", "an entry for it in a key", "none")
    for name in entries:
        if name not in found:
            raise BadInput(f"{folder}, {name}", "the case that a key names", "none")


@dataclass(frozen=True)
class AnswerTask:
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
def answer_stamp(who: str = DIAGNOSIS) -> dict[str, str]:
    """What decides an answer: code and libraries."""
    known = dict(code_version())
    if who != DIAGNOSIS:
        try:
            known["pysindy"] = version("pysindy")
        except PackageNotFoundError:
            known["pysindy"] = "none"
    return known


def answer(task: AnswerTask) -> list[CaseAnswer]:
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
        CaseAnswer(who, found, _errors(case, predict), seconds, error=error)
        for who, found, predict, seconds, error in compare(
            wanted, case.machine, case.shown, effects
        )
    ]


def _diagnosed(case: Sealed, effects: Sequence[Any]) -> CaseAnswer:
    begin = time.process_time()
    try:
        diagnosis = diagnose(case.machine, case.shown, effects=effects, workers=1)
    except Exception as error:  # a crash is the worst of answers, and no reason to lose the others
        seconds, why = time.process_time() - begin, reason_of(error)
        return CaseAnswer(DIAGNOSIS, None, (), seconds, case.seen(), why)
    seconds = time.process_time() - begin
    use = [(get_effect(e["effect"]), e["parameters"]) for e in diagnosis.effects]

    def predict(e: Experiment) -> Array:
        return free_run(case.machine, e, use)

    further = _errors(case, predict if use else None)
    found, other = diagnosis.as_dict(), case.further[ALIKE:]
    refused = promised(case.machine, found, other).refused if use and other else ""
    return CaseAnswer(DIAGNOSIS, found, further, seconds, case.seen(), refused=refused)


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
