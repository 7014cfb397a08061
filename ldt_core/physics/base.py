"""What the twin asks of whatever simulates a machine: the narrow interface of every physics.

A simulator of somebody else joins by `simulator.Simulator`; what this project integrates itself is
`motor_driven.MotorDriven`.
"""

from __future__ import annotations

import abc
import threading
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError, reason_of
from ldt_core.physics.motor_rates import inductance
from ldt_core.physics.parameter import Parameter, Values

if TYPE_CHECKING:
    from ldt_core.physics.effect import Effect

#: Speeds to follow (L,) [rad/s] or none (0,), and the part of the difference taken at a sample.
Tracked = tuple[Array, float]
NOT_TRACKED: Tracked = (np.zeros(0), 0.0)
#: Effects that act, each with all its parameters' values, in the order in which they act.
Effects = Sequence[tuple["Effect", Values]]

#: Places of the states that every physics has: angle [rad], speed [rad/s], current [A].
ANGLE, SPEED, CURRENT = range(3)
MAX_STEP = 0.25e-3  # s; worst relative speed error 5e-6 over 300 random experiments of the rotor
#: Rounds of the fixed point that looks through the sensor. More would blow up the noise that a slow
#: sensor has smoothed away.
SENSOR_ROUNDS = 4


def first_states(effects: Effects, state: Array) -> list[float]:
    """The effects' own states at the first sample, from the machine's (n,), behind each other."""
    return [own for effect, given in effects for own in effect.first_states(state, given)]


class Work:
    """Integration steps done so far, by all threads; what a search may do is limited by them.

    Attributes:
        steps: beyond those that plans promise.
        promised: of runs side by side, the steps of all lanes together, once for each law as well;
            so of those whose current is solved for.
    """

    def __init__(self) -> None:
        self.steps, self.promised, self._lock = 0, 0, threading.Lock()

    def add(self, steps: int, promised: int = 0) -> None:
        """So many more; the sum does not depend on the threads' order."""
        with self._lock:
            self.steps += steps
            self.promised += promised

    def taken(self) -> int:
        """All that was done since this was asked last."""
        with self._lock:
            done, self.steps, self.promised = self.steps + self.promised, 0, 0
        return done


class FreeRun(NamedTuple):
    """What `Physics.simulate` takes of one run.

    `changed` are the values with the effects on them, where they are known already; `work` takes
    the steps that a run needs beyond those that its plan promised.
    """

    values: Values
    voltage: ArrayLike
    period: float
    initial: ArrayLike
    effects: Effects = ()
    tracked: Tracked = NOT_TRACKED
    changed: Values | None = None
    work: Work | None = None


