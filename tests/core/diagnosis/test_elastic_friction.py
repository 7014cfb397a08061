"""Dry friction that builds up over a turn: found as a detail of its law, and only where it is."""

from __future__ import annotations

import json

import numpy as np
import pytest
from recorded_machines import MOTOR, record

from ldt_core.base.errors import OptionError
from ldt_core.base.experiment import Experiment
from ldt_core.checks import check_effect
from ldt_core.diagnosis.candidate import Candidate
from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.diagnosis.diagnosis import read_effects
from ldt_core.effects import EFFECTS, get_effect, parse_effect
from ldt_core.estimation.grey_box import COARSE_STEP, FINE_STEP, GreyBox
from ldt_core.machine.machine_file import load_machine
from ldt_core.models.hybrid import HybridModel
from ldt_core.models.physics import PhysicsModel

DETAILED = [n for n in EFFECTS.names() if get_effect(n).detailed is not None]
FINEST = [n for n in DETAILED if get_effect(n).detailed.detailed is not None]
ELASTIC = "coulomb_friction:torque=0.1,presliding=0.06"


@pytest.mark.parametrize("name", DETAILED)
def test_a_detailed_law_keeps_the_promises_of_an_effect(name):
    detailed = get_effect(name).detailed
    assert detailed.name == name
    assert detailed.family == get_effect(name).family
    assert check_effect(detailed)


@pytest.mark.parametrize("name", FINEST)
def test_all_detail_is_that_of_the_law_before_and_more(name):
    plain, finest = get_effect(name), get_effect(name).finest
    assert check_effect(finest)
    given = plain.detailed.check({**plain.typical, "presliding": 0.05})
    assert plain.in_detail(given) is plain.detailed
    assert plain.in_detail({*given, "change"}) is finest
    (one,), (same,), (other,) = (
        record(MOTOR, use, count=1, noise=0.0)
        for use in (
            (plain.detailed, given),
            (finest, finest.check(given)),
            (finest, finest.check({**given, "change": -0.5})),
        )
    )
    assert np.abs(one.speed - same.speed).max() < 1e-6
    assert np.abs(one.speed - other.speed).max() > 0.1


@pytest.mark.parametrize("name", DETAILED)
def test_a_small_turn_makes_it_the_plain_law(name):
    plain, detailed = get_effect(name), get_effect(name).detailed
    given = plain.check(plain.typical)
    (rough,) = record(MOTOR, (plain, given), count=1, noise=0.0)
    (fine,) = record(MOTOR, (detailed, {**given, "presliding": 1e-3}), count=1, noise=0.0)
    assert np.abs(rough.speed - fine.speed).max() < 0.02 * np.abs(rough.speed).max()


def test_the_steps_of_a_search_follow_bristles_at_any_speed():
    """A small motor turns by a small turn within a tenth of a millisecond."""
    machine, law = load_machine("dc_motor"), get_effect("coulomb_friction").detailed
    driven = Experiment(1, 0.0, 0.01, np.full(200, 12.0), np.zeros(200))
    box = GreyBox(machine, [law], {})
    for turn in (0.002, 0.02, 0.2):
        q = box.coordinates({law.name: {"torque": 0.05, "presliding": turn}}, np.zeros(0))
        coarse, fine = (box.speed(q, driven, True, step=s) for s in (COARSE_STEP, FINE_STEP))
        assert coarse[-1] > 150
        assert np.abs(coarse - fine).max() < 0.1  # the noise of a sensor of 0.1 % class


def test_the_detail_acts_where_it_is_given():
    assert parse_effect("coulomb_friction:torque=0.1")[0] is get_effect("coulomb_friction")
    effect, given = parse_effect(ELASTIC)
    assert effect.states
    assert given == {"torque": 0.1, "presliding": 0.06}
    (driven,) = record(MOTOR, (effect, given), count=1, noise=0.0)
    plain = get_effect("coulomb_friction"), given
    models = [PhysicsModel(MOTOR, effects=[use]) for use in (plain, (effect, given))]
    found = {"machine": dict(MOTOR.parameters), "effects": {effect.name: given}}
    models.append(HybridModel(MOTOR, {**found, "gaussian_process": None}))
    for model in models:
        assert np.abs(model.predict(driven).residual(driven)).max() < 1e-3
    with pytest.raises(OptionError, match="presliding"):
        parse_effect("coulomb_friction:torque=0.1,presliding=-1")


def relatives():
    """Of a friction, and what else may stand for it."""
    tried = [e for e in map(get_effect, EFFECTS.names()) if e.family in ("dry friction", "drag")]
    return [*tried, get_effect("constant_load"), get_effect("inertia")]


@pytest.mark.slow
def test_a_diagnosis_finds_the_turn_and_its_file_gives_it_back(tmp_path):
    held = [np.repeat(np.random.default_rng(k).uniform(-3, 3, 25), 20) for k in range(4)]
    experiments = record(MOTOR, ELASTIC, count=4, noise=0.02, levels=held)
    found = diagnose(MOTOR, experiments, effects=relatives())
    assert found.verdict.acting == [["coulomb_friction"]]
    assert found.gap.after.rmse < 0.022
    (named,) = found.effects
    assert named["parameters"]["torque"] == pytest.approx(0.1, rel=0.02)
    assert named["parameters"]["presliding"] == pytest.approx(0.06, rel=0.1)
    (tmp_path / "diagnosis.json").write_text(json.dumps(found.as_dict()))
    ((effect, given),) = read_effects(tmp_path / "diagnosis.json", MOTOR)
    assert effect.states
    assert given["presliding"] == pytest.approx(0.06, rel=0.1)


@pytest.mark.slow
def test_plain_friction_gets_no_turn():
    """Beside its relatives, and what else may stand for it."""
    experiments = record(MOTOR, "coulomb_friction:torque=0.1", noise=0.02)
    found = diagnose(MOTOR, experiments, effects=relatives())
    (named,) = found.effects
    assert named["parameters"].keys() == {"torque"}


def test_a_diagnosis_stops_at_the_first_detail():
    """A finer law would have coordinates that its search does not know."""
    detailed = Candidate(get_effect("coulomb_friction"), {}).detailed
    assert detailed is not None
    assert detailed.effect.detailed is not None
    assert detailed.detailed is None
