"""The adequacy detector: what it calls explained, and how often it is wrong about that."""

from __future__ import annotations

import itertools
import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from ldt_core.base.errors import OptionError
from ldt_core.base.experiment import Level
from ldt_core.detectors.adequacy import Adequacy
from ldt_core.detectors.excited_range import AFTER, hull, samples_within
from ldt_core.estimation import far_samples
from ldt_core.estimation.far_samples import in_blows
from ldt_core.estimation.misfit import misfit, noise_in, setting

EVERY = 100


def white(random, length):
    return random.normal(size=length)


def student(random, length):
    return random.standard_t(3, size=length)


def other_scale(random, length):
    return random.normal(size=length) * np.exp(random.normal())


def with_memory(random, length, persistence=0.9):
    drive = random.normal(size=length + 500)
    return lfilter([1.0], [1.0, -persistence], drive)[500:]


def outliers(random, length):
    """Of which no moment exists."""
    return random.standard_cauchy(size=length)


def growing(random, length):
    return random.normal(size=length) * np.linspace(0.1, 10, length)


@pytest.mark.parametrize("length", [20, 50, 1000])
@pytest.mark.parametrize("noise", [white, student, other_scale, outliers, growing])
def test_false_alarms_are_no_more_than_stated(noise, length):
    """One in `false_alarm_every`, for independent symmetric noise of any law and scale."""
    random, detector, count = np.random.default_rng(1), Adequacy(EVERY), 1000
    positives = 0
    for _ in range(count):
        detector.update(noise(random, length))
        positives += detector.drift_detected
    assert positives <= count / EVERY


@pytest.mark.slow
@pytest.mark.parametrize("law", [white, student, other_scale, outliers, growing])
@settings(max_examples=3)  # of 800 e-values each
@given(seed=st.integers(0, 10_000), length=st.integers(20, 300))
def test_the_e_value_has_a_mean_of_at_most_one(law, seed, length):
    """Over all signs and orders of the same sizes: drawn at random, within four standard errors."""
    random = np.random.default_rng(seed)
    size = np.abs(law(random, length))
    signs = random.choice([-1.0, 1.0], size=(400, length))
    held = random.uniform(-12, 12, length).repeat(1 + seed % 40)[:length]
    for under in (None, setting(held)):
        found = [misfit(random.permutation(size) * row, None, under).evidence for row in signs]
        values = np.minimum(found, 100.0)
        assert values.mean() <= 1 + 4 * values.std() / 20


@pytest.mark.parametrize(("length", "count"), [(8, 3), (9, 5), (12, 2)])
def test_far_samples_in_any_order_have_a_mean_of_one(length, count):
    """Over every order there is, exactly."""
    stepped = setting(np.repeat([3.0, -5.0, 4.0], 4)[:length]).moves
    for size, moves in ((100.0, None), (100.0, stepped), (7.0, stepped)):
        orders = []
        for out in itertools.combinations(range(length), count):
            row = np.ones(length)
            row[list(out)] = size
            orders.append(in_blows(row, 1.0, np.zeros(1), moves))
        assert np.mean(orders) == pytest.approx(1.0, abs=1e-12)
        assert max(orders) > 1 > min(orders)


def blows(random, number):
    """Noise and `number` blows of 800 samples, which swing within four samples and fade in six."""
    error, ring = random.normal(size=800), np.arange(12)
    for at in random.choice(np.arange(20, 780, 20), number, replace=False):
        error[at : at + 12] += 40 * np.cos(np.pi / 2 * ring + random.uniform(0, 6)) * 0.85**ring
    return error


