"""The linear model is the physics until it has learned, and then the machine as it is."""

from __future__ import annotations

import numpy as np
import pytest

from ldt_core.base.errors import ExperimentError, LdtError, ModelError, OptionError
from ldt_core.base.experiment import Experiment, ModelRecord
from ldt_core.machine.machine_file import Machine, load_machine
from ldt_core.models import build_model
from ldt_core.models.linear import LinearModel
from ldt_core.models.physics import PhysicsModel


@pytest.fixture(scope="module")
def motor() -> Machine:
    return load_machine("dc_motor")


def measure(
    machine: Machine,
    number: int,
    noise: float = 0.1,
    offset: float = 0.0,
    *,
    colour: float = 0.0,
    low: float = 4.0,
    high: float = 12.0,
    start: float | None = None,
) -> Experiment:
    """1000 samples of the machine's own physics under a random voltage, from a random speed."""
    rng = np.random.default_rng(number)
    voltage = np.repeat(rng.uniform(low, high, 40), 25)
    values = machine.parameters
    begin = rng.uniform(0, 100)
    state = machine.model.initial_state(values, begin if start is None else start)
    speed = machine.model.simulate(values, voltage, 0.01, state)[:, 1] + offset
    error = rng.normal(size=1000)
    for k in range(1, 1000):
        error[k] = colour * error[k - 1] + np.sqrt(1 - colour**2) * error[k]
    return Experiment(number, 0.0, 0.01, voltage, speed + noise * error)


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


def test_noise_of_the_first_current_is_no_current_of_a_machine_at_rest():
    """A winding of 0.4 s would keep it for as long."""
    slow = load_machine("dc_motor").with_parameters(J=0.017, K_t=0.39, R=1.36, L=0.57, b=0.01)
    noise = 0.05 * np.random.default_rng(1).standard_normal(400)
    about = (1, 0.0, 0.01, np.full(400, 6.0), np.zeros(400))
    with_noise = LinearModel(slow).predict(Experiment(*about, current=noise))
    without = LinearModel(slow).predict(Experiment(*about))
    assert np.array_equal(with_noise.speed, without.speed)


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


def normalised(model: LinearModel, es: list[Experiment]) -> float:
    """Root mean square of the residual over its stated deviation."""
    predictions = [(model.predict(e), e) for e in es]
    return float(np.sqrt(np.mean([(p.residual(e) / p.speed_std) ** 2 for p, e in predictions])))


@pytest.mark.slow
@pytest.mark.parametrize("colour", [0.0, 0.9])
@pytest.mark.parametrize("order", [0, 2])
def test_stated_deviation_is_the_real_one(motor, colour, order):
    """Learned from one experiment under noise of 1 rad/s, white or autoregressive: on new ones the
    residual over its stated deviation has a root mean square of 0.85 to 1.15 (six machines)."""
    found = []
    for n in range(6):
        es = [measure(motor, 10 * n + k, noise=1.0, colour=colour) for k in range(1, 5)]
        found.append(normalised(LinearModel(motor, order=order).fit(es[:1]), es[1:]))
    assert 0.85 < np.sqrt(np.mean(np.square(found))) < 1.15


def test_well_determined_it_deviates_by_the_noise(motor):
    """Within 5 % of the noise of 0.5 rad/s, once the run's start is forgotten."""
    learned = LinearModel(motor, order=2).fit([measure(motor, n, noise=0.5) for n in (1, 2)])
    std = learned.predict(measure(motor, 3)).speed_std
    assert std[200:] == pytest.approx(0.5, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("order", [0, 1, 2])
def test_poor_data_are_owned_up_to(motor, order):
    """Learned around 8 V ± 0.1 V, the errors at 2 to 22 V are many times the noise: the deviation
    says so, to a factor of two, and says that all is well at 8 V."""
    found, inside = [], []
    for n in range(8):
        near = [measure(motor, 10 * n + k, low=7.9, high=8.1, start=80.0) for k in (1, 2)]
        far = measure(motor, 10 * n + 3, low=2.0, high=22.0)
        learned = LinearModel(motor, order=order).fit(near[:1])
        found.append(normalised(learned, [far]))
        inside.append(learned.predict(near[1]).speed_std.mean())
        outside = learned.predict(far).speed_std
        assert outside.max() > 3 * inside[-1]
    assert 0.5 < np.sqrt(np.mean(np.square(found))) < 2
    assert np.median(inside) < 0.2


def test_a_makeshift_starts_as_its_data_did():
    """A machine that is no linear one: where the model's steady running is absurd (its speed hardly
    depends on the voltage), a run from rest is not off by more than the speeds that occur."""
    rng = np.random.default_rng(5)
    rotor = load_machine("rotor").with_parameters(e=0.011)
    worst = []
    for n in range(1, 6):
        pair = []
        for k in (1, 2):
            voltage = np.repeat(rng.uniform(6, 16, 20), 100)
            state = rotor.model.initial_state(rotor.parameters, 0.0)
            speed = rotor.model.simulate(rotor.parameters, voltage, 0.01, state)[:, 1]
            pair.append(Experiment(2 * n + k, 0.0, 0.01, voltage, speed + rng.normal(0, 0.1, 2000)))
        learned = LinearModel(rotor, order=2).fit(pair[:1])
        worst.append(learned.predict(pair[1]).max_error(pair[1]))
    assert max(worst) < 50


def test_the_papers_model_has_no_offset(motor):
    """Asked for none, the steady speed at 0 V is 0, and the gain is recovered within 1 %."""
    learned = LinearModel(motor, order=2, offset=False).fit([measure(motor, 1)])
    truth = LinearModel(motor).state_space.dc_gain
    assert learned.parameters["offset"] == 0
    assert learned.state_space.dc_gain == pytest.approx(truth, rel=0.01)
    assert learned.fit([measure(motor, 2, offset=5.0)]).parameters["offset"] == 0


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
    assert {"1", "2", "3"} <= LinearModel(motor).fit(es).parameters["held_out"].keys()
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

WRONG_LEARNED = {
    "no start": {"start": None},
    "start of another order": {"start": {"state": [0.0] * 3, "per_speed": [1.0] * 3}},
    "no others": {"others": None},
    "other model": {"others": [{}]},
    "C": {"C": [2.0, 0.0]},
    "noise": {"noise_std": -1.0},
    "not finite": {"start": {"state": [0.0, float("nan")], "per_speed": [1.0, 0.0]}},
}


@pytest.mark.parametrize("change", WRONG_LEARNED.values(), ids=WRONG_LEARNED)
def test_learned_record_that_is_no_model_is_refused(motor, change):
    """What a learned model has besides its matrices is looked at as well."""
    good = LinearModel(motor, order=2).fit([measure(motor, 1)]).parameters
    LinearModel.from_record(ModelRecord(4, "linear", (), good), motor)
    with pytest.raises(ModelError, match="model version 4"):
        LinearModel.from_record(ModelRecord(4, "linear", (), {**good, **change}), motor)


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
