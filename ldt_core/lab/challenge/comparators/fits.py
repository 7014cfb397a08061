"""Effects fitted in free run, alone and in sets, by the diagnosis' own bench and least squares.

Every set is fitted to a few experiments first; those that do best there are fitted to all.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.experiment import Experiment
from ldt_core.diagnosis.candidate import Candidate
from ldt_core.diagnosis.effect_fit import EffectFit, fit
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.responses import SHRINK, STRETCH, best_alone, rank_pairs, simulate_all
from ldt_core.machine.machine_file import Machine
from ldt_core.physics.effect import Effect

Array = NDArray[np.float64]

FEW = 4  # experiments to which every set is fitted, evenly spread
ROUGH = 1e-4  # of the sum of squares: fits to the few end there
BEST = 6  # sets of a kind that are fitted to all experiments


class Fits:
    """Fits of sets of effects to the same experiments.

    At first of every effect alone, from the two starts that promise most.

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
        self.bench = FreeRunResiduals(machine, fitted)
        self.base = self.bench.of()
        places = {round(i) for i in np.linspace(0, len(fitted) - 1, min(FEW, len(fitted)))}
        self._few = self.bench.part(sorted(places))
        self.responses = simulate_all(self._few, self.candidates)
        self._known: dict[frozenset[str], EffectFit] = {}
        found = []
        for i, candidate in enumerate(self.candidates):
            starts = best_alone(self.responses, i)
            tried = [self._fit([candidate], [z]) for z in starts]
            found += sorted(tried, key=_loss)[:1]
        #: The best effects alone, fitted to all experiments, best first.
        self.alone = self.finished(found)

    def finished(self, rough: Sequence[EffectFit], count: int = BEST) -> list[EffectFit]:
        """The best of some fits to a few experiments, fitted to all; best first."""
        for f in sorted(rough, key=_loss)[:count]:
            names = frozenset(f.names)
            if names not in self._known:
                self._known[names] = fit(self.bench, f.members, f.z)
        chosen = {frozenset(f.names) for f in sorted(rough, key=_loss)[:count]}
        return sorted((self._known[names] for names in chosen), key=_loss)

    def grown(self, base: EffectFit, count: int) -> list[EffectFit]:
        """The set with one effect more, for the effects that promise most beside it.

        Fitted to a few experiments.
        """
        d, left = self.responses, self._few.of(base.use)
        size, target = np.diag(d.gram), d.responses @ left
        scale = np.clip(target / np.maximum(size, 1e-9), SHRINK, STRETCH)
        best: dict[int, int] = {}
        for k in np.argsort(-(2 * scale * target - scale**2 * size)):
            owner = int(d.owner[k])
            if self.candidates[owner].name not in base.names:
                best.setdefault(owner, int(k))
        return [
            self._fit([*base.members, self.candidates[i]], [*base.z, d.z[k]])
            for i, k in list(best.items())[:count]
        ]

    def pairs(self, count: int) -> list[EffectFit]:
        """The pairs whose responses together promise most, fitted to a few experiments."""
        ranked = sorted(rank_pairs(self.responses).items(), key=lambda q: -q[1][0])[:count]
        c, z = self.candidates, self.responses.z
        return [self._fit([c[i], c[j]], [z[k], z[m]]) for (i, j), (_, k, m) in ranked]

    def _fit(self, members: Sequence[Candidate], start: Sequence[Array]) -> EffectFit:
        return fit(self._few, members, start, precision=ROUGH)


def _loss(f: EffectFit) -> float:
    return f.loss
