"""From fitted sets to a verdict: how many effects, which cannot be told apart, or none of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldt_core.diagnosis.explain import CLEAR, MOST, Explained, Search
from ldt_core.diagnosis.search import Fit

Array = NDArray[np.float64]

CHANCE = 0.002  # of each of three tests to see a gap where there is none
WORTH = 0.01  # of the gap that a further effect must explain to be named, and
HALF = 0.5  # of what was left before it
ALIKE = 10.8  # loss by which sets differ that cannot be told apart: chi-square, p = 0.001, and
ALSO = 1.5  # times what the best leaves itself: no candidate's law is exactly the machine's
UNEXPLAINED = 0.05  # of the gap: with more left, the best set is not the cause
DRAWS = 2000  # of white noise, for the limits of the tests


@dataclass(frozen=True, eq=False)
class Decision:
    """What explains the gap.

    Attributes:
        kind: none, effect, ambiguous or unknown.
        best: the chosen set's fit; None for `none`.
        alike: all sets that are as good, the chosen one first.
        excess: power of the gap beyond noise, without any effect.
        left: the same with the chosen set.
        structured: whether what is left is more than noise.
    """

    kind: str
    best: Fit | None
    alike: tuple[Fit, ...]
    excess: float
    left: float
    structured: bool

    @property
    def acting(self) -> list[list[str]]:
        """For each effect that acts, the names that it may have; the best first."""
        if self.best is None:
            return []
        groups = [[name] for name in self.best.names]
        for other in self.alike[1:]:
            new = [n for n in other.names if n not in self.best.names]
            gone = [n for n in self.best.names if n not in other.names]
            for group in groups:
                if group[0] in gone:
                    group += [n for n in new if n not in group]
        return groups


def is_gap(found: Explained, seed: int) -> bool:
    """Whether the residuals without any effect are more than white noise.

    Three tests: power at low frequencies, and the best match with a candidate's response, whose
    limit comes from draws of white noise on this very input, and the same without the start.
    """
    if found.excess > found.band.limit_of(CHANCE):
        return True
    d = found.responses
    size = np.sqrt(np.maximum(np.diag(d.gram), 1e-12))
    score = np.max(d.target / size)
    random = np.random.default_rng(seed)
    values, vectors = np.linalg.eigh(d.gram / np.outer(size, size))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    drawn = np.max(root @ random.standard_normal((values.size, DRAWS)), axis=0)
    return bool(score > np.quantile(drawn, 1 - CHANCE))


def decide(search: Search, seed: int = 0) -> Decision:
    """The verdict on what a search has found."""
    found = search.found
    excess, limit = found.excess, found.band.limit_of(0.01)
    if not is_gap(found, seed):
        return Decision("none", None, (), excess, excess, False)
    sizes = [found.of_size(k) for k in range(1, MOST + 1)]
    chosen = _grow([s[0] for s in sizes if s], found, excess)
    search.alternatives(chosen)
    rivals = [f for f in found.of_size(len(chosen.members)) if f is not chosen]
    left = found.band.excess(chosen.rest)
    reach = max(ALIKE, ALSO * left)
    pool = sorted([chosen, *rivals], key=lambda f: f.loss)
    best = pool[0]
    left = found.band.excess(best.rest)
    reach = max(ALIKE, ALSO * left)
    alike = [f for f in pool if f.loss - best.loss <= reach]
    alike = _without_generalisations(alike)
    structured = left > limit
    unknown = structured and left > UNEXPLAINED * excess
    kind = "unknown" if unknown else "ambiguous" if len(alike) > 1 else "effect"
    return Decision(kind, best if best in alike else alike[0], tuple(alike), excess, left, structured)


def _grow(best: Sequence[Fit], found: Explained, excess: float) -> Fit:
    chosen = best[0]
    for larger in best[1:]:
        gain = chosen.loss - larger.loss
        left = max(found.band.excess(chosen.rest), 0.0)
        added = len(larger.members) - len(chosen.members)
        if gain > CLEAR * added and gain > WORTH * excess * added and gain > HALF * left:
            chosen = larger
    return chosen


def _without_generalisations(alike: list[Fit]) -> list[Fit]:
    """Leave out sets that need more parameters to say the same."""
    least = min(f.free for f in alike)
    return [f for f in alike if f.free == least] or alike
