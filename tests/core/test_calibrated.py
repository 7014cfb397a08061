"""The calibrated detector keeps its stated rate, finds drifts, and does not shout for ever."""

import doctest
import json
import math

import numpy as np
import pytest
from false_alarm_rates import EARLY, KINDS, Noise, Rate, RowsAgain, count, machine_rows
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from ldt_core.base.errors import OptionError
from ldt_core.base.experiment import Experiment
from ldt_core.checks import check_detector
from ldt_core.detectors import calibrated, control_chart
from ldt_core.detectors.calibrated import (
    CARRIED,
    GROSS,
    LEAST_SPREAD,
    RETRIES,
    WARNINGS,
    Calibrated,
)
from ldt_core.detectors.control_chart import ALLOWANCE, limits, warning_limits
from ldt_core.detectors.reference import Reference
from ldt_core.lab.study.drift_detection import detection
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine
from ldt_core.models.physics import PhysicsModel

L = 400  # samples of an experiment
WAVE = np.sin(np.linspace(0, 25, L))  # what a wrong model leaves, in units of the noise


def noise(seed, n, scale=1.0):
    return scale * np.random.default_rng(seed).standard_normal((n, L))


def in_control(every=1000, seed=1, n=30):
    """A detector that has seen n experiments of white noise."""
    detector = Calibrated(every)
    for row in noise(seed, n):
        detector.update(row)
    assert not detector.drift_detected
    return detector


@pytest.mark.parametrize("module", [calibrated, control_chart])
def test_examples_are_true(module):
    """The docstrings' examples run as printed."""
    result = doctest.testmod(module)
    assert result.attempted > 0
    assert result.failed == 0


@pytest.mark.slow
@pytest.mark.parametrize("every", [10, 50, 1e6])
def test_it_keeps_the_promises_at_other_rates(every):
    """The suite for detectors; `test_checks` runs it at the default."""
    check_detector(Calibrated(every))


# ---- the chart


@pytest.mark.parametrize("every", [10, 100])
def test_the_chart_has_the_stated_run_length_and_warnings(every):
    """Simulated with standard normal values, 95 % of the time within 2 deviations."""
    single, total = limits(every)
    warn_single, warn_total = warning_limits(every, share := min(0.2, WARNINGS / every))
    z = np.random.default_rng(5).standard_normal((2000, 600))
    risen, alarms, warnings, counted = np.full(2000, total / 2), 0, 0, 0
    for i in range(600):
        risen = np.maximum(0, risen + z[:, i] - ALLOWANCE)
        positive = (z[:, i] > single) | (risen > total)
        if i >= 100:  # settled
            alarms += positive.sum()
            warnings += ((z[:, i] > warn_single) | (risen > warn_total)).sum()
            counted += 2000
        risen[positive] = total / 2
    assert alarms / counted == pytest.approx(1 / every, rel=3 / math.sqrt(alarms))
    assert warnings / counted == pytest.approx(share, rel=6 / math.sqrt(warnings))


def test_the_chart_without_a_single_limit_is_page_s():
    """Run length 930 for a limit of 5 and an allowance of 1/2 (Montgomery, table 9.3: 465 for the
    two-sided chart), from a sum of 0."""
    centres, stays = control_chart.markov_chain(100.0, 5.0)
    run = np.linalg.solve(np.eye(centres.size) - stays, np.ones(centres.size))
    assert run[0] == pytest.approx(930.9, rel=0.002)


# ---- the law of what is usual


def test_unusual_is_standard_normal_for_a_lognormal_law():
    """From the fourth number on, whatever level and spread: few as well as many in the reference.

    Up to the upper tenth; beyond, the doubt about the tail makes the values smaller.
    """
    z = []
    for seed in range(250):
        law, rng = Reference(), np.random.default_rng(seed)
        for value in 3.0 + 0.4 * rng.standard_normal(24):
            if law.known:
                z.append(law.unusual(value, 1e-3))
            law.take(value, 1e-3)
    z = np.array(z)
    for level in (-1.3, 0.0, 1.2):
        share = stats.norm.cdf(level)
        sigma = math.sqrt(share * (1 - share) / z.size)
        assert (z < level).mean() == pytest.approx(share, abs=3.5 * sigma)
    assert stats.norm.sf(2.0) * 0.5 < (z > 2.0).mean() < stats.norm.sf(2.0) * 1.1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "sample"),
    [
        ("chi-square", lambda rng: 0.5 * np.log(rng.chisquare(4, 300))),
        ("two regimes", lambda rng: 0.2 * rng.normal(size=300) + 1.5 * (rng.random(300) < 0.1)),
        ("Student", lambda rng: rng.standard_t(4, 300)),
    ],
)
def test_the_shape_is_learned(law, sample):
    """After 150 numbers of another law, a value above 2.6 comes less than 2.5 times too often.

    A normal law for the logarithm would give 4 times too many for Student's law.
    """
    above = total = 0
    for seed in range(12):
        known, values = Reference(), sample(np.random.default_rng(seed))
        for i, value in enumerate(values):
            if i >= 150:
                above += known.unusual(value, 1e-3) > 2.6
                total += 1
            known.take(value, 1e-3)
    assert above / total < 2.5 * stats.norm.sf(2.6), law


