"""Machines driven by a DC motor, whose equations this project integrates itself."""

from __future__ import annotations

import abc
import functools

import numpy as np
from numpy.typing import ArrayLike

from ldt_core.base.arrays import Array
from ldt_core.physics.base import CURRENT, SPEED, Effects, Physics, Values
from ldt_core.physics.constants import MAX_STEP, NOT_TRACKED, Constants, Tracked
from ldt_core.physics.zero_order_hold import zero_order_hold

DISCRETISATIONS_REMEMBERED = 256  # machines at a sample period; each is some 100 numbers


class MotorDriven(Physics):
    """A physics that comes down to the equations of `integrate.py`, by what it says of them."""

    @abc.abstractmethod
    def constants(self, values: Values) -> Constants:
        """The numbers that the compiled equations of `integrate.py` take."""

    @abc.abstractmethod
    def rate(self, values: Values, voltage: float) -> float:
        """Fastest rate of change at up to this voltage [1/s]; it bounds the integration step."""

    @abc.abstractmethod
    def system(self, values: Values) -> tuple[Array, Array]:
        """The whole linear system: A (n, n) and B (n,) of d(state)/dt = A state + B voltage."""

    def state_space(self, values: Values) -> tuple[Array, Array, Array, Array]:
        """The motor: states current and speed, see `Physics`."""
        k, r, inductance, j, b = (values[n] for n in ("K_t", "R", "L", "J", "b"))
        a = np.array([[-r / inductance, -k / inductance], [k / j, -b / j]])
        return a, np.array([[1 / inductance], [0.0]]), np.array([[0.0, 1.0]]), np.zeros((1, 1))

    def initial_state(self, values: Values, speed: float, current: float | None = None) -> Array:
        """The angle is 0 and the foundation at rest; see `Physics` for the rest."""
        state = np.zeros(len(self.states))
        state[SPEED] = speed
        state[CURRENT] = values["b"] * speed / values["K_t"] if current is None else current
        return state

    def simulate(
        self,
        values: Values,
        voltage: ArrayLike,
        period: float,
        initial: ArrayLike,
        effects: Effects = (),
        max_step: float = MAX_STEP,
        tracked: Tracked = NOT_TRACKED,
        least_step: float = 0.0,
    ) -> Array:
        """Exact (matrix exponential) where everything is linear, else by Runge-Kutta steps."""
        # With its compiler it takes longer to import than all else that loads a machine.
        from ldt_core.physics.integrate import integrate, propagate

        # A record's arrays are read-only: kernels would be compiled once more for them.
        volts = np.require(voltage, np.float64, ["C", "W"])
        tracked = np.require(tracked[0], np.float64, ["C", "W"]), tracked[1]
        state = np.ascontiguousarray(initial, dtype=np.float64)
        for effect, given in effects:
            values = effect.change_parameters(self, values, given)
        times = np.asarray(np.arange(volts.size) * period, dtype=np.float64)
        switches = times, volts
        if any(effect.on_voltage is not None for effect, _ in effects):
            switches = self._switches(values, times, volts, state, effects)
        on_grid = switches[0] is times or np.array_equal(switches[0], times)
        terms = [(e, p) for e, p in effects if e.torque is not None or e.terminal is not None]
        if on_grid and not terms and self.is_linear(values):
            ad, bd = self.discretised(values, period)
            return propagate(ad, bd, switches[1], state[: len(self.states)], *tracked)
        return integrate(self, values, times, switches, state, terms, max_step, tracked, least_step)

    def discretised(self, values: Values, period: float) -> tuple[Array, Array]:
        """Ad (n, n), Bd (n,) of the linear system over a sample period [s], exactly."""
        return _discretised(self, tuple(values[p.name] for p in self.parameters), period)

    def _switches(
        self, values: Values, times: Array, volts: Array, state: Array, effects: Effects
    ) -> tuple[Array, Array]:
        """Times and levels of the voltage behind the effects on it.

        What the supply gave before the first sample is taken to be what keeps the first state
        steady.
        """
        before = values["R"] * state[CURRENT] + values["K_t"] * state[SPEED]
        at, levels = np.concatenate([[-np.inf], times]), np.concatenate([[before], volts])
        for effect, given in effects:
            if effect.on_voltage is not None:
                at, levels = effect.on_voltage(at, levels, **given)
        if np.array_equal(at[1:], times):  # back on the samples' grid, where linear is exact
            at, levels = at[1:], levels[1:]
        return at, np.ascontiguousarray(levels)


@functools.lru_cache(maxsize=DISCRETISATIONS_REMEMBERED)
def _discretised(
    physics: MotorDriven, numbers: tuple[float, ...], period: float
) -> tuple[Array, Array]:
    names = (p.name for p in physics.parameters)
    return zero_order_hold(*physics.system(dict(zip(names, numbers, strict=True))), period)
