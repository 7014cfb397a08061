"""Free run of a linear motor that a learned acceleration drives, and how uncertain it is.

The mean follows [i; w]_{k+1} = Ad [i; w]_k + Bd u_k + Gd f(x_k) with f at its posterior mean. For
one input f is a table on a regular axis: the mean as cubic Hermite polynomials through exact values
and slopes, the deviation by straight lines. For more inputs the inducing points are evaluated as
they are, in microseconds a sample: a table would take longer to fill than the runs to make.

The deviation is propagated along the mean to first order (Girard, Rasmussen, Quiñonero-Candela,
Murray-Smith, "Gaussian process priors with uncertain inputs: application to multiple-step ahead
time series forecasting", NIPS 2003), through the Jacobian J_k = Ad + Gd ∂f/∂x_k, from three
sources:

- the function itself. It is one unknown function, wrong in the same way whenever the run comes to
  the same speed, so its errors are carried as fully correlated along the run: δ_{k+1} = J_k δ_k +
  Gd std_f(x_k). That is exact in steady running, where runs stay, and too wide when the speed
  crosses many length scales within the motor's memory. Independent errors are far too narrow.
- the start: the first measured speed has the sensor's noise.
- what no function of these inputs explains: a disturbance acceleration, first-order autoregressive.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.compiled import njit
from ldt_core.models.gaussian_process.sparse import SparsePosterior

#: What f may depend on, in the order in which the compiled loop keeps them.
INPUTS = ("current", "speed", "voltage")
#: (ad, bd, gd, voltage, start) -> speed (L,), slopes (L, 2), deviation of f (L,): `speed_run`.
FreeRun = Callable[[Array, Array, Array, Array, Array], tuple[Array, Array, Array]]

#: Nodes of the table in a length scale. The Hermite error is h⁴/384 max|f⁗| <= 8e-8 of the size
#: that a function with this length scale has (f⁗ is 3 of it over ℓ⁴ for a single bump), smaller
#: than any sensor resolves. The line's error of the deviation is h²/8 over the length scale
#: squared, 8e-4.
NODES_PER_LENGTH = 16
#: [length scales] Margin of the table on both sides: a bump has fallen to 4e-6 there, so that the
#: step to the prior beyond it is of that size.
MARGIN = 5.0
#: Nodes at most: more are no table of a machine, and would not fit the cache.
MOST_NODES = 1_000_000
#: Squared deviation per unit of its source, at most: it could overflow.
LARGEST_VARIANCE = 1e12


@dataclass(frozen=True, eq=False)
class SpeedTable:
    """A function of one input on a regular axis; beyond its ends mean 0 and the prior's deviation.

    Nodes begin at `low` and are `step` apart; `cubic` (c, 4) are the polynomials of the cells in
    t = 0..1, lowest power first; `std` (c + 1,) is the deviation at the nodes.
    """

    low: float
    step: float
    cubic: Array
    std: Array
    prior_std: float


def tabulate(posterior: SparsePosterior) -> SpeedTable:
    """The table of a posterior with one input; a ValueError where its length is absurd."""
    (length,) = posterior.kernel.length_scales
    z = posterior.inducing[:, 0]
    low, high = float(z.min()) - MARGIN * length, float(z.max()) + MARGIN * length
    nodes_needed = (high - low) / length * NODES_PER_LENGTH
    if not nodes_needed <= MOST_NODES:
        raise ValueError(f"a length scale of {length:g} over inputs from {low:g} to {high:g}")
    count = max(int(np.ceil(nodes_needed)), 1)
    step = (high - low) / count
    nodes = np.linspace(low, high, count + 1)
    rows = posterior.kernel(nodes[:, None], posterior.inducing)
    value = rows @ posterior.weights
    slope = (rows * (z - nodes[:, None])) @ posterior.weights / length**2 * step
    a, b, rise = slope[:-1], slope[1:], np.diff(value)
    cubic = np.column_stack([value[:-1], a, 3 * rise - 2 * a - b, a + b - 2 * rise])
    std = posterior.std(nodes[:, None])
    return SpeedTable(low, step, np.ascontiguousarray(cubic), std, posterior.kernel.signal_std)


def compile_run(posterior: SparsePosterior | None, inputs: Sequence[str]) -> FreeRun:
    """The free run of a motor that this function of `inputs` drives (None for f = 0).

    Raises:
        ValueError: as `tabulate`.
    """
    if posterior is None:
        table: SpeedTable | None = SpeedTable(0.0, 1.0, np.empty((0, 4)), np.empty(0), 0.0)
    elif tuple(inputs) == ("speed",):
        table = tabulate(posterior)
    else:
        table = None
    if table is not None:
        t = table
        return lambda ad, bd, gd, voltage, start: _run_table(
            ad, bd, gd, voltage, start, t.low, t.step, t.cubic, t.std, t.prior_std
        )
    assert posterior is not None
    kernel, indices = posterior.kernel, np.array([INPUTS.index(name) for name in inputs])
    lengths, signal_std = np.array(kernel.length_scales), kernel.signal_std
    inducing, weights = np.ascontiguousarray(posterior.inducing), posterior.weights
    explained = np.tril(posterior.explained) + np.tril(posterior.explained, -1)  # half the work
    return lambda ad, bd, gd, voltage, start: _run_inducing(
        *(ad, bd, gd, voltage, start),
        *(indices, lengths, signal_std, inducing, weights, explained),
    )


@njit()
def _run_table(ad, bd, gd, voltage, start, low, step, cubic, std, prior_std):
    """Speed (L,), slopes (L, 2) of f over current and speed, deviation (L,) of f: from a table.

    The motor's states are current [A] and speed [rad/s]; see `SpeedTable` for the rest.
    """
    samples, cells = len(voltage), len(cubic)
    speed = np.empty(samples)
    slopes, deviation = np.zeros((samples, 2)), np.empty(samples)
    i, w = start[0], start[1]
    inverse = 1.0 / step
    for k in range(samples):
        speed[k] = w
        at = (w - low) * inverse
        force, deviation[k] = 0.0, prior_std
        if 0.0 <= at < cells:
            c = int(at)
            t = at - c
            c0, c1, c2, c3 = cubic[c, 0], cubic[c, 1], cubic[c, 2], cubic[c, 3]
            force = c0 + t * (c1 + t * (c2 + t * c3))
            slopes[k, 1] = (c1 + t * (2.0 * c2 + t * 3.0 * c3)) * inverse
            deviation[k] = std[c] + t * (std[c + 1] - std[c])
        i, w = (
            ad[0, 0] * i + ad[0, 1] * w + bd[0] * voltage[k] + gd[0] * force,
            ad[1, 0] * i + ad[1, 1] * w + bd[1] * voltage[k] + gd[1] * force,
        )
    return speed, slopes, deviation


@njit()
def _run_inducing(
    ad, bd, gd, voltage, start, inputs, lengths, signal_std, inducing, weights, explained
):
    """The same from the inducing points, see `SparsePosterior`.

    `inputs` (d,) are those of f: 0 current, 1 speed, 2 voltage. `explained` is the lower triangle,
    with the entries below the diagonal doubled.
    """
    samples, m, p, d = len(voltage), len(weights), len(explained), len(inputs)
    speed = np.empty(samples)
    slopes, deviation = np.zeros((samples, 2)), np.empty(samples)
    state = np.empty(3)
    state[0], state[1] = start[0], start[1]
    row, known = np.empty(m), np.empty(p)
    variance = signal_std * signal_std
    for k in range(samples):
        state[2] = voltage[k]
        speed[k] = state[1]
        row[:] = 0.0
        for a in range(d):
            x, scale = state[inputs[a]], 1.0 / lengths[a]
            for j in range(m):
                gap = (x - inducing[j, a]) * scale
                row[j] += gap * gap
        force = 0.0
        for j in range(m):
            row[j] = variance * np.exp(-0.5 * row[j])
            force += row[j] * weights[j]
        for a in range(d):
            if inputs[a] < 2:
                x, scale, slope = state[inputs[a]], 1.0 / lengths[a], 0.0
                for j in range(m):
                    slope += row[j] * weights[j] * (inducing[j, a] - x)
                slopes[k, inputs[a]] = slope * scale * scale
        known[:] = 0.0
        for j in range(p):  # row by row, so that the inner loop is vectorised
            for q in range(j + 1):
                known[q] += row[j] * explained[j, q]
        left = variance
        for j in range(p):
            left -= row[j] * known[j]
        deviation[k] = np.sqrt(max(left, 0.0))
        i, w = state[0], state[1]
        state[0] = ad[0, 0] * i + ad[0, 1] * w + bd[0] * voltage[k] + gd[0] * force
        state[1] = ad[1, 0] * i + ad[1, 1] * w + bd[1] * voltage[k] + gd[1] * force
    return speed, slopes, deviation


@njit()
def speed_variances(ad, gd, slopes, deviation, persistence):
    """Variance of the speed along a run, for each source apart.

    Args:
        ad, gd: (2, 2), (2,) discrete motor, states current [A] and speed [rad/s].
        slopes: (L, 2) of f over current and speed.
        deviation: (L,) of f [rad/s²].
        persistence: autocorrelation of the disturbance over one sample, 0 to below 1.

    Returns:
        (L,) from the function [rad²/s²], (L,) per unit of variance of the first speed, (L,) per
        unit of variance of the disturbance [s²].
    """
    samples = len(deviation)
    function, start, drift = np.empty(samples), np.empty(samples), np.empty(samples)
    fi, fw = 0.0, 0.0  # error of the function, one vector
    si, sw = 0.0, 1.0  # error of the start, one vector
    # Covariance of current, speed and disturbance (the last is 1 throughout).
    p00, p01, p02, p11, p12 = 0.0, 0.0, 0.0, 0.0, 0.0
    gi, gw = gd[0], gd[1]
    for k in range(samples):
        function[k], start[k], drift[k] = fw * fw, sw * sw, p11
        j00, j01 = ad[0, 0] + gi * slopes[k, 0], ad[0, 1] + gi * slopes[k, 1]
        j10, j11 = ad[1, 0] + gw * slopes[k, 0], ad[1, 1] + gw * slopes[k, 1]
        fi, fw = (
            j00 * fi + j01 * fw + gi * deviation[k],
            j10 * fi + j11 * fw + gw * deviation[k],
        )
        si, sw = j00 * si + j01 * sw, j10 * si + j11 * sw
        q00 = j00 * p00 + j01 * p01 + gi * p02
        q01 = j00 * p01 + j01 * p11 + gi * p12
        q02 = j00 * p02 + j01 * p12 + gi
        q10 = j10 * p00 + j11 * p01 + gw * p02
        q11 = j10 * p01 + j11 * p11 + gw * p12
        q12 = j10 * p02 + j11 * p12 + gw
        p00 = j00 * q00 + j01 * q01 + gi * q02
        p01 = j10 * q00 + j11 * q01 + gw * q02
        p11 = j10 * q10 + j11 * q11 + gw * q12
        p02, p12 = persistence * q02, persistence * q12
        f, s = fi * fi + fw * fw, si * si + sw * sw
        if f > LARGEST_VARIANCE:
            shrink = np.sqrt(LARGEST_VARIANCE / f)
            fi, fw = fi * shrink, fw * shrink
        if s > LARGEST_VARIANCE:
            shrink = np.sqrt(LARGEST_VARIANCE / s)
            si, sw = si * shrink, sw * shrink
        if p00 + p11 > LARGEST_VARIANCE:
            shrink = LARGEST_VARIANCE / (p00 + p11)
            root = np.sqrt(shrink)
            p00, p01, p11 = p00 * shrink, p01 * shrink, p11 * shrink
            p02, p12 = p02 * root, p12 * root
    return function, start, drift