@settings(max_examples=40)
@given(
    st.lists(st.floats(-5, 5), min_size=4, max_size=12),
    st.floats(-4, 4),
    st.floats(0.01, 0.1),
)
def test_quantile_is_the_inverse_of_unusual(values, z, least):
    """The limits that are shown are those that are applied."""
    law = Reference()
    for value in values:
        law.take(value, least)
    found = law.quantile(z, least)
    if abs(found - law.origin) < 20:
        assert law.unusual(found, least) == pytest.approx(z, abs=1e-3)


# ---- false alarms


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["white", "AR(0.9)", "scale lognormal 1"])
def test_the_stated_rate_is_kept(kind):
    """One false alarm in 50 experiments, in 12 streams of 150; the study counts many more."""
    rate = count("calibrated", KINDS[kind], 50, streams=12, experiments=150, samples=200)
    low, high = rate.interval
    assert low <= rate.stated <= high, rate
    assert rate.observed_warnings < 2 * min(0.2, WARNINGS / 50)


@pytest.mark.slow
def test_a_wrong_model_whose_error_is_always_the_same_in_law_is_in_control():
    """Real rows: the rotor with e = 3 mm against e = 0, drawn again and again, one in 50."""
    rows = machine_rows(load_machine("rotor"), "unbalance:e=0.003", experiments=150)
    rate = count("calibrated", RowsAgain(rows), 50, streams=10, experiments=150)
    assert rate.keeps_its_word, rate


