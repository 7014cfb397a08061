"""From fitted sets to a verdict: how many effects, which cannot be told apart, or none of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldt_core.diagnosis.bench import Bench
from ldt_core.diagnosis.explain import CLEAR, MOST, Explained, Search
from ldt_core.diagnosis.search import Fit

Array = NDArray[np.float64]

CHANCE = 0.002  # of each of three tests to see a gap where there is none
WORTH = 0.01  # of the gap that a further effect must explain to be named, and
HALF = 0.5  # of what was left before it
ALIKE = 10.8  # loss by which sets differ that cannot be told apart: chi-square, p = 0.001, and
ALSO = 1.5  # times what the best leaves itself: no candidate's law is exactly the machine's
UNEXPLAINED = 0.05  # of the gap: with more left, the best set is not the cause
BOOTSTRAP = 400  # draws of experiments
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
        bench: all experiments, with the noise as it was found.
        confidence: that the verdict is right, as far as the experiments agree with each other.
        notes: for a person.
    """

    kind: str
    best: Fit | None
    alike: tuple[Fit, ...]
    excess: float
    left: float
    structured: bool
    bench: Bench
    confidence: float = 1.0
    notes: tuple[str, ...] = ()

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
    """Search, and say what the search has found."""
    found = search.found
    band, assumed = found.band, found.bench.noise
    band.level = search.band.level = band.channel_noise(found.base)
    if not is_gap(found, seed):
        bench = _with_noise(found.bench, assumed, band.level)
        return Decision("none", None, (), found.excess, found.excess, False, bench, 0.99)
    search.run()
    best = found.of_size(1)[0]
    for size in range(1, MOST + 1):
        best = min([best, *found.of_size(size)[:1]], key=lambda f: band.excess(f.rest))
    band.level = search.band.level = band.channel_noise(best.rest)
    excess, limit = found.excess, band.limit_of(0.01)
    chosen = _grow(found, excess)
    search.alternatives(chosen)
    pool = found.of_size(len(chosen.members))
    best = pool[0]
    left = band.excess(best.rest)
    reach = max(ALIKE, ALSO * left)
    alike = _without_generalisations([f for f in pool if f.loss - best.loss <= reach])
    structured = left > limit
    unknown = structured and left > UNEXPLAINED * excess
    kind = "unknown" if unknown else "ambiguous" if len(alike) > 1 else "effect"
    rivals = [f for f in pool if f.loss - best.loss > reach]
    sure = _confidence(found, alike[0], [] if unknown else rivals, unknown, seed)
    bench = _with_noise(found.bench, assumed, band.level)
    return Decision(kind, alike[0], tuple(alike), excess, left, structured, bench, sure)


def _with_noise(bench: Bench, assumed: tuple[float, float], level: tuple[float, float]) -> Bench:
    noise = assumed[0] * level[0], assumed[1] * level[1]
    return Bench(bench.machine, bench.experiments, noise, bench.workers)


def _confidence(
    found: Explained, best: Fit, rivals: Sequence[Fit], unknown: bool, seed: int
) -> float:
    """Part of the draws of experiments (with replacement) that give the same verdict."""
    band = found.band
    count = len(found.bench.pieces)
    pick = np.random.default_rng(seed).integers(0, count, (BOOTSTRAP, count))
    gap = (band.power(found.base) - band.noise / count)[pick].sum(axis=1)
    left = (band.power(best.rest) - band.noise / count)[pick].sum(axis=1)
    same = (left > UNEXPLAINED * gap) if unknown else (left <= UNEXPLAINED * np.maximum(gap, left))
    own = _losses(found.bench, best.rest)[pick].sum(axis=1)
    for rival in rivals:
        same = same & (own < _losses(found.bench, rival.rest)[pick].sum(axis=1))
    return float(np.clip(np.mean(same), 1 / BOOTSTRAP, 1 - 1 / BOOTSTRAP))


def _losses(bench: Bench, rest: Array) -> Array:
    return np.array([float(rest[p.rows] @ rest[p.rows]) for p in bench.pieces])


def _grow(found: Explained, excess: float) -> Fit:
    """The smallest set that no larger one beats by enough."""
    chosen = found.of_size(1)[0]
    for size in range(2, MOST + 1):
        for larger in found.of_size(size)[:1]:
            gain = chosen.loss - larger.loss
            left = max(found.band.excess(chosen.rest), 0.0)
            added = len(larger.members) - len(chosen.members)
            worth = max(CLEAR, WORTH * excess) * added
            if gain > worth and gain > HALF * left:
                chosen = larger
    return chosen


def _without_generalisations(alike: list[Fit]) -> list[Fit]:
    """Leave out sets that need more parameters to say the same."""
    least = min(f.free for f in alike)
    return [f for f in alike if f.free == least] or alike
