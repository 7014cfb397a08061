"""What a further effect must explain to be named, among the sets that were fitted.

No law is exactly the machine's, so further effects can always take away some of what is left. One
is named if it explains a stated part of the gap, or a smaller part, if nearly nothing else is left.
A relative of what is named must also find more left than a law may be off, or take away nearly all
that laws which depart cannot explain.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.diagnosis.candidate import Candidate
from ldt_core.diagnosis.effect_fit import EffectFit, fit
from ldt_core.diagnosis.error_band import ErrorBand
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.law_departure import LawDepartures, own_laws
from ldt_core.diagnosis.responses import Responses
from ldt_core.diagnosis.thresholds import THRESHOLDS

Names = frozenset[str]
#: Families whose laws depart by speed, direction, size or time, as `law_departure` has them. Of an
#: angle's harmonics and of a sensor's or a delay's frequency response it knows nothing.
DEPARTING = frozenset({"dry friction", "drag", "resistance"})


def kin(members: Sequence[Candidate], without: Collection[str] = ()) -> int:
    """How many effects of a set share their family with another one before them.

    Args:
        without: families that do not count.
    """
    families = [c.effect.family for c in members if c.effect.family not in ("", *without)]
    return len(families) - len(set(families))


def plain_enough(simpler: EffectFit, best: EffectFit, behind: float, gap: float) -> bool:
    """Whether a set with fewer parameters leaves so little more that it may be the answer.

    Sets that differ only in the laws of their families are told apart by no less than a second
    effect of such a family must explain.
    """
    limits, same = THRESHOLDS, simpler.families == best.families
    share = limits.same_family_of_gap if same else limits.simpler_set_of_gap
    return simpler.free < best.free and behind <= share * gap


def earned(
    smaller: Sequence[Candidate],
    larger: Sequence[Candidate],
    gain: float,
    left: float,
    gap: float,
    whole: bool = False,
) -> bool:
    """Whether a larger set is to be named instead of a smaller one.

    Args:
        gain: power that only the larger one explains.
        left: power that the smaller one leaves beyond noise.
        whole: whether the larger one leaves the noise alone.
    """
    added = len(larger) - len(smaller)
    limits = THRESHOLDS
    if not gain > limits.chance_gain * added:
        return False
    # What leaves more than a law may be off is no cause by itself, whose law a relative mends.
    related = kin(larger) > kin(smaller)
    departs = kin(larger, DEPARTING) == kin(smaller, DEPARTING) and gain > limits.relative * left
    if related and left <= limits.departure_of_law * gap and not departs:
        return False
    further = limits.further_effect_of_gap * added * gap
    if gain > further and gain > limits.further_effect_of_remainder * left:
        return True
    # What takes away nearly all that was left does not mend another law; down to the noise, it may
    # be as small as it likes, unless it is a relative.
    small = (whole and not related) or gain > limits.small_effect_of_gap * added * gap
    return small and gain > limits.whole_remainder * left


@dataclass(eq=False)
class FittedSets:
    """What the search has found.

    Attributes:
        base: (size,) residuals without any effect.
        refuted: sets that held-out experiments have shown to be no answer.
    """

    residuals: FreeRunResiduals
    band: ErrorBand
    base: Array
    responses: Responses
    fits: dict[Names, EffectFit] = field(default_factory=dict)
    scouted: dict[Names, EffectFit] = field(default_factory=dict)
    refuted: set[Names] = field(default_factory=set)
    _cancelling: dict[Names, bool] = field(default_factory=dict)
    _led: dict[EffectFit, EffectFit] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.departures = LawDepartures(self.residuals, self.base)
        self._own_laws = own_laws(self.residuals)

    def loss(self, fitted: EffectFit) -> float:
        """A set's loss, once its laws may depart from the machine's.

        A start state of its own is a parameter more, beside sets that explain as much without.
        """
        return fitted.loss + fitted.begun - self.departures.taken(fitted)

    def left(self, fitted: EffectFit) -> float:
        """Power in the speed that a set leaves beyond noise, once its laws may depart."""
        return self.band.speed_excess(fitted.residual) - self.departures.taken(fitted)

    def behind(self, fitted: EffectFit, best: EffectFit) -> float:
        """Loss in the speed beyond that of another set, once the laws of both may depart."""
        losses = (
            float(self.band.speed_loss(f.residual).sum()) - self.departures.taken(f)
            for f in (fitted, best)
        )
        return next(losses) - next(losses)

    @property
    def own_laws(self) -> float:
        """Power in the speed by which laws of the machine file may be off, as a cause's at most."""
        return min(self._own_laws, THRESHOLDS.departure_of_law * max(self.excess, 0.0))

    @property
    def excess(self) -> float:
        """Of the residuals without any effect."""
        return self.band.excess(self.base)

    @property
    def speed_shows(self) -> bool:
        """Whether the speed shows a gap, and not the current alone."""
        limit = self.band.speed_limit(THRESHOLDS.remainder_false_alarm)
        return not self.band.free[1] or self.band.speed_excess(self.base) > limit

    def least_left(self) -> tuple[float, EffectFit]:
        """The set that leaves least, and the power that it leaves beyond noise."""
        best = min(self.fits.values(), key=lambda f: self.band.excess(f.residual))
        return self.band.excess(best.residual), best

    def of_size(self, count: int) -> list[EffectFit]:
        """Sets of so many effects, fitted on all experiments, best first.

        Without those in which two effects all but cancel each other: a drag beside a friction that
        is negative can imitate nearly anything, and is nothing that a machine has.
        """
        found = [f for names, f in self.fits.items() if len(names) == count]
        return sorted((f for f in found if not self.cancels(f)), key=self.loss)

    def standing(self, count: int) -> list[EffectFit]:
        """Sets of so many effects without those that were refuted."""
        return [f for f in self.of_size(count) if frozenset(f.names) not in self.refuted]

    def simulated_as(self, smaller: EffectFit, larger: EffectFit) -> EffectFit:
        """The smaller set, simulated as the larger one is.

        Where only the larger one's simulations follow the measured speed, it leaves less of what a
        law that is not linear lacks, whatever its further members do.
        """
        if self.residuals.led(smaller.use) or not self.residuals.led(larger.use):
            return smaller
        if smaller not in self._led:
            led = self.residuals.always_led()
            self._led[smaller] = fit(led, smaller.members, smaller.z, own=smaller.own)
        return min(smaller, self._led[smaller], key=lambda f: f.loss)

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