def test_the_count_of_false_alarms_is_itself_right():
    """Against a detector whose rate is known: by the calendar, every tenth experiment."""
    plain = {"window": 10}
    rate = count("window", Noise(), 10, plain, streams=5, experiments=100, samples=10)
    assert rate.alarms == (10,) * 5
    assert rate.early == (EARLY // 10,) * 5
    assert rate.observed == rate.stated == 0.1
    assert rate.keeps_its_word
    low, high = Rate(0.1, 100, (4,), (0,), (0,)).interval
    assert (low * 100, high * 100) == pytest.approx((1.09, 10.24), abs=0.01)  # Garwood's table
    none = Rate(0.1, 100, (0, 0), (0, 0), (0, 0)).interval
    assert none == pytest.approx((0, 3.689 / 200), abs=1e-5)
    flocks = Rate(0.1, 100, (8, 0, 0, 0), (0,) * 4, (0,) * 4).interval
    single = Rate(0.1, 100, (2, 2, 2, 2), (0,) * 4, (0,) * 4).interval
    assert flocks[1] - flocks[0] > 1.5 * (single[1] - single[0])


def test_more_noise_is_no_drift():
    """Nobody can predict white noise: three times as much of it is no reason to learn again."""
    detector = in_control()
    for row in noise(2, 20, scale=3.0):
        detector.update(row)
        assert not detector.drift_detected


def test_a_deviation_that_the_model_states_is_the_yardstick():
    """Errors grow tenfold: no drift if the model's deviation says so, a drift if it does not."""
    for honest in (True, False):
        detector = Calibrated()
        rows = noise(3, 31).cumsum(axis=1) / 10
        scale = np.ones(31)
        scale[30] = 10.0
        for row, factor in zip(rows, scale, strict=True):
            detector.update(factor * row, np.full(L, factor if honest else 1.0))
        assert detector.yardstick == "deviation"
        assert detector.drift_detected is not honest


def test_what_was_learned_from_noise_alone_holds_when_the_model_states_its_deviation():
    """A drift right after the first training is found; else it became the usual level, for good."""
    detector = in_control()
    for row in noise(31, 5):
        detector.update(row, np.full(L, 1.0))
        assert not detector.drift_detected
    detector = in_control()
    detector.update(noise(32, 1)[0] + WAVE, np.full(L, 1.0))
    assert detector.drift_detected


def test_a_model_that_was_wrong_throughout_is_judged_anew_by_its_own_deviation():
    """Its errors were no noise, so they say nothing of what a trained model's will be."""
    detector = Calibrated()
    for row in noise(33, 30):
        detector.update(row + 3 * WAVE)
        assert not detector.drift_detected
    for row in noise(34, 10):
        detector.update(row, np.full(L, 0.5))
        assert not detector.drift_detected


# ---- drifts


def ideal_run(every, seed, experiments=200):
    """Positives and drifts of the wearing rotor with a learner that knows e after each positive.

    The machine starts at rest, which the learner knows, too.
    """
    machine = load_machine("rotor")
    plant = Plant(machine, experiments=experiments, seed=seed)
    detector, positives, known = Calibrated(every), [], 0.0
    for number in range(1, experiments + 1):
        e = plant.experiment(number)
        model = PhysicsModel(machine, {"machine": {**machine.parameters, "e": known}})
        still = np.append(0.0, e.speed[1:])
        predicted = model.predict(Experiment(number, e.start, e.period, e.voltage, still))
        detector.update(e.speed - predicted.speed)
        if detector.drift_detected:
            positives.append(number)
            known = plant.schedule.value(number)
    return plant.schedule.changes, positives


@pytest.mark.slow
@pytest.mark.parametrize("every", [200, 1000])
def test_an_ideal_learner_is_told_of_nearly_every_drift(every):
    """Recall at least 0.9 and precision at least 0.8 on the wearing rotor, noise 0.1 rad/s."""
    found = detection(*ideal_run(every, seed=6))
    assert found.drifts == 12
    assert found.recall >= 0.9
    assert found.precision >= 0.8


def test_a_sudden_drift_is_found_at_once_and_a_small_one_soon():
    """A wave as large as the noise, and one that adds 1.5 deviations to the relative error."""
    detector = in_control()
    detector.update(noise(9, 1)[0] + WAVE)
    assert detector.drift_detected
    detector = in_control()
    small = math.sqrt(2 * (math.exp(2 * 1.5 / math.sqrt(2 * L)) - 1))
    rows = iter(noise(10, 15))
    while not detector.drift_detected:
        detector.update(next(rows) + small * WAVE)  # StopIteration: not found


def test_slow_wear_is_not_taken_for_normal():
    """A wave that grows by 1 % of the noise per experiment is found long before it equals it."""
    detector = in_control()
    for i, row in enumerate(noise(11, 100)):
        detector.update(row + 0.01 * i * WAVE)
        if detector.drift_detected:
            break
    assert i < 70


def test_what_was_learned_outlasts_a_positive():
    """A drift is found, mended, and the next one found four experiments later."""
    detector = in_control()
    for row in noise(12, 3):
        detector.update(row + 2 * WAVE)
        assert detector.drift_detected
        for mended in noise(13, 3):
            detector.update(mended)
            assert not detector.drift_detected


def test_a_grossly_wrong_model_is_noticed_in_the_first_experiment():
    """An error of 30 yardsticks is; noise with a memory, 3.5 times its own roughness, is not."""
    detector = Calibrated()
    detector.update(noise(14, 1)[0] + 30 * math.sqrt(2) * WAVE)
    assert detector.drift_detected
    assert detector.statistics["relative_error"] > GROSS
    detector = Calibrated()
    rows, _ = Noise(0.9)(np.random.default_rng(1), 10, 2000)
    for row in rows:
        detector.update(row)
        assert not detector.drift_detected
        assert 3 < detector.statistics["relative_error"] < 4.5


def test_a_learner_that_cannot_follow_is_told_a_few_times_only():
    """After 1 + RETRIES positives the level is the new normal; from there drifts are found."""
    detector = in_control()
    signals = []
    for row in noise(15, 30):
        detector.update(row + 2 * WAVE)
        signals.append(detector.drift_detected)
    assert signals == [True] * (1 + RETRIES) + [False] * (30 - 1 - RETRIES)
    detector.update(noise(16, 1)[0] + 4 * WAVE)
    assert detector.drift_detected


def test_a_model_wrong_from_the_beginning_is_accepted_in_the_end():
    """The same for a gross error that nothing mends."""
    detector = Calibrated()
    signals = []
    for row in noise(17, 30):
        detector.update(row + 50 * WAVE)
        signals.append(detector.drift_detected)
    assert signals == [True] * (1 + RETRIES) + [False] * (30 - 1 - RETRIES)


def test_a_better_model_sets_a_new_standard():
    """When the error falls for certain, a rise back to the old level is a drift."""
    detector = Calibrated()
    for row in noise(18, 30):
        detector.update(row + 3 * WAVE)
    for row in noise(19, 12):
        detector.update(row)
        assert not detector.drift_detected
    detector.update(noise(20, 1)[0] + 3 * WAVE)
    assert detector.drift_detected


def test_a_certain_positive_is_not_learned_from_and_an_uncertain_one_is():
    """Else the usual would look wider after a drift, or narrower after a false alarm."""
    detector = in_control()
    known = detector.reference.freedom
    detector.update(noise(21, 1)[0] + 3 * WAVE)
    assert detector.drift_detected
    assert detector.reference.freedom == known
    detector = in_control()
    single, _ = limits(1000)
    barely = detector.reference.quantile(single + 0.1, LEAST_SPREAD / math.sqrt(L))
    row = noise(22, 1)[0]
    low, high = 0.0, 3.0
    for _ in range(60):
        middle = (low + high) / 2
        yardstick, ratio = calibrated.log_relative_error(row + middle * WAVE, None)
        score = calibrated.symmetric(ratio, yardstick)
        low, high = (middle, high) if score < barely else (low, middle)
    detector.update(row + high * WAVE)
    assert detector.drift_detected
    assert detector.reference.freedom == known + 1
    detector.restart()
    assert detector.reference.count == CARRIED


def test_it_is_positive_just_when_the_error_is_above_the_limit():
    """So that the two can be drawn; the warning limit is the lower one."""
    detector = Calibrated(50)
    positives = 0
    for row in noise(23, 150):
        detector.update(row)
        got = detector.statistics
        assert detector.drift_detected == (got["relative_error"] > got.get("drift_limit", math.inf))
        if not detector.drift_detected and "warning_limit" in got:
            assert detector.warning_detected == (got["relative_error"] > got["warning_limit"])
        positives += detector.drift_detected
    assert positives > 0


# ---- what comes in, and the state


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1e-300, 1e-5, 1e5, 1e300])
def test_units_do_not_matter(scale):
    """With a yardstick, the signals are those of the same residuals in another unit."""
    rows, deviation = noise(24, 12), np.full(L, 1.0)
    for given_deviation in (False, True):
        seen = []
        for factor in (1.0, scale):
            detector = Calibrated(20)
            for i, row in enumerate(rows):
                residual = factor * (row + (i > 8) * WAVE)
                detector.update(residual, factor * deviation if given_deviation else None)
            seen.append((detector.signal, round(detector.statistics["relative_error"], 6)))
        assert seen[0] == seen[1]


