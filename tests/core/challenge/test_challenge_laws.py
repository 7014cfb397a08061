"""The challenge's machines against the twin's: the same physics, other laws, near parameters."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from made_case import make_case

from ldt_core.base.experiment import rms
from ldt_core.effects import EFFECTS, get_effect
from ldt_core.lab.challenge.case_plan import LEAST_EXPLAINED_SHARE, plan_case
from ldt_core.lab.challenge.case_plant import STATES, ideal
from ldt_core.lab.challenge.laws import LAWS, OUTSIDE
from ldt_core.lab.challenge.rig import KINDS, CaseBench, draw_excitation
from ldt_core.lab.challenge.simulation import Drive, motion_from_rest
from ldt_core.machine.machine_file import load_machine, machine_from_dict

pytestmark = pytest.mark.slow

ROTOR = load_machine("rotor")
RANDOM = np.random.default_rng(0)
PERIOD = 0.01
NOISE = 0.1
# Both ways and in steps: everything shows, and little is to be integrated.
MIDDLE = {"excitation": "reversing", "start": "rest", "noise": NOISE, "samples": 1000}


def motion(volts, **fields):
    """Motion of the rotor, from rest, with these numbers of its record."""
    plant = ideal(ROTOR.parameters)
    for name, value in fields.items():
        plant[name] = value
    return motion_from_rest(plant, Drive(np.asarray(volts, float), 0, PERIOD), RANDOM)


def state(moved, name):
    return moved.states[-1, STATES.index(name)]


@pytest.mark.parametrize("e", [0.0, 0.004])
@pytest.mark.parametrize("kind", ["steps", "reversing", "multisine"])
def test_without_a_law_the_rotor_moves_as_the_twins_physics_says(e, kind):
    """To 1e-6 rad/s in 10 s, from another integrator and other lines of code."""
    volts = draw_excitation(kind, np.random.default_rng(1)).voltage(
        1000, PERIOD, np.random.default_rng(2)
    )
    machine = ROTOR.with_parameters(e=e)
    rest = machine.model.initial_state(machine.parameters, 0.0)
    twin = machine.model.simulate(machine.parameters, volts, PERIOD, rest, max_step=1e-4)
    ours = motion_from_rest(ideal(machine.parameters), Drive(volts, 0, PERIOD), RANDOM)
    np.testing.assert_allclose(ours.speed, twin[:, 1], atol=1e-6)
    np.testing.assert_allclose(ours.current, twin[:, 2], atol=1e-6)


@pytest.mark.parametrize(("physics", "start"), [("dc_motor_rotor", "running"), ("dc_motor", "cut")])
def test_a_case_without_a_gap_is_its_machine_file_and_white_noise(physics, start):
    """What is left of it, next to the twin's free run from the true start, is the noise."""
    about = {"physics": physics, "start": start, "excitation": "steps", "samples": 1000}
    plan = plan_case("none", seed=(1,), **about)
    machine, bench = machine_from_dict(plan.machine, "case"), CaseBench(plan.setting)
    moved, measured = bench.run((), 1), bench.experiment((), 1)
    first = moved.states[0][: len(machine.model.states)]
    twin = machine.model.simulate(machine.parameters, measured.voltage, measured.period, first)
    np.testing.assert_allclose(moved.speed, twin[:, 1], atol=1e-6)
    left = measured.speed - twin[:, 1]
    rounded = plan.setting.quantum / math.sqrt(12)
    assert rms(left) == pytest.approx(math.hypot(plan.setting.noise, rounded), rel=0.1)
    assert abs(np.corrcoef(left[1:], left[:-1])[0, 1]) < 0.15
    assert abs(moved.speed[0]) > 1  # it was running


def test_the_laws_are_of_the_librarys_effects_by_their_names_and_units():
    """Each effect has a law, with the library's parameters in the library's units."""
    assert sorted(LAWS) == sorted(EFFECTS.names())
    for name, law in LAWS.items():
        assert dict(law.units) == {p.name: p.unit for p in get_effect(name).parameters}, name


