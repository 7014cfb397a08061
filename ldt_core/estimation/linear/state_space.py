"""A continuous-time linear model with one input and one output, simulated exactly."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from ldt_core.base.errors import ExperimentError
from ldt_core.physics.zero_order_hold import zero_order_hold

Array = NDArray[np.float64]

DISCRETISATIONS_REMEMBERED = 512  # models at a sample period: a few with their alternatives


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
        """(n,) the steady state whose output is that one.

        A model whose steady output does not depend on the input has no such state: then the
        smallest state with that output, at that voltage, is taken.

        Args:
            output: [rad/s].
            voltage: the input at that moment [V]; matters to a feedthrough without steady gain.
        """
        response = -np.linalg.solve(self.A, self.B)
        gain = float(self.C @ response)
        whole = gain + self.D
        # below this the gain is a difference of equal numbers
        if abs(whole) > 1e-12 * (np.abs(self.C) @ np.abs(response) + abs(self.D)):
            return np.asarray(response * ((output - self.offset) / whole), dtype=np.float64)
        size = float(self.C @ self.C)
        rest = output - self.offset - self.D * voltage
        return self.C * (rest / size) if size else np.zeros(self.order)

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


@njit(cache=True, fastmath=False)
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