def worth_more(
    found: FittedSets, smaller: EffectFit, larger: EffectFit, gap: float, departing: bool = False
) -> bool:
    """Whether what a larger set gains over a smaller one earns it its further members.

    Args:
        departing: True leaves out what laws that depart could explain as well, and what is a small
            part of the gap.
    """
    band, smaller = found.band, found.simulated_as(smaller, larger)
    # What only departures gain, of which a larger set has more, no further effect has explained.
    exact = band.speed_gain(smaller.residual, larger.residual)
    gain, left = min(found.behind(smaller, larger), exact), max(found.left(smaller), 0.0)
    if larger.ended and not gain > THRESHOLDS.further_effect_of_gap * gap:
        return False  # what mends so little and has no size is no cause
    limit = band.speed_limit(THRESHOLDS.remainder_false_alarm)
    plainly = THRESHOLDS.plainly_structured * limit
    # Of what laws that depart may leave, a little is left over: it has no name, down to the noise.
    rest = max(band.speed_excess(smaller.residual), 0.0)
    if frozenset(smaller.names) in found.refuted:  # no departure of its laws makes up for that
        gain, left = exact, rest
    departs = left < (1 - THRESHOLDS.further_effect_of_remainder) * rest
    whole = found.left(larger) <= limit and not departs
    # What departures plainly cannot explain, and one effect nearly does, is that effect's; or what
    # one exact law nearly explains. Two may mend any law.
    one = len(larger.effects) == len(smaller.effects) + 1
    if left > plainly or exact > THRESHOLDS.nearly_all_of_remainder * rest:
        whole |= one and not departing and gain > THRESHOLDS.relative * left
    if not exact > THRESHOLDS.least_gap * band.samples:
        return False  # what matters to no prediction
    if earned(smaller.effects, larger.effects, gain, left, gap, whole):
        return True
    if _current_shows(found, smaller, larger):
        return True
    if departing or not one:
        return False
    # Exact laws that leave the noise alone are believed before laws that depart from the machine's.
    # Beside what the smaller set leaves, the simulation's error is as good as noise.
    if band.speed_excess(larger.residual) > max(limit, THRESHOLDS.law_error**2 * rest):
        return False
    # What is plainly there the further effect may then explain however small it is, though laws
    # that depart could as well: what leaves noise alone says more than what may be anything.
    whole = rest > plainly
    return earned(smaller.effects, larger.effects, exact, rest, gap, whole)


def _current_shows(found: FittedSets, smaller: EffectFit, larger: EffectFit) -> bool:
    """Whether the current tells of a larger set's further members: as the speed would have to.

    A torque beside a sensor's lag, say, shows in the current, which the lag does not touch.
    """
    band, base = found.band, found.base
    left, rest = (max(band.current_excess(f.residual), 0.0) for f in (smaller, larger))
    gain = band.current_gain(smaller.residual, larger.residual)
    gap = max(band.current_gain(base, larger.residual), 0.0) + rest
    if left <= THRESHOLDS.departure_of_law * gap:
        return False  # so much a law may be off
    return earned(smaller.effects, larger.effects, gain, left, gap)
