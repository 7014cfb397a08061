"""What every physics is: named parameters and states, equations of motion, and a free run."""

from __future__ import annotations

import abc
import functools
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ldt_core.physics.constants import MAX_STEP, NOT_TRACKED, Constants, Tracked
from ldt_core.physics.parameter import Parameter

if TYPE_CHECKING:
    from ldt_core.physics.effect import Effect

Values = Mapping[str, float]
Array = NDArray[np.float64]
SENSOR_ROUNDS = 4  # of the fixed point that looks through the sensor
#: Effects that act, each with all its parameters' values, in the order in which they act.
Effects = Sequence[tuple["Effect", Values]]


class Physics(abc.ABC):
    """The equations of a kind of machine, without any machine's numbers.

    The first three states are always angle [rad], speed [rad/s] and current [A], since every
    machine here turns and is driven by a DC motor.
    """

    #: In the registry and in machine files.
    name: str
    #: What a machine file must or may give (those with a default).
    parameters: tuple[Parameter, ...]
    #: State names; units in the module's docstring.
    states: tuple[str, ...]

    @abc.abstractmethod
    def is_linear(self, values: Values) -> bool:
        """Whether the equations are linear for these parameters, and thus solved exactly."""

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
        """The motor as a continuous-time linear system.

        Returns:
            A (2, 2), B (2, 1), C (1, 2), D (1, 1); states current [A] and speed [rad/s], input
            voltage [V], output speed [rad/s]. Exact whenever `is_linear`.
        """
        k, r, inductance, j, b = (values[n] for n in ("K_t", "R", "L", "J", "b"))
        a = np.array([[-r / inductance, -k / inductance], [k / j, -b / j]])
        return a, np.array([[1 / inductance], [0.0]]), np.array([[0.0, 1.0]]), np.zeros((1, 1))

    def initial_state(self, values: Values, speed: float, current: float | None = None) -> Array:
        """(n,) state at the first sample of an experiment, from what was measured there.

        Args:
            values: the machine's parameters.
            speed: first measured speed [rad/s].
            current: first measured current [A]; None takes the one that would hold that speed,
                b omega / K_t, which is exact at rest and in steady running. The angle is 0 and the
                foundation at rest.
        """
        state = np.zeros(len(self.states))
        state[1] = speed
        state[2] = values["b"] * speed / values["K_t"] if current is None else current
        return state

    def running_state(
        self, values: Values, speed: float, angle: float, current: float | None = None
    ) -> Array:
        """(n,) state of a machine that has run at this speed [rad/s] for long, at this angle [rad].

        As `initial_state`, but for what such a machine shakes.
        """
        state = self.initial_state(values, speed, current)
        state[0] = angle
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
        """Free run: the states at the samples.

        Exact (matrix exponential) where everything is linear, else by Runge-Kutta steps.

        Args:
            values: the machine's parameters.
            voltage: (L,) [V], each held from its sample to the next.
            period: sample period [s].
            initial: (n,) state at the first sample, with the effects' own states behind it where a
                simulation goes on from an earlier one.
            effects: acting effects; those on the measurement are ignored here, see `measure`.
            max_step: longest Runge-Kutta step [s]: a search may do with a longer one.
            tracked: (L,) speeds [rad/s] and a gain in 0..1: behind each sample the speed moves
                towards the one given by this part of their difference (a Luenberger observer), and
                the states are then predictions from one sample to the next. None: a free run.
            least_step: shortest Runge-Kutta step [s], however stiff the machine is: a search that
                comes by absurd values must not be held up by them.

        Returns:
            (L, n) states; states of effects that have any follow in further columns.

        Raises:
            BadInput: an effect that this machine cannot have, or a machine too stiff to simulate.
            LdtError: the simulated state grows without bound.
        """
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
            ad, bd = _discretise(self, tuple(values[p.name] for p in self.parameters), period)
            return propagate(ad, bd, switches[1], state[: len(self.states)], *tracked)
        return integrate(self, values, times, switches, state, terms, max_step, tracked, least_step)

    def _switches(
        self, values: Values, times: Array, volts: Array, state: Array, effects: Effects
    ) -> tuple[Array, Array]:
        """Times and levels of the voltage behind the effects on it.

        What the supply gave before the first sample is not known. It is taken to be what keeps the
        first state steady: nothing for a machine at rest.
        """
        before = values["R"] * state[2] + values["K_t"] * state[1]
        at, levels = np.concatenate([[-np.inf], times]), np.concatenate([[before], volts])
        for effect, given in effects:
            if effect.on_voltage is not None:
                at, levels = effect.on_voltage(at, levels, **given)
        if np.array_equal(at[1:], times):  # back on the samples' grid, where linear is exact
            at, levels = at[1:], levels[1:]
        return at, np.ascontiguousarray(levels)

    def measure(self, states: Array, period: float, effects: Effects = ()) -> Array:
        """(L,) measured speed without noise [rad/s]: seen through the effects on the sensor."""
        speed = states[:, 1].copy()
        for effect, given in effects:
            if effect.on_measurement is not None:
                speed = effect.on_measurement(speed, period, **given)
        return speed

    def behind_sensor(self, shown: Array, period: float, effects: Effects = ()) -> Array:
        """(L,) speed that a sensor with these effects shows as `shown` (L,) [rad/s].

        By a few rounds of a fixed point, so that a slow sensor's inverse does not blow up noise.
        """
        on_sensor = [(effect, given) for effect, given in effects if effect.on_measurement]
        if not on_sensor:
            return shown
        speed = shown.copy()
        states = np.zeros((shown.size, len(self.states)))
        for _ in range(SENSOR_ROUNDS):
            states[:, 1] = speed
            speed = speed + shown - self.measure(states, period, on_sensor)
        return speed

    def __repr__(self) -> str:
        return f"{type(self).__name__}()"


@functools.lru_cache(maxsize=256)
def _discretise(physics: Physics, numbers: tuple[float, ...], period: float) -> tuple[Any, Any]:
    """Exact zero-order-hold discretisation: Ad (n, n), Bd (n,)."""
    from scipy.linalg import expm  # 0.1 s to import, and only the linear machines need it

    names = (p.name for p in physics.parameters)
    a, b = physics.system(dict(zip(names, numbers, strict=True)))
    n = len(b)
    augmented = np.zeros((n + 1, n + 1))
    augmented[:n, :n], augmented[:n, n] = a, b
    discrete = expm(augmented * period)
    return np.ascontiguousarray(discrete[:n, :n]), np.ascontiguousarray(discrete[:n, n])
