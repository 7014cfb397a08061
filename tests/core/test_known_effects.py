"""Effects and tolerances in a machine file: read, checked, and part of the machine everywhere."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

import ldt_core as ldt
from ldt_core.advice.machine_estimate import estimate_machine
from ldt_core.base.errors import MachineFileError, OptionError
from ldt_core.diagnosis.library import library
from ldt_core.effects import EFFECTS, get_effect, parse_effect
from ldt_core.estimation.grey_box import Prior
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import Machine, machine_from_dict
from ldt_core.models.diagnosed import DiagnosedModel
from ldt_core.models.grey_box import GreyBoxModel
from ldt_core.models.hybrid import HybridModel
from ldt_core.models.physics import PhysicsModel
from ldt_core.physics.machine_sizes import is_amount
from ldt_core.restart.run_key import key_text
from tests.motors import all_but

MOTOR = {
    "name": "motor",
    "physics": "dc_motor",
    "parameters": {"J": 0.002, "K_t": 0.055, "R": 1.2, "L": 0.002, "b": 0.0002},
    "limits": {"voltage": [-24, 24]},
    "experiment": {"duration": 2.0, "sample_period": 0.01},
    "simulation": {"voltage": {"kind": "steps", "low": 4, "high": 12, "hold": 0.4}, "noise": 0.05},
}
FRICTION = [{"name": "coulomb_friction", "parameters": {"torque": 0.03}}]
LOOSE = [{"name": "coulomb_friction", "parameters": {"torque": {"value": 0.03, "std": 0.006}}}]


def motor(**keys) -> Machine:
    """The motor with other keys in its file."""
    return machine_from_dict({**MOTOR, **keys}, "motor.yaml")


def test_a_parameter_may_have_a_deviation():
    """It takes the place of the physics' own, relative; the others keep theirs."""
    given = {**MOTOR["parameters"], "R": {"value": 1.2, "std": "1.2e-2"}}
    machine = motor(parameters=given)
    assert machine.parameters["R"] == 1.2
    assert machine.tolerances["R"] == pytest.approx(0.01)
    assert machine.tolerances["J"] == motor().tolerances["J"]
    assert machine.with_parameters(K_t=0.06).deviations == {"R": 0.012}
    assert Machine(machine.as_dict()) == Machine(json.loads(json.dumps(machine.as_dict())))
    assert machine.as_dict()["parameters"]["R"] == {"value": 1.2, "std": 0.012}


def test_effects_are_read_written_and_in_the_key_of_a_run():
    """The keys come back as they were, and another value is another machine."""
    machine = motor(effects=LOOSE)
    assert machine.as_dict()["effects"] == LOOSE
    assert machine_from_dict(machine.as_dict(), "motor.yaml") == machine
    assert machine.parameters["coulomb_friction.torque"] == 0.03
    assert machine.tolerances["coulomb_friction.torque"] == pytest.approx(0.2)
    assert "coulomb_friction.torque" not in motor(effects=FRICTION).tolerances
    assert len({key_text(m, {}) for m in (motor(), motor(effects=FRICTION), machine)}) == 3


