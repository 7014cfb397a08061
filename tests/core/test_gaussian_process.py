"""Claims about `ldt_core.models.gaussian_process`, without any model of the twin."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ldt_core.base.errors import LdtError
from ldt_core.estimation.motor_run import MotorRun
from ldt_core.models.gaussian_process.observer import (
    estimate_noise,
    filter_columns,
    filtered,
    kalman_gains,
)
from ldt_core.models.gaussian_process.sparse import (
    Kernel,
    SparsePosterior,
    cells,
    choose_inducing,
    condition,
    fit_hyperparameters,
    minus_log_likelihood,
)
from ldt_core.models.gaussian_process.speed_run import compile_run, speed_variances, tabulate

# A motor with a mechanical time constant of 0.2 s, sampled at 100 Hz.
AD = np.array([[0.003, -0.28], [0.019, 0.95]])
BD = np.array([0.95, 0.11])
GD = np.array([-0.001, 0.0098])
PERIOD = 0.01


def motor(force=None, samples=400, noise=0.0, process=0.0, seed=0) -> MotorRun:
    """A run of that motor, with an acceleration force(w) [rad/s²] that the physics lacks."""
    rng = np.random.default_rng(seed)
    voltage = np.repeat(rng.uniform(0, 10, samples // 50 + 1), 50)[:samples]
    state, speed = np.zeros(2), np.empty(samples)
    for k in range(samples):
        speed[k] = state[1]
        extra = force(state[1]) if force else 0.0
        shock = np.array([0.0, process * rng.standard_normal()])
        state = AD @ state + BD * voltage[k] + GD * extra + shock
    return MotorRun(AD, BD, GD, PERIOD, voltage, speed + noise * rng.standard_normal(samples), 0.0)


def trained(x, y, kernel, noise=0.1) -> SparsePosterior:
    z = choose_inducing(x, kernel, 200)
    return condition(kernel, z, [(kernel(x, z), y)], noise)


@pytest.mark.parametrize("numbers", [(0.0, (1.0,)), (1.0, (-1.0,)), (1.0, ()), (np.nan, (1.0,))])
def test_a_kernel_refuses_numbers_that_are_no_kernel(numbers):
    """Deviations and length scales are above 0, and there is at least one input."""
    with pytest.raises(ValueError, match="kernel: expected finite numbers above 0"):
        Kernel(*numbers)


def test_the_sparse_posterior_is_the_exact_one():
    """With enough inducing points mean and deviation equal those of dense Gaussian conditioning."""
    rng = np.random.default_rng(1)
    x = rng.uniform(0, 10, (300, 2))
    y = np.sin(x[:, 0]) + 0.1 * rng.standard_normal(300)
    kernel = Kernel(1.5, (2.0, 6.0))
    ours = trained(x, y, kernel)
    at = rng.uniform(0, 10, (50, 2))
    inverse = np.linalg.inv(kernel(x, x) + 0.01 * np.eye(300))
    mean = kernel(at, x) @ inverse @ y
    variance = 1.5**2 - np.einsum("ij,jk,ik->i", kernel(at, x), inverse, kernel(at, x))
    np.testing.assert_allclose(ours.mean(at), mean, atol=2e-3)
    np.testing.assert_allclose(ours.std(at), np.sqrt(variance), atol=2e-3)


def test_a_functional_of_the_function_is_as_good_as_its_values():
    """Conditioning on running sums gives what dense conditioning on the same sums gives."""
    rng = np.random.default_rng(2)
    x = rng.uniform(0, 10, (200, 1))
    functional = np.tril(np.ones((200, 200))) / 10
    kernel = Kernel(2.0, (1.5,))
    y = functional @ np.cos(x[:, 0]) + 0.05 * rng.standard_normal(200)
    z = choose_inducing(x, kernel, 200)
    ours = condition(kernel, z, [(functional @ kernel(x, z), y)], 0.05)
    at = np.linspace(0, 10, 40)[:, None]
    gram = functional @ kernel(x, x) @ functional.T + 0.05**2 * np.eye(200)
    np.testing.assert_allclose(
        ours.mean(at), kernel(at, x) @ functional.T @ np.linalg.solve(gram, y), atol=0.01
    )


def test_observations_may_come_in_parts():
    """Two batches give the posterior of one."""
    rng = np.random.default_rng(3)
    x = rng.uniform(0, 5, (80, 1))
    y = np.sin(x[:, 0])
    kernel = Kernel(1.0, (1.0,))
    z = choose_inducing(x, kernel, 50)
    rows = kernel(x, z)
    whole = condition(kernel, z, [(rows, y)], 0.1)
    parts = condition(kernel, z, [(rows[:30], y[:30]), (rows[30:], y[30:])], 0.1)
    np.testing.assert_allclose(parts.mean(x), whole.mean(x), atol=1e-9)


def test_inducing_points_are_as_many_as_the_length_scale_needs():
    """A long length scale needs few; the bound holds; a smaller bound gives the first of them."""
    x = np.random.default_rng(4).uniform(0, 10, (1000, 1))
    few, many = (choose_inducing(x, Kernel(1.0, (s,)), 200) for s in (10.0, 0.5))
    assert len(few) < 10 < len(many) < 100
    assert len(np.unique(many)) == len(many)
    np.testing.assert_array_equal(choose_inducing(x, Kernel(1.0, (0.5,)), 12), many[:12])


def test_hyperparameters_of_a_known_process_are_found():
    """Length scale, deviation: within 25 % of those the data were drawn with."""
    rng = np.random.default_rng(5)
    x = np.sort(rng.uniform(0, 100, 3000))[:, None]
    grid = np.linspace(0, 100, 500)[:, None]
    kernel = Kernel(3.0, (4.0,))
    root = np.linalg.cholesky(kernel(grid, grid) + 1e-6 * np.eye(500))
    function = np.interp(x[:, 0], grid[:, 0], root @ rng.standard_normal(500))
    found = fit_hyperparameters(x, function + rng.standard_normal(3000))
    assert found.length_scales[0] == pytest.approx(4.0, rel=0.25)
    assert found.signal_std == pytest.approx(3.0, rel=0.25)


@pytest.mark.parametrize(("x_unit", "y_unit"), [(1e3, 1.0), (1.0, 1e-6), (1e-5, 1e4)])
def test_hyperparameters_scale_with_the_units(x_unit, y_unit):
    """The same data in other units give the same kernel in those units."""
    rng = np.random.default_rng(6)
    x = rng.uniform(0, 10, (400, 2))
    y = np.sin(x[:, 0]) + 0.1 * rng.standard_normal(400)
    here, there = fit_hyperparameters(x, y), fit_hyperparameters(x * x_unit, y * y_unit)
    assert there.signal_std == pytest.approx(here.signal_std * y_unit, rel=1e-2)
    np.testing.assert_allclose(there.length_scales, np.multiply(here.length_scales, x_unit), 1e-2)


def test_cells_fill_the_space_and_know_their_noise():
    """Data piled up in one place get few cells; a mean's stated variance is its real one."""
    rng = np.random.default_rng(7)
    x = np.concatenate([rng.normal(5, 0.01, 5000), rng.uniform(0, 10, 1000)])[:, None]
    inputs, targets, variance, width = cells(x, 2.0 * rng.standard_normal(6000))
    assert np.mean(np.abs(inputs[:, 0] - 5) < 0.1) < 0.1
    assert np.mean(targets**2 / variance) == pytest.approx(1.0, abs=0.3)
    assert width[0] == pytest.approx(10 / len(inputs), rel=0.5)