class Physics(abc.ABC):
    """The equations of a kind of machine, without any machine's numbers.

    The first three states are always angle [rad], speed [rad/s] and current [A], since every
    machine here turns and is driven by a DC motor.
    """

    #: In the registry and in machine files.
    name: str
    #: What a machine file must or may give (those with a default).
    parameters: tuple[Parameter, ...]
    #: Relative standard deviation of parameters that nobody has measured; the others are exact.
    tolerances: Mapping[str, float] = MappingProxyType({})
    #: State names; units in the module's docstring.
    states: tuple[str, ...]

    @abc.abstractmethod
    def is_linear(self, values: Values) -> bool:
        """Whether the equations are linear for these parameters, and thus solved exactly."""

    def shakes(self, values: Values) -> bool:
        """Whether the machine moves its foundation, or its speed depends on the angle by itself."""
        return not self.is_linear(values)

    def changed(self, values: Values, effects: Effects) -> Values:
        """The parameters with what these effects change of them.

        Raises:
            LdtError: no machine can have what comes out.
        """
        for effect, given in effects:
            values = effect.change_parameters(self, values, given)
        return values

    def folded(self, values: Values) -> Values:
        """The parameters with the machine's known effects on them, see `known_effects`."""
        return values

    def state_space(self, values: Values) -> tuple[Array, Array, Array, Array]:
        """The motor as a continuous-time linear system.

        Returns:
            A (2, 2), B (2, 1), C (1, 2), D (1, 1); states current [A] and speed [rad/s], input
            voltage [V], output speed [rad/s]. Exact whenever `is_linear`.
        """
        k, r, j, b = (values[n] for n in ("K_t", "R", "J", "b"))
        own = inductance(values)
        a = np.array([[-r / own, -k / own], [k / j, -b / j]])
        return a, np.array([[1 / own], [0.0]]), np.array([[0.0, 1.0]]), np.zeros((1, 1))

    def initial_state(self, values: Values, speed: float, current: float | None = None) -> Array:
        """(n,) state at the first sample of an experiment, from speed [rad/s] and current [A]
        there.

        Without a current it is the one that would hold that speed, b omega / K_t, which is exact at
        rest and in steady running. The angle and all further states are 0: a foundation is at rest.
        """
        state = np.zeros(len(self.states))
        state[SPEED] = speed
        state[CURRENT] = values["b"] * speed / values["K_t"] if current is None else current
        return state

    def running_state(
        self, values: Values, speed: float, angle: float, current: float | None = None
    ) -> Array:
        """(n,) state of a machine that has long run at this speed [rad/s], at this angle [rad]."""
        state = self.initial_state(values, speed, current)
        state[ANGLE] = angle
        return state

    @abc.abstractmethod
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
            tracked: (L,) speeds [rad/s] and a gain in 0..1: after each sample the speed moves
                towards the one given by this part of their difference (a Luenberger observer).
            least_step: shortest Runge-Kutta step [s], however stiff the machine is: a search that
                comes by absurd values must not be held up by them.

        Returns:
            (L, n) states; states of effects that have any follow in further columns.

        Raises:
            BadInput: an effect that this machine cannot have, or a machine too stiff to simulate.
            LdtError: the simulated state grows without bound.
        """

    def simulate_all(
        self,
        runs: Sequence[FreeRun],
        max_step: float = MAX_STEP,
        least_step: float = 0.0,
        workers: int = 1,
    ) -> Iterator[tuple[int, Array | LdtError]]:
        """Many runs: of each its place, and its states or what `simulate` raises; in any order.

        What comes out for a run depends neither on the others nor on the number of threads,
        `workers`. A physics that can compute several at once overrides this.
        """
        from ldt_core.base.threads import spread  # imports linear algebra

        def alone(i: int) -> Array | LdtError:
            values, voltage, period, initial, effects, tracked = runs[i][:6]
            about = values, voltage, period, initial, effects, max_step, tracked, least_step
            try:
                return self.simulate(*about)
            except LdtError as error:
                return error
            except Exception as error:  # of a physics that somebody else wrote
                return LdtError(f"physics {self.name}: {reason_of(error)}")

        return enumerate(spread(alone, len(runs), workers))

    def diverged(self, when: float) -> LdtError:
        """What is raised where the state is not finite at this time [s]."""
        return LdtError(
            f"the simulation of {self.name} diverged: its state is not finite "
            f"{when:g} s after the start"
        )

    def switches(
        self, values: Values, times: Array, volts: Array, state: Array, effects: Effects
    ) -> tuple[Array, Array]:
        """(S,) times [s] and (S,) levels [V] of the voltage behind the effects on it.

        What the supply gave before the first sample is taken to be what keeps the first state
        steady.
        """
        before = values["R"] * state[CURRENT] + values["K_t"] * state[SPEED]
        at, levels = np.concatenate([[-np.inf], times]), np.concatenate([[before], volts])
        for effect, given in effects:
            if effect.on_voltage is not None:
                at, levels = effect.switched(at, levels, given)
        if np.array_equal(at[1:], times):  # back on the samples' grid, where linear is exact
            at, levels = at[1:], levels[1:]
        return at, np.ascontiguousarray(levels)

    def measure(
        self, states: Array, period: float, effects: Effects = (), values: Values | None = None
    ) -> Array:
        """(L,) measured speed without noise [rad/s]: seen through the effects on the sensor.

        `values`, the machine's parameters, are for its known effects; None takes the file's.
        """
        speed = states[:, SPEED].copy()
        for effect, given in effects:
            if effect.on_measurement is not None:
                speed = effect.shown(speed, period, given)
        return speed

    def behind_sensor(
        self, shown: Array, period: float, effects: Effects = (), values: Values | None = None
    ) -> Array:
        """(L,) speed that a sensor with these effects shows as `shown` (L,) [rad/s]."""
        on_sensor = [(effect, given) for effect, given in effects if effect.on_measurement]
        if not on_sensor:
            return shown
        states = np.zeros((shown.size, len(self.states)))

        def seen(speed: Array) -> Array:
            states[:, SPEED] = speed
            return self.measure(states, period, on_sensor)

        first = seen(shown)
        answer = float((first - seen(np.zeros_like(shown))) @ shown)
        gain = answer / (float(shown @ shown) or 1) or 1.0
        speed = shown + (shown - first) / gain
        for _ in range(SENSOR_ROUNDS - 1):
            speed = speed + (shown - seen(speed)) / gain
        return speed

    def __repr__(self) -> str:
        return f"{type(self).__name__}()"
