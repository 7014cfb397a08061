"""The state in which a run starts, of which one speed is measured.

A first speed does not determine n states. Two rules say what else there is, both of them linear in
that speed, so that the state is `state + per_speed · speed`:

- settled: the machine has been running at a constant voltage, whichever gives that speed. Exact for
  an experiment that begins at rest or settled, if the model is right about steady running.
- usual: what went with such a speed in the data, by linear regression of the states on the speed
  along the run. Where a linear model is a makeshift, its steady running can be absurd: if it hardly
  depends on the voltage, a speed of 0 takes thousands of volts, and the run is off for seconds.

The rule taken is the one whose free runs are nearer to the experiments learned from.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ldt_core.base.experiment import Experiment
from ldt_core.estimation.linear.state_space import StateSpace, discretise

Array = NDArray[np.float64]

#: Least variance relative to the largest: what is below is rounding.
ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class StartRule:
    """The rule: state (n,) at speed 0, and (n,) per rad/s of it.

    Args:
        spread: (n, n) covariance of the states about it, at a given speed.
    """

    state: Array
    per_speed: Array
    spread: Array

    def at(self, speed: float) -> Array:
        """(n,) state at the first sample of a run that begins with that speed [rad/s]."""
        return self.state + self.per_speed * speed


def settled(model: StateSpace) -> StartRule | None:
    """In steady running; None where the speed does not depend on the voltage then."""
    response = -np.linalg.solve(model.A, model.B)
    gain = float(model.C @ response) + model.D
    # below this the gain is a difference of equal numbers
    if abs(gain) <= 1e-12 * (np.abs(model.C) @ np.abs(response) + abs(model.D)):
        return None
    per_speed = np.asarray(response / gain, dtype=np.float64)
    return StartRule(
        np.asarray(-per_speed * model.offset, dtype=np.float64), per_speed, np.zeros_like(model.A)
    )


def usual(model: StateSpace, starts: Array, experiments: Sequence[Experiment]) -> StartRule:
    """As along the runs of some experiments, from the states (experiments, n) they started in."""
    count, sums, products = 0, np.zeros(model.order), np.zeros((model.order, model.order))
    for start, e in zip(starts, experiments, strict=True):
        step, drive = discretise(model.A, model.B, e.period)
        count += len(e)
        _moments(step, drive, np.array(start), np.ascontiguousarray(e.voltage), sums, products)
    mean = sums / count
    spread = products / count - np.outer(mean, mean)
    along = spread @ model.C
    variance = float(model.C @ along)
    if not variance > 0:  # a speed that does not vary: any state with the output will do
        along, variance = model.C, float(model.C @ model.C)
    per_speed = along / variance
    rest = spread - np.outer(along, along) / variance
    state = mean - per_speed * (float(model.C @ mean) + model.offset)
    return StartRule(state, per_speed, (rest + rest.T) / 2)


def misses(model: StateSpace, start: StartRule, experiments: Sequence[Experiment]) -> float:
    """Sum of squared errors of the free runs that start by that rule [rad²/s²]."""
    total = 0.0
    for e in experiments:
        run = model.simulate(e.voltage, e.period, start.at(float(e.speed[0])))
        total += float(((run - e.speed) ** 2).sum())
    return total


def principal_deviations(covariance: Array) -> Array:
    """(directions, n): one standard deviation along each principal axis that has one."""
    values, vectors = np.linalg.eigh(covariance)
    real = values > ROUNDING * values[-1]
    return (vectors[:, real] * np.sqrt(values[real])).T


@njit(cache=True, fastmath=False)
def _moments(step, drive, state, voltage, sums, products):
    order = state.size
    following = np.empty(order)
    for k in range(voltage.size):
        for i in range(order):
            sums[i] += state[i]
            moved = drive[i] * voltage[k]
            for j in range(order):
                products[i, j] += state[i] * state[j]
                moved += step[i, j] * state[j]
            following[i] = moved
        for i in range(order):
            state[i] = following[i]
