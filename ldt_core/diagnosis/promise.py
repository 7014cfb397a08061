"""What a diagnosis promises of further experiments: how far its effects close the gap there.

What held-out experiments show holds for more of their kind, as far as it is alike in all of them.
Another voltage is another matter. Sets of effects that this recording cannot tell apart may differ
there, and beyond the speeds that it has seen no law was put to the test. So a promise is made for
stated voltages, from simulations by every set that is as good as the best, before anything is
measured there.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.experiment import Experiment
from ldt_core.base.sentences import spoken
from ldt_core.diagnosis.diagnosis import acting_entries, used_effects
from ldt_core.diagnosis.holdout import closed, free_run
from ldt_core.machine.machine_file import Machine
from ldt_core.physics.effect import Effect

#: Of a closed fraction [1]: what differs by more is not the number that was said. Chosen as that by
#: which `ldt challenge` counts a promise as kept.
WITHIN = 0.05
#: Of the fastest speed seen in a direction [1]: beyond, nothing was seen of the laws. Chosen. On 73
#: sealed cases 1.5 refuses six promises more, 3 none less: most turn back for the first time.
FAR = 2.0
SEEN_DEVIATIONS = 5.0  # of the noise [1]: a speed below shows no direction; as `visible_change`


def further_interval(
    part: float | None,
    experiments: Sequence[Experiment],
    before: Sequence[Array],
    after: Sequence[Array],
    noise: float,
    count: int,
    seed: int,
) -> tuple[float, float] | None:
    """Between what lies the closed fraction of further experiments of the same kind, in 95 %.

    Few are held out. So those that were fitted are drawn from too: what laws leave of a free run
    differs more from run to run than a fit takes of it.

    Args:
        part: closed fraction of those held out; None without a gap.
        experiments: all of them; before, after: (L,) their free runs [rad/s].
        noise: deviation of the measured speed [rad/s].
        count: how many further ones.
    """
    _, drawn = closed(experiments, before, after, noise, seed, count)
    if part is None or drawn is None:
        return None
    return min(part, drawn[0]), max(part, drawn[1])


def determined(part: float | None, interval: tuple[float, float] | None) -> float | None:
    """The closed fraction where further experiments show the same, else None."""
    if part is None or interval is None:
        return part
    return part if max(part - interval[0], interval[1] - part) <= WITHIN else None


@dataclass(frozen=True)
class Promise:
    """How far a diagnosis closes the gap of experiments that it has not seen.

    Attributes:
        closed_fraction: what it promises; None where it promises nothing.
        interval: within which it lies if the machine is one of those that the recording could not
            tell apart; None where nothing can be said.
        refused: why nothing is promised, as a sentence; "" where something is.
    """

    closed_fraction: float | None
    interval: tuple[float, float] | None
    refused: str = ""

    @property
    def sentence(self) -> str:
        """For a person."""
        if self.closed_fraction is None or self.interval is None:
            return self.refused
        low, high = self.interval
        return (
            f"By the diagnosis, {self.closed_fraction:.0%} of the gap closes here "
            f"({low:.0%} to {high:.0%})."
        )

    def as_dict(self) -> dict[str, Any]:
        """In JSON types."""
        ends = None if self.interval is None else list(self.interval)
        return {"closed_fraction": self.closed_fraction, "ci95": ends, "refused": self.refused}


@dataclass(eq=False)
class Promising:
    """Gathers the experiments of which something is to be promised: their voltages and starts.

    Args:
        machine: by its file.
        found: the keys of `diagnosis.json`.
        own: effects of the user's that it names.
        file: where the keys are from.

    Raises:
        BadInput, OptionError: an effect that is not known, or with parameters it cannot have.
    """

    machine: Machine
    found: Mapping[str, Any]
    own: Sequence[Effect] = ()
    file: str = "the diagnosis"
    _runs: list[Array] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        more = self.found.get("alternatives")
        own = [*self.own, *self.machine.own_laws]
        self.best = used_effects(self.file, acting_entries(self.file, self.found), own)
        self.others = [
            used_effects(f"{self.file}, alternatives", listed, own)
            for listed in (more if isinstance(more, list) else ())
        ]
        gap = self.found.get("gap")
        gap = gap if isinstance(gap, Mapping) else {}
        seen = self.found.get("seen")
        speed = seen.get("speed") if isinstance(seen, Mapping) else None
        self._part = _number(gap.get("closed_fraction"))
        self._ends = _numbers(gap.get("closed_fraction_ci95"))
        self._noise = _number(gap.get("noise_std")) or 0.0
        self._seen = _numbers(speed)
        verdict = self.found.get("verdict")
        told = verdict.get("effects") if isinstance(verdict, Mapping) else None
        self._named = told if isinstance(told, list) else []
        self._gaps, self._apart = np.zeros(len(self.others)), np.zeros(len(self.others))

    def add(self, experiment: Experiment, run: Array, alone: Array) -> None:
        """One more; of what was measured in it only the start is used.

        Args:
            experiment: of which something is to be promised.
            run: (L,) its free run with the effects found [rad/s].
            alone: (L,) the same by the machine file alone [rad/s].
        """
        self._runs.append(run)
        for k, use in enumerate(self.others):
            other = free_run(self.machine, experiment, use)
            self._gaps[k] += float(np.sum((other - alone) ** 2))
            self._apart[k] += float(np.sum((other - run) ** 2))

    def promise(self) -> Promise:
        """Of all that were added."""
        part = self._part
        if not self.best:
            return Promise(None, None, "Nothing is promised: no effect was named.")
        if part is None:
            told = "how much of the gap closes differs from experiment to experiment"
            return Promise(None, None, f"Nothing is promised: {told}.")
        low, high = self._ends or (part, part)
        for use, whole, apart in zip(self.others, self._gaps, self._apart, strict=True):
            closes = 1 - apart / whole if whole > 0 else 0.0
            closes = closes if math.isfinite(closes) else 0.0
            if closes < part - WITHIN:
                names = " and ".join(spoken(e.name) for e, _ in use if e.name in self._named)
                told = (
                    f"if the cause is {names}, which the recording could not tell from it, "
                    f"{max(closes, 0.0):.0%} of the gap closes here"
                )
                return Promise(None, (max(closes, 0.0), high), f"Nothing is promised: {told}.")
            low = min(low, closes)
        beyond = self._beyond()
        if beyond:
            return Promise(None, None, f"Nothing is promised: {beyond}.")
        return Promise(part, (low, high))

    def _beyond(self) -> str:
        """Where the speed goes that the recording has not seen; "" where it does not."""
        if self._seen is None or not self._runs:
            return ""
        speed = np.concatenate(self._runs)
        if not np.isfinite(speed).all():
            return "the machine with these effects cannot be simulated here"
        least, (low, high) = SEEN_DEVIATIONS * self._noise, self._seen
        for way, turned, known in (("forward", speed, high), ("backward", -speed, -low)):
            if float(np.mean(turned > FAR * max(known, least))) > WITHIN:
                shown = f"at most {known:.3g} rad/s" if known > least else "no motion"
                return (
                    f"the shaft turns {way} at up to {float(turned.max()):.3g} rad/s, and {shown} "
                    "was recorded"
                )
        return ""


def promised(
    machine: Machine, found: Mapping[str, Any], experiments: Sequence[Experiment]
) -> Promise:
    """What a diagnosis promises of experiments; arguments and errors as of `Promising`."""
    of = Promising(machine, found)
    for experiment in experiments:
        of.add(experiment, *(free_run(machine, experiment, use) for use in (of.best, ())))
    return of.promise()


def _number(value: Any) -> float | None:
    """A number of a file; None where there is something else, or none that floats hold."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    return float(value) if abs(value) <= sys.float_info.max else None


def _numbers(value: Any) -> tuple[float, float] | None:
    """A range of a file; None where there is something else."""
    if not isinstance(value, (list, tuple)) or len(value) != 2:
        return None
    low, high = map(_number, value)
    return None if low is None or high is None else (low, high)