def explained(name, seed):
    """The share of a case's gap that the law's nearest parameters explain in the twin."""
    plan = plan_case("single", [name], seed=(seed,), strength=6.0, **{**MIDDLE, "samples": 400})
    machine, bench = machine_from_dict(plan.machine, "case"), CaseBench(plan.setting)
    effect, key = get_effect(name), plan.truth["parameters"][name]
    used = [(effect, effect.check({n: p["value"] for n, p in key.items()}))]
    gap = left = 0.0
    for number in (1, 4, 7, 10):
        moved = bench.run(plan.acting, number)
        first = moved.states[0][: len(machine.model.states)]
        volts = bench.drive(number).volts
        states = machine.model.simulate(machine.parameters, volts, plan.setting.period, first, used)
        twin = machine.model.measure(states, plan.setting.period, used)
        gap += rms(moved.speed - bench.ideal_speed(number, moved.states[0])) ** 2
        left += rms(moved.speed - twin) ** 2
    assert plan.truth["explained"] >= LEAST_EXPLAINED_SHARE
    return 1 - left / gap


@pytest.mark.parametrize("name", sorted(LAWS))
def test_a_laws_nearest_parameters_explain_nearly_all_of_its_gap_in_the_twin(name):
    """And hardly ever all of it: no candidate is exactly right.

    In two of five cases: near capture, after a blow, or where friction holds, free runs part by
    rounding.
    """
    right = (0.95 <= explained(name, seed) < 1 - 1e-7 for seed in range(1, 6))
    assert sum(itertools.islice((1 for one in right if one), 2)) == 2


