"""Claims about the few experiments that a search works on, and what they may not show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recorded_machines import MOTOR, candidates, record

from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.diagnosis.effect_fit import EffectFit, fit
from ldt_core.diagnosis.effect_set_search import EffectSetSearch
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.scouting import (
    LONGEST_SCOUTED,
    SCOUT_STRETCHES,
    bearable,
    empty,
    looked_at,
    scouted,
)
from ldt_core.diagnosis.set_fits import TriedSet
from ldt_core.effects import get_effect

LIMIT = "voltage_saturation:limit=9"
LOUD = 2  # place of the only experiment that reaches the limit


@pytest.fixture(scope="module")
def one_reaches_it():
    """Six experiments of 3000 samples, of which one alone exceeds the limit."""
    random = np.random.default_rng(4)
    levels = [np.repeat(random.uniform(-8, 8, 30), 100) for _ in range(6)]
    levels[LOUD] = 1.5 * levels[LOUD]
    return FreeRunResiduals(MOTOR, record(MOTOR, LIMIT, count=6, samples=3000, levels=levels))


def test_the_experiment_with_the_largest_gap_is_always_looked_at(one_reaches_it):
    """An effect that acts in one experiment alone would not be found without it."""
    seen = [s.place for s in scouted(one_reaches_it, one_reaches_it.of())]
    assert LOUD in seen
    assert 2 <= len(seen) < 6


def test_of_long_experiments_stretches_are_looked_at():
    """Only so much of them, or time and memory grow; where the gap is largest is among it."""
    random, length, moment = np.random.default_rng(4), 3 * LONGEST_SCOUTED, 30_000
    levels = [np.repeat(random.uniform(-8, 8, length // 100), 100) for _ in range(2)]
    levels[1][moment : moment + 100] = 12.0
    given = record(MOTOR, LIMIT, count=2, samples=length, levels=levels)
    whole = FreeRunResiduals(MOTOR, given)
    seen = scouted(whole, whole.of())
    assert len(seen) == SCOUT_STRETCHES
    assert sum(s.stop - s.begin for s in seen) == LONGEST_SCOUTED
    assert np.count_nonzero(looked_at(whole, seen)) == LONGEST_SCOUTED
    assert any(s.place == 1 and s.begin <= moment < s.stop for s in seen)
    found = EffectSetSearch(whole, candidates(MOTOR, ["voltage_saturation", "viscous_friction"]))
    assert sum(map(len, found.scout.experiments)) == LONGEST_SCOUTED
    assert found.run().of_size(1)[0].names == ("voltage_saturation",)


def test_residuals_do_not_depend_on_how_many_runs_are_side_by_side(one_reaches_it, monkeypatch):
    """However little memory there is for them."""
    (limit,) = candidates(MOTOR, ["voltage_saturation"])
    uses = [[], [(limit.effect, limit.typical)], [(limit.effect, {"limit": 3.0})]]
    together = list(one_reaches_it.of_all(uses))
    monkeypatch.setattr("ldt_core.diagnosis.free_run_residuals.SAMPLES_AT_ONCE", 1)
    np.testing.assert_array_equal(list(one_reaches_it.of_all(uses)), together)
    np.testing.assert_array_equal(one_reaches_it.of(uses[2]), together[2])


def test_what_runs_away_elsewhere_begins_weaker(one_reaches_it):
    """A winding that a few experiments let grow hot melts in another one."""
    (heat,) = candidates(MOTOR, ["winding_heating"])
    base = one_reaches_it.of()
    begun = [heat.coordinates({"thermal_resistance": 1e5, "time_constant": 1.0})]
    rest = empty(one_reaches_it).residual
    wild = EffectFit((heat,), tuple(begun), rest, np.zeros((rest.size, 2)), 0.0)
    found = bearable(one_reaches_it, wild, base)
    assert found[0][0] < begun[0][0]
    mild = heat.coordinates({"thermal_resistance": 1.0, "time_constant": 1.0})
    calm = fit(one_reaches_it, [heat], [mild])
    np.testing.assert_array_equal(bearable(one_reaches_it, calm, base)[0], calm.z[0])


def test_plainer_laws_take_the_place_of_several_members_at_once():
    """Else a set of two flexible laws is never held against the two plain ones."""
    acting = "coulomb_friction:torque=0.05", "viscous_friction:b=0.001"
    residuals = FreeRunResiduals(MOTOR, record(MOTOR, *acting, count=3))
    names = "stribeck_friction", "coulomb_friction", "viscous_asymmetric", "viscous_friction"
    tried = candidates(MOTOR, names)
    search = EffectSetSearch(residuals, tried)
    flexible = [c for c in tried if c.name in ("stribeck_friction", "viscous_asymmetric")]
    start = [c.coordinates(c.typical) for c in flexible]
    (base,) = search._scout([TriedSet(flexible, start)])
    found = {frozenset(f.names) for f in search._with_plainer_laws(base)}
    assert {"coulomb_friction", "viscous_friction"} in found


def test_what_the_few_experiments_like_best_is_not_the_only_one_that_is_fitted_on_all():
    """A spring over a few slow turns is a constant load, and over many it is not."""
    levels = [np.full(3000, level) for level in (3.0, 3.0, 3.0, 6.0, 9.0, 12.0)]
    measured = record(MOTOR, "constant_load:torque=0.1", count=6, samples=3000, levels=levels)
    residuals = FreeRunResiduals(MOTOR, measured)
    names = ["constant_load", "coulomb_friction", "stribeck_friction", "spring_load"]
    search = EffectSetSearch(residuals, candidates(MOTOR, names))
    search._alone()
    spring = search.found.scouted[frozenset({"spring_load"})]
    liked = replace(spring, residual=np.zeros_like(spring.residual), loss=0.0)
    search.found.scouted[frozenset({"spring_load"})] = liked
    search._finish(1)
    assert search.found.of_size(1)[0].names != ("spring_load",)


@pytest.mark.slow
@pytest.mark.parametrize("torque", [0.0015, 0.0025])
def test_a_gap_that_makes_the_noise_look_larger_hides_no_second_effect(torque):
    """By a voltage that moves at every sample, what a wrong gain leaves is rough as noise is."""
    acting = "sensor_gain:factor=2.5", f"gravity_imbalance:torque={torque}"
    names = "sensor_gain", "gravity_imbalance", "viscous_friction", "winding_heating"
    effects = [get_effect(n) for n in names]
    found = diagnose(MOTOR, record(MOTOR, *acting, hold=1, count=4), effects=effects, workers=1)
    assert sorted(found.verdict.effects) == ["gravity_imbalance", "sensor_gain"]
    assert found.gap.noise_std == pytest.approx(0.05, rel=0.03)
