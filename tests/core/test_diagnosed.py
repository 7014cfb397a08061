"""Claims about the diagnosed model, on machines whose cause is known."""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ldt_core.base.errors import LdtError, ModelError, OptionError
from ldt_core.base.experiment import Experiment, ModelRecord
from ldt_core.effects import get_effect, parse_effect
from ldt_core.estimation.effect.cause import Cause
from ldt_core.estimation.effect.start_angle import FoundAngle, believe
from ldt_core.estimation.noise import correlation_time
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine, machine_from_dict
from ldt_core.models import build_model
from ldt_core.models.diagnosed import DiagnosedModel
from ldt_core.models.physics import PhysicsModel

ROTOR = load_machine("rotor")
SHORT = replace(ROTOR, duration=10.0)
MOTOR = load_machine("dc_motor")
NOISE = 0.1  # rad/s


def plant(*effects, machine=SHORT, **options):
    acting = [parse_effect(text) for text in effects]
    return Plant(machine, degradation="none", effects=acting, **{"seed": 3, **options})


def worn(e, machine=SHORT, **options):
    return plant(f"unbalance:e={e}", machine=machine, **options)


def at_angle(angle, e, number, machine=SHORT, seed=3):
    """An experiment that starts at this angle [rad]."""
    made = worn(e, machine, seed=seed).experiment(number)
    values = {**machine.parameters, "e": e}
    start = machine.model.initial_state(values, 0.0)
    start[0] = angle
    speed = machine.model.simulate(values, made.voltage, made.period, start)[:, 1]
    noise = np.random.default_rng([seed, number]).normal(0.0, NOISE, speed.size)
    return Experiment(number, made.start, made.period, made.voltage, speed + noise)


@functools.cache
def trained(e=0.006, number=1):
    return DiagnosedModel(SHORT).fit([worn(e).experiment(number)])


def learned(model):
    return model.parameters["cause"]


def spread(model, held_out):
    """Root mean square of residual over stated deviation."""
    predictions = [(model.predict(e), e) for e in held_out]
    return float(np.sqrt(np.mean([(p.residual(e) / p.speed_std) ** 2 for p, e in predictions])))


def test_untrained_it_is_the_physics_bit_for_bit():
    """Nothing learned: the physics model's prediction, and no deviation."""
    e = worn(0.006).experiment(1)
    ours, theirs = DiagnosedModel(SHORT).predict(e), PhysicsModel(SHORT).predict(e)
    assert ours.speed.tobytes() == theirs.speed.tobytes()
    assert ours.speed_std is None
    assert ours.model_version == 0


@pytest.mark.parametrize("e", [0.003, 0.0081, 0.0122])
def test_one_experiment_tells_the_unbalance(e):
    """Within 0.5 %, and within 4 of the deviations that it states; the noise within 10 %."""
    found = learned(DiagnosedModel(SHORT).fit([worn(e).experiment(2)]))
    assert found["parameters"]["e"] == pytest.approx(e, rel=5e-3)
    assert abs(found["parameters"]["e"] - e) < 4 * found["std"]["e"]
    assert found["noise_std"] == pytest.approx(NOISE, rel=0.1)


def test_the_error_falls_to_the_noise():
    """On new experiments of the same machine, where the physics is off by 3 rad/s and more."""
    held_out = [worn(0.006).experiment(n) for n in range(3, 7)]
    assert np.mean([PhysicsModel(SHORT).predict(e).max_error(e) for e in held_out]) > 3
    model = DiagnosedModel(SHORT).fit([worn(0.006).experiment(n) for n in (1, 2)])
    assert np.mean([model.predict(e).max_error(e) for e in held_out]) < 5 * NOISE
    assert 0.8 < spread(model, held_out) < 1.25


