"""The mean torque as a function of one quantity, straight from the speed's residuals.

What a torque m(q) does to the speed is linear in m. With m linear between knots of q,

    residual(t) = sum_k m_k r_k(t) + noise,    J r_k' = hat_k(q(t)) - (J / tau) r_k,

m is found by least squares from residuals that nobody has smoothed: smoothing would spread a torque
that acts between 45 and 46 rad/s over all the speeds that the machine passes through meanwhile.
A priori m is a random walk over q, its step that under which the residuals are likeliest
(MacKay, "Bayesian interpolation", Neural Computation 4, 1992), so that it may jump where the data
say so and is quiet where there are none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from ldt_core.base.arrays import Array
from ldt_core.physics.integrate import answered

KNOTS = 101  # of a curve, so that a knot is a per cent of the quantity's range
BLOCK = 20_000  # samples worked on at a time, so that a long experiment needs no more memory
STIFFNESS = np.logspace(-7, 3, 41)  # tried of the random walk, over the largest of the data
LEVEL_STIFFNESS = 1e-3  # of the random walk's: draws its level to 0 where there are no data


@dataclass(frozen=True, eq=False)
class TorqueCurve:
    """Mean torque over a quantity.

    Attributes:
        knots: (K,) values of the quantity, evenly spaced over its range.
        torque: (K,) mean torque there [N m].
        deviation: (K,) its standard deviation [N m].
        explained: part of the residuals' power beyond noise that this torque accounts for.
    """

    knots: Array
    torque: Array
    deviation: Array
    explained: float


def torque_curve(
    residuals: Sequence[Array],
    quantity: Sequence[Array],
    periods: Sequence[float],
    rests: Sequence[bool],
    inertia: float,
    memory: float,
    noise: float,
) -> TorqueCurve:
    """The torque over a quantity that explains residuals best.

    Args:
        residuals: (L,) measured minus simulated speed of each experiment [rad/s].
        quantity: (L,) what the torque may depend on, of each.
        periods: sample period of each [s].
        rests: whether the machine stood still at the first sample of each; else what an unknown
            first speed does to the residuals is projected out.
        inertia: J [kg m^2].
        memory: tau, in which the motor forgets its speed [s].
        noise: deviation of the residuals that is the sensor's [rad/s].
    """
    low = min(float(q.min()) for q in quantity)
    high = max(float(q.max()) for q in quantity)
    knots = np.linspace(low, high, KNOTS)
    gram, along = np.zeros((KNOTS, KNOTS)), np.zeros(KNOTS)
    power, count = 0.0, 0
    for left, q, period, rest in zip(residuals, quantity, periods, rests, strict=True):
        decay = float(np.exp(-period / memory))
        gain = memory / inertia * (1 - decay)
        wrong, state = np.asarray(left, dtype=np.float64), np.zeros(KNOTS)
        # What an unknown first speed does, of length 1, and its products with the others.
        first = decay ** np.arange(wrong.size)
        first /= np.linalg.norm(first)
        shared = np.zeros(KNOTS)
        for begin in range(0, wrong.size, BLOCK):
            part = slice(begin, begin + BLOCK)
            moved = answered(hats(q[part], knots), decay, gain, state)
            gram += moved.T @ moved
            along += moved.T @ wrong[part]
            shared += moved.T @ first[part]
        power += float(wrong @ wrong)
        count += wrong.size
        if not rest:
            known = float(first @ wrong)
            gram -= np.outer(shared, shared)
            along -= shared * known
            power -= known**2
    torque, deviation, taken = likeliest(gram, along, power, count)
    beyond = max(power - count * noise**2, 1e-12 * power, 1e-300)
    return TorqueCurve(knots, torque, deviation, min(max(taken / beyond, 0.0), 1.0))


def hats(q: Array, knots: Array) -> Array:
    """(L, K) weights of the knots at each sample."""
    apart = (knots[1] - knots[0]) or 1.0  # of what never changes, all are one
    place = np.clip((q - knots[0]) / apart, 0.0, knots.size - 1 - 1e-9)
    below = place.astype(np.int64)
    hats, rows = np.zeros((q.size, knots.size)), np.arange(q.size)
    hats[rows, below] = 1.0 - (place - below)
    hats[rows, below + 1] = place - below
    return hats


def likeliest(gram: Array, along: Array, power: float, count: int) -> tuple[Array, Array, float]:
    """((K,) torque, (K,) its deviation, power it takes away) at the likeliest prior."""
    size = along.size
    walk = np.diff(np.eye(size), axis=0)
    root = np.linalg.cholesky(size * (walk.T @ walk + LEVEL_STIFFNESS / size * np.eye(size)))
    whitened = solve_triangular(root, solve_triangular(root, gram, lower=True).T, lower=True)
    values, vectors = np.linalg.eigh(0.5 * (whitened + whitened.T))
    values = np.maximum(values, 0.0)
    target = vectors.T @ solve_triangular(root, along, lower=True)
    # The noise's variance is at its likeliest for every stiffness, and not the sensor's: whatever
    # does not depend on the quantity is noise as well.
    best, chosen, variance = -np.inf, 1.0, 0.0
    for stiff in max(float(values[-1]), 1e-300) * STIFFNESS:
        left = max(power - float(np.sum(target**2 / (values + stiff))), 1e-12 * power, 1e-300)
        spread = float(np.sum(np.log1p(values / stiff)))
        likely = -0.5 * count * np.log(left / count) - 0.5 * spread
        if likely > best:
            best, chosen, variance = likely, stiff, left / count
    back = solve_triangular(root, vectors, lower=True, trans="T")
    weight = target / (values + chosen)
    with np.errstate(over="ignore"):  # infinite where nothing is known
        deviation = np.sqrt(variance * np.sum(back**2 / (values + chosen), axis=1))
    taken = float(2 * weight @ target - np.sum(values * weight**2))
    return back @ weight, deviation, taken
