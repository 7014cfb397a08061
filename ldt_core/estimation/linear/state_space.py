"""A continuous-time linear model with one input and one output, simulated exactly, and its start.

A first speed does not determine the n states in which a run starts. Two rules say what else there
is, both linear in that speed, so that the state is `state + per_speed · speed`:

- settled: the machine has been running at a constant voltage, whichever gives that speed. Exact for
  an experiment that begins at rest or settled, if the model is right about steady running.
- usual: what went with such a speed in the data, by linear regression of the states on the speed
  along the run. Where a linear model is a makeshift, its steady running can be absurd: if it hardly
  depends on the voltage, a speed of 0 takes thousands of volts, and the run is off for seconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ldt_core.base.arrays import Array
from ldt_core.base.compiled import njit
from ldt_core.base.errors import ExperimentError
from ldt_core.base.experiment import Experiment
from ldt_core.physics.zero_order_hold import zero_order_hold

DISCRETISATIONS_REMEMBERED = 512  # models at a sample period: a few with their alternatives

#: Least variance relative to the largest: what is below is rounding.
LEAST_VARIANCE = 1e-12


@dataclass(frozen=True, eq=False)
class StateSpace:
    """ẋ = A x + B u, y = C x + D u + offset, for a voltage that is held between samples.

    Args:
        A: (n, n) [1/s].
        B: (n,) [unit of a state per V and s].
        C: (n,) [rad/s per unit of a state].
        D: feedthrough [rad/s per V].
        offset: of the output [rad/s]. It stands for a constant load as well: a constant in the
            state equation of a model without integrator is an offset of its output.
    """

    A: Array
    B: Array
    C: Array
    D: float = 0.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        matrix = _frozen(self.A)
        if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or not matrix.size:
            raise ValueError(f"A: expected a square matrix, got shape {matrix.shape}")
        order = matrix.shape[0]
        object.__setattr__(self, "A", matrix)
        for name in ("B", "C"):
            vector = _frozen(getattr(self, name)).reshape(-1)
            if vector.size != order:
                raise ValueError(f"{name}: expected {order} values, got {vector.size}")
            object.__setattr__(self, name, vector)
        for name in ("D", "offset"):
            object.__setattr__(self, name, float(_frozen(getattr(self, name)).reshape(())))

    @property
    def order(self) -> int:
        """Number of states."""
        return self.A.shape[0]

    @property
    def poles(self) -> NDArray[np.complex128]:
        """(n,) eigenvalues of A [1/s], slowest first."""
        poles = np.linalg.eigvals(self.A).astype(np.complex128)
        return poles[np.lexsort((poles.imag, poles.real, np.abs(poles)))]

    @property
    def dc_gain(self) -> float:
        """Steady output per steady input, D − C A⁻¹ B [rad/s per V]."""
        return float(self.D - self.C @ np.linalg.solve(self.A, self.B))

    def equilibrium(self, output: float, voltage: float = 0.0) -> Array:
        """(n,) the steady state with that output [rad/s].

        A model whose steady output does not depend on the input has none: then the smallest state
        with that output at that voltage [V] is taken.
        """
        response, gain = self.steady_response()
        if gain:
            return np.asarray(response * ((output - self.offset) / gain), dtype=np.float64)
        size = float(self.C @ self.C)
        rest = output - self.offset - self.D * voltage
        return self.C * (rest / size) if size else np.zeros(self.order)

    def steady_response(self) -> tuple[Array, float]:
        """(n,) steady state per V, and the steady output per V; 0 where that is rounding."""
        response = -np.linalg.solve(self.A, self.B)
        gain = float(self.C @ response) + self.D
        # below this the gain is a difference of equal numbers
        rounding = 1e-12 * (np.abs(self.C) @ np.abs(response) + abs(self.D))
        return np.asarray(response, dtype=np.float64), gain if abs(gain) > rounding else 0.0

    def simulate(self, voltage: ArrayLike, period: float, start: ArrayLike) -> Array:
        """(L,) free run from a start state [rad/s].

        Args:
            voltage: (L,) [V], each held from its sample to the next.
            period: sample period [s].
            start: (n,) state at the first sample.
        """
        volts = np.ascontiguousarray(voltage, dtype=np.float64)
        state = np.array(start, dtype=np.float64)
        step, drive = discretise(self.A, self.B, period)
        return _run(step, drive, self.C, self.D, self.offset, volts, state)


def discretise(A: Array, B: Array, period: float) -> tuple[Array, Array]:
    """(A_d, B_d) of x[k+1] = A_d x[k] + B_d u[k], exact for an input held between samples.

    Raises:
        ExperimentError: a period so long that they are not finite.
    """
    A = np.ascontiguousarray(A)
    return _discretise(A.tobytes(), np.ascontiguousarray(B).tobytes(), A.shape[0], float(period))


@lru_cache(maxsize=DISCRETISATIONS_REMEMBERED)
def _discretise(A: bytes, B: bytes, order: int, period: float) -> tuple[Array, Array]:
    moved = zero_order_hold(np.frombuffer(A).reshape(order, order), np.frombuffer(B), period)
    if not all(np.isfinite(m).all() for m in moved):
        expected = "one at which the linear model can be sampled"
        raise ExperimentError("sample period", expected, f"{period:g} s")
    return _frozen(moved[0]), _frozen(moved[1])


def _frozen(values: ArrayLike) -> Array:
    array = np.array(values, dtype=np.float64, order="C")
    if not np.isfinite(array).all():
        raise ValueError("a linear model needs finite numbers")
    array.setflags(write=False)
    return array


@njit(fastmath=False)
def _run(step, drive, C, D, offset, voltage, state):
    order = state.size
    output = np.empty(voltage.size)
    following = np.empty(order)
    for k in range(voltage.size):
        total = 0.0
        for i in range(order):
            total += C[i] * state[i]
        output[k] = total + D * voltage[k] + offset
        for i in range(order):
            moved = drive[i] * voltage[k]
            for j in range(order):
                moved += step[i, j] * state[j]
            following[i] = moved
        for i in range(order):
            state[i] = following[i]
    return output


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
    response, gain = model.steady_response()
    if not gain:
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
    real = values > LEAST_VARIANCE * values[-1]
    return (vectors[:, real] * np.sqrt(values[real])).T


@njit(fastmath=False)
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