@pytest.mark.parametrize("name", sorted(OUTSIDE))
def test_every_outside_cause_makes_a_gap_of_the_strength_asked_for(name):
    """Within half of it in the median of three, and its entry names no effect."""
    slowest = name == "speed_limiter"
    asked, seeds = ({**MIDDLE, "samples": 500}, [2]) if slowest else (MIDDLE, [2, 3, 4])
    plans = [plan_case("outside", [name], seed=(s,), strength=4.0, **asked) for s in seeds]
    plan = sorted(plans, key=lambda p: p.truth["signal_to_noise"])[len(plans) // 2]
    assert 4 / 1.5 < plan.truth["signal_to_noise"] < 4 * 2
    assert plan.truth["effects"] == []
    assert plan.truth["parameters"] == {}
    assert plan.truth["outside"] == name


def test_bristles_take_their_level_from_a_steady_speed_and_hold_below_it():
    """K i = b omega + T turning; below the break-away torque the shaft only bends the bristles."""
    turning = motion(np.full(1000, 10.0), forward=0.2, backward=0.2)
    speed, current = state(turning, "omega"), state(turning, "current")
    assert 0.3 * current == pytest.approx(0.01 * speed + 0.2, rel=1e-6)
    held = motion(np.full(500, 1.0), forward=0.5, backward=0.5)
    assert state(held, "bristle") == pytest.approx(0.02 * 0.3 / 0.5, rel=1e-6)
    assert abs(state(held, "omega")) < 1e-6


def test_an_eddy_brake_loses_half_of_its_slope_at_its_strongest_speed():
    """Smythe: c omega / (1 + (omega / omega_c)^2)."""
    moved = motion(np.full(1000, 10.0), eddy=0.004, eddy_backward=0.004, eddy_slowness=1 / 25)
    speed, current = state(moved, "omega"), state(moved, "current")
    brake = 0.3 * current - 0.01 * speed
    assert brake == pytest.approx(0.004 * speed / (1 + (speed / 25) ** 2), rel=1e-6)


def test_a_winding_on_its_housing_settles_at_the_sum_of_both_resistances():
    """T = (R_w + R_h) P, from losses in the warm resistance."""
    hot = motion(
        *(np.full(2000, 12.0),),
        heat_winding=2.0,
        heat_housing=1.0,
        time_winding=0.3,
        time_housing=0.5,
        forward=1.0,
        backward=1.0,
    )
    rise, current = state(hot, "winding"), state(hot, "current")
    assert rise == pytest.approx(3.0 * (1 + 0.00393 * rise) * current**2, rel=1e-4)


def test_a_delay_moves_the_motion_and_nothing_else():
    """By 30 ms, which is three samples."""
    volts = np.repeat([8.0, 14.0, 6.0], 100)
    late, prompt = motion(volts, delay=0.03), motion(volts)
    assert np.all(late.speed[:4] == 0)
    np.testing.assert_allclose(late.speed[3:], prompt.speed[:-3], atol=1e-6)


def test_pieces_of_one_record_go_on_where_the_last_one_ended():
    """One run, cut: the state at a piece's first sample is one sample behind the last one's end."""
    plan = plan_case(
        "none", seed=(3,), physics="dc_motor", start="cut", excitation="steps", samples=400
    )
    bench = CaseBench(plan.setting)
    one, next_one = bench.run((), 4), bench.run((), 5)
    whole, count = bench.drive(5).volts, plan.setting.samples
    np.testing.assert_allclose(bench.drive(4).volts, whole[: whole.size - count])
    moved = motion_from_rest(ideal(plan.setting.known), bench.drive(5), RANDOM)
    np.testing.assert_allclose(moved.states, next_one.states)
    step = np.abs(next_one.speed[0] - one.speed[-1])
    assert step <= 1.5 * np.abs(np.diff(np.concatenate([one.speed, next_one.speed]))).max()


def test_a_drive_that_pauses_leaves_the_terminals_open_only_then():
    """The shaft coasts by its own friction, and brakes at any other command."""
    volts = np.repeat([10.0, 0.0, 2.0], 100)
    coasting, plain = motion(volts, open=100.0), motion(volts)
    slowing = ROTOR.parameters["b"] / ROTOR.parameters["J"]
    ratio = coasting.speed[199] / coasting.speed[110]
    assert ratio == pytest.approx(math.exp(-slowing * 89 * PERIOD), rel=0.05)
    assert plain.speed[199] < 0.5 * plain.speed[110]
    assert coasting.speed[-1] == pytest.approx(plain.speed[-1], rel=0.05)


def test_an_eddy_brake_may_be_another_one_backward():
    """K i = (b + eddy) omega, either way its own."""
    for volts, level in ((10.0, 0.004), (-10.0, 0.008)):
        moved = motion(np.full(1000, volts), eddy=0.004, eddy_backward=0.008)
        speed, current = state(moved, "omega"), state(moved, "current")
        assert 0.3 * current == pytest.approx((0.01 + level) * speed, rel=1e-6)


def test_a_backlash_lets_the_motor_turn_alone_through_its_gap():
    """The far end stands still until the gap is closed."""
    moved = motion(np.full(30, 2.0), far=0.01, J=0.01, coupling=60.0, backlash=0.2)
    angle, far = moved.states[:, 0], moved.states[:, STATES.index("far_angle")]
    assert np.all(far[angle < 0.2] == 0)
    assert far[-1] > 0


@pytest.mark.parametrize("kind", KINDS)
def test_excitations_stay_within_the_machines_limits(kind):
    """And turn both ways if they say so."""
    for seed in range(20):
        random = np.random.default_rng(seed)
        drawn = draw_excitation(kind, random)
        volts = drawn.voltage(2000, PERIOD, random)
        assert volts.size == 2000
        assert drawn.low - 1e-9 <= volts.min() < volts.max() <= drawn.high + 1e-9
        assert -24 <= drawn.low < drawn.high <= 16
        assert (volts.min() < 0) == drawn.reversing == kind.startswith("reversing")


def test_members_of_a_set_show_beside_one_another():
    """Each its own gap above the noise and above 15 % of the others', of different families."""
    truth = make_case("triple", seed=3, samples=500).truth
    gaps = [g / truth["noise"] for g in truth["own_gap_rms"].values()]
    assert len(truth["effects"]) == len(gaps) == 3
    assert min(gaps) >= 1
    assert min(gaps) >= 0.15 * max(gaps)
    families = [LAWS[name].family or name for name in truth["effects"]]
    assert len(set(families)) == 3


def test_a_phase_that_differs_from_experiment_to_experiment_is_null():
    """A shaft that starts at any angle has no one phase; amplitude and periods it has."""
    truth = plan_case("single", ["gravity_imbalance"], seed=(1,), start="angle", samples=500).truth
    parameters = truth["parameters"]["gravity_imbalance"]
    assert parameters["phase"] == {"value": None, "unit": "rad"}
    assert math.isfinite(parameters["torque"]["value"])
