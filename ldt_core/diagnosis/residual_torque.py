"""The torque on the shaft that would explain a residual.

The residual speed of a motor under an extra torque T follows J r' = T - (J / tau) r, tau being the
time in which the motor forgets its speed. Turned round, with the residual smoothed, it gives the
torque at each moment, where the free run's error itself would smear it over tau.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from ldt_core.base.arrays import Array
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.simulated_experiments import StartStates, Use
from ldt_core.diagnosis.torque_curve import TorqueCurve, torque_curve
from ldt_core.estimation.smoothing import polynomial_weights, smoothed

WINDOW = 0.7  # of the motor's memory: a longer window would smear the torque over speeds
DEGREE = 2  # of the smoothing polynomial: it has a slope and a curvature
QUANTITIES = {
    "speed": "rad/s",
    "voltage": "V",
    "acceleration": "rad/s^2",
    "time": "s",
    "experiment": "",
}

LEAST_GAIN = 0.02  # of the torque's variance beyond noise: what a step predicts in addition
MOST_SAMPLES = 8000  # of the torque: more take longer and tell no more
SPLINE_KNOTS = 8  # of each quantity: a law is smooth over an eighth of the data
#: Per turn: a half and low multiples, of which ripples consist.
SHAFT_ORDERS = (0.5, 1.0, 2.0, 3.0, 4.0)
LAGS = (1, 2, 4, 8)  # time constants of the motor, at which what went before is looked up
RIDGE_PENALTY = 1.0  # on splines, which are between 0 and 1: keeps those alike in check
FOLDS = 5  # of cross-validation: each model sees four fifths of the experiments


class TorqueEstimator:
    """The torque behind a residual speed, for one sample period.

    Args:
        inertia: J [kg m^2].
        memory: tau [s].
        period: of the samples [s].
        length: of the experiment, in samples.
    """

    def __init__(self, inertia: float, memory: float, period: float, length: int) -> None:
        samples = max(int(WINDOW * memory / period) | 1, DEGREE + 3)
        self.window = min(samples, length - 1 + length % 2)
        self.inertia, self.memory, self.period = inertia, memory, period

    def smooth(self, signal: Array, derivative: int = 0) -> Array:
        """(L,) signal or its derivative."""
        if self.window <= DEGREE:
            return np.gradient(signal, self.period) if derivative else signal
        return smoothed(signal, self.window, DEGREE, derivative, self.period)

    def of(self, residual: Array) -> Array:
        """(L,) torque [N m] that explains (L,) measured minus simulated speed [rad/s]."""
        return self.inertia * (self.smooth(residual, 1) + self.smooth(residual) / self.memory)

    @property
    def noise(self) -> float:
        """Deviation of the torque [N m] per deviation of white noise on the speed [rad/s]."""
        if self.window <= DEGREE:
            return self.inertia / self.memory
        slope = polynomial_weights(self.window, DEGREE, 1, self.period)
        mean = polynomial_weights(self.window, DEGREE, 0, self.period)
        return float(self.inertia * np.linalg.norm(slope + mean / self.memory))


@dataclass(frozen=True, eq=False)
class ResidualTorque:
    """The torque that explains what is wrong, sample by sample, over all experiments.

    Attributes:
        torque: (N,) smoothed so long that ripples and noise are small [N m].
        noise: (N,) its deviation that comes from the sensor's noise [N m].
        over: quantity to (N,) values.
        periods: sample period of each [s].
        window: samples over which `torque` is smoothed.
        left: (L,) what is wrong with the speed in each [rad/s].
        speeds: (L,) speed in each, not smoothed [rad/s].
        deviation: of the sensor's noise on `left` [rad/s].
    """

    torque: Array
    noise: Array
    over: dict[str, Array]
    pieces: list[int]
    periods: list[float]
    window: int
    residuals: FreeRunResiduals
    left: list[Array]
    speeds: list[Array]
    deviation: float

    @functools.cached_property
    def power(self) -> Array:
        """(N,) squared torque beyond noise."""
        return self.torque**2 - self.noise**2

    def curve(self, quantity: str) -> TorqueCurve:
        """The mean torque over a quantity."""
        split = np.split(self.over[quantity], np.cumsum(self.pieces)[:-1])
        values = self.speeds if quantity == "speed" else split
        return torque_curve(
            self.left,
            values,
            self.periods,
            [p.at_rest for p in self.residuals.pieces],
            self.residuals.values["J"],
            self.residuals.memory,
            self.deviation,
        )


def residual_torque(
    residuals: FreeRunResiduals, use: Use = (), starts: StartStates | None = None
) -> ResidualTorque:
    """The torque left by these effects, and what it may depend on."""
    simulated = [
        residuals.outputs(i, use, angle=_angle(residuals, starts, i))[0]
        for i in range(len(residuals.pieces))
    ]
    measured = [e.speed for e in residuals.experiments]
    left = [a - b for a, b in zip(measured, simulated, strict=True)]
    return _torque_of(residuals, left, measured, residuals.noise[0])


def added_torque(
    residuals: FreeRunResiduals, use: Use, to: Use, starts: StartStates | None = None
) -> ResidualTorque:
    """The torque that effects add to others, as simulated: free of noise.

    Args:
        use: effects before.
        to: effects after.
        starts: states at the first samples, with the latter.
    """
    moved, after = [], []
    for i in range(len(residuals.pieces)):
        after.append(residuals.outputs(i, to, angle=_angle(residuals, starts, i))[0])
        moved.append(
            after[-1] - residuals.outputs(i, use, angle=_angle(residuals, residuals.starts, i))[0]
        )
    return _torque_of(residuals, moved, after, 0.0)


def _angle(residuals: FreeRunResiduals, starts: StartStates | None, i: int) -> float:
    return float((starts or residuals.starts).angles[i])


def _torque_of(
    residuals: FreeRunResiduals, left: Sequence[Array], speeds: Sequence[Array], deviation: float
) -> ResidualTorque:
    torque, noise, window = [], [], 1
    over: dict[str, list[Array]] = {name: [] for name in QUANTITIES}
    for e, wrong, speed in zip(residuals.experiments, left, speeds, strict=True):
        turn = TorqueEstimator(residuals.values["J"], residuals.memory, e.period, len(e))
        torque.append(turn.of(wrong))
        noise.append(np.full(len(e), turn.noise * deviation))
        window = max(window, turn.window)
        over["speed"].append(turn.smooth(speed))
        over["voltage"].append(np.asarray(e.voltage))
        over["acceleration"].append(turn.smooth(speed, 1))
        over["time"].append(e.time)
        over["experiment"].append(np.full(len(e), float(e.number)))
    return ResidualTorque(
        np.concatenate(torque),
        np.concatenate(noise),
        {name: np.concatenate(parts) for name, parts in over.items()},
        [len(e) for e in residuals.experiments],
        [e.period for e in residuals.experiments],
        window,
        residuals,
        list(left),
        list(speeds),
        deviation,
    )


def depends_on(residuals: FreeRunResiduals, left: ResidualTorque) -> list[str]:
    """What the torque left over can be predicted from.

    A ladder of ever more that it may depend on: smooth functions of speed, then also of voltage,
    acceleration, time, experiment, shaft angle, and what went before. A step counts when it
    predicts experiments that it was not fitted to better than the steps below.
    """
    groups = np.repeat(np.arange(len(left.pieces)), left.pieces)
    take = np.arange(0, left.torque.size, max(1, left.torque.size // MOST_SAMPLES))
    if len(left.pieces) < FOLDS:  # parts of experiments instead
        groups = np.arange(left.torque.size) * 2 * FOLDS // left.torque.size
    target, folds = left.torque[take], groups[take] % FOLDS
    explainable = max(float(np.mean(left.power)), 1e-300)
    columns: list[Array] = []
    found: list[str] = []
    best = float(np.mean(target**2))
    for name, added in _ladder(residuals, left):
        # What changes by less has no variance in floating point: nothing can depend on it.
        seen = [c[take] for c in added if np.ptp(c[take]) > np.sqrt(np.finfo(np.float64).tiny)]
        if not seen:
            continue
        tried = [*columns, *map(_splines, seen)]
        guessed = _predicted(np.column_stack(tried), target, folds)
        square = float(np.mean((target - guessed) ** 2))
        if best - square > LEAST_GAIN * explainable:
            found.append(name)
            best = square
            columns = tried
    return found


def _splines(x: Array) -> Array:
    """(N, q) cubic B-splines of x (N,), whose knots have as many samples between them."""
    knots = np.unique(np.quantile(x, np.linspace(0.0, 1.0, SPLINE_KNOTS)))
    knots = np.concatenate([[knots[0]] * 3, knots, [knots[-1]] * 3])
    return np.asarray(BSpline.design_matrix(x, knots, 3).toarray())


def _predicted(columns: Array, target: Array, folds: NDArray[np.int64]) -> Array:
    """(N,) ridge regression on columns (N, p), each fold predicted from the others."""
    design = np.column_stack([np.ones(target.size), columns])
    penalty = RIDGE_PENALTY * np.eye(design.shape[1])
    penalty[0, 0] = 0.0  # the mean is free
    guessed = np.empty(target.size)
    for fold in np.unique(folds):
        kept, rows = design[folds != fold], design[folds == fold]
        weights = np.linalg.solve(kept.T @ kept + penalty, kept.T @ target[folds != fold])
        guessed[folds == fold] = rows @ weights
    return guessed


def _ladder(residuals: FreeRunResiduals, left: ResidualTorque) -> list[tuple[str, list[Array]]]:
    over = left.over
    angle, before = [], []
    at = 0
    for length, period in zip(left.pieces, left.periods, strict=True):
        part = slice(at, at + length)
        angle.append(np.cumsum(over["speed"][part]) * period)
        # A heavy machine remembers longer than was measured, up to more than memory holds.
        steps = [max(1, min(length, round(k * residuals.memory / period))) for k in LAGS]
        volts = over["voltage"][part]
        before.append(
            np.column_stack([np.concatenate([np.full(s, volts[0]), volts])[:length] for s in steps])
        )
        at += length
    theta, lags = np.concatenate(angle), np.concatenate(before)
    turned = [f(order * theta) for order in SHAFT_ORDERS for f in (np.sin, np.cos)]
    return [
        ("speed", [over["speed"]]),
        ("voltage", [over["voltage"]]),
        ("acceleration", [over["acceleration"]]),
        ("time", [over["time"]]),
        ("experiment", [over["experiment"]]),
        ("angle", turned),
        ("history", list(lags.T)),
    ]
