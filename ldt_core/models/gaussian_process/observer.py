"""What a measured run says of an unknown acceleration that drives a linear motor.

    [i; w]_{k+1} = Ad [i; w]_k + Bd u_k + Gd f(x_k) + [0; process noise],   y_k = w_k + noise

One-step differences y_{k+1} - y_k minus the physics carry the noise of two samples each, and y_k is
in the input as well as, with a minus sign, in the target: a regression on them sees a restoring
force that does not exist. The innovations of a Kalman filter for the equation above carry the same
information with white noise, and they are linear in f: the innovation of the measurements, filtered
with f = 0, equals that of the function's own column plus white noise. So generalised least squares
is ordinary least squares on filtered columns. A gain of 1 would give back the one-step differences,
a gain of 0 the output error of a free run; the ratio of the two noise variances is chosen by
likelihood.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.compiled import njit
from ldt_core.estimation.motor_run import MotorRun

#: Ratios of process to sensor noise variance [per sample] that are tried: from a pure free run to
#: pure one-step differences, three a decade.
RATIOS = np.concatenate([[0.0], np.logspace(-6, 3, 28)])


@dataclass(frozen=True, eq=False)
class ObserverNoise:
    """White noise of sensor and process: std of the sensor [rad/s], ratio of the variances."""

    std: float
    ratio: float


@njit()
def one_step(run):
    """Equation error of the physics alone.

    Returns:
        acceleration (L - 1,) [rad/s²] that the physics lacks, from each sample to the next, and the
        current (L,) [A], propagated by the physics under the measured speed.
    """
    ad, bd, gd, voltage, speed = run.ad, run.bd, run.gd, run.voltage, run.speed
    lacking = np.empty(len(speed) - 1)
    currents = np.empty(len(speed))
    currents[0] = run.current
    for k in range(len(speed) - 1):
        i, w, u = currents[k], speed[k], voltage[k]
        lacking[k] = (speed[k + 1] - ad[1, 0] * i - ad[1, 1] * w - bd[1] * u) / gd[1]
        currents[k + 1] = ad[0, 0] * i + ad[0, 1] * w + bd[0] * u
    return lacking, currents


@njit()
def kalman_gains(ad, ratio, samples):
    """Kalman gains (L, 2) and innovation scales (L,), in units of the sensor noise."""
    gains, scales = np.zeros((samples, 2)), np.ones(samples)
    # The first sample is all that is known of the start; the current is taken as known.
    p00, p01, p11 = 0.0, 0.0, 1.0
    for k in range(1, samples):
        q00 = ad[0, 0] * p00 + ad[0, 1] * p01
        q01 = ad[0, 0] * p01 + ad[0, 1] * p11
        q10 = ad[1, 0] * p00 + ad[1, 1] * p01
        q11 = ad[1, 0] * p01 + ad[1, 1] * p11
        p00 = q00 * ad[0, 0] + q01 * ad[0, 1]
        p01 = q00 * ad[1, 0] + q01 * ad[1, 1]
        p11 = q10 * ad[1, 0] + q11 * ad[1, 1] + ratio
        scale = p11 + 1.0
        gains[k, 0], gains[k, 1] = p01 / scale, p11 / scale
        scales[k] = np.sqrt(scale)
        p00 -= gains[k, 0] * p01
        p01 -= gains[k, 0] * p11
        p11 -= gains[k, 1] * p11
    return gains, scales


@njit()
def filtered(run, force, ratio):
    """Kalman filter over one run with a known acceleration.

    Args:
        run: the experiment, a `MotorRun`.
        force: (L,) acceleration at the samples [rad/s²]; the last has no effect.
        ratio: process over sensor noise variance.

    Returns:
        innovations (L - 1,) scaled to the sensor noise [rad/s], states (L, 2) estimated from the
        measurements up to each sample, and the scales (L - 1,) of the innovations.
    """
    ad, bd, gd, voltage, speed = run.ad, run.bd, run.gd, run.voltage, run.speed
    samples = len(speed)
    gains, scales = kalman_gains(ad, ratio, samples)
    innovations, states = np.empty(samples - 1), np.empty((samples, 2))
    i, w = run.current, speed[0]
    states[0, 0], states[0, 1] = i, w
    for k in range(1, samples):
        u, f = voltage[k - 1], force[k - 1]
        ahead_i = ad[0, 0] * i + ad[0, 1] * w + bd[0] * u + gd[0] * f
        ahead_w = ad[1, 0] * i + ad[1, 1] * w + bd[1] * u + gd[1] * f
        surprise = speed[k] - ahead_w
        innovations[k - 1] = surprise / scales[k]
        i, w = ahead_i + gains[k, 0] * surprise, ahead_w + gains[k, 1] * surprise
        states[k, 0], states[k, 1] = i, w
    return innovations, states, scales[1:]


@njit()
def filter_columns(run, columns, gains, scales, states):
    """What accelerations at samples in a row contribute to the scaled innovations after each.

    Args:
        run: the experiment, a `MotorRun`.
        columns: (n, m) accelerations [rad/s²].
        gains, scales: (n, 2), (n,) of the samples after these, see `kalman_gains`.
        states: (2, m) what came before, 0 at first; changed to what comes after.

    Returns:
        (n, m).
    """
    ad, gd = run.ad, run.gd
    samples, m = columns.shape
    out = np.empty((samples, m))
    i, w = states[0], states[1]
    for k in range(samples):
        for j in range(m):
            f = columns[k, j]
            ahead_i = ad[0, 0] * i[j] + ad[0, 1] * w[j] + gd[0] * f
            ahead_w = ad[1, 0] * i[j] + ad[1, 1] * w[j] + gd[1] * f
            out[k, j] = ahead_w / scales[k]
            i[j] = ahead_i - gains[k, 0] * ahead_w
            w[j] = ahead_w - gains[k, 1] * ahead_w
    return out


def estimate_noise(runs: Sequence[MotorRun], forces: Sequence[Array]) -> ObserverNoise:
    """Maximum-likelihood noise of sensor and process, given the accelerations (L,) [rad/s²]."""
    best, least = ObserverNoise(0.0, 0.0), np.inf
    for ratio in RATIOS:
        squares, logs, count = 0.0, 0.0, 0
        for run, force in zip(runs, forces, strict=True):
            innovations, _, scales = filtered(run, force, float(ratio))
            squares += float(innovations @ innovations)
            logs += 2 * float(np.log(scales).sum())
            count += len(scales)
        variance = squares / count
        if variance == 0:
            return ObserverNoise(0.0, float(ratio))
        minus_log_likelihood = count * np.log(variance) + logs
        if minus_log_likelihood < least:
            best, least = (
                ObserverNoise(float(np.sqrt(variance)), float(ratio)),
                minus_log_likelihood,
            )
    return best
