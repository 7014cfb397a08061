"""What positive numbers are usual, learned from one after the other: level, spread and shape."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import ndtr, ndtri, stdtr, stdtrit

#: Powers λ of the Box-Cox transform that are weighed against each other, and how much each is
#: believed beforehand: the logarithm (0) most. -0.25 has a longer upper tail than the lognormal
#: law, 1/3 to 1/2 fits gamma and chi-square laws, 1 is the normal law itself.
POWERS = np.linspace(-0.25, 1.0, 6)
LOGARITHM = POWERS == 0
DIVISORS = np.where(LOGARITHM, 1.0, POWERS)
BELIEF = -0.5 * (POWERS / 0.5) ** 2
#: The upper tail is the law's this share, and has a weight of its own, as if so many values of a
#: normal tail had been seen.
TAIL, TAIL_SEEN = 0.1, 10.0
#: Furthest ratio of two numbers that is told from a further one, as a logarithm.
FURTHEST = 40.0
#: Least probability, so that its normal quantile is finite.
LEAST_CHANCE = 1e-300
#: Values before anything can be said of the next: level and spread take two.
LEAST_KNOWN = 3


class Reference:
    """Law of a row of positive numbers, for saying how unusual the next one is.

    Each is transformed to (x^λ - 1) / λ, for several λ side by side. If the transformed ones are
    normal with unknown mean and variance, the next one minus their mean, over their standard
    deviation times sqrt(1 + 1/n), has Student's law with n - 1 degrees of freedom: exactly, from
    the third number on, and independently of how unusual the earlier ones were (Hawkins 1987;
    Quesenberry 1991). The λ are weighed by how well each foretold the numbers so far.

    What no λ can fit is a tail too long on both sides. Of a number among the upper tenth, with
    chance p, log(0.1 / p) is exponential with mean 1 if the law is right. The mean that it has had
    so far, with the doubt about it, corrects p: a generalised Pareto law over a threshold, as in
    SPOT, which begins as the fitted law's tail instead of with nothing.

    Numbers are given and taken as logarithms.

    References:
        Hawkins: Self-starting CUSUM charts for location and scale, The Statistician 36 (1987).
        Quesenberry: SPC Q charts for start-up processes, J. Quality Technology 23 (1991).
        Box, Cox: An analysis of transformations, J. R. Statist. Soc. B 26 (1964).
        Siffer et al.: Anomaly detection in streams with extreme value theory, KDD 2017.
    """

    def __init__(self) -> None:
        self.origin = 0.0
        #: Numbers that the level is known from, and degrees of freedom of the spread.
        self.count = 0.0
        self.freedom = -1.0
        self.mean = np.zeros(POWERS.size)
        self.squares = np.zeros(POWERS.size)
        self.evidence = BELIEF.copy()
        self.tail = [TAIL_SEEN, TAIL_SEEN]

    @property
    def known(self) -> bool:
        """Whether anything can be said of the next number."""
        return self.count >= LEAST_KNOWN

    @property
    def level(self) -> float:
        """Logarithm of the usual number: half lie above."""
        return self.quantile(0.0, 0.0)

    def doubt_level(self, count: float) -> None:
        """Believe the level only as if it were known from so many numbers; the spread stays."""
        self.count = min(self.count, count)

    def take(self, value: float, least: float, deviations: float = math.inf) -> None:
        """Learn from one number.

        Args:
            value: its logarithm.
            least: standard deviation of the logarithm that there is at least.
            deviations: it is taken for so many above the mean at most.
        """
        if self.count == 0:
            self.origin = value
        if self.known:
            value = min(value, self._far(deviations))
            if (chance := self._chance(value, least)) < TAIL:
                self.tail = [self.tail[0] + 1, self.tail[1] + math.log(TAIL / chance)]
        if self.freedom >= 1:
            off, spread = self._standardised(value, least)
            n = self.freedom
            density = -(n + 1) / 2 * np.log1p(off**2 / n) - np.log(spread)
            self.evidence = self.evidence + density + POWERS * self._relative(value)
            self.evidence = self.evidence - self.evidence.max()
        off = self._transformed(value) - self.mean
        self.mean = self.mean + off / (self.count + 1)
        self.squares = self.squares + off**2 * (self.count / (self.count + 1))
        self.count += 1
        self.freedom += 1

    def unusual(self, value: float, least: float) -> float:
        """How unusual a number is, as the value of a standard normal variable.

        Args:
            value: its logarithm.
            least: as of `take`.
        """
        chance = self._chance(value, least)
        if chance >= 0.5:
            return float(ndtri(max(self._chance(value, least, side=1), LEAST_CHANCE)))
        if chance < TAIL:
            seen, total = self.tail
            chance = TAIL * (1 + math.log(TAIL / chance) / total) ** -seen
        return -float(ndtri(chance))

    def quantile(self, unusual: float, least: float) -> float:
        """Logarithm of the number that is as unusual as that (inverse of `unusual`)."""
        upper = unusual > 0
        chance = float(ndtr(-abs(unusual)))
        if upper and chance < TAIL:
            seen, total = self.tail
            chance = TAIL * math.exp(-total * ((chance / TAIL) ** (-1 / seen) - 1))
        chance = max(chance, 2 * LEAST_CHANCE)
        side = -1 if upper else 1

        def excess(value: float) -> float:
            return math.log(self._chance(value, least, side) / chance)

        # The mixture's quantile lies between those of its parts.
        _, spread = self._standardised(self.origin, least)
        parts = self.mean - side * spread * -stdtrit(self.freedom, chance)
        slopes = np.maximum(1 + POWERS * parts, LEAST_CHANCE)
        ends = np.where(LOGARITHM, parts, np.log(slopes) / DIVISORS)
        ends = np.clip(ends, -FURTHEST, FURTHEST) + self.origin
        low, high = float(ends.min()) - 1e-6, float(ends.max()) + 1e-6
        if excess(low) * excess(high) >= 0:
            return high if upper else low
        return float(brentq(excess, low, high, xtol=1e-7))

    def _far(self, deviations: float) -> float:
        at = int(np.argmax(LOGARITHM))
        spread = math.sqrt(self.squares[at] / self.freedom)
        return float(self.origin + self.mean[at] + deviations * spread) if spread else math.inf

    def _chance(self, value: float, least: float, side: int = -1) -> float:
        """Probability of a larger number (side -1) or of a smaller one (1), by the fitted law."""
        off, _ = self._standardised(value, least)
        weights = np.exp(self.evidence)
        share = float(weights @ stdtr(self.freedom, side * off)) / float(weights.sum())
        return max(share, LEAST_CHANCE)

    def _standardised(
        self, value: float, least: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(deviations from the mean in spreads of prediction, these spreads), for each power."""
        spread = np.sqrt(self.squares / self.freedom)
        # A spread of the logarithm is one of the transformed number times the latter's slope.
        spread = np.maximum(spread, max(least, 1e-12) * np.abs(1 + POWERS * self.mean))
        spread = spread * math.sqrt(1 + 1 / self.count)
        return (self._transformed(value) - self.mean) / spread, spread

    def _relative(self, value: float) -> float:
        return min(max(value - self.origin, -FURTHEST), FURTHEST)

    def _transformed(self, value: float) -> NDArray[np.float64]:
        log = self._relative(value)
        return np.where(LOGARITHM, log, np.expm1(POWERS * log) / DIVISORS)

    def state(self) -> dict[str, Any]:
        """All that was learned, in JSON types."""
        rows = {name: getattr(self, name).tolist() for name in ("mean", "squares", "evidence")}
        numbers = {name: getattr(self, name) for name in ("origin", "count", "freedom")}
        return {**numbers, **rows, "tail": list(self.tail)}

    @classmethod
    def from_state(cls, state: Mapping[str, Any]) -> Self:
        """What `state` gave.

        Raises:
            ValueError: it did not.
        """
        new = cls()
        own = new.state()
        if not isinstance(state, Mapping) or set(state) != set(own):
            raise ValueError(f"expected the keys {sorted(own)}")
        for name, value in state.items():
            row = np.asarray(value, dtype=np.float64)
            if row.shape != np.shape(own[name]) or not np.isfinite(row).all():
                raise ValueError(f"{name}: expected the like of {own[name]}, got {value}")
            plain = row.tolist()
            setattr(new, name, row if isinstance(getattr(new, name), np.ndarray) else plain)
        return new
