"""What else the data allow: other models, whose runs show how far a prediction may be off.

The parameters' covariance is that of the linearised least squares, s² τ (JᵀJ)⁻¹. s is the
residual's deviation, and τ the number of samples that carry as much as one independent one. It
falls into two parts, and with each go the start states that belong to it:

- θ, the poles, with everything linear refitted: two models for each principal direction, moved
  until the loss itself says one deviation, not its curvature: poles that the data hardly determine
  lie far apart, on one side;
- the linear parameters at given θ: one model for each direction, since the run is linear in them.

To these come the errors of the start of a new run: the noise of its first speed, and the states
that one speed leaves open. The variance of a predicted speed is the sum of the squared distances of
their runs, and that of the residual.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.compiled import njit
from ldt_core.estimation.linear import schwarz
from ldt_core.estimation.linear.output_error import Linear, OutputError

#: [logarithm] Change of a component of θ, at most: a factor of 7 is unknown enough.
LARGEST_CHANGE = 2.0
#: [s² τ] Rise of the sum of squares, at most, where a parabola would have risen by 1.
MOST_RISE = 1.5
#: Times that a direction is shortened, at most, until the rise is below that.
SHORTENINGS = 6
#: Factor by which one shortening may shorten, at most: a parabola is no guide to more.
LEAST_FACTOR = 0.1
#: Least curvature relative to the largest: what is below is rounding.
ROUNDING = 1e-12
#: Share of the samples that the unknowns use up at most: beyond, the residual says nothing.
MOST_USED = 0.75


@dataclass(frozen=True)
class Alternative:
    """Another model: its poles θ, all else, and its weight in the variance."""

    theta: Array
    linear: Linear
    weight: float


def residual_deviation(squares: float, samples: int, unknowns: int, time: float) -> float:
    """Standard deviation of a residual, what the unknowns took of it given back."""
    used = min(unknowns * time / samples, MOST_USED)
    return float(np.sqrt(squares / (samples * (1 - used))))


def alternatives(
    search: OutputError, theta: Array, linear: Linear, deviation: float
) -> list[Alternative]:
    """The other models.

    Args:
        search: the data.
        theta, linear: the best model's.
        deviation: s √τ, in the unit of the outputs.
    """
    found: list[Alternative] = []
    if not deviation > 0:
        return found  # exact data
    low, high = schwarz.bounds(theta.size, search.sigma)
    curvature, products, states = search.information(theta)
    least = search.loss(theta) * search.count
    for direction in _deviations(curvature, deviation):
        for side in (1.0, -1.0):
            share = 1.0
            for _ in range(SHORTENINGS):
                moved = np.clip(side * share * direction, -LARGEST_CHANGE, LARGEST_CHANGE)
                there = np.clip(theta + moved, low, high)
                lost = (search.loss(there) * search.count - least) / deviation**2
                if lost <= MOST_RISE:
                    break
                share *= max(1 / np.sqrt(lost), LEAST_FACTOR)
            found.append(Alternative(there, search.solve_quickly(there), 0.5))
    for direction in _deviations(products, deviation):
        c, others = direction[: theta.size], direction[theta.size :]
        moved = Linear(
            linear.c + c,
            linear.v - states @ direction,
            linear.offset + (others[-1] if search.offset else 0.0),
        )
        found.append(Alternative(theta, moved, 1.0))
    return found


def _deviations(information: Array, deviation: float) -> Array:
    """(directions, parameters): one standard deviation along each principal axis."""
    most = float(np.diag(information).max())
    if not most > 0:
        return np.zeros((0, len(information)))
    # what the data say nothing of is known as little as rounding lets one tell
    size = np.sqrt(np.maximum(np.diag(information), ROUNDING * most))
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    return (vectors * (deviation / np.sqrt(np.maximum(values, ROUNDING)))).T / size


@njit(fastmath=False)
def squared_distances(steps, drives, offsets, starts, weights, voltage):
    """(L,) weighted sum of the squared distances of runs from the first one.

    The models are discrete, `steps` (models, n, n) and `drives` (models, n), with the first state
    plus an offset as output. `starts` (models, n) is overwritten; the first weight has no effect.
    """
    models, order = drives.shape
    distances = np.zeros(voltage.size)
    following = np.empty(order)
    for k in range(voltage.size):
        best = starts[0, 0] + offsets[0]
        for m in range(models):
            state = starts[m]
            distances[k] += weights[m] * (state[0] + offsets[m] - best) ** 2
            for i in range(order):
                moved = drives[m, i] * voltage[k]
                for j in range(order):
                    moved += steps[m, i, j] * state[j]
                following[i] = moved
            for i in range(order):
                state[i] = following[i]
    return distances