@pytest.mark.parametrize(
    ("x", "words"),
    [(np.ones((50, 1)), "the same in all"), (np.full((50, 1), np.inf), "not finite")],
)
def test_data_that_determine_nothing_are_refused(x, words):
    """A constant or an infinite input gets a sentence."""
    with pytest.raises(LdtError, match=words):
        fit_hyperparameters(x, np.zeros(50))


def a_posterior() -> SparsePosterior:
    rng = np.random.default_rng(8)
    x = rng.uniform(0, 10, (200, 1))
    return trained(x, 5 * np.sin(x[:, 0]), Kernel(5.0, (1.5,)))


def test_the_table_is_the_function():
    """Mean within 1e-6 of the prior deviation, deviation within 1e-3, slope within 1e-4 of it."""
    posterior = a_posterior()
    table = tabulate(posterior)
    at = np.random.default_rng(9).uniform(-5, 15, 2000)
    cell, t = np.divmod((at - table.low) / table.step, 1.0)
    c = table.cubic[cell.astype(int)].T
    mean = c[0] + t * (c[1] + t * (c[2] + t * c[3]))
    slope = (c[1] + t * (2 * c[2] + 3 * t * c[3])) / table.step
    std = np.interp(at, table.low + table.step * np.arange(len(table.std)), table.std)
    h = 1e-4
    exact_slope = (posterior.mean(at[:, None] + h) - posterior.mean(at[:, None] - h)) / (2 * h)
    assert np.abs(mean - posterior.mean(at[:, None])).max() < 1e-6 * 5
    assert np.abs(slope - exact_slope).max() < 1e-4 * 5
    assert np.abs(std - posterior.std(at[:, None])).max() < 1e-3 * 5