def test_a_repaired_machine_is_found_again():
    """From 10 mm back to 1 mm, which hardly shows: the deviation says how well it is known."""
    bad = DiagnosedModel(SHORT).fit([worn(0.010).experiment(1)])
    good = learned(bad.fit([worn(0.001).experiment(2)]))
    assert abs(good["parameters"]["e"] - 0.001) < 4 * good["std"]["e"] < 0.002


@pytest.mark.slow
def test_an_experiment_in_which_next_to_nothing_decides_is_fitted_all_the_same():
    """5e-5 more unbalance moves this experiment by 1 rad/s, so that no scan can hit it."""
    e = worn(0.010, ROTOR, seed=1).experiment(181)
    found = learned(DiagnosedModel(ROTOR).fit([e]))
    assert found["parameters"]["e"] == pytest.approx(0.010, rel=1e-5)
    assert found["noise_std"] == pytest.approx(NOISE, rel=0.1)


def test_the_deviation_knows_the_edge_of_capture():
    """The unbalance known to 0.1 %, and yet a later experiment may end elsewhere: it says so."""
    machine = worn(0.010, ROTOR, seed=1)
    model = DiagnosedModel(ROTOR).fit([machine.experiment(174)])
    calm, edge = (model.predict(machine.experiment(n)) for n in (175, 181))
    assert learned(model)["std"]["e"] < 1e-3 * 0.010
    assert edge.speed_std.max() > max(3 * calm.speed_std.max(), 30 * NOISE)
    assert spread(model, [machine.experiment(181)]) < 2


def test_the_start_angle_is_found():
    """Half a turn makes no difference to a vertical shaft."""
    start = learned(DiagnosedModel(SHORT).fit([at_angle(0.7 + math.pi, 0.006, 1)]))["start"]
    assert start["turn"] == math.pi
    assert start["angle"] % math.pi == pytest.approx(0.7, abs=0.03)
    assert start["same_angle"] == pytest.approx(0.5)


@pytest.mark.slow
def test_a_machine_that_always_starts_alike_is_told_from_one_that_does_not():
    """From angles that two versions found one after the other."""

    def after(angles):
        model = DiagnosedModel(SHORT)
        for number, angle in enumerate(angles, 1):
            model = model.fit([at_angle(angle, 0.005 + 0.001 * number, number)])
        return model

    alike, free = after([0.7, 0.7]), after([0.7, 2.2])
    assert learned(alike)["start"]["same_angle"] > 0.9
    assert learned(free)["start"]["same_angle"] < 0.2
    e = at_angle(0.7, 0.007, 9)
    assert alike.predict(e).max_error(e) < 5 * NOISE
    assert free.predict(e).speed_std.max() > 2 * alike.predict(e).speed_std.max()
    assert np.abs(free.predict(e).residual(e) / free.predict(e).speed_std).max() < 5


def test_experiments_of_one_machine_are_learned_from_together():
    """At different angles, out of order; those of the machine before the drift are left out."""
    pool = [at_angle(a, e, n) for a, e, n in ((0.3, 0.006, 3), (1.0, 0.004, 1), (2.0, 0.006, 2))]
    model = DiagnosedModel(SHORT).fit(pool)
    assert sorted(model.trained_on) == [2, 3]
    alone = DiagnosedModel(SHORT).fit(pool[:1])
    assert learned(model)["parameters"]["e"] == pytest.approx(0.006, rel=5e-3)
    assert learned(model)["std"]["e"] < learned(alone)["std"]["e"]
    assert {int(n) for n, _, _ in learned(model)["start"]["seen"]} == {2, 3}


def test_the_noise_is_known_better_from_version_to_version_and_given_up_when_it_changes():
    """Two experiments weigh alike; a sensor with twice the noise is believed at once."""
    first = trained()
    one, two = worn(0.006).experiment(1), worn(0.008).experiment(2)
    alone = learned(DiagnosedModel(SHORT).fit([two]))
    both = learned(first.fit([two]))
    weights = learned(first)["noise_samples"], alone["noise_samples"]
    squares = learned(first)["noise_std"] ** 2, alone["noise_std"] ** 2
    assert both["noise_samples"] == pytest.approx(sum(weights), rel=1e-3)
    assert both["noise_std"] ** 2 == pytest.approx(np.average(squares, weights=weights), rel=1e-3)
    loud = worn(0.008, noise=2 * NOISE).experiment(2)
    changed = learned(first.fit([loud]))
    assert changed["noise_std"] == pytest.approx(2 * NOISE, rel=0.1)
    assert changed["noise_samples"] < 1.5 * len(one)


