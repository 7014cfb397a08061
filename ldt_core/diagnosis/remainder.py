"""What is left after the best set, and what it can be predicted from.

A ladder of ever more that the torque left over may depend on: smooth functions of speed, then also
of voltage, acceleration, time, shaft angle, and what went before. A step counts when it predicts
experiments that it was not fitted to better than the steps below.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.residual_torque import ResidualTorque

Array = NDArray[np.float64]

LEAST_GAIN = 0.02  # of the torque's variance beyond noise: what a step predicts in addition
MOST_SAMPLES = 8000  # of the torque: more take longer and tell no more
SPLINE_KNOTS = 8  # of each quantity: a law is smooth over an eighth of the data
SHAFT_ORDERS = (
    0.5,
    1.0,
    2.0,
    3.0,
    4.0,
)  # per turn: halves and low multiples, of which ripples consist
LAGS = (1, 2, 4, 8)  # time constants of the motor, at which what went before is looked up
RIDGE_PENALTY = 1.0  # on standardised columns: keeps those that are alike in check
FOLDS = 5  # of cross-validation: each model sees four fifths of the experiments


def depends_on(residuals: FreeRunResiduals, left: ResidualTorque) -> list[str]:
    """What the torque left over can be predicted from, in the order of the ladder."""
    from sklearn.linear_model import Ridge
    from sklearn.model_selection import GroupKFold, cross_val_predict
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import SplineTransformer, StandardScaler

    groups = np.repeat(np.arange(len(left.pieces)), left.pieces)
    take = np.arange(0, left.torque.size, max(1, left.torque.size // MOST_SAMPLES))
    if len(left.pieces) < FOLDS:  # parts of experiments instead
        groups = np.arange(left.torque.size) * 2 * FOLDS // left.torque.size
    target, groups = left.torque[take], groups[take]
    explainable = max(float(np.mean(left.power)), 1e-300)
    folds = GroupKFold(min(FOLDS, len(set(groups.tolist()))))
    columns: list[Array] = []
    found: list[str] = []
    best = float(np.mean(target**2))
    for name, added in _ladder(residuals, left):
        tried = np.column_stack([*columns, *(c[take] for c in added)])
        tried = tried[:, np.ptp(tried, axis=0) > 0]
        if tried.shape[1] == 0:
            continue
        model = make_pipeline(
            StandardScaler(),
            SplineTransformer(SPLINE_KNOTS, knots="quantile"),
            Ridge(RIDGE_PENALTY),
        )
        guessed = cross_val_predict(model, tried, target, cv=folds, groups=groups)
        square = float(np.mean((target - guessed) ** 2))
        if best - square > LEAST_GAIN * explainable:
            found.append(name)
            best = square
            columns += [c[take] for c in added]
    return found


def _ladder(residuals: FreeRunResiduals, left: ResidualTorque) -> list[tuple[str, list[Array]]]:
    over = left.over
    angle, before = [], []
    at = 0
    for length, period in zip(left.pieces, left.periods, strict=True):
        part = slice(at, at + length)
        angle.append(np.cumsum(over["speed"][part]) * period)
        steps = [max(1, round(k * residuals.memory / period)) for k in LAGS]
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
