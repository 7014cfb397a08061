"""Cogging of another engine, with a second harmonic: quick for the samples, or begun anywhere."""

from __future__ import annotations

import math

import numpy as np
import pytest
from recorded_machines import candidates, steps

from ldt_core.base.experiment import Experiment
from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.diagnosis.effect_fit import fit
from ldt_core.diagnosis.effect_set_search import EffectSetSearch
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.ripple_orders import ripple_orders
from ldt_core.effects import get_effect
from ldt_core.estimation.noise import white_noise
from tests.motors import motor_file

J, K, R, L, B = 0.018, 0.3, 1.0, 5e-3, 0.01
PERIOD, SAMPLES, FINER = 0.02, 500, 20  # s, of an experiment, steps of the engine in a sample
TRIED = ("cogging_torque", "gravity_imbalance", "coulomb_friction", "inertia")
MACHINE = motor_file({"J": J, "K_t": K, "R": R, "L": L, "b": B}, SAMPLES, PERIOD)


def cogged(torque, periods, volts, noise, angles):
    """Experiments, one for each angle at the first sample [rad], by classical Runge-Kutta steps."""
    random = np.random.default_rng(5)
    u = np.array([steps(random, SAMPLES, *volts, 100) for _ in angles])
    y = np.stack([np.array(angles, dtype=float), np.zeros(len(angles)), np.zeros(len(angles))])
    speed, step = np.empty(u.shape), PERIOD / FINER

    def rate(y, volt):
        angle, turn = y[0], y[1]
        ripple = np.sin(periods * angle) + 0.2 * np.sin(2 * periods * angle + 1.0)
        return np.stack(
            [turn, (K * y[2] - B * turn - torque * ripple) / J, (volt - R * y[2] - K * turn) / L]
        )

    for i in range(SAMPLES):
        speed[:, i] = y[1]
        for _ in range(FINER):
            a = rate(y, u[:, i])
            b = rate(y + step / 2 * a, u[:, i])
            c = rate(y + step / 2 * b, u[:, i])
            d = rate(y + step * c, u[:, i])
            y = y + step / 6 * (a + 2 * b + 2 * c + d)
    speed += noise * random.standard_normal(speed.shape)
    rows = zip(u, speed, strict=True)
    return [Experiment(k + 1, 20.0 * k, PERIOD, *row) for k, row in enumerate(rows)]


def found(experiments):
    """The diagnosis, of a few effects."""
    return diagnose(MACHINE, experiments, effects=[get_effect(n) for n in TRIED], workers=1)


@pytest.mark.slow
def test_a_ripple_that_is_quick_against_the_samples_is_a_gap():
    """To the measured signal's third differences it is noise, and larger than the sensor's."""
    experiments = cogged(0.6, 5.0, (6.0, 12.0), 0.02, [0.0] * 4)
    seeming = white_noise(e.speed for e in experiments)
    assert seeming > 7 * 0.02
    answer = found(experiments)
    assert answer.verdict.effects == ["cogging_torque"]
    assert answer.gap.noise_std < seeming / 3  # the second harmonic is left
    cogging = next(c for c in answer.candidates if c.effect == "cogging_torque").parameters
    assert cogging["periods"].value == pytest.approx(5.0, abs=0.01)
    assert cogging["torque"].value == pytest.approx(0.6, rel=0.15)


@pytest.mark.slow
def test_a_ripple_is_named_though_no_experiment_begins_at_the_same_angle():
    """From angle 0 a free run is worse with the right effect: it promises nothing, and says so."""
    angles = np.random.default_rng(1).uniform(0, 6, 6)
    experiments = cogged(0.06, 6.0, (4.0, 12.0), 0.01, list(angles))
    answer = found(experiments)
    assert answer.verdict.effects == ["cogging_torque"]
    assert answer.gap.after.rmse > answer.gap.before.rmse
    assert answer.gap.closed_fraction is None
    assert "Where the start state is unknown" in answer.verdict.sentence


