"""From fitted sets to a verdict: how many effects, which cannot be told apart, or none of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldt_core.diagnosis.energy import Band
from ldt_core.diagnosis.explain import CLEAR, MOST, Search
from ldt_core.diagnosis.explained import Explained
from ldt_core.diagnosis.model_selection import earned, kin, plain_enough
from ldt_core.diagnosis.search import Fit
from ldt_core.diagnosis.shares import shapley
from ldt_core.diagnosis.trials import Bench

Array = NDArray[np.float64]

CHANCE = 0.002  # of each of two tests to see a gap where there is none
ALIKE = 10.8  # loss by which sets differ that cannot be told apart: chi-square, p = 0.001, and
ALSO = 0.7  # times what the best leaves itself: no candidate's law is exactly the machine's
SHARE = 0.01  # of what a set explains, that each member must bring to it (Shapley)
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
        excess: power of the gap in the speed beyond noise, without any effect.
        left: the same with the chosen set.
        structured: whether what is left is more than noise.
        bench: all experiments, with the noise as it was found.
        confidence: that the verdict is right, as far as the experiments agree with each other.
    """

    kind: str
    best: Fit | None
    alike: tuple[Fit, ...]
    excess: float
    left: float
    structured: bool
    bench: Bench
    confidence: float

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

    Two tests: power at low frequencies, and the best match with a candidate's response, whose limit
    comes from draws of white noise on this very input.
    """
    if found.excess > found.band.limit_of(CHANCE):
        return True
    d = found.responses
    score = np.max(d.target / d.length)
    random = np.random.default_rng(seed)
    values, vectors = np.linalg.eigh(d.cosine)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    drawn = np.max(root @ random.standard_normal((values.size, DRAWS)), axis=0)
    return bool(score > np.quantile(drawn, 1 - CHANCE))


def decide(search: Search, seed: int = 0, faulty: bool = False) -> Decision:
    """Search, and say what the search has found; nothing is sought in a faulty sensor's speed."""
    found = search.found
    band = found.band
    band.level = search.band.level = band.channel_noise(found.base)
    if faulty:
        bench = _with_noise(found.bench, band.level)
        return Decision("unknown", None, (), found.excess, found.excess, False, bench, 0.99)
    if not is_gap(found, seed):
        bench = _with_noise(found.bench, band.level)
        return Decision("none", None, (), found.excess, found.excess, False, bench, 0.99)
    search.run()
    best = found.of_size(1)[0]
    for size in range(1, MOST + 1):
        best = min([best, *found.of_size(size)[:1]], key=lambda f: band.excess(f.rest))
    band.level = search.band.level = band.channel_noise(best.rest)
    chosen = _carried(search, _grow(found, _gap(found, best)))
    search.alternatives(chosen)
    pool = found.of_size(len(chosen.names))
    alike = _plainest(found, _as_good(band, pool), pool, _gap(found, pool[0]))
    alike = sorted(alike, key=lambda f: kin(f.effects))  # else the best first, as before
    best = alike[0]
    left, gap = band.speed_excess(best.rest), _gap(found, best)
    structured = band.excess(best.rest) > band.limit_of(0.01)
    unknown = _unexplained(band, best, gap)
    kind = "unknown" if unknown else "ambiguous" if len(alike) > 1 else "effect"
    least = min(alike, key=lambda f: f.loss)
    rivals = [f for f in pool if f not in alike and f.loss > least.loss]
    sure = _confidence(found, least, [] if unknown else rivals, unknown, seed)
    bench = _with_noise(found.bench, band.level)
    return Decision(kind, best, tuple(alike), gap, left, structured, bench, sure)


def _unexplained(band: Band, chosen: Fit, gap: float) -> bool:
    """Whether a set leaves so much of the gap that it is not the cause."""
    left = band.speed_excess(chosen.rest) - band.speed_limit(0.01)
    return bool(left > UNEXPLAINED * gap)


def _gap(found: Explained, best: Fit) -> float:
    """Power of the gap in the speed: what the best set explains, and what it leaves.

    The speed alone, since it is what is to be predicted: a current that was measured well shows how
    the laws differ from the machine's long before that matters.
    """
    band = found.band
    explained = float((band.speed_loss(found.base) - band.speed_loss(best.rest)).sum())
    return max(explained, 0.0) + max(band.speed_excess(best.rest), 0.0)