@pytest.mark.slow
def test_far_from_the_data_the_prior_returns():
    """Mean 0 and the prior's deviation, in the formula and beyond the ends of the table alike."""
    posterior = a_posterior()
    far = np.array([[-30.0], [60.0]])
    np.testing.assert_allclose(posterior.mean(far), 0, atol=1e-6)
    np.testing.assert_allclose(posterior.std(far), 5.0, rtol=1e-9)
    run = compile_run(posterior, ["speed"])
    _, slopes, deviation = run(AD, BD, GD, np.zeros(2), np.array([0.0, 500.0]))
    assert (slopes[0] == 0).all()
    assert deviation[0] == 5.0


@pytest.mark.slow
def test_table_and_inducing_points_run_alike():
    """The two compiled forms of one function give one free run."""
    posterior = a_posterior()
    wide = SparsePosterior(
        Kernel(5.0, (1.5, 1e9)),  # does not depend on the second input
        np.column_stack([posterior.inducing[:, 0], np.zeros(len(posterior.inducing))]),
        posterior.weights,
        posterior.explained,
    )
    measured = motor()
    of = (AD, BD, GD, measured.voltage, np.zeros(2))
    table, points = (
        compile_run(p, i)(*of) for p, i in ((posterior, ["speed"]), (wide, ["speed", "voltage"]))
    )
    for a, b, atol in zip(table, points, (1e-5, 1e-3, 1e-2), strict=True):
        np.testing.assert_allclose(a, b, atol=atol)


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(ratio=st.floats(0, 1e4), seed=st.integers(0, 100))
def test_innovations_are_linear_in_the_acceleration(ratio, seed):
    """Filtering with f known is filtering with f = 0 minus the filtered column of f."""
    run = motor(np.sin, noise=0.1, seed=seed)
    force = np.random.default_rng(seed).standard_normal(len(run.speed))
    known, _, _ = filtered(run, force, ratio)
    without, _, _ = filtered(run, np.zeros_like(force), ratio)
    gains, scales = kalman_gains(run.ad, ratio, len(force))
    states, parts = np.zeros((2, 1)), []
    for here in (slice(0, 100), slice(100, len(force) - 1)):  # in two parts, as of a long run
        after = slice(here.start + 1, here.stop + 1)
        parts.append(filter_columns(run, force[here, None], gains[after], scales[after], states))
    column = np.concatenate(parts)[:, 0]
    np.testing.assert_allclose(known, without - column, atol=1e-9)


def test_innovations_of_the_truth_are_nothing_but_noise():
    """With the true acceleration and no noise the filter is never surprised."""
    run = motor(lambda w: 3 * np.sin(w))
    innovations, states, _ = filtered(run, 3 * np.sin(run.speed), 0.1)
    assert np.abs(innovations).max() < 1e-10
    np.testing.assert_allclose(states[:, 1], run.speed, atol=1e-10)


@pytest.mark.parametrize(("sensor", "process"), [(0.3, 0.0), (0.3, 0.1), (0.05, 0.5)])
def test_sensor_and_process_noise_are_told_apart(sensor, process):
    """Both are recovered to 10 % of the larger one from 4000 samples."""
    slack = 0.1 * max(sensor, process)
    runs = [motor(None, 2000, sensor, process, seed) for seed in (1, 2)]
    found = estimate_noise(runs, [np.zeros(2000)] * 2)
    assert found.std == pytest.approx(sensor, abs=slack)
    assert np.sqrt(found.ratio) * found.std == pytest.approx(process, abs=slack)


