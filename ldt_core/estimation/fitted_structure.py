"""A machine with effects that act, fitted to experiments, and how sure each of them is."""

from __future__ import annotations

import functools
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.estimation.grey_box import GreyBox, Prior
from ldt_core.estimation.grey_box_fit import GreyBoxFit, of_first
from ldt_core.estimation.structure_screening import Present
from ldt_core.physics.effect import Effect

#: Standard deviations of the cost of a fit to white noise, beyond which a prior is doubted: one fit
#: in 700 for nothing, which costs the time of another fit and no more.
SURPRISING = 3.0


@dataclass(frozen=True, eq=False)
class FittedStructure:
    """A machine with effects, fitted.

    Attributes:
        box: machine and effects.
        fit: where the fit ended.
        prior: of the machine's coordinates, with which it began.
        score: squared residuals in noise deviations plus the price of the parameters; the least is
            the best. Structures that differ by less than `2 log(odds)` are not told apart.
    """

    box: GreyBox
    fit: GreyBoxFit
    prior: Prior
    score: float

    @property
    def names(self) -> tuple[str, ...]:
        """Of its effects."""
        return tuple(e.name for e in self.box.effects)

    @property
    def explains(self) -> bool:
        """Whether the residuals of all experiments are noise."""
        return self.fit.explained

    @property
    def present(self) -> Present:
        """Its effects with their values, and the prior that it began with."""
        given = {e.name: values for e, values in self.box.values(self.fit.q)[1]}
        return Present(self.box.effects, given, self.prior)

    def needs(self, effect: Effect, most: float) -> bool:
        """Whether, to first order, every parameter of an effect raises the squared residuals by
        more than this where it is left at neutral.
        """
        at = self._places([effect.name])
        variance = np.diag(self._covariance)
        return bool(np.all(self.fit.q[at] ** 2 > most * variance[at]))

    def rise(self, given: Mapping[str, Mapping[str, float]]) -> float:
        """What the squared residuals rise by where these effects have these values, to first order;
        all else follows.
        """
        at, own = self._places(given), self.fit.q[: len(self.box.uncertain)]
        values = {n: {**fitted, **given.get(n, {})} for n, fitted in self.present.given.items()}
        there = self.box.coordinates(values, own)
        far = (self.fit.q - there)[at]
        return float(far @ np.linalg.pinv(self._covariance[np.ix_(at, at)], hermitian=True) @ far)

    def keeps(self, effect: Effect, before: Mapping[str, Mapping[str, float]]) -> bool:
        """Whether an effect is likelier to act as before than not at all, the others as before."""
        gone = {**before, effect.name: effect.neutral}
        return self.rise(before) < self.rise(gone)

    def score_beside(self, before: Mapping[str, Mapping[str, float]], price: float) -> float:
        """Its score where an effect has no price that acts as before: it is known already.

        Args:
            before: effects that acted, with their values.
            price: of a parameter.
        """
        known = {n: v for n, v in before.items() if n in self.names}
        if not known:
            return self.score
        anew = price * len(self._places(known))
        return self.score - anew + min(anew, self.rise(known))

    @functools.cached_property
    def _covariance(self) -> Array:
        return np.asarray(np.linalg.pinv(self.fit.information, hermitian=True))

    def _places(self, names: Collection[str]) -> list[int]:
        """Of these effects' coordinates."""
        begin = len(self.box.uncertain)
        of_effects = [e.name for e in self.box.effects for _ in e.parameters]
        return [begin + i for i, name in enumerate(of_effects) if name in names]

    @property
    def surprises(self) -> bool:
        """Whether white noise, and a prior that is right, would cost less than this fit."""
        count = sum(r.size for r in self.fit.residuals) + len(self.box.uncertain)
        return self.fit.cost > count + SURPRISING * math.sqrt(2 * count)

    @property
    def surprise(self) -> float:
        """-2 log of what the prior gives the data, but for what all priors have in common.

        Laplace's approximation (MacKay, "Bayesian interpolation", Neural Computation 4, 1992): a
        narrow prior is rewarded where it is right.
        """
        machine = of_first(self.fit.information, len(self.box.uncertain))
        told, before = (np.linalg.slogdet(m)[1] for m in (machine, self.prior.precision))
        return self.fit.cost + float(told - before)