@pytest.mark.slow
def test_a_block_held_back_is_not_looked_at():
    """What stands in it does not move the result by more than a tenth of its deviation."""
    e = worn(0.006).experiment(1)
    block = slice(500, 750)
    speed = e.speed.copy()
    speed[block] += np.linspace(-3.0, 3.0, 250)
    other = Experiment(1, e.start, e.period, e.voltage, speed)
    clean, soiled = (DiagnosedModel(SHORT).fit_without([x], [block]) for x in (e, other))
    ours, theirs = (learned(m)["parameters"]["e"] for m in (clean, soiled))
    assert abs(ours - theirs) < 0.1 * learned(trained())["std"]["e"]
    assert learned(soiled)["noise_std"] == pytest.approx(NOISE, rel=0.1)


def test_the_gates_questions_do_not_change_the_answer():
    """After fits with blocks held back, the fit of everything is the same to the bit."""
    e = worn(0.006).experiment(1)
    model = DiagnosedModel(SHORT)
    model.fit_without([e], [slice(0, 250)])
    model.fit_without([e], [slice(250, 500)])
    assert model.fit([e]).parameters == trained().parameters


def test_what_the_effect_does_not_explain_is_in_the_deviation():
    """A winding that warms up as well: the rest is smooth, and makes the unbalance less sure."""
    both = plant("unbalance:e=0.006", "winding_heating:thermal_resistance=4,time_constant=5")
    model = DiagnosedModel(SHORT).fit([both.experiment(1)])
    found = learned(model)
    assert found["noise_std"] > 1.5 * NOISE
    assert found["memory"] > 3
    assert found["std"]["e"] > 3 * learned(trained())["std"]["e"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("machine", "effect", "tolerance"),
    [
        (SHORT, "coulomb_friction:torque=0.13", 0.01),
        (MOTOR, "viscous_friction:b=0.0003", 0.01),
        (MOTOR, "sensor_bias:bias=-2.1", 0.01),
        (MOTOR, "voltage_saturation:limit=8.3", 0.01),
        (MOTOR, "winding_heating:thermal_resistance=8,time_constant=6", 0.15),
    ],
    ids=lambda value: getattr(value, "name", value),
)
def test_other_causes_are_found_too(machine, effect, tolerance):
    """Terms in the equations, parameters, voltage, sensor; one parameter or two."""
    kind, true = parse_effect(effect)
    model = DiagnosedModel(machine, cause=kind.name)
    sick = plant(effect, machine=machine)
    model = model.fit([sick.experiment(1)])
    for name, value in true.items():
        assert learned(model)["parameters"][name] == pytest.approx(value, rel=tolerance)
    e = sick.experiment(2)
    assert model.predict(e).max_error(e) < 5 * NOISE


def test_a_cause_may_come_from_a_users_file(tmp_path):
    """As file.py:NAME, under which it is kept; a record cannot name a file by itself."""
    file = tmp_path / "mine.py"
    file.write_text(
        "from ldt_core.effects.base import Effect\n"
        "from ldt_core.physics.parameter import Parameter\n"
        "PULL = Effect('pull', 'a pull', 'torque = -T',\n"
        "    (Parameter('T', 'N m', 0.0, default=0.0, scale=0.01),), {'T': 0.01},\n"
        "    torque=lambda t, theta, omega, current, voltage, p: -p[0])\n"
    )
    name = f"{file}:PULL"
    sick = plant("constant_load:torque=0.012", machine=MOTOR).experiment(1)
    model = DiagnosedModel(MOTOR, cause=name).fit([sick])
    assert learned(model)["parameters"]["T"] == pytest.approx(0.012, rel=0.02)
    again = DiagnosedModel.from_record(model.record(), MOTOR, cause=name)
    assert again.predict(sick).speed.tobytes() == model.predict(sick).speed.tobytes()
    with pytest.raises(ModelError, match="not known"):
        DiagnosedModel.from_record(model.record(), MOTOR, cause="viscous_friction")