def test_the_carried_spread_is_that_of_sampled_runs():
    """Start and disturbance: the propagated variance is the one of 4000 noisy runs, within 10 %."""
    rng = np.random.default_rng(10)
    samples, runs, rho = 60, 4000, 0.9
    slopes = np.column_stack([np.full(samples, -0.5), np.full(samples, -3.0)])
    function, start, drift = speed_variances(AD, GD, slopes, np.ones(samples), rho)
    jacobian = AD + np.outer(GD, [-0.5, -3.0])
    state, d = np.zeros((2, runs)), rng.standard_normal(runs)
    wrong = np.zeros(2)
    from_start = np.array([0.0, 1.0])
    for k in range(samples):
        assert function[k] == pytest.approx(wrong[1] ** 2)
        assert start[k] == pytest.approx(from_start[1] ** 2)
        if k > 5:
            assert drift[k] == pytest.approx(state[1].var(), rel=0.1)
        state = jacobian @ state + GD[:, None] * d
        d = rho * d + np.sqrt(1 - rho**2) * rng.standard_normal(runs)
        wrong = jacobian @ wrong + GD
        from_start = jacobian @ from_start


def test_an_unstable_stretch_does_not_overflow():
    """A slope that blows errors up gives a large finite variance, not infinity."""
    slopes = np.column_stack([np.zeros(5000), np.full(5000, 50.0)])
    for variance in speed_variances(AD, GD, slopes, np.ones(5000), 0.5):
        assert np.isfinite(variance).all()
        assert variance.min() >= 0


@pytest.mark.slow
@pytest.mark.parametrize("inputs", [1, 2])
def test_kernel_is_the_one_that_scikit_learn_finds(inputs):
    """The same data, bounds and starts give the same parameters, to 1e-3."""
    process = pytest.importorskip("sklearn.gaussian_process")
    kernels = process.kernels
    rng = np.random.default_rng(3)
    x = rng.uniform(-3, 3, (300, inputs))
    y = np.sin((2 if inputs == 1 else 0.7) * x).sum(axis=1) + 0.1 * rng.standard_normal(300)
    ours = fit_hyperparameters(x, y)
    means, targets, variance, width = cells(x, y)
    span, size = np.ptp(x, axis=0), np.sqrt(np.mean(y**2))
    bounds = [(2 * w / s, 3.0) for w, s in zip(width, span, strict=True)]
    first = [np.sqrt(low / 2) for low, _ in bounds]
    prior = kernels.ConstantKernel(0.5, (1e-4, 1e2)) * kernels.RBF(first, bounds)
    theirs = process.GaussianProcessRegressor(
        prior, alpha=variance / size**2, n_restarts_optimizer=2, random_state=0
    ).fit(means / span, targets / size)
    lengths = np.atleast_1d(theirs.kernel_.k2.length_scale) * span
    assert ours.length_scales == pytest.approx(lengths, rel=1e-3)
    assert ours.signal_std == pytest.approx(
        size * np.sqrt(theirs.kernel_.k1.constant_value), rel=1e-3
    )


def test_derivative_of_the_likelihood_is_its_derivative():
    """Against central differences, two inputs."""
    rng = np.random.default_rng(4)
    x, y = rng.standard_normal((30, 2)), rng.standard_normal(30)
    squares = np.array([np.subtract.outer(c, c) ** 2 for c in x.T])
    theta, noise = np.array([0.3, -0.2, 0.4]), np.full(30, 0.1)
    _, slope = minus_log_likelihood(theta, squares, y, noise)
    h = 1e-6
    differences = [
        (
            minus_log_likelihood(theta + h * d, squares, y, noise)[0]
            - minus_log_likelihood(theta - h * d, squares, y, noise)[0]
        )
        / (2 * h)
        for d in np.eye(3)
    ]
    assert slope == pytest.approx(differences, rel=1e-6, abs=1e-6)
