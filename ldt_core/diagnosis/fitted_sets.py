"""What a search for the cause has found so far: every set of effects that it has fitted."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ldt_core.diagnosis.effect_fit import EffectFit
from ldt_core.diagnosis.error_band import ErrorBand
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.responses import Responses
from ldt_core.diagnosis.thresholds import THRESHOLDS

Array = NDArray[np.float64]
Names = frozenset[str]


@dataclass(eq=False)
class FittedSets:
    """What the search has found.

    Attributes:
        residuals: all experiments.
        band: its low frequencies.
        base: (size,) residuals without any effect.
        responses: of all candidates, on a few experiments.
        fits: every set that was fitted on all experiments.
        scouted: every set that the scout has fitted.
    """

    residuals: FreeRunResiduals
    band: ErrorBand
    base: Array
    responses: Responses
    fits: dict[Names, EffectFit] = field(default_factory=dict)
    scouted: dict[Names, EffectFit] = field(default_factory=dict)
    _cancelling: dict[Names, bool] = field(default_factory=dict)

    @property
    def excess(self) -> float:
        """Of the residuals without any effect."""
        return self.band.excess(self.base)

    def of_size(self, count: int) -> list[EffectFit]:
        """Sets of so many effects, fitted on all experiments, best first.

        Without those in which two effects all but cancel each other: a drag beside a friction that
        is negative can imitate nearly anything, and is nothing that a machine has.
        """
        found = [f for names, f in self.fits.items() if len(names) == count]
        return sorted((f for f in found if not self.cancels(f)), key=lambda f: f.loss)

    def cancels(self, fitted: EffectFit) -> bool:
        """Whether two members of a set move the experiments in nearly opposite directions."""
        names = frozenset(fitted.names)
        if len(names) < 2:
            return False
        if names not in self._cancelling:
            # The machine's own parameters are the set's: without any effect they make up for it.
            own = fitted.use[len(names) :]
            base = self.responses.residuals.of(own)
            moved = []
            for c, z in zip(fitted.effects, fitted.z, strict=False):
                with_it = self.responses.residuals.of([(c.effect, c.given(z)), *own])
                change = base - with_it
                moved.append(change / max(float(np.linalg.norm(change)), 1e-12))
            pairs = itertools.combinations(moved, 2)
            self._cancelling[names] = any(
                float(a @ b) < THRESHOLDS.opposed_responses for a, b in pairs
            )
        return self._cancelling[names]
