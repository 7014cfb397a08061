"""Somebody else's simulator as a physics: an engine that advances a machine by a short step.

The engine is asked for one thing, `Simulator.advance`. Effects act from outside, so that all of
them can be simulated and diagnosed: a torque on the shaft and a voltage at the terminals, both held
over a step. What comes out is accurate to the first order of the step.
"""

from __future__ import annotations

import abc
import threading
import time
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ldt_core.base import slow_runs
from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError, described, reason_of
from ldt_core.base.registry import own_place
from ldt_core.physics.base import (
    ANGLE,
    CURRENT,
    MAX_STEP,
    NOT_TRACKED,
    SPEED,
    Effects,
    Physics,
    Tracked,
    first_states,
)
from ldt_core.physics.parameter import Values
from ldt_core.physics.run_plan import sample_times, steps_of

if TYPE_CHECKING:
    from ldt_core.physics.effect import Effect

_ENGINE = threading.RLock()  # most engines work on one state, which no two threads may write


class Simulator(Physics):
    """A physics whose `advance` calls an engine; it needs a name, parameters and this method.

    Effects and start states find the motor's `J`, `K_t`, `R`, `L` and `b` among the parameters.
    """

    states = ("theta", "omega", "current")
    #: Longest step [s] that `advance` is asked for.
    step: float = 1e-3

    @abc.abstractmethod
    def advance(
        self, values: Values, state: Array, voltage: float, torque: float, duration: float
    ) -> ArrayLike:
        """The state a short time later.

        Args:
            values: the machine's parameters, with effects on them.
            state: (n,) angle [rad], speed [rad/s], current [A], then what `states` names.
            voltage: at the terminals [V], constant meanwhile.
            torque: from outside, on the shaft [N m], constant meanwhile.
            duration: at most `step` [s].

        Returns:
            (n,) state. It must follow from the arguments alone: an engine that remembers more, such
            as the last contact, has to be set back to what they say.
        """

    def is_linear(self, values: Values) -> bool:
        """Nothing is known of an engine's equations."""
        return False

    def shakes(self, values: Values) -> bool:
        """Whether the speed depends on the angle by itself; override it where that is so."""
        return False

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
        """Free run by steps of the engine; `step` takes the place of `max_step`."""
        volts = np.asarray(voltage, dtype=np.float64)
        times = sample_times(volts.size, period)
        state = np.array(initial, dtype=np.float64)
        values = self.changed(values, effects)
        at, levels = self.switches(values, times, volts, state, effects)
        given, values = values, {**values}
        acting = _Acting(values, effects, len(self.states), state)
        most = float(np.abs(levels).max())
        rate = max([0.0, *(e.rate(values, most, p) for e, p in acting.terms)])
        longest = min(self.step, 1 / rate) if rate > 0 else self.step
        steps = int(steps_of(np.array([0.0, period]), max(longest, least_step))[0])
        states = np.zeros((volts.size, len(self.states) + acting.own.size))
        state = state[: len(self.states)]
        duration = period / steps
        fine = (times[:-1, None] + duration * (np.arange(steps) + 0.5)).ravel()
        held = levels[np.searchsorted(at, fine, side="right") - 1]
        followed, gain = tracked
        with _ENGINE, np.errstate(all="ignore"):  # a search comes by absurd values
            begin = time.perf_counter()
            for k in range(volts.size):
                states[k] = np.concatenate([state, acting.own])
                if not np.isfinite(states[k]).all():
                    raise self.diverged(float(times[k]))
                if gain > 0:
                    state[SPEED] += gain * (followed[k] - state[SPEED])
                for j in range(k * steps, min((k + 1) * steps, held.size)):
                    now = j * duration
                    torque, terminal = acting.on(now, state, held[j], duration)
                    state = self._advanced(values, state, terminal, torque, duration)
            slow_runs.tell(self.name, time.perf_counter() - begin)
        if values != given:  # each run would be of another machine
            expected = "expected the parameters left as they are (change a copy: {**values, ...})"
            raise LdtError(f"physics {self.name}, advance: {expected}, got others behind it")
        return states

    def _advanced(
        self, values: Values, state: Array, voltage: float, torque: float, duration: float
    ) -> Array:
        where = f"physics {self.name}, advance"
        try:
            found = self.advance(values, state, voltage, torque, duration)
            later = np.array(found, dtype=float)
        except LdtError:
            raise
        except Exception as error:
            place = own_place(error)
            at = f" ({place})" if place else ""
            raise LdtError(f"{where}: {reason_of(error)}{at}") from error
        if later.shape != state.shape:
            expected = f"{state.size} states ({', '.join(self.states)})"
            raise LdtError(f"{where}: expected {expected}, got {described(found)}")
        return later


class _Acting:
    """The torques and voltages of effects, with the states that they have of their own."""

    def __init__(self, values: Values, effects: Effects, count: int, initial: Array) -> None:
        self.terms = [(term, given) for e, given in effects for term in e.terms]
        own = list(initial[count:]) or first_states(self.terms, initial)
        self.own = np.array(own, dtype=np.float64)
        self._acting: list[tuple[Effect, Array, Array]] = []
        if not self.terms:
            return
        from ldt_core.physics.effect import term_parameters  # with its compiler; see `integrate`

        parameters, first_parameter, first_state = term_parameters(self.terms, values)
        given = np.array(parameters)
        for (effect, _), p, at in zip(self.terms, first_parameter, first_state, strict=True):
            own_states = self.own[at : at + len(effect.states)]
            self._acting.append((effect, given[p:], own_states))

    def on(self, t: float, state: Array, voltage: float, duration: float) -> tuple[float, float]:
        """Torque [N m] and terminal voltage [V] now; own states go on by `duration` [s]."""
        torque, terminal = 0.0, voltage
        now = t, state[ANGLE], state[SPEED], state[CURRENT], voltage
        for effect, given, own in self._acting:
            function = effect.torque or effect.terminal
            assert function is not None
            if effect.states:
                rate = np.zeros(own.size)
                value = function(*now, given, own, rate)
                own += duration * rate
            else:
                value = function(*now, given)
            if effect.terminal is None:
                torque += value
            else:
                terminal += value
        return torque, terminal