def _with_noise(bench: Bench, level: tuple[float, float]) -> Bench:
    noise = bench.noise[0] * level[0], bench.noise[1] * level[1]
    return Bench(bench.machine, bench.experiments, noise, bench.workers)


def _confidence(
    found: Explained, best: Fit, rivals: Sequence[Fit], unknown: bool, seed: int
) -> float:
    """Part of the draws of experiments (with replacement) that give the same verdict."""
    band = found.band
    count = len(found.bench.pieces)
    pick = np.random.default_rng(seed).integers(0, count, (BOOTSTRAP, count))
    explained = (band.speed_loss(found.base) - band.speed_loss(best.rest))[pick].sum(axis=1)
    noise = band.free[0] * band.level[0] ** 2 / count
    left = (band.power(best.rest, speed=True) - noise)[pick].sum(axis=1)
    gap = np.maximum(explained, 0.0) + np.maximum(left, 0.0)
    same = (left - band.speed_limit(0.01) > UNEXPLAINED * gap) == unknown
    own = _losses(found.bench, best.rest)[pick].sum(axis=1)
    for rival in rivals:
        same = same & (own < _losses(found.bench, rival.rest)[pick].sum(axis=1))
    return float(np.clip(np.mean(same), 1 / BOOTSTRAP, 1 - 1 / BOOTSTRAP))


def _losses(bench: Bench, rest: Array) -> Array:
    return np.array([float(rest[p.rows] @ rest[p.rows]) for p in bench.pieces])


def _grow(found: Explained, gap: float) -> list[Fit]:
    """From the best effect alone, ever larger sets that are each better by enough."""
    chosen, band = [found.of_size(1)[0]], found.band
    for size in range(2, MOST + 1):
        for larger in _good(found, found.of_size(size))[:1]:
            smaller = chosen[-1]
            gain = float((band.speed_loss(smaller.rest) - band.speed_loss(larger.rest)).sum())
            left = max(band.speed_excess(smaller.rest), 0.0)
            clear = gain > CLEAR * (len(larger.names) - len(smaller.names))
            if clear and earned(smaller.effects, larger.effects, gain, left, gap):
                chosen.append(larger)
    return chosen


def _carried(search: Search, chosen: Sequence[Fit]) -> Fit:
    """The largest of these sets to which each member brings a share that is more than a trifle.

    One that hardly explains anything in any order only mends what another law gets a little wrong.
    """
    for tried in reversed(chosen[1:]):
        if min(shapley(search, tried).values()) >= SHARE:
            return tried
    return chosen[0]


def _good(found: Explained, pool: Sequence[Fit]) -> list[Fit]:
    """Sets that are as good as the first, those with the fewest effects of one family."""
    if not pool:
        return []
    close = _as_good(found.band, pool)
    least = min(kin(f.effects) for f in close)
    return [f for f in close if kin(f.effects) == least]


def _as_good(band: Band, pool: Sequence[Fit]) -> list[Fit]:
    """Sets that cannot be told from the first, by all channels and by the speed alone."""
    best = pool[0]
    reach = max(ALIKE, ALSO * band.excess(best.rest))
    fine = float(band.speed_loss(best.rest).sum())
    there = max(ALIKE, ALSO * band.speed_excess(best.rest))
    return [
        f
        for f in pool
        if f.loss - best.loss <= reach and float(band.speed_loss(f.rest).sum()) - fine <= there
    ]


def _plainest(found: Explained, alike: Sequence[Fit], pool: Sequence[Fit], gap: float) -> list[Fit]:
    """The sets that need the fewest parameters, the best first.

    A law with more parameters follows a machine better than a simpler one even where the simpler
    one is right, since no law is exactly right. So where a simpler set leaves hardly more, it is
    the answer, and the other is named beside it if it does fit better. Laws of the same family
    are told apart by no less than a second one of that family must explain to be named.
    """
    best = alike[0]
    band = found.band
    fine = float(band.speed_loss(best.rest).sum())
    hopeless = _unexplained(band, best, gap)
    close = [
        f
        for f in pool
        if plain_enough(f, best, float(band.speed_loss(f.rest).sum()) - fine, gap)
        and (hopeless or not _unexplained(band, f, gap))
    ]
    if not close:
        least = min(f.free for f in alike)
        return [f for f in alike if f.free == least]
    least = min(f.free for f in close)
    plain = [f for f in close if f.free == least]
    kept = _as_good(band, plain)
    related = [f for f in alike if f not in kept and plain[0].loss - f.loss > ALIKE]
    return [*kept, *related[:1]]