def test_a_running_start_is_no_obstacle():
    """Each experiment begins where the last one ended: speed, foundation and angle unknown."""
    running = worn(0.006, start="continue")
    made = [running.experiment(n) for n in range(1, 5)]
    model = DiagnosedModel(SHORT).fit([made[1]])
    assert learned(model)["parameters"]["e"] == pytest.approx(0.006, rel=0.02)
    assert learned(model)["noise_std"] == pytest.approx(NOISE, rel=0.1)
    assert learned(model)["start"]["seen"] == []
    for e in made[2:]:
        ours, original = model.predict(e), PhysicsModel(SHORT).predict(e)
        assert ours.max_error(e) < original.max_error(e)
        assert np.sqrt(np.mean((ours.residual(e) / ours.speed_std) ** 2)) < 2


def test_a_rotor_that_has_run_for_long_shakes_its_foundation_evenly():
    """From the running state the foundation has no transient; from a still one it has."""
    values = {**ROTOR.parameters, "e": 0.002}
    model = ROTOR.model
    steady, still = model.running_state(values, 40.0, 1.0), model.initial_state(values, 40.0)
    volts = np.full(1000, values["R"] * steady[2] + values["K_t"] * 40.0)

    def unevenness(start):
        x = np.abs(model.simulate(values, volts, 0.005, start)[:, 3])
        return abs(x[:200].max() / x[-200:].max() - 1)

    assert unevenness(steady) < 0.02
    assert unevenness(still) > 0.2


def test_which_angle_makes_no_difference_is_found_by_the_machine_itself():
    """Vertical shaft: half a turn; gravity: a whole one; no eccentricity: any angle."""

    def turn(machine, effect):
        return Cause(machine, machine.parameters, get_effect(effect)).turn

    assert turn(ROTOR, "unbalance") == math.pi
    assert turn(ROTOR.with_parameters(g=9.81), "unbalance") == 2 * math.pi
    assert turn(ROTOR, "coulomb_friction") == 0
    assert turn(ROTOR.with_parameters(e=0.006), "coulomb_friction") == math.pi
    assert turn(MOTOR, "viscous_friction") == 0


def test_a_cause_is_sought_in_the_machine_s_own_sizes():
    """A motor with a ten-thousandth of the torques turns as fast, and learns the same friction."""

    def friction(part):
        volts = math.sqrt(part)
        keys = {
            "name": "m",
            "physics": "dc_motor",
            "parameters": {
                "J": 1e-3 * part,
                "K_t": 0.05 * volts,
                "R": 1.0,
                "L": 1e-3,
                "b": 1e-4 * part,
            },
            "limits": {"voltage": [-24 * volts, 24 * volts]},
            "experiment": {"duration": 4, "sample_period": 0.01},
            "simulation": {
                "voltage": {"kind": "steps", "low": -12 * volts, "high": 12 * volts, "hold": 0.5},
                "noise": NOISE,
            },
        }
        small = machine_from_dict(keys, "m")
        sick = plant(f"coulomb_friction:torque={0.03 * part}", machine=small).experiment(1)
        found = DiagnosedModel(small, cause="coulomb_friction").fit([sick])
        return found.given["torque"] / part

    assert friction(1.0) == pytest.approx(0.03, rel=0.02)
    assert friction(1e-4) == pytest.approx(friction(1.0), rel=1e-3)