@pytest.mark.parametrize(
    ("torque", "periods", "seed"), [(0.6, 12.0, 1), (0.6, 5.0, 2), (1.2, 12.0, 2)]
)
def test_a_fit_from_the_truth_stays_there_whatever_the_start_angles(torque, periods, seed):
    """From one angle for all, the first steps led to a ripple half as strong."""
    angles = np.random.default_rng(seed).uniform(0, 2 * math.pi, 8)
    experiments = cogged(torque, periods, (6.0, 12.0), 0.02, list(angles))
    residuals = FreeRunResiduals(MACHINE, experiments)
    (cogging,) = candidates(MACHINE, ["cogging_torque"])
    begun = cogging.coordinates({"torque": torque, "periods": periods, "phase": 0.5})
    amounts = cogging.given(fit(residuals, [cogging], [begun]).z[0])
    assert amounts["torque"] == pytest.approx(torque, rel=0.1)
    assert amounts["periods"] == pytest.approx(periods, abs=0.01)


def test_a_further_effect_leaves_no_more_though_its_fit_begins_astray():
    """A ripple of another order is no minimum that the fit of both could leave again."""
    angles = np.random.default_rng(1).uniform(0, 2 * math.pi, 8)
    residuals = FreeRunResiduals(MACHINE, cogged(0.6, 5.0, (6.0, 12.0), 0.02, list(angles)))
    cogging, inertia = candidates(MACHINE, ["cogging_torque", "inertia"])
    search = EffectSetSearch(residuals, [cogging, inertia])
    begun = cogging.coordinates({"torque": 0.6, "periods": 5.0, "phase": 0.5})
    alone = search.found.fits[frozenset([cogging.name])] = fit(residuals, [cogging], [begun])
    astray = cogging.coordinates({"torque": 0.6, "periods": 8.5, "phase": 0.5})
    both = [cogging, inertia], [astray, inertia.coordinates({"factor": 1.0})]
    assert fit(residuals, *both).loss > 2 * alone.loss
    scouted = fit(search.scout, *both, steps=2)
    assert search.finish(scouted).loss < 1.01 * alone.loss


@pytest.mark.parametrize(
    ("periods", "most"), [(2, 4.0), (11, 4.0), (13, 3.0), (29, 2.0), (36, 1.5)]
)
def test_the_order_of_a_ripple_is_found_whatever_it_is(periods, most):
    """A search that begins at other orders never gets there: the residual tells it."""
    experiments = cogged(0.02, float(periods), (0.3, most), 0.01, [0.0] * 4)
    residuals = FreeRunResiduals(MACHINE, experiments)
    (order, torque, phase), *_ = ripple_orders(residuals, residuals.of(), residuals.starts)
    assert order == periods
    assert torque == pytest.approx(0.02, rel=0.3)
    assert math.cos(phase) > 0.5  # the engine's is 0, but for what the speed changes in a ripple


def test_an_order_shows_in_the_slow_part_of_fast_experiments():
    """At most speeds, eight teeth pass quicker than the samples follow."""
    experiments = cogged(0.1, 8.0, (0.3, 16.0), 0.01, [0.0] * 4)
    speeds = np.abs(np.concatenate([e.speed for e in experiments]))
    assert 0.25 < np.mean(8 * speeds * PERIOD < math.pi) < 0.5
    residuals = FreeRunResiduals(MACHINE, experiments)
    assert ripple_orders(residuals, residuals.of(), residuals.starts)[0].order == 8


@pytest.mark.slow
def test_a_ripple_of_an_odd_order_is_named():
    """Eleven teeth, at which no search begins by itself."""
    answer = found(cogged(0.06, 11.0, (0.5, 4.0), 0.01, [0.0] * 5))
    assert answer.verdict.effects == ["cogging_torque"]
    cogging = next(c for c in answer.candidates if c.effect == "cogging_torque").parameters
    assert cogging["periods"].value == pytest.approx(11.0, abs=0.01)


@pytest.mark.slow
def test_noise_is_not_taken_for_less_than_it_is():
    """Its level may fall to that above the errors' band, and is found there without a ripple."""
    answer = found(cogged(0.0, 5.0, (6.0, 12.0), 0.02, [0.0] * 4))
    assert answer.verdict.kind == "none"
    assert answer.gap.noise_std == pytest.approx(0.02, rel=0.1)
