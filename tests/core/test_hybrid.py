"""Claims about the hybrid model, on machines whose missing acceleration is known."""

from __future__ import annotations

import functools
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from ldt_core.base.errors import LdtError, ModelError, OptionError
from ldt_core.base.experiment import Experiment, ModelRecord, rms
from ldt_core.base.pausable import finished
from ldt_core.effects import get_effect
from ldt_core.machine.machine_file import load_machine
from ldt_core.machine.plant import Plant
from ldt_core.models import restore_model
from ldt_core.models.gaussian_process import learn, sparse
from ldt_core.models.grey_box import GreyBoxModel
from ldt_core.models.hybrid import HybridModel
from ldt_core.models.physics import PhysicsModel

MACHINE = load_machine("rotor")
NOISE = 0.1  # rad/s
LIMIT_BYTES = 500_000  # of a record: it is sent as one message


def drag(speed, voltage):
    """Quadratic drag [rad/s²]: 30 at 45 rad/s, a tenth of it at 14."""
    return -0.015 * speed * abs(speed)


def experiments(
    force=drag, count=4, *, seed=0, noise=NOISE, samples=1000, period=0.01, low=6.0, high=16.0
):
    """Experiments of the model class: the ideal motor plus force(speed, voltage) [rad/s²].

    Integrated at 1 ms whatever the sample period, so that the period does not change the machine.
    """
    a, b, _, _ = MACHINE.model.state_space(MACHINE.parameters)
    fine = 10 if force is drag else 1  # a force with a memory counts samples
    step = period / fine
    augmented = np.zeros((3, 3))
    augmented[:2, :2], augmented[:2, 2] = a, b[:, 0]
    discrete = expm(augmented * step)[:2]
    result = []
    for number in range(1, count + 1):
        rng = np.random.default_rng([seed, number])
        hold = round(0.5 / period)
        voltage = np.repeat(rng.uniform(low, high, samples // hold + 1), hold)[:samples]
        i = w = 0.0
        speed = np.empty(samples)
        for k in range(samples):
            speed[k] = w
            for _ in range(fine):
                extra = step * float(force(w, voltage[k]))
                i, w = discrete @ (i, w, voltage[k])
                w += extra
        speed += noise * rng.standard_normal(samples)
        result.append(Experiment(number, 0.0, period, voltage, speed))
    return result


@functools.cache
def trained():
    return HybridModel(MACHINE).fit(experiments())


def rmse(model, held_out):
    return float(np.sqrt(np.mean([model.predict(e).residual(e) ** 2 for e in held_out])))


def spread(model, held_out):
    """Root mean square of residual over stated deviation."""
    predictions = [(model.predict(e), e) for e in held_out]
    return float(np.sqrt(np.mean([(p.residual(e) / p.speed_std) ** 2 for p, e in predictions])))


def learned_at(model, speed):
    """f_d [rad/s²] at these speeds."""
    return model.learned.posterior.mean(np.asarray(speed, dtype=float)[:, None])


def test_untrained_it_is_the_ideal_physics():
    """Nothing learned: the physics model's prediction to 1e-11, and no deviation."""
    for e in experiments(count=2, seed=5):
        ours, theirs = HybridModel(MACHINE).predict(e), PhysicsModel(MACHINE).predict(e)
        np.testing.assert_allclose(ours.speed, theirs.speed, rtol=0, atol=1e-11)
        assert ours.speed_std is None
        assert ours.model_version == 0


def test_a_measured_current_is_where_the_run_starts():
    """The first measured current enters as it does in the physics model."""
    e = experiments(count=1)[0]
    e = Experiment(1, 0.0, 0.01, e.voltage, e.speed, np.full(len(e), 8.0))
    ours, theirs = HybridModel(MACHINE).predict(e), PhysicsModel(MACHINE).predict(e)
    np.testing.assert_allclose(ours.speed, theirs.speed, rtol=0, atol=1e-11)


def test_a_known_drag_is_recovered():
    """Within 2 % of its largest value wherever the machine ran, from 4 experiments of 10 s."""
    speed = np.linspace(18, 40, 50)
    np.testing.assert_allclose(learned_at(trained(), speed), drag(speed, 0), atol=0.6)


def test_a_long_run_is_learned_in_parts(monkeypatch):
    """Memory that does not grow with it; the parts make the whole, but for rounding."""
    model, made = HybridModel(MACHINE), experiments(count=2)
    whole = model.fit(made)
    for module in (learn, sparse):
        monkeypatch.setattr(module, "ROWS", 37)
    parts = model.fit(made)
    one, other = (m.predict(made[0]) for m in (whole, parts))
    np.testing.assert_allclose(one.speed, other.speed, rtol=1e-6)
    np.testing.assert_allclose(one.speed_std, other.speed_std, rtol=1e-4)


def test_learning_takes_the_error_to_the_noise():
    """On new experiments: the physics is off by 2 rad/s and more, the model by the noise."""
    held_out = experiments(seed=1)
    assert rmse(PhysicsModel(MACHINE), held_out) > 2
    assert rmse(trained(), held_out) < 1.1 * NOISE


def test_noise_does_not_become_a_restoring_force():
    """A machine equal to its physics, watched by a bad sensor: nothing is learned.

    A regression on one-step differences finds a strong pull to each steady speed here, since the
    noise of a sample is in input and target. The acceleration of 1 rad/s² is 0.2 rad/s of speed.
    """
    nothing = experiments(lambda w, u: 0.0, noise=1.0, samples=1000)
    model = HybridModel(MACHINE).fit(nothing)
    assert np.abs(learned_at(model, np.linspace(18, 45, 100))).max() < 1.0
    assert model.learned.noise_std == pytest.approx(1.0, rel=0.1)


@pytest.mark.parametrize("noise", [0.0, 0.02, 0.5])
def test_the_sensors_noise_is_estimated(noise):
    """Within 10 %; a perfect sensor gives next to nothing and no failure."""
    model = HybridModel(MACHINE).fit(experiments(noise=noise, samples=500))
    assert model.learned.noise_std == pytest.approx(noise, rel=0.1, abs=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("step", [0.2, 1.0, 5.0])
def test_a_coarse_encoder_is_no_obstacle(step):
    """Speeds rounded to so many rad/s, no other noise: the error is that of rounding."""

    def rounded(seed):
        return [
            Experiment(e.number, 0.0, 0.01, e.voltage, np.round(e.speed / step) * step)
            for e in experiments(seed=seed, noise=0.0)
        ]

    assert rmse(HybridModel(MACHINE).fit(rounded(0)), rounded(1)) < 1.05 * step / np.sqrt(12)


def test_the_stated_deviation_is_the_real_one():
    """Residual over deviation has a spread of 0.8 to 1.25 on new data, averaged over 4 machines.

    Each machine's acceleration is drawn from a Gaussian process and seen for 10 s only, so that the
    function's own uncertainty counts. The band is that wide because errors are carried as fully
    correlated (too wide in transients) and four draws vary.
    """
    spreads = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        phase, rate = rng.uniform(0, 2 * np.pi, 40), rng.standard_normal(40) / 3
        force = lambda w, u, p=phase, r=rate: np.cos(r * w + p).sum() * 6 * np.sqrt(2 / 40)  # noqa: E731
        model = HybridModel(MACHINE).fit(experiments(force, 2, seed=seed, samples=500))
        spreads.append(spread(model, experiments(force, 2, seed=100 + seed, samples=500)))
    assert 0.8 < np.sqrt(np.mean(np.square(spreads))) < 1.25


def test_the_rest_that_no_function_of_speed_explains_is_in_the_deviation():
    """A torque that comes and goes in time: the stated deviation covers it on new data."""

    def moody(seed):
        rng = np.random.default_rng(seed)
        state = [0.0]

        def force(w, u):
            state[0] = 0.98 * state[0] + np.sqrt(1 - 0.98**2) * 8 * rng.standard_normal()
            return state[0] - 0.2 * w

        return force

    model = HybridModel(MACHINE).fit(experiments(moody(1), seed=1))
    assert model.learned.disturbance_std > 1
    assert 0.75 < spread(model, experiments(moody(2), seed=2)) < 1.3


def test_away_from_the_data_it_falls_back_to_physics_and_says_so():
    """Trained below 25 rad/s: at 70 rad/s f_d is 0, and the deviation has grown a lot."""
    slow = experiments(low=2.0, high=8.0)
    model = HybridModel(MACHINE).fit(slow)
    far = model.learned.span + 10 * model.learned.posterior.kernel.length_scales[0]
    assert abs(learned_at(model, [far])[0]) < 1e-6
    here, there = (
        model.predict(experiments(count=1, seed=9, low=u, high=u)[0]).speed_std[-1]
        for u in (5.0, 20.0)
    )
    assert there > 10 * here


@pytest.mark.slow
def test_the_record_stays_small_with_many_inducing_points():
    """Two inputs with fine detail fill the inducing points; the record still fits a message."""
    wavy = lambda w, u: 20 * np.sin(w / 2) * np.sin(2 * u)  # noqa: E731
    data = experiments(wavy, 8, noise=0.01)
    model = HybridModel(MACHINE, gp_inputs=["speed", "voltage"], inducing=1000).fit(data)
    assert len(model.learned.posterior.weights) > 200
    assert len(json.dumps(model.parameters)) < LIMIT_BYTES


def test_another_sample_period_is_predicted_too():
    """Trained at 100 Hz, it predicts experiments sampled at 50 and 200 Hz to the noise."""
    for period in (0.02, 0.005):
        held_out = experiments(seed=1, period=period, count=2)
        assert rmse(PhysicsModel(MACHINE), held_out) > 2
        assert rmse(trained(), held_out) < 1.5 * NOISE


def test_several_sample_periods_train_together():
    """Experiments at 100 and 50 Hz give one function."""
    both = experiments(count=2) + experiments(count=2, seed=2, period=0.02, samples=500)
    assert rmse(HybridModel(MACHINE).fit(both), experiments(seed=1)) < 1.2 * NOISE


@pytest.mark.parametrize("inputs", [["speed", "voltage"], ["current", "speed"]])
def test_more_inputs_learn_what_the_speed_alone_cannot(inputs):
    """A loss that depends on the voltage: with it, or with the current, the error falls by half."""
    lossy = lambda w, u: -0.08 * u * u + 0.1 * w  # noqa: E731
    data, held_out = experiments(lossy), experiments(lossy, 2, seed=1)
    alone = HybridModel(MACHINE).fit(data)
    more = HybridModel(MACHINE, gp_inputs=inputs).fit(data)
    assert rmse(more, held_out) < 0.5 * rmse(alone, held_out)


def worn_rotor(number):
    """20 s of the real rotor with e = 6 mm, from rest."""
    plant = MACHINE.with_parameters(e=0.006)
    rng = np.random.default_rng([6, number])
    voltage = np.repeat(rng.uniform(6, 16, 20), 100)
    start = plant.model.initial_state(plant.parameters, 0.0)
    speed = plant.model.simulate(plant.parameters, voltage, 0.01, start)[:, 1]
    return Experiment(number, 0.0, 0.01, voltage, speed + NOISE * rng.standard_normal(2000))


def test_the_real_rotor_is_predicted_better_than_by_physics():
    """e = 6 mm, 6 experiments of 20 s: the mean maximum error on new ones falls by a sixth or more.

    Far from all of it, as in the paper: the foundation has a memory, and speed alone has none.
    """
    model = HybridModel(MACHINE).fit([worn_rotor(n) for n in range(1, 7)])
    held_out = [worn_rotor(n) for n in range(11, 21)]
    ours, original = (
        np.mean([m.predict(e).max_error(e) for e in held_out])
        for m in (model, PhysicsModel(MACHINE))
    )
    assert ours < original * 5 / 6


def test_the_deviation_is_honest_where_the_class_is_wrong():
    """e = 6 mm, learned from one experiment: the next ones' residual over its stated deviation has
    a root mean square of 0.8 to 1.2 over six trainings. (Its own data a function fits too well.)"""
    found = []
    for trial in range(6):
        first, *others = (worn_rotor(20 * trial + k) for k in range(1, 5))
        found.append(spread(HybridModel(MACHINE).fit([first]), others))
    assert 0.8 < np.sqrt(np.mean(np.square(found))) < 1.2


STEADY = experiments(count=1, low=10.0, high=10.0)[0].part(500, 1000)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("data", "inputs", "words"),
    [
        ([], ["speed"], "got none"),
        ([experiments(count=1, samples=20)[0]], ["speed"], "expected at least 41 samples"),
        ([STEADY], ["speed"], "the speed stays within"),
        ([experiments(count=1, low=9, high=9)[0]], ["speed", "voltage"], "the voltage stays"),
        (
            [Experiment(1, 0, 0.01, np.ones(100), np.linspace(0, 1, 100) * 1e300)],
            ["speed"],
            "hybrid model|Gaussian process",
        ),
        (
            [Experiment(n, 0, 0.01, [1.0, 2.0], [0.0, n]) for n in range(1, 50)],
            ["speed"],
            "4 samples or more",
        ),
    ],
)
def test_data_that_teach_nothing_are_refused_with_a_sentence(data, inputs, words):
    """No data, too few, nothing that varies, absurd sizes: each says what is wrong."""
    with pytest.raises(LdtError, match=words):
        HybridModel(MACHINE, gp_inputs=inputs).fit(data)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"gp_inputs": ["sped"]}, "did you mean 'speed'"),
        ({"gp_inputs": []}, "one or more different inputs"),
        ({"gp_inputs": ["speed", "speed"]}, "one or more different inputs"),
        ({"inducing": 0}, "1 or more"),
    ],
)
def test_wrong_options_are_refused(options, words):
    """The option is named, and what it may be."""
    with pytest.raises(OptionError, match=words):
        HybridModel(MACHINE, **options)