def test_angles_weigh_by_their_precision_and_round_the_turn():
    """Angles just above 0 and just below pi are the same; a wrong one among many does no harm."""
    alike = [FoundAngle(n, a, 0.02) for n, a in enumerate((0.01, math.pi - 0.02, 0.015), 1)]
    belief = believe(alike, math.pi)
    assert belief.same > 0.99
    assert min(belief.angle, math.pi - belief.angle) < 0.02
    assert believe([*alike, FoundAngle(9, 1.5, 0.01)], math.pi).same > 0.9
    assert believe([FoundAngle(n, 0.7 * n, 0.02) for n in range(1, 4)], math.pi).same < 0.1
    assert believe([], math.pi).same == 0.5


def test_the_correlation_time_is_that_of_a_known_process():
    """(1 + a) / (1 - a) for a first-order process, 1 for white noise."""
    white = np.random.default_rng(0).standard_normal(20_000)
    assert correlation_time(white) == pytest.approx(1.0, abs=0.1)
    red = white.copy()
    for k in range(1, red.size):
        red[k] += 0.9 * red[k - 1]
    assert correlation_time(red) == pytest.approx(19.0, rel=0.2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("samples", "cause", "words"),
    [
        (0, "unbalance", "got none"),
        (10, "unbalance", "20 samples or more"),
        (1000, "foundation_damping", "says nothing about"),
    ],
)
def test_data_that_teach_nothing_are_refused_with_a_sentence(samples, cause, words):
    """No data, too few, an effect that this machine cannot show."""
    data = [worn(0.006).experiment(1).part(0, samples)] if samples else []
    with pytest.raises(LdtError, match=words):
        DiagnosedModel(SHORT, cause=cause).fit(data)


def test_a_machine_that_cannot_have_the_cause_says_which_it_can():
    """The machine is named, and what to choose instead."""
    with pytest.raises(OptionError, match=r"'dc_motor' can have: one of .*viscous_friction"):
        build_model("diagnosed", MOTOR, {"cause": "unbalance"})
    with pytest.raises(OptionError, match="did you mean 'unbalance'"):
        DiagnosedModel(ROTOR, cause="unballance")


@pytest.mark.parametrize(
    "change",
    [
        {"effect": "wear"},
        {"effect": "coulomb_friction"},
        {"effect": 3},
        {"parameters": {}},
        {"parameters": {"e": -1.0}},
        {"parameters": {"e": "thick"}},
        {"noise_std": -1.0},
        {"start": None},
        {"start": {"turn": 3.1, "same_angle": 2.0, "seen": []}},
        {"start": {"turn": 3.1, "same_angle": 0.5, "seen": [[1, 0.1]]}},
        {"members": []},
        {"members": [[1.0, 0.0]]},
        {"members": [[0.5, 0.0, 0.006]]},
        {"members": [[1.0, None, 0.006]]},
    ],
    ids=str,
)
def test_a_record_that_is_no_model_is_refused(change):
    """Wrong names, shapes, types and values never become a model, nor an unclear failure."""
    good = trained().parameters
    bad = {**good, "cause": {**good["cause"], **change}}
    with pytest.raises((ModelError, OptionError), match=r"diagnosed model|effect unbalance"):
        DiagnosedModel.from_record(ModelRecord(1, "diagnosed", (), bad), SHORT)


@settings(max_examples=15, deadline=None)
@given(
    levels=st.lists(st.floats(-24, 24), min_size=1, max_size=3),
    start=st.floats(-80, 80),
    period=st.floats(1e-3, 0.05),
)
def test_any_run_stays_finite_and_honest(levels, start, period):
    """Whatever voltage, start and period: finite, and never surer than the sensor."""
    voltage = np.repeat(levels, 20)
    e = Experiment(1, 0.0, period, voltage, np.full(len(voltage), start))
    p = trained().predict(e)
    assert np.abs(p.speed).max() < abs(start) + 24 / SHORT.parameters["K_t"] + 20
    assert p.speed_std.min() >= trained().noise_std
