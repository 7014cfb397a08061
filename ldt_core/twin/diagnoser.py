"""The diagnosis of a machine that runs: when to make one, and of which experiments."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ldt_core.base.errors import LdtError, reason_of
from ldt_core.base.experiment import (
    AMOUNT_PREFIX,
    DiagnosisRecord,
    Experiment,
    Level,
    Scalar,
    Signal,
    rms,
)
from ldt_core.base.own_process import undivided
from ldt_core.base.sentences import confident
from ldt_core.base.settings import resolve
from ldt_core.base.threads import one_thread
from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.diagnosis.diagnosis import Diagnosis
from ldt_core.diagnosis.holdout import free_run
from ldt_core.diagnosis.sentence import unsought
from ldt_core.machine.experiment_limits import too_long_to_learn
from ldt_core.machine.machine_file import Machine
from ldt_core.machine.speed_jumps import median_step
from ldt_core.twin.stage import Archive, RecordedStep
from ldt_core.twin.training_data import JOINT_ERROR_RATIO, VALID_ERROR_RATIO

Make = Callable[..., Diagnosis]
#: Kinds of verdict that name a cause.
NAMED = ("effect", "ambiguous")
#: Median step from sample to sample of normal noise, over its standard deviation.
NORMAL_STEP = 0.954
#: A list and an object of `diagnosis.json`, null where undefined.
COMPOUND = ("gap.closed_fraction_ci95", "next_experiment")


@dataclass(frozen=True, eq=False)
class Known:
    """What a diagnosis says of the machine, and with which later experiments are compared.

    Args:
        error: of a free run with the verdict's effects, on the experiment that asked [rad/s].
        unknown: it found a gap without a cause, so that its free run is no measure.
    """

    use: Sequence[Any]
    error: float
    unknown: bool


@dataclass(frozen=True, eq=False)
class Found:
    """A diagnosis, what it says, and the experiments that it was made of, the last one last."""

    diagnosis: Diagnosis
    known: Known
    pool: Sequence[Experiment]


@dataclass(eq=False)
class Asked:
    """A diagnosis that an experiment asked for, and all that it is made of.

    Args:
        recent: experiments and their signals, the one that asked last.
        last: what was known of the machine then.
        answer: what comes of it, where it is made beside the loop.
    """

    recent: Sequence[tuple[Experiment, Level]]
    last: Known | None
    answer: Future[Found] | None = field(default=None, repr=False)

    @property
    def experiment(self) -> Experiment:
        """The one that asked."""
        return self.recent[-1][0]

    @property
    def holds(self) -> Known | None:
        """What was known of the machine, if it says what an experiment must look like."""
        return None if self.last is None or self.last.unknown else self.last


class Diagnoser:
    """Diagnoses at positives, from the last experiments of the machine as it is now.

    A diagnosis must not mix in experiments from before a change, nor do with fewer than there are:
    one experiment alone tells amounts ten times worse than six.

    A positive starts a diagnosis if none has been made, if the last verdict no longer explains the
    experiment, or if the last diagnosis is `diagnosis_every` experiments ago. Its verdict takes
    part `after` experiments later, whenever it is ready: that number decides, not the computer's
    speed. Until then no other is asked for. With an `executor` it is made beside the loop
    meanwhile, otherwise at once when its time has come. Both give the same numbers, if all linear
    algebra of the process is on one thread.

    The experiment in which the machine changed is left out, and asks for nothing: its first half
    is as before, its second is not. If the last verdict explains the present experiment, the
    machine has not changed since: all of the last `diagnosis_experiments` that it explains are
    diagnosed together. Otherwise the present one is diagnosed alone. Together with those of a
    machine that changes it would tell nothing, after a long search.

    - Where it tells the causes apart, that counts. All recent experiments that the verdict explains
      as well, within `VALID_ERROR_RATIO`, are of the present machine. They are diagnosed together,
      and the answer counts unless it does worse on the present experiment.
    - Where it does not, all those after the last one that was negative, or that the last verdict
      explains, are diagnosed together. If their cause is unknown, the first answer stays.

    Args:
        settings: parameters of the group diagnosis; those that are missing have their defaults.
        make: what makes a diagnosis; the arguments are those of `diagnosis.diagnose.diagnose`.
        after: experiments from the one that asks to the one at which the verdict takes part.

    Attributes:
        executor: where it is made beside the loop; None makes it in `step`.
        asked: the diagnosis that has not taken part yet, if any.
        trouble: why the last diagnosis came to nothing; empty when it came to something.

    Raises:
        OptionError: a parameter outside its range.
    """

    def __init__(
        self,
        machine: Machine,
        settings: Mapping[str, Any],
        make: Make = diagnose,
        after: int = 0,
    ) -> None:
        own = {n: v for n, v in settings.items() if n in resolve({}, "diagnosis")}
        given = resolve(own, "diagnosis")
        self.machine = machine
        self.every: int = given["diagnosis_every"]
        self.trouble = ""
        self.make, self.after = make, after
        self.executor: Executor | None = None
        self.asked: Asked | None = None
        self._recent: deque[tuple[Experiment, Level]] = deque(maxlen=given["diagnosis_experiments"])
        self._last: Known | None = None
        self._last_at = 0  # number of the experiment at which that was found
        self._since = 0
        #: Whether it was told to stop.
        self.cancelled = False

    def cancel(self) -> None:
        """Break off the diagnosis under way, from another thread, and begin no more."""
        self.cancelled = True

    @undivided()
    def step(self, experiment: Experiment, signal: Signal) -> DiagnosisRecord | None:
        """Take in one experiment; the verdict that takes part from it on, if there is one."""
        verdict = self._answer(signal) if self._due(experiment) else None
        if self._take(experiment, signal) and self._due(experiment):
            return self._answer(signal)
        if self.executor is not None and self.asked is not None and self.asked.answer is None:
            self.asked.answer = self.executor.submit(self._made, self.asked)
        return verdict

    def _due(self, experiment: Experiment) -> bool:
        """Whether the verdict that was asked for takes part from this experiment on."""
        asked = self.asked
        if asked is None:
            return False
        first = asked.experiment.number
        return experiment.number >= first + self.after or experiment.number < first  # begun anew

    def _answer(self, signal: Signal) -> DiagnosisRecord | None:
        """What was asked for; waits for it where it is made beside the loop."""
        asked, self.asked = self.asked, None
        assert asked is not None
        self.trouble = ""
        try:
            found = asked.answer.result() if asked.answer else self._made(asked)
        except Exception as error:
            self._last, self.trouble = None, reason_of(error)
            return None
        self._last, self._last_at = found.known, signal.experiment
        return _record(found, signal)

    def _made(self, asked: Asked) -> Found:
        """The diagnosis, from nothing but what was asked: the loop may go on meanwhile."""
        with one_thread():
            return self._checked(self._first(asked), asked)

    def recall(self, step: RecordedStep) -> None:
        """Take over what a recorded step says, without diagnosing anew."""
        if self._due(step.experiment):
            self._recall_answer(step)
        if self._take(step.experiment, step.signal) and self._due(step.experiment):
            self._recall_answer(step)

    def _recall_answer(self, step: RecordedStep) -> None:
        asked, self.asked = self.asked, None
        assert asked is not None
        found, self._last = step.diagnosis, None
        known = _known(self.machine, found, math.nan) if found is not None else None
        if known is not None:
            error = self._error(asked.experiment, known.use)
            self._last, self._last_at = replace(known, error=error), step.experiment.number

    def state(self) -> dict[str, Any]:
        """Its state by the numbers of what is recorded; `return_to` takes it back."""
        last = self._last
        error = last.error if last is not None and math.isfinite(last.error) else None
        return {
            "recent": _numbers(self._recent),
            "asked": None if self.asked is None else _numbers(self.asked.recent),
            "since": self._since,
            "last": None if last is None else {"experiment": self._last_at, "error": error},
        }

    def return_to(self, state: Mapping[str, Any], archive: Archive) -> None:
        """Take back a state, before any step here."""
        since, last = state["since"], state["last"]
        if type(since) is not int or since < 0 or len(state["recent"]) > (self._recent.maxlen or 0):
            raise ValueError("since is no count, or there are more experiments than are kept")
        recent, asked = (
            [(archive.experiment(n, start), Level(level)) for n, start, level in told]
            for told in (state["recent"], state["asked"] or [])
        )
        known = None
        if last is not None:
            error = math.nan if last["error"] is None else float(last["error"])
            known = _known(self.machine, archive.diagnosis(last["experiment"]), error)
            self._last_at = last["experiment"]
        self._recent.clear()
        self._recent.extend(recent)
        self._since, self._last = since, known
        self.asked = Asked(asked, known) if asked else None

    def _take(self, experiment: Experiment, signal: Signal) -> bool:
        """Take in one experiment; whether it is the occasion for a diagnosis.

        Of one that is too long for it nothing is learned, and nobody knows what happened in it.
        """
        if words := too_long_to_learn(self.machine, experiment):
            self._recent.clear()
            self.trouble = words
            return False
        if self._recent and not self._recent[-1][0].same_period(experiment):
            self._recent.clear()
        mixed = signal.level is Level.POSITIVE and self._changed_within(experiment)
        # As a negative it ends the experiments of the machine as it is now.
        self._recent.append((experiment, Level.NEGATIVE if mixed else signal.level))
        self._since += 1
        if signal.level is not Level.POSITIVE or mixed or self.asked is not None:
            return False
        if self._explained(experiment) and self._since < self.every:
            return False
        self._since = 0
        self.asked = Asked(list(self._recent), self._last)
        return True

    def _changed_within(self, experiment: Experiment) -> bool:
        """Whether the machine was as before in the first half, and not in the second.

        As before is what the last verdict says, or the machine file without any. It explains a half
        if it leaves the noise alone.
        """
        if self._last is not None and self._last.unknown:
            return False
        use = self._last.use if self._last else []
        left = experiment.speed - free_run(self.machine, experiment, use)
        first, second = np.array_split(left, 2)
        limit = VALID_ERROR_RATIO * median_step(experiment) / NORMAL_STEP
        return bool(rms(first) <= limit < rms(second))

    def _explained(self, experiment: Experiment) -> bool:
        return self._last is not None and self._valid(experiment, self._last)

    def _valid(self, experiment: Experiment, found: Known) -> bool:
        return self._error(experiment, found.use) <= VALID_ERROR_RATIO * found.error

    def _error(self, experiment: Experiment, use: Sequence[Any]) -> float:
        """Of a free run [rad/s]; nan, which compares as false, where it diverges."""
        return rms(experiment.speed - free_run(self.machine, experiment, use))

    def _unexplained(self, asked: Asked) -> list[Experiment]:
        """What the signals and the last verdict let pass for the machine as it is now."""
        pool = [asked.experiment]
        for e, level in reversed(asked.recent[:-1]):
            if level is Level.NEGATIVE or (asked.holds and self._valid(e, asked.holds)):
                break
            pool.insert(0, e)
        return pool

    def _diagnosed(self, pool: Sequence[Experiment]) -> Found:
        diagnosis = self.make(self.machine, pool, workers=1, tick=self._tick)
        use = [(self.machine.law(e["effect"]), e["parameters"]) for e in diagnosis.effects]
        unknown = diagnosis.verdict.kind == "unknown"
        return Found(diagnosis, Known(use, self._error(pool[-1], use), unknown), pool)

    def _first(self, asked: Asked) -> Found:
        present, last = asked.experiment, asked.holds
        if last and self._valid(present, last):
            return self._diagnosed([e for e, _ in asked.recent if self._valid(e, last)])
        alone, pool = self._diagnosed([present]), self._unexplained(asked)
        if alone.diagnosis.verdict.kind == "effect" or len(pool) == 1:
            return alone
        found = self._diagnosed(pool)
        named = alone.diagnosis.verdict.kind in NAMED
        if named and not found.known.error <= JOINT_ERROR_RATIO * alone.known.error:
            return alone
        return alone if found.known.unknown else found

    def _checked(self, found: Found, asked: Asked) -> Found:
        """The diagnosis, or a better one of the experiments that it says are valid."""
        present = found.pool[-1]
        valid = [e for e, _ in asked.recent if e is present or self._valid(e, found.known)]
        if found.known.unknown or [id(e) for e in valid] == [id(e) for e in found.pool]:
            return found
        again = self._diagnosed(valid)
        return again if again.known.error <= JOINT_ERROR_RATIO * found.known.error else found

    def _tick(self, doing: str) -> None:
        if self.cancelled:
            raise LdtError(f"broken off while {doing}")


def _numbers(recent: Iterable[tuple[Experiment, Level]]) -> list[list[float]]:
    """By which experiments and their signals are found again."""
    return [[e.number, e.start, int(level)] for e, level in recent]


def _known(machine: Machine, found: DiagnosisRecord, error: float) -> Known | None:
    """What a recorded diagnosis says; None where it names effects that the machine file does not.

    What was recorded names no file to run.
    """
    if not found.amounts.keys() <= set(machine.effect_names):
        return None
    use = [(machine.law(name), given) for name, given in found.amounts.items()]
    return Known(use, error, found.kind == "unknown")


def _record(found: Found, signal: Signal) -> DiagnosisRecord:
    verdict = found.diagnosis.verdict
    values = scalars(found.diagnosis.as_dict())
    values.pop("machine_file")  # a node reads a copy of its own, gone with the graph
    values["since"] = found.pool[0].number
    values["asked_at"] = found.pool[-1].number
    if cause := _cause(found.diagnosis):
        values["cause"] = cause
    for effect, given in found.known.use:
        values |= {f"{AMOUNT_PREFIX}{effect.name}.{name}": float(v) for name, v in given.items()}
    sure = "" if unsought(verdict) else confident(verdict.confidence)
    said = f"{verdict.sentence} {sure}".rstrip()
    return DiagnosisRecord(
        signal.experiment, signal.model_version, said, tuple(verdict.effects), values
    )


def _cause(diagnosis: Diagnosis) -> str | None:
    """The named effect with the largest share of what is explained."""
    verdict = diagnosis.verdict
    if verdict.kind not in NAMED:
        return None
    shares = {c.effect: c.shapley_share or 0.0 for c in diagnosis.candidates}
    leading = [group[0] for group in verdict.acting]
    return max(leading, key=lambda name: shares.get(name, 0.0))


def scalars(data: Mapping[str, Any], under: str = "") -> dict[str, Scalar]:
    """What is neither list nor object in `diagnosis.json`, by dotted name."""
    flat: dict[str, Scalar] = {}
    for key, value in data.items():
        if isinstance(value, Mapping):
            flat |= scalars(value, f"{under}{key}.")
        elif not isinstance(value, list) and under + key not in COMPOUND:
            flat[f"{under}{key}"] = value
    return flat