@pytest.mark.parametrize("friction", ["coulomb_friction", "asymmetric_friction"])
def test_a_law_in_detail_acts_in_detail(friction):
    """Its file was read and its presliding lost; a calibration with it failed at its end."""
    detailed = get_effect(friction).finest
    given = detailed.check({**detailed.typical, "presliding": 0.3})
    effects = [{"name": friction, "parameters": given}]
    machine = motor(effects=effects)
    assert machine.as_dict()["effects"] == effects
    assert machine.with_parameters(J=0.003).parameters[f"{friction}.presliding"] == 0.3
    ((law, _),) = machine.effects
    assert law.states
    assert machine.effect(friction).neutral == given
    plain = motor(effects=[{"name": friction, "parameters": dict(detailed.typical)}])
    assert not plain.effects[0][0].states
    volts = np.repeat([0.0, 6.0, -6.0], 20)
    speeds = []
    for m in (plain, machine):
        start = m.model.initial_state(m.parameters, 0.0)
        speeds.append(m.model.simulate(m.parameters, volts, 0.01, start)[:, 1])
    assert np.abs(speeds[1] - speeds[0]).max() > 0.05


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"R": {"value": 1.2, "std": 0}}, "a standard deviation above 0"),
        ({"R": {"value": 1.2, "std": -1.0}}, "a standard deviation above 0"),
        ({"R": {"value": 1.2, "std": True}}, "R.std: expected a number"),
        ({"R": {"value": 1.2, "std": "much"}}, "R.std: expected a number"),
        ({"R": {"std": 0.1}}, "the key 'value'"),
        ({"R": {"value": 1.2, "spread": 0.1}}, "'spread'"),
        ({"R": True}, "parameters.R: expected a number"),
        ({"R": {"value": -1.0, "std": 0.1}}, "above 0"),
        ({"b": {"value": 0.0, "std": 0.1}}, "other than 0"),
        ({"coulomb_friction.torque": 0.1}, "unknown key 'coulomb_friction.torque'"),
    ],
)
def test_wrong_parameters_get_a_sentence(keys, said):
    """Each names the parameter and what was expected."""
    with pytest.raises(MachineFileError, match=re.escape(said)) as told:
        motor(parameters={**MOTOR["parameters"], **keys})
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("effects", "said"),
    [
        ({"coulomb_friction": 0.1}, "a list of {name: , parameters: }"),
        ([["coulomb_friction"]], "entry 1: expected names with values"),
        ([{"name": "coulomb_friction"}], "the key 'parameters'"),
        ([{"name": "colomb_friction", "parameters": {"torque": 0.1}}], "coulomb_friction"),
        ([{"name": 3, "parameters": {"torque": 0.1}}], "3"),
        ([{"name": "/tmp/mine.py:DRAG", "parameters": {"c": 0.1}}], "'/tmp/mine.py:DRAG'"),
        ([{"name": "unbalance", "parameters": {"e": 0.001}}], "a machine with parameter e"),
        (FRICTION + LOOSE, "one entry an effect"),
        ([{"name": "coulomb_friction", "parameters": {}}], "a value for torque"),
        ([{"name": "coulomb_friction", "parameters": {"force": 1.0}}], "'force'"),
        ([{"name": "coulomb_friction", "parameters": {"torque": -0.1}}], "at least 0"),
        ([{"name": "coulomb_friction", "parameters": {"torque": True}}], "a number"),
        ([{"name": "viscous_friction", "parameters": {"b": -1.0}}], "viscous_friction"),
    ],
)
def test_wrong_effects_get_a_sentence(effects, said):
    """What it is about, what was expected, what was found."""
    with pytest.raises(MachineFileError, match=re.escape(said)) as told:
        motor(effects=effects)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("name", EFFECTS.builtin)
def test_a_known_effect_is_the_effect_given_to_a_simulation(name):
    """Simulated and predicted, with the sensor's, the states' and the parameters' effects."""
    typical = get_effect(name).check(get_effect(name).typical)
    record = {
        **ldt.Machine("rotor").as_dict(),
        "experiment": {"duration": 1, "sample_period": 0.01},
    }
    bare = Machine(record)
    known = Machine({**record, "effects": [{"name": name, "parameters": typical}]})
    (without,) = ldt.simulate(bare, 1, effects={name: typical}, noise=0.0)
    (having,) = ldt.simulate(known, 1, noise=0.0)
    assert np.array_equal(without.speed, having.speed)
    acting = [(get_effect(name), typical)]
    told = PhysicsModel(bare, effects=acting).predict(without).speed
    assert np.array_equal(PhysicsModel(known).predict(without).speed, told)


def test_known_effects_with_states_go_on_with_others():
    """`continue` hands on all states; an effect of the plant has its own behind the known one's."""
    heating = get_effect("winding_heating")
    keys = [{"name": heating.name, "parameters": heating.check(heating.typical)}]
    begun = {**MOTOR["simulation"], "start": "continue", "noise": 0.0}
    twist = get_effect("torsional_compliance")
    known = motor(effects=keys, simulation=begun)
    plants = [
        Plant(known, effects=[(twist, twist.check(twist.typical))]),
        Plant(
            motor(simulation=begun),
            effects=[(e, e.check(e.typical)) for e in (heating, twist)],
        ),
    ]
    one, other = ([p.experiment(n).speed for n in (1, 2, 3)] for p in plants)
    assert np.array_equal(one, other)


def test_the_plant_s_value_wins_and_that_is_said():
    """An effect given in both acts once, with what was given to the plant."""
    given = [parse_effect("coulomb_friction:torque=0.05")]
    plant = Plant(motor(effects=FRICTION), effects=given)
    alone = Plant(motor(), effects=given)
    assert np.array_equal(plant.experiment(1).speed, alone.experiment(1).speed)
    words = (
        "coulomb_friction:torque=0.05 in place of the machine file's coulomb_friction:torque=0.03"
    )
    assert words in plant.describe()


def test_wear_begins_with_what_is_known():
    """Values that do not wear are the file's."""
    stribeck = {"torque": 0.03, "static": 0.02, "velocity": 8.0}
    machine = motor(effects=[{"name": "stribeck_friction", "parameters": stribeck}])
    wear = {"kind": "abrupt", "effect": "stribeck_friction", "parameter": "torque"}
    keys = {
        "voltage": MOTOR["simulation"]["voltage"],
        "degradation": {**wear, "from": 0, "to": 0.1},
    }
    worn = Plant(Machine({**machine.as_dict(), "simulation": keys}), experiments=10)
    ((_, values),) = worn.acting(10)
    assert values == {**stribeck, "torque": 0.1}


