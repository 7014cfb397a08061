"""The physics model: the machine file's equations, never adapted."""

from __future__ import annotations

import numpy as np
import pytest

from ldt_core.base.errors import LdtError, ModelError
from ldt_core.base.experiment import Experiment, ModelRecord
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine
from ldt_core.models import MODELS, build_model
from ldt_core.models.physics import PhysicsModel

ROTOR = load_machine("rotor")


def test_without_anything_unknown_the_error_is_the_noise():
    """From rest, no effect: the residual is white with the plant's standard deviation."""
    plant = Plant(ROTOR, seed=1, degradation="none", noise=0.1)
    model, residuals = PhysicsModel(ROTOR), []
    for i in range(1, 6):
        # The free run starts from a noisy first speed, which it forgets within seconds.
        residuals.append(model.predict(e := plant.experiment(i)).residual(e)[500:])
    assert np.std(residuals) == pytest.approx(0.1, rel=0.03)
    assert abs(np.mean(residuals)) < 0.01


def test_with_the_true_eccentricity_the_prediction_is_the_truth():
    """The same equations with e from the plant: equal to rounding."""
    plant = Plant(ROTOR, seed=1, degradation="none", noise=0.0).machine
    worn = plant.with_parameters(e=0.008)
    e = Plant(worn, seed=1, degradation="none", noise=0.0).experiment(3)
    np.testing.assert_allclose(PhysicsModel(worn).predict(e).speed, e.speed, atol=1e-9)
    assert PhysicsModel(ROTOR).predict(e).max_error(e) > 1


def test_it_starts_from_what_was_measured():
    """First speed and first current are the prediction's, wherever the experiment begins."""
    volts = np.full(50, 12.0)
    e = Experiment(1, 0.0, 0.01, volts, np.full(50, 20.0), np.full(50, 3.0))
    blind = Experiment(1, 0.0, 0.01, volts, np.full(50, 20.0))
    with_current, without = (PhysicsModel(ROTOR).predict(x).speed for x in (e, blind))
    assert with_current[0] == without[0] == 20.0
    assert with_current[1] > without[1]


def test_it_does_not_learn():
    """fit raises with a sentence."""
    assert not PhysicsModel.adaptive
    with pytest.raises(LdtError, match="does not learn"):
        PhysicsModel(ROTOR).fit([])


def test_its_record_makes_the_same_model():
    """Bit-equal predictions from the record, and a sentence for a record that cannot be one."""
    model = PhysicsModel(ROTOR)
    again = PhysicsModel.from_record(model.record(), ROTOR)
    e = Plant(ROTOR, seed=0).experiment(1)
    np.testing.assert_array_equal(again.predict(e).speed, model.predict(e).speed)
    good = dict(model.parameters["machine"])
    for wrong in ({}, {"machine": {**good, "J": -1.0}}, {"machine": {**good, "z": 1.0}}):
        with pytest.raises(ModelError, match="parameters of a physics model"):
            PhysicsModel.from_record(ModelRecord(0, "physics", (), wrong), ROTOR)


@pytest.mark.parametrize("name", MODELS.builtin)
def test_a_models_options_make_the_untrained_model_again(name):
    """Whatever the settings."""
    settings = {"order": 2, "offset": False, "inducing": 50, "cause": "coulomb_friction"}
    model = build_model(name, load_machine("dc_motor"), settings)
    again = type(model)(model.machine, **model.options)
    assert again.options == model.options
    assert (again.version, again.parameters) == (0, model.parameters)
