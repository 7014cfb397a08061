"""Claims about further effects: which are named beside those that are named already."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from recorded_machines import MOTOR, NOISE, ROTOR, candidates, record

from ldt_core.diagnosis.attribution import shapley_shares
from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.diagnosis.effect_fit import EffectFit, fit
from ldt_core.diagnosis.effect_set_search import EffectSetSearch
from ldt_core.diagnosis.equally_good import as_good_as_first, no_cause, plainest
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.model_selection import earned, kin, plain_enough, worth_more
from ldt_core.diagnosis.thresholds import THRESHOLDS
from ldt_core.diagnosis.verdict import Decision
from ldt_core.effects import EFFECTS, get_effect

GAP = 1e6  # power
LIMITS = THRESHOLDS
FURTHER = LIMITS.further_effect_of_gap * GAP
SMALL = LIMITS.small_effect_of_gap * GAP
KIN = LIMITS.same_family_of_gap * GAP
NO_CAUSE = LIMITS.departure_of_law * GAP


def members(*names):
    return candidates(ROTOR, names)


def test_effects_of_one_family_are_kin_and_own_ones_are_not():
    """Three kinds of dry friction are two too many; what has no family is nobody's kin."""
    dry = members("coulomb_friction", "stribeck_friction", "load_friction")
    assert kin(dry) == 2
    assert kin(members("constant_load", "sensor_bias", "coulomb_friction")) == 0
    assert kin([]) == 0


def test_every_family_has_at_least_two_effects():
    """One alone would be a name without a meaning."""
    families = [get_effect(n).family for n in EFFECTS.names()]
    assert all(families.count(f) > 1 for f in families if f)


def test_a_large_part_of_the_gap_and_of_what_is_left_earns_a_name():
    """Neither alone is enough."""
    one, two = members("inertia"), members("inertia", "coulomb_friction")
    gain = 1.1 * FURTHER
    assert earned(one, two, gain, gain / LIMITS.further_effect_of_remainder * 0.9, GAP)
    assert not earned(one, two, gain, gain / LIMITS.further_effect_of_remainder * 1.1, GAP)
    assert not earned(
        one,
        two,
        0.9 * FURTHER,
        0.9 * FURTHER / LIMITS.whole_remainder * 1.1,
        GAP,
    )


def test_a_small_part_earns_it_if_it_is_nearly_all_that_was_left():
    """Not one so small that the laws' own errors reach it."""
    one, two = members("quadratic_drag"), members("quadratic_drag", "coulomb_friction")
    gain = 2 * SMALL
    assert earned(one, two, gain, gain / LIMITS.whole_remainder * 0.9, GAP)
    assert not earned(one, two, gain, gain / LIMITS.whole_remainder * 1.1, GAP)
    assert not earned(
        one,
        two,
        0.9 * SMALL,
        0.9 * SMALL,
        GAP,
    )


def test_a_relative_is_named_only_beside_what_is_no_cause_by_itself():
    """A harmonic beside gravity is what gravity's own law may look like, if little is left."""
    one, two = members("gravity_imbalance"), members("gravity_imbalance", "cogging_torque")
    assert not earned(one, two, 0.9 * NO_CAUSE, 0.9 * NO_CAUSE, GAP, whole=True)
    assert earned(one, two, 0.9 * NO_CAUSE, 1.1 * NO_CAUSE, GAP)


def test_a_weak_friction_beside_a_strong_drag_is_named():
    """It explains a hundredth of the gap, and all that the drag leaves."""
    experiments = record(
        ROTOR,
        "quadratic_drag:c=1e-4",
        "coulomb_friction:torque=0.01",
        count=4,
        volts=(-16.0, 16.0),
    )
    names = ("quadratic_drag", "coulomb_friction", "viscous_friction", "inertia", "sensor_gain")
    found = diagnose(ROTOR, experiments, effects=[get_effect(n) for n in names], workers=1)
    assert {n for group in found.verdict.acting for n in group} >= {names[0], names[1]}
    assert len(found.verdict.acting) == 2
    alone = next(c.score for c in found.candidates if c.effect == names[0])
    assert 1 - LIMITS.further_effect_of_gap < alone < 1 - LIMITS.small_effect_of_gap