@pytest.mark.parametrize(("number", "most"), [(4, 2), (8, 1)])
def test_blows_that_swing_are_no_noise(number, most):
    """A backlash leaves such. Neighbours agree in sign as often as not, and the rest is noise."""
    random, detector = np.random.default_rng(4), Adequacy()
    voltage = np.repeat(random.uniform(4, 12, 8), 100)
    speed = lfilter([0.0, 0.1], [1.0, -0.9], voltage)
    assert judged(detector, random.normal(size=800), voltage, speed, speed) == "holds"
    for _ in range(most):
        assert judged(detector, blows(random, number), voltage, speed, speed) != "holds"
        assert detector.adequacy > 2
    assert detector.drift_detected


def behind_steps(random, voltage):
    """Noise, and behind each step of the voltage a shock of one sample, whatever its sign."""
    error, steps = random.normal(size=voltage.size), np.flatnonzero(np.diff(voltage)) + 1
    late = steps + random.integers(1, 4, steps.size)
    error[late] += random.choice([-1, 1], steps.size) * random.uniform(4, 14, steps.size)
    return error


def test_shocks_behind_the_steps_of_the_voltage_are_no_noise():
    """A small play leaves such. The twin never learned, and in some experiments said `holds`."""
    random, detector, heard = np.random.default_rng(0), Adequacy(), []
    for number in range(6):
        voltage = np.repeat(random.uniform(-12, 12, 8), 50)
        speed = lfilter([0.0, 0.1], [1.0, -0.9], voltage)
        error = behind_steps(random, voltage) if number else random.normal(size=400)
        judged(detector, error, voltage, speed, speed)
        heard.append(detector.drift_detected)
        if detector.drift_detected:
            break
    assert 2 <= len(heard) <= 5


@pytest.mark.parametrize(("length", "count"), [(12, 1), (31, 3)])
def test_what_bets_on_outliers_win_is_one_in_the_mean_at_most(length, count):
    """Over every order there is: exactly one for a single outlier, less of several."""
    moves = setting(np.repeat([3.0, -5.0], length)[length - 2 : 2 * length - 2]).moves
    won = []
    for out in itertools.combinations(range(length), count):
        row = np.ones(length)
        row[list(out)] = 100.0
        won.append(far_samples.outliers(row, 1.0, moves))
    assert {found for found, _ in won} == {count}
    mean = np.mean([e for _, e in won])
    assert mean == pytest.approx(1.0, abs=1e-12) if count == 1 else 0.5 < mean < 1.0


def heard_with_outliers(behind, number=60, quiet=10):
    """States of quiet experiments, and of `number` with a sample 14 deviations out in each."""
    random, detector, states = np.random.default_rng(5), Adequacy(1e9), []
    for k in range(quiet + number):
        voltage = np.repeat(random.uniform(4, 12, 8) * np.resize([-1, 1], 8), 50)
        speed = lfilter([0.0, 0.1], [1.0, -0.9], voltage)
        noise = random.normal(size=400)
        if k >= quiet:
            step = 50 * random.integers(1, 8)
            at = step + random.integers(1, 4) if behind else random.integers(400)
            noise[at] = random.choice([-14, 14])
        states.append(judged(detector, noise, voltage, speed, speed))
    assert states[:quiet] == ["holds"] * quiet
    return states[quiet:]


def test_an_outlier_behind_a_step_is_not_explained_where_there_were_none():
    """A play's first shocks: each alone may be an outlier, and the state was `holds`."""
    assert set(heard_with_outliers(behind=True)) == {"learning"}


def test_a_sensor_with_outliers_holds_once_they_are_known():
    """They lie anywhere."""
    assert set(heard_with_outliers(behind=False)[10:]) == {"holds"}


def test_far_samples_anywhere_are_noise_however_the_voltage_steps():
    """Student's noise of two degrees of freedom: outliers lie behind steps only by chance."""
    random, detector = np.random.default_rng(1), Adequacy()
    for _ in range(200):
        voltage = np.repeat(random.uniform(-12, 12, 8), 50)
        speed = lfilter([0.0, 0.1], [1.0, -0.9], voltage)
        judged(detector, random.standard_t(2, size=400), voltage, speed, speed)
        assert not detector.drift_detected