@pytest.fixture(scope="module")
def rubbing():
    """Experiments of the motor with 0.03 N m of dry friction."""
    return ldt.simulate(motor(effects=FRICTION), 4, seed=2)


@pytest.mark.parametrize("kind", [PhysicsModel, GreyBoxModel, HybridModel])
def test_untrained_models_have_the_known_effects(kind, rubbing):
    """All predict to the noise of 0.05 rad/s; without them the error is some 10 rad/s."""
    for e in rubbing:
        assert np.std(kind(motor(effects=FRICTION)).predict(e).speed - e.speed) < 0.06
        assert np.std(kind(motor()).predict(e).speed - e.speed) > 0.3


def test_a_diagnosed_model_without_its_cause_has_the_known_effects(rubbing):
    """Of another cause, and of the known effect itself, whose neutral value is the known one."""
    for cause in ("quadratic_drag", "coulomb_friction"):
        model = DiagnosedModel(motor(effects=FRICTION), cause=cause)
        assert np.std(model.predict(rubbing[0]).speed - rubbing[0].speed) < 0.06


def test_a_diagnosed_model_finds_that_a_known_effect_has_grown_less():
    """From 0.03 down to 0.02 N m: the whole effect is learned, not what has come on top."""
    machine = motor(effects=FRICTION)
    (e,) = ldt.simulate(machine, 1, effects={"coulomb_friction": {"torque": 0.02}}, seed=4)
    before = DiagnosedModel(machine, cause="coulomb_friction")
    after = before.fit([e])
    assert after.given["torque"] == pytest.approx(0.02, rel=0.02)
    assert after.change(before) == "coulomb friction has fallen to 0.02 N m"


def test_the_grey_box_knows_known_effects_within_their_deviation():
    """With a std the torque is uncertain and found again; without one it is exact."""
    plant = motor(effects=[{"name": "coulomb_friction", "parameters": {"torque": 0.036}}])
    experiments = ldt.simulate(plant, 2, seed=5)
    loose, exact = GreyBoxModel(motor(effects=LOOSE)), GreyBoxModel(motor(effects=FRICTION))
    assert "coulomb_friction.torque" in loose.box.uncertain
    assert "coulomb_friction.torque" not in exact.box.uncertain
    found = loose.fit(experiments)
    assert np.std(found.predict(experiments[1]).speed - experiments[1].speed) < 0.06
    assert found.parameters["machine"]["coulomb_friction.torque"] == pytest.approx(0.036, rel=0.1)


def test_the_hybrid_learns_what_the_known_effects_leave():
    """Dry friction known, quadratic drag not: a part of the error of the untrained model."""
    machine = motor(effects=FRICTION)
    drag = {"quadratic_drag": {"c": 3e-6}}
    experiments = ldt.simulate(machine, 6, effects=drag, seed=6)
    before, after = HybridModel(machine), HybridModel(machine).fit(experiments[:4])
    e = experiments[-1]
    was, now = (np.std(m.predict(e).speed - e.speed) for m in (before, after))
    assert was > 0.5
    assert now < 0.3 * was


@pytest.mark.slow
def test_a_diagnosis_knows_the_known_effects(rubbing):
    """No gap where the file has the friction; the file's friction is neutral for its candidate."""
    found = ldt.diagnose(rubbing, motor(effects=FRICTION))
    assert found.verdict.kind == "none"
    candidates = {e.name: e for e in library(motor(effects=FRICTION))}
    assert candidates["coulomb_friction"].neutral == {"torque": 0.03}
    assert candidates["quadratic_drag"].neutral == {"c": 0.0}


@pytest.mark.slow
def test_a_diagnosis_names_the_whole_of_a_known_effect_that_changed():
    """Friction known as 0.03 is 0.05 N m; predicted with that, the error is the noise."""
    both = {"voltage": {"kind": "steps", "low": -12, "high": 12, "hold": 0.4}, "noise": 0.05}
    machine = motor(effects=FRICTION, simulation=both)
    measured = ldt.simulate(machine, 6, effects={"coulomb_friction": {"torque": 0.05}}, seed=3)
    others = all_but("coulomb_friction", "viscous_friction", "quadratic_drag", "motor_constant")
    found = ldt.diagnose(measured, machine, without=others)
    assert found.verdict.effects == ["coulomb_friction"]
    (named,) = found.effects
    assert named["parameters"]["torque"] == pytest.approx(0.05, rel=0.02)
    assert found.gap.after.rmse < 0.06