def test_a_fit_passes_from_one_end_of_a_turn_to_the_other():
    """A phase just below pi is found from a start just above -pi."""
    experiments = record(MOTOR, "gravity_imbalance:torque=0.02,phase=3.0", volts=(-6.0, 6.0))
    residuals = FreeRunResiduals(MOTOR, experiments, (NOISE, 1.0))
    (c,) = candidates(MOTOR, ["gravity_imbalance"])
    start = c.coordinates({"torque": 0.015, "phase": -3.0})
    found = fit(residuals, [c], [start])
    phase = c.given(found.z[0])["phase"]
    assert abs(math.remainder(phase - 3.0, 2 * math.pi)) < 0.1
    assert -math.pi <= phase <= math.pi


@pytest.mark.slow
def test_frictions_that_fit_alike_do_not_take_every_place():
    """Beside three of them a load is found, and the plainest friction is among the answers."""
    experiments = record(ROTOR, "coulomb_friction:torque=0.1", "constant_load:torque=0.1")
    names = ["coulomb_friction", "stribeck_friction", "load_friction", "constant_load"]
    found = diagnose(ROTOR, experiments, effects=[get_effect(n) for n in names], workers=1)
    friction, load = sorted(found.verdict.acting, key=lambda group: "constant_load" in group)
    assert "coulomb_friction" in friction
    assert load == ["constant_load"]


def test_the_angle_matters_for_what_pulls_at_an_angle_alone():
    """Gravity and cogging follow the measured speed; friction runs free."""
    residuals = FreeRunResiduals(ROTOR, record(ROTOR), (NOISE, 1.0))
    for name, expected in (("gravity_imbalance", True), ("coulomb_friction", False)):
        effect = get_effect(name)
        assert residuals.angular([effect]) is expected
    assert np.isfinite(residuals.of()).all()


def searched(machine, *effects):
    """(a search that is done, the best pair) of a machine with two effects, the only candidates."""
    names = [e.split(":")[0] for e in effects]
    residuals = FreeRunResiduals(machine, record(machine, *effects))
    search = EffectSetSearch(residuals, candidates(machine, names))
    search.run()
    return search, search.found.of_size(2)[0]


def test_start_states_of_its_own_are_parameters_of_a_set():
    """A winding that is warm in each experiment does what a resistance does, and a little more.

    It came first in the group, and left 30 times the noise where the winding begins cold.
    """
    experiments = record(MOTOR, "armature_resistance:factor=1.3", count=4)
    residuals = FreeRunResiduals(MOTOR, experiments, (NOISE, 1.0))
    heating, resistance = candidates(MOTOR, ["winding_heating", "armature_resistance"])
    begin = heating.coordinates({"thermal_resistance": 4.0, "time_constant": 170.0})
    warm = fit(residuals, [heating], [begin])
    more = fit(residuals, [resistance], [resistance.coordinates({"factor": 1.2})])
    found = EffectSetSearch(residuals, [heating, resistance]).found
    for gain, better in ((3, False), (5, True)):  # by the price of so many start states
        alike = replace(warm, loss=more.loss - gain * LIMITS.start_state_gain)
        assert (found.loss(alike) < found.loss(more)) == better


def test_a_fit_that_went_astray_takes_no_share_from_the_others():
    """An effect may be neutral, so a set explains no less than each of its parts."""
    search, both = searched(MOTOR, "inertia:factor=1.3", "constant_load:torque=0.01")
    for name in both.names:
        alone = search.subset(both, [name])
        search.found.fits[frozenset([name])] = replace(alone, loss=1e12)
        shares = shapley_shares(search, both)
        assert all(0 <= s <= 1 for s in shares.values()), shares
        assert sum(shares.values()) == pytest.approx(1.0)
        search.found.fits[frozenset([name])] = alone


