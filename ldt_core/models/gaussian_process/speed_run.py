"""Free run of a linear motor that a learned acceleration drives, and how uncertain it is.

The mean follows [i; w]_{k+1} = Ad [i; w]_k + Bd u_k + Gd f(x_k) with f at its posterior mean.
The deviation is propagated along it to first order (Girard, Rasmussen, Quiñonero-Candela,
Murray-Smith, "Gaussian process priors with uncertain inputs: application to multiple-step ahead
time series forecasting", NIPS 2003), through the Jacobian J_k = Ad + Gd ∂f/∂x_k, from three
sources:

- the function itself. It is one unknown function, wrong in the same way whenever the run comes to
  the same speed, so its errors are carried as fully correlated along the run: δ_{k+1} = J_k δ_k +
  Gd std_f(x_k). That is exact in steady running, where runs stay, and too wide when the
  speed crosses many length scales within the motor's memory. Taking them as independent, as is
  common, is far too narrow.
- the start: the first measured speed has the sensor's noise.
- what no function of these inputs explains: a disturbance acceleration, first-order autoregressive.
"""

from __future__ import annotations

import numpy as np
from numba import njit

#: Squared deviation per unit of its source, at most: it could overflow.
LARGEST_VARIANCE = 1e12


@njit(cache=True)
def run_table(ad, bd, gd, voltage, start, low, step, cubic, std, prior_std):
    """Mean run with f of the speed from a table.

    Args:
        ad: (2, 2) discrete motor, states current [A] and speed [rad/s].
        bd: (2,) likewise, for the voltage.
        gd: (2,) likewise, for an acceleration of the shaft.
        voltage: (L,) [V].
        start: (2,) state at the first sample.
        low: first node of the table [rad/s]; `compiled.SpeedTable` describes this and the rest.
        step: distance of nodes [rad/s].
        cubic: (c, 4) polynomials [rad/s²].
        std: (c + 1,) [rad/s²].
        prior_std: beyond the table [rad/s²].

    Returns:
        speed (L,), slopes (L, 2) of f over current and speed, deviation (L,) of f.
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


@njit(cache=True)
def run_inducing(
    ad, bd, gd, voltage, start, inputs, lengths, signal_std, inducing, weights, explained
):
    """Mean run with f of one to three inputs from the inducing points.

    Args:
        ad: (2, 2) discrete motor, states current [A] and speed [rad/s].
        bd: (2,) likewise, for the voltage.
        gd: (2,) likewise, for an acceleration of the shaft.
        voltage: (L,) [V].
        start: (2,) state at the first sample.
        inputs: (d,) of f: 0 current, 1 speed, 2 voltage.
        lengths: (d,) length scales.
        signal_std: prior deviation of f [rad/s²].
        inducing: (m, d), `sparse.SparsePosterior` describes this and the rest.
        weights: (m,).
        explained: (p, p), lower triangle, with the entries below the diagonal doubled.

    Returns:
        speed (L,), slopes (L, 2) of f over current and speed, deviation (L,) of f.
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


@njit(cache=True)
def spread(ad, gd, slopes, deviation, persistence):
    """Variance of the speed along a run, for each source apart.

    Args:
        ad: (2, 2) discrete motor, states current [A] and speed [rad/s].
        gd: (2,) likewise, for an acceleration of the shaft.
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