def test_advice_counts_with_the_known_eccentricity():
    """An unbalance in `effects` is the eccentricity; friction is said not to be counted in."""
    record = {**ldt.Machine("rotor").as_dict(), "effects": FRICTION}
    record["effects"] = [*FRICTION, {"name": "unbalance", "parameters": {"e": 0.005}}]
    belief = estimate_machine(Machine(record))
    assert belief.values["e"] == pytest.approx(0.005)
    assert belief.left_out == ("coulomb_friction",)


def test_with_effects_replaces_and_refuses():
    """What is taken into a file is there once; an effect of a user's file cannot be."""
    more = motor(effects=LOOSE).with_effects([parse_effect("coulomb_friction:torque=0.01")])
    assert more.as_dict()["effects"] == [
        {"name": "coulomb_friction", "parameters": {"torque": 0.01}}
    ]
    assert get_effect("coulomb_friction").neutral == {"torque": 0.0}
    with pytest.raises(OptionError):
        motor(effects=LOOSE).effect("nothing_known")


def test_a_known_effect_that_is_as_the_file_says_has_not_gone():
    """It acts as before: the twin only takes it for no other than the file's any more."""
    plain = GreyBoxModel(motor(effects=FRICTION))
    grown = {**plain.parameters, "effects": {"coulomb_friction": {"torque": 0.05}}}
    grown["intervals"] = {"coulomb_friction": {"torque": [0.048, 0.052]}}
    words = plain.change(GreyBoxModel(plain.machine, grown, 1))
    assert words == "coulomb friction is the file's again"


def test_a_known_effect_may_change_again_and_again():
    """A file from `ldt calibrate --with`: all that is known has a deviation.

    That the friction may act as before was asked of a machine with fewer unknowns, by what was
    known of more: the twin learned nothing for the rest of its life.
    """
    leads = {"name": "source_resistance", "parameters": {"resistance": {"value": 0.3, "std": 0.05}}}
    both = {"voltage": {"kind": "steps", "low": -12, "high": 12, "hold": 0.4}, "noise": 0.05}
    machine = motor(effects=[*LOOSE, leads], simulation=both)
    twin, said, number = ldt.Twin(machine), [], 0
    for torque in (0.03, 0.1, 0.2, 0.06):
        use = {"coulomb_friction": {"torque": torque}}
        for e in ldt.simulate(machine, 2, effects=use, seed=5):
            number += 1
            step = twin.step(replace(e, number=number, start=10.0 * number))
            if step.signal.state != "holds":
                said.append(step.adaptation.reason)
    first, second, third = said
    assert "coulomb friction has grown to 0.1" in first
    assert "coulomb friction has grown to 0.2" in second
    assert "coulomb friction has fallen to 0.06" in third
    assert not any(
        "not told apart" in words and "coulomb_friction.torque" in words for words in said
    )


def test_a_known_effect_of_the_machines_numbers_takes_the_place_of_its_own():
    """What a change of it moves is seen in its own number, too: no KeyError ends a search."""
    leads = {"name": "source_resistance", "parameters": {"resistance": {"value": 0.3, "std": 0.05}}}
    model = GreyBoxModel(motor(effects=[leads]))
    moved = model.box.changed_by(model.machine.effect("source_resistance"))
    assert moved == {"R", "source_resistance.resistance"}
    gain = {"name": "input_gain", "parameters": {"factor": {"value": 1.02, "std": 0.05}}}
    model = GreyBoxModel(motor(effects=[gain]))
    assert model.box.changed_by(model.machine.effect("input_gain")) == {"input_gain.factor"}


def test_how_much_of_an_effect_there_is_does_not_depend_on_what_is_known():
    """A friction of 0.03 N m is as much an amount as one of 0; a width is none either way."""
    law, known = (
        get_effect("stribeck_friction"),
        {"stribeck_friction": {"torque": 0.03, "static": 0.04}},
    )
    given = [{"name": n, "parameters": p} for n, p in known.items()]
    about = motor(effects=given).effect("stribeck_friction")
    amounts = {p.name: is_amount(p) for p in law.parameters}
    assert {p.name: is_amount(p) for p in about.parameters} == amounts
    assert True in amounts.values()


def test_what_is_known_of_coordinates_holds_for_those_that_stay():
    """Of the others whatever they are; a new one is the file's."""
    known = Prior(np.array([1.0, 2.0]), np.linalg.inv([[2.0, 0.5], [0.5, 1.0]]))
    found = known.among(["a", "b"], ["new", "a"])
    assert found.mean.tolist() == [0.0, 1.0]
    assert np.linalg.inv(found.precision) == pytest.approx(np.diag([1.0, 2.0]))