def test_shares_are_those_of_a_game_and_sum_to_1():
    """Of two effects: the mean of what each explains alone and after the other one."""
    search, both = searched(ROTOR, "coulomb_friction:torque=0.2", "inertia:factor=1.2")
    shares = shapley_shares(search, both)
    start = float(search.found.base @ search.found.base)
    alone = {f.names[0]: start - f.loss for f in search.found.of_size(1)}
    whole = start - both.loss
    expected = (alone["inertia"] + whole - alone["coulomb_friction"]) / 2 / whole
    assert shares["inertia"] == pytest.approx(expected)
    assert sum(shares.values()) == pytest.approx(1.0)


def fitted(*names, left=0.0):
    """A set that leaves so much power."""
    chosen, rest = tuple(members(*names)), np.array([math.sqrt(left)])
    return EffectFit(chosen, tuple(np.zeros(len(c)) for c in chosen), rest, np.zeros((1, 0)), left)


class Noiseless:
    """A band in which all power counts."""

    def excess(self, rest):
        return float(rest @ rest)

    speed_excess = excess

    def speed_gap(self, base, rest):
        return GAP

    def speed_loss(self, rest):
        return rest**2

    def speed_limit(self, chance):
        return 0.0

    def current_excess(self, rest):
        return 0.0

    def current_gain(self, before, after):
        return 0.0


class Exact:
    """Sets whose laws depart from the machine's in nothing."""

    excess, base, own_laws = GAP, np.zeros(1), 0.0
    refuted = frozenset()
    departures = SimpleNamespace(taken=lambda fitted: 0.0)

    def __init__(self, band):
        self.band = band

    def loss(self, fitted):
        return fitted.loss

    def left(self, fitted):
        return self.band.speed_excess(fitted.residual)

    def behind(self, fitted, best):
        return self.left(fitted) - self.left(best)

    def simulated_as(self, smaller, larger):
        return smaller


def test_a_simpler_set_may_leave_a_little_more_and_one_of_the_same_families_more():
    """Whatever the members' order; one with as many parameters must be as good."""
    best = fitted("stribeck_friction", "inertia")
    relative, other = fitted("inertia", "coulomb_friction"), fitted("inertia", "viscous_friction")
    assert plain_enough(other, best, 0.9 * LIMITS.simpler_set_of_gap * GAP, GAP)
    assert not plain_enough(other, best, 1.1 * LIMITS.simpler_set_of_gap * GAP, GAP)
    assert plain_enough(relative, best, 0.9 * KIN, GAP)
    assert not plain_enough(relative, best, 1.1 * KIN, GAP)
    assert not plain_enough(other, relative, 0.0, GAP)


def test_a_simpler_law_is_no_answer_where_it_leaves_what_would_be_unknown():
    """Coulomb's friction may stand for Stribeck's as long as it explains the gap."""
    best = fitted("stribeck_friction", left=0.01 * GAP)
    for left, names in ((0.02, "coulomb_friction"), (0.03, "stribeck_friction")):
        plain = fitted("coulomb_friction", left=left * GAP)
        assert plainest(Exact(Noiseless()), [best], [best, plain], GAP)[0].names == (names,)


def test_a_relative_is_named_beside_a_law_that_departs_if_it_takes_nearly_all_that_is_left():
    """A dead zone beside a dry friction; of an angle or a lag, departures know nothing."""
    one, two = members("load_friction"), members("load_friction", "input_deadzone")
    left = 0.9 * NO_CAUSE
    assert earned(one, two, 1.01 * LIMITS.relative * left, left, GAP)
    assert not earned(one, two, 0.99 * LIMITS.relative * left, left, GAP)
    for family in (("input_delay", "sensor_lag"), ("gravity_imbalance", "cogging_torque")):
        assert not earned(members(family[0]), members(*family), left, left, GAP)


class CurrentBand(Noiseless):
    """A speed and a current, one residual each, without noise."""

    free = (1.0, 1.0)
    samples = 1

    def speed_excess(self, rest):
        return float(rest[0] ** 2)

    def current_excess(self, rest):
        return float(rest[1] ** 2)

    def speed_loss(self, rest):
        return rest[:1] ** 2

    def speed_gain(self, before, after):
        return self.speed_excess(before) - self.speed_excess(after)

    def current_gain(self, before, after):
        return self.current_excess(before) - self.current_excess(after)


