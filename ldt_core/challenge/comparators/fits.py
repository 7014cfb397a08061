"""Effects fitted in free run, alone and in sets, by the diagnosis' own bench and least squares."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ldt_core.diagnosis.bench import Bench
from ldt_core.diagnosis.candidate import Candidate
from ldt_core.diagnosis.explain import scouted
from ldt_core.diagnosis.search import (
    SHRINK,
    STRETCH,
    Fit,
    best_alone,
    fit,
    rank_pairs,
    simulate_all,
)
from ldt_core.effects.base import Effect
from ldt_core.experiment import Experiment
from ldt_core.machine import Machine

Array = NDArray[np.float64]


class Fits:
    """Fits of sets of effects to the same experiments.

    At first every effect alone, from the two starts that promise most.

    Args:
        machine: as its file knows it.
        fitted: experiments.
        effects: the library.
    """

    def __init__(
        self, machine: Machine, fitted: Sequence[Experiment], effects: Sequence[Effect]
    ) -> None:
        most = max(float(np.abs(e.voltage).max()) for e in fitted) or 1.0
        self.candidates = [Candidate(e, most) for e in effects]
        self.bench = Bench(machine, fitted)
        self.base = self.bench.rest()
        self._few = self.bench.part(scouted(self.bench))
        self.responses = simulate_all(self._few, self.candidates)
        self._known: dict[frozenset[str], Fit] = {}
        for i, candidate in enumerate(self.candidates):
            for start in best_alone(self.responses, i):
                self.fit([candidate], [start])

    @property
    def alone(self) -> list[Fit]:
        """Effects fitted alone, best first."""
        return sorted((f for f in self._known.values() if len(f.members) == 1), key=_loss)

    def fit(self, members: Sequence[Candidate], start: Sequence[Array]) -> Fit:
        """The best fit so far of a set, from this start if that is better."""
        names = frozenset(c.name for c in members)
        tried = fit(self.bench, members, start)
        if names not in self._known or tried.loss < self._known[names].loss:
            self._known[names] = tried
        return self._known[names]

    def grown(self, base: Fit, count: int) -> list[Fit]:
        """The set with one effect more, for the effects that promise most beside it."""
        d, left = self.responses, self._few.rest(base.use)  # type: ignore[arg-type]
        size, target = np.diag(d.gram), d.responses @ left
        scale = np.clip(target / np.maximum(size, 1e-9), SHRINK, STRETCH)
        best: dict[int, int] = {}
        for k in np.argsort(-(2 * scale * target - scale**2 * size)):
            owner = int(d.owner[k])
            if self.candidates[owner].name not in base.names:
                best.setdefault(owner, int(k))
        return [
            self.fit([*base.members, self.candidates[i]], [*base.z, d.z[k]])
            for i, k in list(best.items())[:count]
        ]

    def pairs(self, count: int) -> list[Fit]:
        """The pairs whose responses together promise most."""
        ranked = sorted(rank_pairs(self.responses).items(), key=lambda q: -q[1][0])[:count]
        c, z = self.candidates, self.responses.z
        return [self.fit([c[i], c[j]], [z[k], z[m]]) for (i, j), (_, k, m) in ranked]


def _loss(f: Fit) -> float:
    return f.loss
