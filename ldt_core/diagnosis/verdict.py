"""The decision between none, effect, ambiguous and unknown; its limits are in `thresholds`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.diagnosis.attribution import vague
from ldt_core.diagnosis.confidence import decades
from ldt_core.diagnosis.effect_fit import EffectFit
from ldt_core.diagnosis.effect_set_search import EffectSetSearch
from ldt_core.diagnosis.equally_good import (
    as_good_as_first,
    divided,
    in_place_of_each,
    may_be_the_answer,
    no_cause,
    unexplained,
)
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.model_selection import FittedSets, kin, worth_more
from ldt_core.diagnosis.other_minima import other_minima
from ldt_core.diagnosis.thresholds import THRESHOLDS

RESAMPLES = 400  # draws of experiments for the confidence, which is then known to 0.01 near 0.95
NOISE_DRAWS = 2000  # of white noise: four beyond the quantile that a test takes of them


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
        residuals: all experiments, with the noise as it was found.
        grounds: what speaks for it and against it; see `confidence.GROUNDS`.
    """

    kind: str
    best: EffectFit | None
    alike: tuple[EffectFit, ...]
    excess: float
    left: float
    structured: bool
    residuals: FreeRunResiduals
    grounds: Mapping[str, float]

    @property
    def acting(self) -> list[list[str]]:
        """For each effect that acts, the names that it may have; the best first."""
        return in_place_of_each(self.best, self.alike) if self.best is not None else []


def is_gap(found: FittedSets, seed: int) -> bool:
    """Whether the residuals without any effect are more than white noise.

    Two tests: power at low frequencies, and the best match with a candidate's response, whose limit
    comes from draws of white noise on this very input. A gap far below the noise is none.
    """
    d = found.responses
    score = np.max(d.target / d.length, initial=0.0)  # 0 where no candidate can be simulated
    power = max(found.excess, float(score) ** 2)
    # A foundation's own numbers are found among many minima: what they leave is the search's error.
    if found.residuals.shaking and power < THRESHOLDS.law_error**2 * found.band.excess(
        found.residuals.of()
    ):
        return False
    if power < THRESHOLDS.least_gap * found.band.samples or power < _trifle(found.residuals):
        return False
    if power < found.residuals.rounding:  # which noise and a slow signal repeat in any shape
        return False
    if found.excess > found.band.limit_of(THRESHOLDS.gap_false_alarm):
        return True
    if not d.target.size:
        return False
    random = np.random.default_rng(seed)
    values, vectors = np.linalg.eigh(d.cosine)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    drawn = np.max(root @ random.standard_normal((values.size, NOISE_DRAWS)), axis=0)
    level = math.sqrt(found.band.noise / sum(found.band.free))  # of the noise, over what is assumed
    return bool(score > max(level, 1.0) * np.quantile(drawn, 1 - THRESHOLDS.gap_false_alarm))


def _trifle(residuals: FreeRunResiduals) -> float:
    """Power of a gap that is nothing beside the motion itself."""
    signal = sum(float(np.sum(e.speed**2)) for e in residuals.experiments)
    return THRESHOLDS.least_gap_of_signal * signal / residuals.noise[0] ** 2


def decide(search: EffectSetSearch, seed: int = 0, faulty: bool = False) -> Decision:
    """The verdict: none, effect, ambiguous or unknown.

    Args:
        faulty: a sensor is faulty, so nothing is sought and the verdict is unknown.
    """
    found = search.found
    band = found.band
    band.level = search.band.level = band.channel_noise(found.base)
    if faulty or not is_gap(found, seed):
        kind = "unknown" if faulty else "none"
        residuals = _with_noise(found.residuals, band.level)
        return Decision(kind, None, (), found.excess, found.excess, False, residuals, {})
    search.run()
    return choose(search, seed)