def two_channels(*names, speed, current):
    """A set that leaves so much power in each."""
    rest = np.sqrt([speed, current])
    return replace(fitted(*names), residual=rest, loss=speed + current)


def test_a_torque_that_the_current_alone_shows_is_named_beside_a_lag_of_the_sensor():
    """The lag takes nearly all of the speed's gap, and nothing of the current's."""
    found = Exact(CurrentBand())
    found.base = np.sqrt([GAP, GAP])
    lag = two_channels("sensor_lag", speed=0.02 * GAP, current=GAP)
    for current, named in ((0.01, True), (0.9, False)):
        both = two_channels("sensor_lag", "quadratic_drag", speed=0.01 * GAP, current=current * GAP)
        assert worth_more(found, lag, both, GAP) is named


def test_what_the_current_shows_is_a_cause_though_the_file_can_follow_the_speed():
    """Numbers of the file took most of the speed's gap before, so that little of it was left."""
    found = Exact(CurrentBand())
    found.excess = 100 * GAP
    cause = two_channels("viscous_friction", speed=0.3 * GAP, current=GAP)
    assert not no_cause(found, cause, GAP)
    found.excess = 2 * GAP
    assert no_cause(found, cause, GAP)


@pytest.mark.slow
def test_laws_of_one_family_that_hardly_differ_are_a_group():
    """A Coulomb friction with a little of Stribeck's peak is either; a large peak is Stribeck's."""
    found = {}
    tried = [e for e in map(get_effect, EFFECTS.names()) if e.family in ("dry friction", "drag")]
    tried += [get_effect("constant_load"), get_effect("inertia")]
    for static in (0.01, 0.2):
        law = f"stribeck_friction:torque=0.1,static={static},velocity=4"
        machine = record(ROTOR, law, count=4, volts=(-8.0, 8.0), samples=600, hold=60)
        found[static] = diagnose(ROTOR, machine, effects=tried).verdict.acting
    assert found[0.2] == [["stribeck_friction"]]
    ((*group,),) = found[0.01]
    assert group[0] == "stribeck_friction"  # what follows the machine best is what predicts it


def test_laws_of_one_family_that_differ_by_less_than_laws_are_off_are_as_good():
    """A filter of two poles, behind a slow winding, was a delay by e^26, and never a lag."""
    off = LIMITS.law_error**2 * GAP
    best = fitted("input_delay", "inertia", left=1.0)
    for part, names in ((0.9, True), (1.1, False)):
        relative = fitted("sensor_lag", "inertia", left=1.0 + part * off)
        other = fitted("input_delay", "viscous_friction", left=1.0 + part * off)
        found = as_good_as_first(Exact(Noiseless()), [best, relative, other])
        assert (relative in found) is names
        assert other not in found


def test_sets_that_differ_in_two_members_are_grouped_by_family():
    """A law of friction stands for another one, and not for what else differs."""
    zeros = np.zeros(1)
    sets = [
        EffectFit(tuple(candidates(ROTOR, names)), (zeros,) * 2, zeros, np.zeros((1, 2)), loss)
        for loss, names in (
            (1.0, ["no_regeneration", "stribeck_friction"]),
            (1.1, ["coulomb_friction", "open_circuit"]),
        )
    ]
    decision = Decision("ambiguous", sets[0], tuple(sets), 1.0, 0.0, False, None, {})
    assert decision.acting == [
        ["no_regeneration", "open_circuit"],
        ["stribeck_friction", "coulomb_friction"],
    ]


class SpeedBand(Noiseless):
    """The same of the speed alone, in which one deviation is noise."""

    speed_excess = Noiseless.excess
    samples = 1000

    def speed_gain(self, before, after):
        return self.excess(before) - self.excess(after)

    def speed_limit(self, alarm):
        return 1.0