@pytest.mark.parametrize(
    "change",
    [
        {"inputs": ["speed", "voltage"]},
        {"inputs": ["angle"]},
        {"inputs": []},
        {"signal_std": -1.0},
        {"length_scales": [1e-12]},
        {"weights": [1.0]},
        {"weights": "many"},
        {"inducing": [1.0, 2.0]},
        {"explained": []},
        {"explained": [[1.0], [1.0]]},
        {"noise_std": 0.0},
        {"memory": -1.0},
        {"noise_std": None},
        {"weights": None},
    ],
    ids=str,
)
def test_a_record_that_is_no_model_is_refused(change):
    """Wrong shapes, types and signs never become a model, nor an unclear failure."""
    good = trained().parameters
    bad = {**good, "gaussian_process": {**good["gaussian_process"], **change}}
    with pytest.raises(ModelError, match="hybrid model"):
        HybridModel.from_record(ModelRecord(1, "hybrid", (), bad), MACHINE)


@settings(max_examples=40, deadline=None)
@given(
    levels=st.lists(st.floats(-24, 24), min_size=1, max_size=5),
    start=st.floats(-1e3, 1e3),
    period=st.floats(1e-4, 0.1),
)
def test_any_run_stays_finite_and_honest(levels, start, period):
    """Whatever voltage, start and period: finite, bounded, and never surer than the sensor."""
    voltage = np.repeat(levels, 60)
    e = Experiment(1, 0.0, period, voltage, np.full(len(voltage), start))
    p = trained().predict(e)
    assert p.speed[0] == start
    assert np.abs(p.speed).max() < abs(start) + 24 / MACHINE.parameters["K_t"] + 100
    known = trained().learned
    assert p.speed_std.min() >= known.noise_std
    assert p.speed_std.max() <= known.span


@pytest.mark.slow
def test_it_learns_what_a_grey_box_leaves():
    """On the physics found, not on the file's; its record holds both."""
    motor = load_machine("dc_motor")
    drag, odd = get_effect("quadratic_drag"), get_effect("coulomb_friction")
    acting = [(drag, {"c": 2e-6}), (odd, {"torque": 0.004})]
    plant = Plant(motor, experiments=3, seed=2, degradation="none", effects=acting)
    first, second, third = (plant.experiment(i) for i in (1, 2, 3))
    grey = GreyBoxModel(motor)
    found = grey.adopt(finished(grey.search_on([first]).fitted(grey.present, (drag,))), [first])
    untrained = HybridModel(motor).on(found)
    off = untrained.predict(second).speed - found.predict(second).speed
    assert rms(off) < 0.1  # rad/s, for the noise of the first sample
    learned = untrained.fit([first, second])
    assert learned.parameters["effects"] == found.parameters["effects"]
    error = rms(learned.predict(third).residual(third))
    assert error < 0.5 * rms(HybridModel(motor).predict(third).residual(third))
    again = restore_model(learned.record(), motor, {"model": "hybrid"})
    assert (again.predict(third).speed == learned.predict(third).speed).all()