def choose(search: EffectSetSearch, seed: int) -> Decision:
    """The verdict on what was found: effect, ambiguous or unknown."""
    found, band = search.found, search.found.band
    best = found.of_size(1)[0]
    for size in range(1, THRESHOLDS.largest_set + 1):
        best = min([best, *found.of_size(size)[:1]], key=lambda f: band.excess(f.residual))
    band.level = search.band.level = band.channel_noise(best.residual)
    gap = band.speed_gap(found.base, best.residual)
    chosen: EffectFit | None = _largest_worth_its_parts(search, _growing_sets(found, gap), gap)
    asked: set[frozenset[str]] = set()
    while chosen:
        asked.add(frozenset(chosen.names))
        search.alternatives(chosen)
        # A better minimum may have turned up for it, on the scout's experiments alone so far.
        search.finish(found.scouted[frozenset(chosen.names)])
        pool = found.standing(len(chosen.names)) or [chosen]
        gap = band.speed_gap(found.base, pool[0].residual)
        alike = may_be_the_answer(found, pool, gap)
        # A plainer one in its place has rivals of its own, which differ from the first in two.
        own = frozenset(alike[0].names) in asked
        if own:
            alike = _with_rivals_of_rivals(search, alike, gap)
        chosen = _without_the_vague(search, alike, gap) if own else alike[0]
        if chosen is None:
            plainer = (f for f in divided(found, alike[0]) if f.free < alike[0].free)
            chosen = next((f for f in plainer if frozenset(f.names) not in asked), None)
    best = alike[0]
    alike += divided(found, best)
    left, gap = band.speed_excess(best.residual), band.speed_gap(found.base, best.residual)
    structured = band.excess(best.residual) > band.limit_of(THRESHOLDS.remainder_false_alarm)
    unknown = no_cause(found, best, gap)
    kind = "unknown" if unknown else "ambiguous" if len(alike) > 1 else "effect"
    nearest = min(alike, key=found.loss)
    rivals = [f for f in pool if f not in alike and found.loss(f) > found.loss(nearest)]
    same = _agreement(found, nearest, [] if unknown else rivals, unknown, seed)
    grounds = _grounds(search, best, rivals, left, gap, same)
    residuals = _with_noise(found.residuals, band.level)
    alike += () if unknown else other_minima(search, best, left, gap)
    return Decision(kind, best, tuple(alike), gap, left, structured, residuals, grounds)


def _with_rivals_of_rivals(
    search: EffectSetSearch, alike: list[EffectFit], gap: float
) -> list[EffectFit]:
    """The sets that may be the answer, with those that differ from the first in two members.

    Of a rigid motor that shows its gain and its time constant, any two numbers may have changed.
    """
    best, *others = alike
    others = [f for f in others if f.families != best.families]
    if len(best.effects) < 2 or not others:
        return alike
    for f in others:
        search.exchange(f)
    pool = search.found.standing(len(best.effects))
    again = may_be_the_answer(search.found, pool, gap)
    return sorted(again, key=lambda f: f is not best) if best in again else alike


def _without_the_vague(
    search: EffectSetSearch, alike: Sequence[EffectFit], gap: float
) -> EffectFit | None:
    """The set without a member that any of several families could be; None if there is none.

    Where laws that depart explain as much, what speaks for a further effect is that only it leaves
    noise alone. That is not so where quite different laws do as well in its place. Nor is one named
    whose amount may be none, where laws that depart leave noise alone without it.
    """
    best, band = alike[0], search.found.band
    if len(best.effects) < 2:
        return None
    limit = band.speed_limit(THRESHOLDS.remainder_false_alarm)
    for name in vague(best, band.speed_excess(best.residual), gap):
        part = search.part_without(best, name)
        if search.found.left(part) <= limit:
            return part
    family = {c.name: c.effect.family or c.name for f in alike for c in f.effects}
    several = [g for g in in_place_of_each(best, alike) if len({family[name] for name in g}) > 1]
    # Where nothing is common to all sets, no part of one is known better than the whole.
    for group in several if len(several) < len(best.effects) else ():
        part = search.part_without(best, group[0])
        if not worth_more(search.found, part, best, gap, departing=True):
            return part
    return None