@pytest.mark.parametrize("at_limit", [False, True])
def test_what_mends_little_and_has_no_size_is_no_further_effect(at_limit):
    """Its fit ended where the search does; a large part of the gap it may still take away."""
    power = 10 * THRESHOLDS.chance_gain
    smaller = fitted("constant_load", left=power)
    larger = fitted("constant_load", "torsional_compliance")
    if at_limit:
        z = larger.z[0], larger.members[1].bounds[1]
        larger = replace(larger, z=z)
    assert bool(larger.ended) is at_limit
    little = power / (0.9 * LIMITS.further_effect_of_gap)
    assert worth_more(Exact(SpeedBand()), smaller, larger, little) is not at_limit
    assert worth_more(Exact(SpeedBand()), smaller, larger, little / 2)


def test_what_only_departures_gain_names_no_further_effect():
    """A larger set has more laws that may depart: an inertia that explained nothing was named."""
    found = Exact(SpeedBand())
    smaller, larger = fitted("sensor_lag", left=0.1 * GAP), fitted("sensor_lag", "inertia")
    assert worth_more(found, smaller, larger, GAP)
    larger = fitted("sensor_lag", "inertia", left=0.099 * GAP)
    found.left = lambda f: 0.01 * GAP if f is larger else 0.1 * GAP
    assert not worth_more(found, smaller, larger, GAP)


@pytest.mark.parametrize("departing", [0.0, 0.7])
def test_what_takes_nearly_all_that_is_left_is_named_however_small_a_part_of_the_gap(departing):
    """A viscous friction of 0.2 % of a motor constant's gap cut the error from 2.6 noises to 1.1.

    Laws that depart could explain 70 % of what it takes, and it did not reach the noise. Nor did a
    brush's drop beside a resistance, which took 93 % of what departures could not explain.
    """
    left = 0.2 * LIMITS.small_effect_of_gap * GAP
    found = Exact(SpeedBand())
    found.left = lambda f: (1 - departing) * f.loss
    found.behind = lambda f, best: found.left(f) - found.left(best)
    smaller = fitted("motor_constant", left=left)
    for share, named in ((0.92, True), (0.88, False)):
        larger = fitted("motor_constant", "viscous_friction", left=(1 - share) * left)
        assert worth_more(found, smaller, larger, GAP) is named
        # Where quite different laws do as well, so small a part has no name.
        assert not worth_more(found, smaller, larger, GAP, departing=True)


@pytest.mark.parametrize(("beyond", "named"), [(5.0, True), (3.0, False)])
def test_what_departures_nearly_explain_is_no_further_effect(beyond, named):
    """Only what they plainly leave, at so many times what noise may, speaks for one more."""
    found, rest = Exact(SpeedBand()), 2 * THRESHOLDS.chance_gain
    smaller = fitted("motor_constant", left=rest)
    larger = fitted("motor_constant", "viscous_friction", left=0.07 * rest)
    found.left = lambda f: {smaller: beyond, larger: 0.02 * beyond}[f]
    found.behind = lambda f, best: 2 * THRESHOLDS.chance_gain
    assert worth_more(found, smaller, larger, GAP) is named


def test_a_set_that_was_refuted_does_not_keep_out_what_it_lacks():
    """An inertia left four times what a linear model does; of a sensor's lag beside it, 0.1 %."""
    found = Exact(SpeedBand())
    smaller = fitted("inertia", left=0.03 * GAP)
    larger = fitted("inertia", "sensor_lag", left=0.2 * 0.03 * GAP)
    found.left = lambda f: 0.1 * f.loss  # laws that depart could explain most of what is left
    found.behind = lambda f, best: found.left(f) - found.left(best)
    assert not worth_more(found, smaller, larger, GAP)
    found.refuted = {frozenset(["inertia"])}
    assert worth_more(found, smaller, larger, GAP)


def test_what_matters_to_no_prediction_earns_no_name():
    """A load that grew by a thousandth got a viscous friction beside it."""
    band = SpeedBand()
    band.samples = 1.1 * 2 * THRESHOLDS.chance_gain / THRESHOLDS.least_gap
    smaller = fitted("constant_load", left=2 * THRESHOLDS.chance_gain)
    larger = fitted("constant_load", "viscous_friction")
    assert not worth_more(Exact(band), smaller, larger, 1e6)
    band.samples /= 1.2
    assert worth_more(Exact(band), smaller, larger, 1e6)
