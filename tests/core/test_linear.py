"""The linear model is the physics until it has learned, and then the machine as it is."""

from __future__ import annotations

import json

import numpy as np
import pytest

from ldt_core.errors import ExperimentError, LdtError, ModelError, OptionError
from ldt_core.experiment import Experiment, ModelRecord
from ldt_core.machine import Machine, load_machine
from ldt_core.models import build_model, restore_model
from ldt_core.models.linear import LinearModel
from ldt_core.models.physics import PhysicsModel


@pytest.fixture(scope="module")
def motor() -> Machine:
    return load_machine("dc_motor")


def measure(machine: Machine, number: int, noise: float = 0.1, offset: float = 0.0) -> Experiment:
    """1000 samples of the machine's own physics under a random voltage, from a random speed."""
    rng = np.random.default_rng(number)
    voltage = np.repeat(rng.uniform(4, 12, 40), 25)
    values = machine.parameters
    start = machine.model.initial_state(values, rng.uniform(0, 100))
    speed = machine.model.simulate(values, voltage, 0.01, start)[:, 1] + offset
    return Experiment(number, 0.0, 0.01, voltage, speed + noise * rng.normal(size=1000))


def rmse(model: LinearModel, e: Experiment) -> float:
    return float(np.sqrt((model.predict(e).residual(e) ** 2).mean()))


@pytest.mark.parametrize("name", ["dc_motor", "rotor"])
@pytest.mark.parametrize("current", [None, 3.0])
def test_untrained_it_predicts_as_the_physics(name, current):
    """Version 0 runs as the physics with e = 0, measured current included, to 1e-9."""
    machine = load_machine(name)
    e = measure(machine, 1)
    amperes = None if current is None else np.full(len(e), current)
    e = Experiment(1, 0.0, e.period, e.voltage, e.speed, amperes)
    ours, theirs = LinearModel(machine).predict(e), PhysicsModel(machine).predict(e)
    assert ours.speed == pytest.approx(theirs.speed, rel=1e-9, abs=1e-9)
    assert ours.speed_std is None
    assert ours.model_version == 0


def test_eccentric_rotor_is_taken_without_its_eccentricity():
    """A machine file with e > 0 is not linear: the linear model begins as the motor alone."""
    rotor = load_machine("rotor")
    e = measure(rotor, 1)
    worn = LinearModel(rotor.with_parameters(e=0.006))
    assert worn.predict(e).speed.tolist() == LinearModel(rotor).predict(e).speed.tolist()


def test_learning_follows_a_changed_machine(motor):
    """With the load's friction up fourfold and a constant load, one experiment brings the error of
    the next ones from far off down to the noise."""
    worn = motor.with_parameters(b=4e-4)
    es = [measure(worn, n, offset=-6.0) for n in range(1, 6)]
    before = LinearModel(motor)
    after = before.fit(es[:1])
    errors = [(rmse(before, e), rmse(after, e)) for e in es[1:]]
    assert all(old > 3 and new < 0.6 for old, new in errors)
    assert (after.version, after.trained_on) == (1, (1,))
    assert before.version == 0


def test_deviation_is_the_noise(motor):
    """speed_std is constant and within 5 % of the noise of 0.5 rad/s."""
    learned = LinearModel(motor, order=2).fit([measure(motor, n, noise=0.5) for n in (1, 2)])
    std = learned.predict(measure(motor, 3)).speed_std
    assert np.ptp(std) == 0
    assert std[0] == pytest.approx(0.5, rel=0.05)


def test_learning_forgets_what_it_is_not_given(motor):
    """A fit uses its experiments alone: the same ones give the same model from any predecessor."""
    es = [measure(motor, n) for n in (1, 2, 3)]
    fresh = LinearModel(motor).fit(es[:1])
    again = LinearModel(motor).fit(es[1:]).fit(es[:1])
    assert again.parameters == fresh.parameters
    assert (fresh.version, again.version) == (1, 2)