def _grounds(
    search: EffectSetSearch,
    best: EffectFit,
    rivals: Sequence[EffectFit],
    left: float,
    gap: float,
    same: float,
) -> dict[str, float]:
    """What speaks for a verdict, as far as the fitted experiments tell; see `confidence`."""
    band = search.found.band
    noise, samples = band.speed_limit(THRESHOLDS.remainder_false_alarm), band.samples
    least = max(band.speed_excess(best.residual), 0.0) + noise
    next_one = min((max(band.speed_excess(f.residual), 0.0) for f in rivals), default=gap) + noise
    parts = (search.part_without(best, name) for name in best.names if len(best.names) > 1)
    weakest = min((band.speed_gain(p.residual, best.residual) for p in parts), default=gap)
    return {
        "agreement": math.log(same / (1 - same)),
        "left": decades(max(left, 0.0) + noise, max(gap, 0.0) + noise),
        "margin": decades(next_one, least),
        "weakest": decades(gap, weakest),
        "strength": decades(gap, samples) / 2,
        "prior": float(np.abs(best.z[-1]).max()) if best.own else 0.0,
        "spent": float(search.spent),
    }


def _with_noise(residuals: FreeRunResiduals, level: tuple[float, float]) -> FreeRunResiduals:
    speed, current = (
        n * size * white
        for n, size, white in zip(residuals.noise, level, residuals.whiteness, strict=True)
    )
    noise = speed, current
    return FreeRunResiduals(residuals.machine, residuals.experiments, noise, residuals.workers)


def _agreement(
    found: FittedSets, best: EffectFit, rivals: Sequence[EffectFit], unknown: bool, seed: int
) -> float:
    """Share of the draws of experiments (with replacement) that give the same verdict."""
    band = found.band
    count = len(found.residuals.pieces)
    pick = np.random.default_rng(seed).integers(0, count, (RESAMPLES, count))
    explained = (band.speed_loss(found.base) - band.speed_loss(best.residual))[pick].sum(axis=1)
    noise = band.free[0] * band.level[0] ** 2 / count
    power = band.power(best.residual, speed=True)
    left = (power - noise)[pick].sum(axis=1)
    gap = np.maximum(explained, 0.0) + np.maximum(left, 0.0)
    departs = found.departures.taken(best) / max(float(power.sum()), 1e-300)
    same = unexplained(found, left - departs * power[pick].sum(axis=1), gap) == unknown
    whole = band.speed_gap(found.base, best.residual)
    if not unknown and unexplained(found, found.left(best), whole):
        same = np.ones_like(same)  # the current has decided
    own = _losses(found.residuals, best)[pick].sum(axis=1)
    for rival in rivals:
        same = same & (own < _losses(found.residuals, rival)[pick].sum(axis=1))
    return float(np.clip(np.mean(same), 1 / RESAMPLES, 1 - 1 / RESAMPLES))


def _losses(residuals: FreeRunResiduals, fit: EffectFit) -> Array:
    rows = [fit.residual[p.rows] for p in residuals.pieces]
    return np.array([float(r @ r) for r in rows])


def _growing_sets(found: FittedSets, gap: float) -> list[EffectFit]:
    """From the best effect alone, ever larger sets that are each better by enough."""
    chosen = [found.of_size(1)[0]]
    for size in range(2, THRESHOLDS.largest_set + 1):
        pool = found.standing(size)
        if not pool:
            continue
        # Of the sets that are as good as the best, one that has not run to its end, with the fewest
        # effects of one family.
        larger = min(as_good_as_first(found, pool), key=lambda f: (bool(f.ended), kin(f.effects)))
        if worth_more(found, chosen[-1], larger, gap):
            chosen.append(larger)
    return chosen


def _largest_worth_its_parts(
    search: EffectSetSearch, chosen: Sequence[EffectFit], gap: float
) -> EffectFit:
    """The largest of these sets that is worth more than each of its parts.

    The smaller set that it was held against may have been a poor one: a part of it that is nearly
    as good as all of it shows that a member only mends another law.
    """
    for tried in reversed(chosen[1:]):
        parts = (search.part_without(tried, name) for name in tried.names)
        if all(worth_more(search.found, part, tried, gap) for part in parts):
            return tried
    return chosen[0]
