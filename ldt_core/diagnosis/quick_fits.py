"""Fits of a few experiments, by which a search over sets of effects finds its way."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.threads import spread
from ldt_core.diagnosis.candidate import Candidate
from ldt_core.diagnosis.effect_fit import EffectFit, fit, law_variance
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.model_selection import Names
from ldt_core.diagnosis.start_states import StartStates

STEPS = 8  # least-squares steps: a ranking needs no more
PRECISION = 1e-4  # of the loss, where a fit ends
RACE_STEPS = 3  # the same of a race: with two, the best effect was often not among the first five
RACED = 5  # sets that a race leaves


class TriedSet(NamedTuple):
    """A set of effects, where its fit is to begin, and the start states that are nearly its own.

    `own` is where the machine's own parameters are in a race, () for the file's values.
    """

    members: Sequence[Candidate]
    start: Sequence[Array]
    known: StartStates | None = None
    own: Sequence[Array] = ()

    @property
    def names(self) -> Names:
        """Of its members."""
        return frozenset(c.name for c in self.members)


def prior_weight(excess: float) -> float:
    """Of a deviation of the machine file's numbers beside one of the noise: the laws are off.

    Args:
        excess: power of the gap that the numbers alone leave.
    """
    return math.sqrt(law_variance(0.0, excess))


@dataclass(eq=False)
class QuickFits:
    """Fits of sets to a few experiments, side by side.

    Attributes:
        own: the machine's own parameters, fitted with every set; none or one candidate.
        first: where they begin: alone, well known numbers went as far as they may; beside a cause
            they need not.
        excess: power of the gap that they alone leave.
    """

    residuals: FreeRunResiduals
    own: Sequence[Candidate]
    first: Sequence[Array]
    excess: float
    workers: int
    tick: Callable[[str], None]

    def __post_init__(self) -> None:
        self._middle = len(self.residuals.pieces) // 2
        self._one = self.residuals.part([self._middle])

    def fitted(self, tries: Sequence[TriedSet]) -> list[EffectFit]:
        """All of them, each with the machine's own parameters."""
        weight, found = prior_weight(self.excess), []

        def work(k: int) -> EffectFit:
            tried = _sorted(tries[k])
            return fit(
                self.residuals,
                [*tried.members, *self.own],
                [*tried.start, *self.first],
                steps=STEPS,
                precision=PRECISION,
                own=len(self.own),
                known=tried.known,
                weight=weight,
            )

        for one in spread(work, len(tries), self.workers):
            self.tick("fitting sets of effects")
            found.append(one)
        return found

    def race(self, tries: Sequence[TriedSet], kept: int = RACED) -> list[TriedSet]:
        """The sets that a few steps of a fit of one experiment follow best, begun where they ended.

        Where effects distort each other, responses promise too little of what a fit then finds. The
        machine's own parameters stay where they are: laws are off by more than they would move.
        """
        if len(tries) <= kept:
            return list(tries)

        def work(k: int) -> EffectFit:
            tried = _sorted(tries[k])
            own = [_held(c, z) for c, z in zip(self.own, tried.own or self.first, strict=True)]
            return fit(
                self._one,
                [*tried.members, *own],
                [*tried.start, *(np.zeros(0) for _ in own)],
                steps=RACE_STEPS,
                precision=PRECISION,
                known=self._of_one(tried.known),
            )

        best: dict[Names, tuple[float, TriedSet]] = {}
        for tried, ran in zip(tries, spread(work, len(tries), self.workers), strict=True):
            self.tick("trying effects beside others")
            if ran.loss < best.get(tried.names, (math.inf,))[0]:
                count = len(tried.members)
                began = TriedSet(ran.members[:count], ran.z[:count], tried.known)
                best[tried.names] = ran.loss, began
        return [tried for _, tried in sorted(best.values(), key=lambda f: f[0])[:kept]]

    def _of_one(self, known: StartStates | None) -> StartStates | None:
        """Start states of the one experiment."""
        if known is None:
            return None
        i = self._middle
        return StartStates(
            known.angles[i : i + 1], known.bases[i : i + 1], known.offsets[i : i + 1]
        )


def _sorted(tried: TriedSet) -> TriedSet:
    """The same set with its members in the order of their names."""
    order = sorted(range(len(tried.members)), key=lambda i: tried.members[i].name)
    members = [tried.members[i] for i in order]
    return tried._replace(members=members, start=[tried.start[i] for i in order])


def _held(candidate: Candidate, z: Array) -> Candidate:
    """A candidate that stays at these coordinates."""
    effect, given = candidate.effect, candidate.given(z)

    def changed(values: Mapping[str, float]) -> Mapping[str, float]:
        return effect.on_parameters(values, **given) if effect.on_parameters else values

    still = replace(effect, parameters=(), typical={}, on_parameters=changed)
    return Candidate(still, candidate.most_voltage)