def test_model_from_a_record_predicts_bit_equally(motor):
    """A record sent as JSON text makes the same model, bit for bit."""
    learned = LinearModel(motor).fit([measure(motor, 1)])
    record = learned.record()
    text = json.loads(json.dumps(record.parameters, allow_nan=False))
    sent = ModelRecord(record.version, record.kind, record.trained_on, text)
    again = restore_model(sent, motor, {"model": "linear", "order": 0})
    e = measure(motor, 2)
    assert again.predict(e).speed.tobytes() == learned.predict(e).speed.tobytes()
    assert again.predict(e).speed_std.tobytes() == learned.predict(e).speed_std.tobytes()


def test_free_run_reads_no_later_measurement(motor):
    """Only the voltage and the first speed matter."""
    learned = LinearModel(motor).fit([measure(motor, 1)])
    e = measure(motor, 2)
    blind = np.full(len(e), e.speed[0])
    other = Experiment(2, 0.0, e.period, e.voltage, blind)
    assert learned.predict(other).speed.tobytes() == learned.predict(e).speed.tobytes()
    assert learned.predict(e).speed[0] == pytest.approx(e.speed[0], rel=1e-12)


def test_model_serves_other_sample_periods(motor):
    """Continuous time: learned at 100 Hz, it predicts at 50 Hz what it predicts at 100 Hz."""
    learned = LinearModel(motor).fit([measure(motor, 1)])
    e = measure(motor, 2)
    coarse = Experiment(2, 0.0, 0.05, e.voltage[::5], e.speed[::5])
    fine = Experiment(2, 0.0, 0.01, np.repeat(coarse.voltage, 5), np.repeat(coarse.speed, 5))
    run = learned.predict(fine).speed[::5]
    assert learned.predict(coarse).speed == pytest.approx(run, rel=1e-9)


def test_order_is_an_option(motor):
    """A given order is kept by all later fits; 0 chooses it."""
    es = [measure(motor, 1)]
    learned = build_model("linear", motor, {"model": "linear", "order": 3, "gate": "none"}).fit(es)
    assert learned.parameters["order"] == learned.fit(es).parameters["order"] == 3
    assert LinearModel(motor).fit(es).parameters["held_out"].keys() == {"1", "2", "3", "4"}
    with pytest.raises(OptionError, match="0 to 10"):
        LinearModel(motor, order=11)


WRONG = {
    "unstable": {"A": [[1.0]]},
    "integrator": {"A": [[0.0]]},
    "not square": {"A": [[-1.0, 0.0]]},
    "wrong length": {"B": [1.0, 2.0]},
    "text": {"C": ["fast"]},
    "not finite": {"offset": float("inf")},
    "order": {"order": 2},
    "noise": {"noise_std": -1.0},
    "list for D": {"D": [0.0, 1.0]},
}


@pytest.mark.parametrize("change", WRONG.values(), ids=WRONG)
def test_record_that_is_no_model_is_refused(motor, change):
    """A bad record is a ModelError that names the version, never a wrong prediction."""
    good = {
        "A": [[-1.0]],
        "B": [1.0],
        "C": [1.0],
        "D": 0.0,
        "offset": 0.0,
        "order": 1,
        "noise_std": None,
        "fit_percent": None,
    }
    LinearModel.from_record(ModelRecord(4, "linear", (), good), motor)
    with pytest.raises(ModelError, match="model version 4"):
        LinearModel.from_record(ModelRecord(4, "linear", (), {**good, **change}), motor)


def test_experiments_that_teach_nothing_are_refused(motor):
    """Constant voltage and mixed sample periods are refused with the reason."""
    e = measure(motor, 1)
    flat = Experiment(2, 0.0, 0.01, np.full(1000, 5.0), e.speed)
    slow = Experiment(3, 0.0, 0.02, e.voltage, e.speed)
    model = LinearModel(motor)
    with pytest.raises(LdtError, match="voltage is 5 V throughout"):
        model.fit([flat])
    with pytest.raises(ExperimentError, match="sample period"):
        model.fit([e, slow])
    with pytest.raises(ExperimentError, match="at least one"):
        model.fit([])


def test_a_model_shaped_like_another_learns_with_its_order(motor):
    """The gate chooses an order once and keeps it for its other trainings."""
    one = measure(motor, 1)
    third = LinearModel(motor, order=3).fit([one])
    shaped = LinearModel(motor).shaped_like(third)
    assert shaped.version == 0
    assert shaped.fit([one]).parameters["A"] == third.parameters["A"]