def test_absurd_residuals_do_no_harm():
    """Zeros, single samples, constants, a vanishing deviation: an answer, and a finite state."""
    detector = Calibrated()
    tiny = np.full(L, 1e-300)
    for residual, deviation in [
        (np.zeros(L), None),
        (1.5, None),
        (np.ones(L), None),
        (1e300 * np.ones(L), tiny),
        (np.append(1e-200, np.zeros(L - 1)), np.append(1e200, tiny[1:])),
        (np.ones(L), np.zeros(L)),
        (np.linspace(0, 1e-300, L), None),
    ] * 5:
        detector.update(residual, deviation)
        json.dumps([detector.state(), detector.statistics], allow_nan=False)


def test_scalars_are_judged_by_their_size():
    """Without samples there is no yardstick, and the size itself has to do."""
    detector = Calibrated()
    for value in 1.0 + 0.1 * np.random.default_rng(3).standard_normal(40):
        detector.update(value)
        assert not detector.drift_detected
    assert detector.yardstick == "none"
    detector.update(1e4)
    assert detector.drift_detected


@pytest.mark.slow
@settings(max_examples=25)
@given(
    st.lists(st.floats(0.0, 6.0), min_size=3, max_size=25),
    st.integers(0, 25),
    st.sampled_from([10, 1000]),
)
def test_a_restart_changes_nothing(waves, cut, every):
    """State through JSON text into a new object, anywhere: all goes on equally."""
    own, restored = Calibrated(every), None
    for i, (wave, row) in enumerate(zip(waves, noise(25, 25), strict=False)):
        if i == cut:
            restored = own.clone()
            restored.restore(json.loads(json.dumps(own.state(), allow_nan=False)))
        for detector in filter(None, (own, restored)):
            detector.update(row + wave * WAVE)
    if restored:
        assert restored.state() == own.state()
        assert restored.statistics == own.statistics


@pytest.mark.parametrize(
    "change",
    [
        {"reference": {}},
        {"reference": {**Reference().state(), "mean": [0.0]}},
        {"reference": {**Reference().state(), "tail": ["a", "b"]}},
        {"suspects": ["high"]},
        {"rise": [1.0]},
        {"last": {"sum": "high"}},
    ],
)
def test_a_foreign_state_is_refused(change):
    """What lies inside the state is looked at, too; the detector has seen nothing then."""
    detector = in_control(n=5)
    with pytest.raises(OptionError, match="state of detector calibrated"):
        detector.restore({**detector.state(), **change})
    assert detector.state() == Calibrated().state()