def test_noise_in_proportion_to_the_speed_comes_in_no_blows():
    """Its largest samples lie where the speed is high."""
    random, detector = np.random.default_rng(1), Adequacy(1e9)
    for _ in range(200):
        voltage = np.repeat(random.uniform(-12, 12, 8), 100)
        speed = lfilter([0.0, 1.6], [1.0, -0.9], voltage)
        noise = random.normal(size=800) * (0.01 * np.abs(speed) + 0.02)
        assert judged(detector, noise, voltage, speed, speed) == "holds"


def of_first_order(random, length, memory, first):
    """Voltage, speed of a machine that so many samples remember, and its free run from `first`."""
    voltage = np.repeat(random.uniform(4, 12, length // 50), 50)
    forgets = 1 / memory
    filtered, kept = ([1.0], [1.0, forgets - 1])
    speed = lfilter(filtered, kept, np.concatenate([[20.0], 5 * forgets * voltage[:-1]]))
    led = lfilter(filtered, kept, np.concatenate([[20.0 + first], 5 * forgets * voltage[:-1]]))
    return voltage, speed, led


def judged(detector, noise, voltage, speed, led):
    measured = speed + noise
    detector.excited(voltage)
    detector.measured(measured)
    detector.update(measured - led)
    return detector.model_state


@pytest.mark.parametrize("memory", [3, 50, 1000])
@pytest.mark.parametrize("noise", [white, student, outliers])
def test_noise_in_the_first_sample_is_no_misfit_of_a_run_that_begins_there(noise, memory):
    """However long the machine remembers it; but the largest of all, which is one in 500."""
    random, held = np.random.default_rng(2), 0
    for _ in range(100):
        error = noise(random, 500)
        about = of_first_order(random, 500, memory, error[0])
        held += judged(Adequacy(), error, *about) == "holds"
    assert held >= 99


@pytest.mark.parametrize("first", [-20.0, 20.0])
def test_a_start_further_off_than_any_noise_is_a_misfit(first):
    """A sensor that jumps behind its first sample, for one."""
    random = np.random.default_rng(3)
    about = of_first_order(random, 500, 50, first)
    assert judged(Adequacy(), random.normal(size=500), *about) == "changed"


def test_a_slow_error_is_no_noise_where_the_voltage_jumps():
    """What was fitted to it by the voltage's jumps was rougher than the error itself."""
    random = np.random.default_rng(4)
    error = 20 * (1 - np.exp(-np.arange(1000) / 40)) + random.normal(0, 0.1, 1000)
    held = random.uniform(4, 12, 10).repeat(100)
    assert noise_in(error, setting(held)) < 0.15


def test_a_movement_of_the_smallest_number_is_none():
    """What follows it was no number, and numpy warned of it on the user's terminal."""
    noise = np.random.default_rng(1).normal(0, 1, 100)
    least, still = (setting(np.full(100, volt)) for volt in (5e-324, 0.0))
    assert misfit(noise, None, least).evidence == misfit(noise, None, still).evidence


@pytest.mark.parametrize(("hold", "most"), [(1, 1), (15, 3)])
def test_an_error_gone_within_a_sample_is_no_noise(hold, most):
    """A motor that is over before the next sample, at another rate than its model thinks."""
    random, detector = np.random.default_rng(6), Adequacy()
    for number in range(1, most + 1):
        voltage = random.uniform(-12, 12, 300).repeat(hold)[:300]
        changed = np.r_[0, 0, np.diff(voltage)[:-1]] / 2  # up to a hundred deviations of the noise
        residual = changed + random.normal(0, 0.1, 300)
        detector.excited(voltage)
        detector.update(residual, None)
        assert detector.model_state != "holds", number
        assert detector.adequacy > 10
    assert detector.drift_detected


@pytest.mark.parametrize("noise", [0.0, 0.1, 0.2, 0.3, 0.5])
def test_the_steps_of_a_coarse_sensor_are_no_misfit(noise):
    """Of a speed that stays within a step for long, whatever noise there is; ten steps are one."""
    random, detector = np.random.default_rng(7), Adequacy()
    voltage = np.zeros(300)
    for number, error in enumerate((*np.zeros(200), 10.0)):
        top = random.uniform(-40, 40) if number else 40.0  # the first one shows the steps
        true = top * (1 - np.exp(-np.arange(300) / 8))
        speed = np.round(true + random.normal(0, noise, 300) if noise else true)
        detector.excited(voltage)
        detector.measured(speed)
        detector.update(speed - true + error)
        assert detector.model_state == ("changed" if error else "holds")


@pytest.mark.parametrize(("size", "holds"), [(1.0, True), (2.0, True), (6.0, False), (40.0, False)])
def test_a_swing_near_half_the_sample_rate_is_told_by_its_size(size, holds):
    """Its neighbours have opposite signs, as if it were rough noise; at 45 of 100 Hz here."""
    random, detector = np.random.default_rng(3), Adequacy()
    swing = size * math.sqrt(2) * np.sin(0.9 * math.pi * np.arange(400))
    for _ in range(8):
        detector.update(random.normal(size=400))
        assert detector.model_state == "holds"
    detector.update(random.normal(size=400) + swing)
    assert (detector.model_state, detector.drift_detected) == (
        ("holds", False) if holds else ("changed", True)
    )
    assert holds or detector.adequacy == pytest.approx(math.hypot(size, 1), rel=0.3)
    again = Adequacy()
    again.restore(json.loads(json.dumps(detector.state())))
    assert again.state() == detector.state()


@pytest.mark.parametrize("law", ["rare", "lasting", "of many sizes"])
def test_a_sensor_that_is_louder_is_no_change_of_the_machine(law):
    """However loud, what remembers nothing is noise."""
    random, detector = np.random.default_rng(4), Adequacy()
    scales = {
        "rare": np.where(random.random(300) < 0.05, 5.0, 1.0),
        "lasting": np.where(np.arange(300) < 20, 1.0, 5.0),
        "of many sizes": np.exp(0.7 * random.standard_normal(300)),
    }
    for scale in scales[law]:
        detector.update(scale * random.normal(size=400))
        assert detector.model_state == "holds"


def test_noise_with_a_memory_is_tried_ever_more_rarely():
    """Learning does not help, is tried after 1, 2, 4, ... experiments, and nothing is explained."""
    random, detector, positives, states = np.random.default_rng(2), Adequacy(), 0, set()
    for i in range(300):
        detector.update(with_memory(random, 500))
        states.add(detector.model_state)
        if detector.drift_detected:
            positives += 1
            detector.answered(False)
        assert detector.adequacy > 1.5, i
    assert positives <= 10
    assert "holds" not in states


@given(
    seed=st.integers(0, 1000),
    size=st.floats(10.0, 1e6),
    rate=st.floats(0.001, 0.05),
    length=st.integers(100, 1000),
)
def test_an_error_far_above_the_noise_is_never_explained(seed, size, rate, length):
    """Whatever came before, and however slowly it grows."""
    random, detector = np.random.default_rng(seed), Adequacy()
    for _ in range(seed % 5):
        detector.update(random.normal(size=length))
    wave = size * np.sin(rate * np.arange(length) + seed)
    for _ in range(5):
        detector.update(random.normal(size=length) + wave)
        if np.sqrt(np.mean(wave**2)) > 3:
            assert detector.model_state != "holds"
            assert detector.signal is not Level.NEGATIVE
        if detector.drift_detected:
            detector.answered(bool(seed % 2))


def inadequate(random, wave):
    """A detector that waits long until it has learning tried again."""
    detector = Adequacy(20)
    for _ in range(64):
        detector.update(random.normal(size=wave.size) + wave * random.uniform(0.9, 1.1))
        if detector.drift_detected:
            detector.answered(False)
    assert detector.wait > 10
    return detector


def test_a_change_while_inadequate_is_positive_out_of_turn():
    """Against the experiments since the last trial, not against the noise."""
    random, wave = np.random.default_rng(3), np.sin(np.arange(500) / 30)
    detector = inadequate(random, wave)
    waited = detector.wait
    states = []
    while not detector.drift_detected:
        detector.update(random.normal(size=500) + 1.3 * wave)
        states.append(detector.model_state)
    assert states[-1] == "changed"
    assert len(states) < waited


def test_an_error_far_above_all_that_learning_was_tried_on_is_heard_at_once():
    """Learning that failed of a small error may succeed of a large one; tried ever more rarely."""
    random, wave = np.random.default_rng(3), np.sin(np.arange(500) / 30)
    detector = inadequate(random, wave)
    detector.update(random.normal(size=500) + 3 * wave)
    assert (detector.drift_detected, detector.model_state) == (True, "inadequate")
    tried = 0
    for _ in range(30):
        detector.answered(False)
        detector.update(random.normal(size=500) + 3 * wave)
        tried += detector.drift_detected
    assert tried <= 8


def test_a_new_model_that_explains_ends_the_waiting():
    """And a later error is positive at once again."""
    random, detector = np.random.default_rng(4), Adequacy()
    wave = 5 * np.sin(np.arange(500) / 30)
    for error in (wave, wave, 0, wave):
        if detector.drift_detected:
            detector.answered(False)
        detector.update(random.normal(size=500) + error)
    assert (detector.model_state, detector.signal) == ("changed", Level.POSITIVE)


def test_what_the_model_claims_not_to_know_is_no_misfit():
    """A deviation beyond the noise is taken off the misfit, and not off the adequacy."""
    random = np.random.default_rng(5)
    wave = 3 * np.sin(np.arange(1000) / 50)
    residual, claim = random.normal(size=1000) + wave, np.sqrt(1 + wave**2)
    plain, claimed = misfit(residual), misfit(residual, claim)
    assert claimed.explained
    assert not plain.explained
    assert plain.ratio == claimed.ratio > 2 > claimed.relative


def test_too_few_samples_tell_nothing():
    """Said as `learning`, with no adequacy."""
    detector = Adequacy()
    detector.update(np.ones(5))
    assert (detector.model_state, detector.adequacy, detector.signal) == ("learning", None, -1)


def told(detector, voltage, residual):
    detector.excited(voltage)
    detector.update(residual)
    return detector.model_state, detector.signal


def test_another_excitation_alone_is_a_new_range():
    """Of a model that has learned: first negative, then learned from, and never `changed`."""
    random, detector = np.random.default_rng(6), Adequacy()
    steady, steps = np.full(600, 12.0), np.repeat(random.uniform(2, 18, 12), 50)
    wave = 5 * np.sin(np.arange(600) / 30)
    assert told(detector, steady, random.normal(size=600) + wave) == ("changed", Level.POSITIVE)
    detector.answered(True)
    for _ in range(3):
        assert told(detector, steady, random.normal(size=600)) == ("holds", Level.NEGATIVE)
    assert told(detector, steps, random.normal(size=600) + wave) == ("new_range", Level.NEGATIVE)
    assert told(detector, steps, random.normal(size=600) + wave) == ("new_range", Level.POSITIVE)


def test_what_fails_where_the_machine_was_seen_is_learned_from():
    """However new the rest is: a range may grow with every experiment."""
    random, detector = np.random.default_rng(6), Adequacy()
    steady, steps = np.full(600, 12.0), np.repeat(random.uniform(2, 18, 12), 50)
    wave = 5 * np.sin(np.arange(600) / 30)
    told(detector, steady, random.normal(size=600) + wave)
    detector.answered(True)
    told(detector, steady, random.normal(size=600))
    assert told(detector, steps, random.normal(size=600) + wave) == ("new_range", Level.NEGATIVE)
    wider = np.where(np.arange(600) > 500, 30.0, steps)
    assert told(detector, wider, random.normal(size=600) + wave) == ("new_range", Level.POSITIVE)


def test_a_change_within_the_known_range_is_no_new_range():
    """However new the rest of the excitation is."""
    random, detector = np.random.default_rng(7), Adequacy()
    steps = np.repeat(random.uniform(4, 16, 12), 50)
    wave = 5 * np.sin(np.arange(600) / 30)
    told(detector, steps, random.normal(size=600) + wave)
    detector.answered(True)
    told(detector, steps, random.normal(size=600))
    wider = np.where(np.arange(600) > 500, 23.0, steps)
    assert told(detector, wider, random.normal(size=600) + wave) == ("changed", Level.POSITIVE)


def test_a_model_that_has_not_learned_has_changed_only_where_it_was_right():
    """One that was right nowhere has no such range."""
    random, detector, fresh = np.random.default_rng(8), Adequacy(), Adequacy()
    low, high, wave = np.full(600, 3.0), np.full(600, 20.0), 5 * np.sin(np.arange(600) / 30)
    assert told(fresh, high, random.normal(size=600) + wave) == ("changed", Level.POSITIVE)
    assert told(detector, low, random.normal(size=600)) == ("holds", Level.NEGATIVE)
    assert told(detector, high, random.normal(size=600) + wave) == ("new_range", Level.NEGATIVE)
    assert told(detector, low, random.normal(size=600) + wave) == ("changed", Level.POSITIVE)


def test_more_of_what_a_model_does_not_know_is_heard_at_once():
    """The wait for the next lesson is for errors of the size that was learned from."""
    random, detector = np.random.default_rng(4), Adequacy()
    wave = np.sin(np.linspace(0, 20, 500))
    claim = np.sqrt(1 + (5 * wave) ** 2)

    def signal(height):
        detector.update(random.normal(size=500) + height * wave, claim)
        heard = detector.signal
        # Learning that did not help is told: for good it was "learning" at 30 times the noise.
        put_off = heard is Level.WARNING
        assert detector.model_state == ("inadequate" if put_off else "learning")
        if detector.drift_detected:
            detector.answered(False)
        return heard

    assert [int(signal(2)) for _ in range(7)] == [1, 1, 0, 1, 0, 0, 0]
    assert signal(6) is Level.POSITIVE


@pytest.mark.parametrize("length", [1, 2, 10, 1000, 1_000_000])
def test_what_follows_a_voltage_outside_the_range_is_outside_too(length):
    """For a twentieth of the experiment; of a million samples in no more than proportional time."""
    voltage = np.zeros(length)
    voltage[[length // 3, length // 2]] = 5.0
    memory = 300  # samples after a pulse in which the running mean differs most
    known = samples_within(voltage, hull(np.linspace(-1.0, 1.0, 1000)))
    wide = max(1, round(AFTER * length))
    assert known[: length // 3].all()
    assert not known[length // 3 : length // 3 + wide].any()
    assert not known[length // 2 : length // 2 + wide].any()
    assert known[length // 2 + wide + memory :].all()


@pytest.mark.parametrize("name", ["explained", "seen", "last"])
@pytest.mark.parametrize("value", [[1.0], [[1.0], []], [["a"] * 4] * 2, [[2.0] * 4, [1.0] * 4]])
def test_a_state_of_no_ranges_is_refused(name, value):
    """It was taken from a checkpoint, and a run could not be resumed; so it is with errors."""
    detector = Adequacy()
    good = detector.state()
    with pytest.raises(OptionError, match="expected ranges and errors"):
        detector.restore({**good, name: value})
    with pytest.raises(OptionError, match="expected ranges and errors"):
        detector.restore({**good, name: [[0.0] * 4, [1.0] * 4], "errors": ["x"]})
    assert detector.state() == good
