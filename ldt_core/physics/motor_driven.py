"""Machines driven by a DC motor, whose equations this project integrates itself."""

from __future__ import annotations

import abc
import functools
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ldt_core.base.arrays import Array
from ldt_core.base.errors import BadInput, LdtError
from ldt_core.physics.base import (
    CURRENT,
    MAX_STEP,
    NOT_TRACKED,
    SPEED,
    Effects,
    Physics,
    Tracked,
    Values,
)
from ldt_core.physics.motor_rates import inductance, memory, motor_rate
from ldt_core.physics.zero_order_hold import zero_order_hold

if TYPE_CHECKING:
    from ldt_core.physics.terms import Terms

DISCRETISATIONS_REMEMBERED = 256  # machines at a sample period; each is some 100 numbers
SAME_LENGTH = 1e-9  # of a step, the rounding of its ends: sample times are sums
#: Of the largest speed, what a step may get wrong where a term bends; a search is content with a
#: hundredth of a usual sensor's noise.
BEND, BEND_IN_SEARCH = 3e-7, 1e-5
TINY = 1e-9  # V, so that a machine at rest without a voltage divides by no 0
MAX_STEPS = 2_000_000_000  # of one simulation: some minutes of computing; more is a mistake
#: Of the time in which the motor forgets its speed, an L/R with which it does so fastest.
SETTLED = 0.25
QUIET_CHANGE = 1e-3  # of stall torque and voltage: a term that changes less needs no short steps


class Constants(NamedTuple):
    """Numbers of the equations, in SI units."""

    torque_constant: float
    friction: float
    resistance: float
    inductance: float
    inertia: float  # J + m e^2 - (m e)^2 / (M + m): what is left after solving for theta''
    unbalance: float  # m e
    mass: float  # M + m
    stiffness_x: float
    stiffness_y: float
    damping_x: float
    damping_y: float
    weight_torque: float  # m g e


class Coefficients(NamedTuple):
    """The constants as the equations use them: divisions done once, not in each stage."""

    pull: float
    drag: float
    ease: float
    weight: float
    coupling: float
    supply: float
    loss: float
    emf: float
    lever: float
    stiffness_x: float
    stiffness_y: float
    damping_x: float
    damping_y: float


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
        k, r, j, b = (values[n] for n in ("K_t", "R", "J", "b"))
        own = inductance(values)
        a = np.array([[-r / own, -k / own], [k / j, -b / j]])
        return a, np.array([[1 / own], [0.0]]), np.array([[0.0, 1.0]]), np.zeros((1, 1))

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
        from ldt_core.physics.integrate import propagate  # see `integrate`

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
        return self.integrate(values, times, switches, state, terms, max_step, tracked, least_step)

    def integrate(
        self,
        values: Values,
        times: Array,
        switches: tuple[Array, Array],
        initial: Array,
        terms: Effects = (),
        max_step: float = MAX_STEP,
        tracked: Tracked = NOT_TRACKED,
        least_step: float = 0.0,
    ) -> Array:
        """States at the sample times by Runge-Kutta steps aligned with the voltage switches.

        Args:
            values: the machine's parameters, effects on them included.
            times: (L,) sample times from 0 [s].
            switches: (S,) increasing times [s], the first at most 0 (-inf for a level that held
                before the experiment), and (S,) levels [V], each until the next time.
            initial: (n,) state at time 0, effects' states behind it or left out (then 0).
            terms: effects with a torque or terminal term.
            max_step, tracked, least_step: as for `simulate`.

        Returns:
            (L, n) states, effects' states in further columns.

        Raises:
            BadInput: so stiff that it would take more than MAX_STEPS steps.
            LdtError: the state grows without bound.
        """
        # With its compiler it takes longer to import than all else that loads a machine.
        from ldt_core.physics.effect import gather
        from ldt_core.physics.integrate import MAX_STEP_RATE, RIGID_STATES, STATES, runge_kutta

        at, levels = switches
        values = {**values, "L": inductance(values)}
        c = self.constants(values)
        most = float(np.abs(levels).max())
        own_rate = self.rate(values, most)
        rates = [effect.rate(values, most, given) for effect, given in terms]
        solved = [effect.terminal is not None and not effect.states for effect, _ in terms]
        electrical = [r for r, one in zip(rates, solved, strict=True) if one]
        fast = max([motor_rate(values), *electrical]) * MAX_STEP > MAX_STEP_RATE
        if fast:  # then the current is solved for, and asks for no shorter steps
            calm = max(values["L"], SETTLED * values["R"] * memory(values))
            own_rate = self.rate({**values, "L": calm}, most)
            rates = [0.0 if one else r for r, one in zip(rates, solved, strict=True)]
        rate = max(own_rate, *rates) if rates else own_rate
        step = max(min(max_step, MAX_STEP_RATE / rate), least_step)
        if times[-1] / step > MAX_STEPS:
            raise BadInput(
                "machine parameters",
                f"a fastest rate of at most {MAX_STEPS / times[-1]:.3g} 1/s (sqrt(K_x / (M + m)), "
                "for instance)",
                f"{rate:.3g} 1/s, which takes steps of {step:.3g} s",
            )
        edges, volts, samples = _edges(times, at, levels)
        steps = np.maximum(1, np.ceil(np.diff(edges) / step - 1e-9)).astype(np.int64)
        long, watched = steps, [False] * len(terms)
        if least_step > 0 and terms and not fast:  # a search, which can do with less
            calm = max(min(max_step, MAX_STEP_RATE / own_rate), least_step)
            watched = [min(MAX_STEP_RATE / r, calm) < calm if r > 0 else False for r in rates]
            long = np.maximum(1, np.ceil(np.diff(edges) / calm - 1e-9)).astype(np.int64)
        n = len(self.states)
        own = initial[n:]
        if own.size == 0:
            first = (effect.first_states(initial, given) for effect, given in terms)
            own = np.array([state for states in first for state in states])
        start = np.zeros(STATES + own.size)
        start[:n], start[STATES:] = initial[:n], own
        rigid = bool(c.unbalance == 0 and not start[3:STATES].any())
        states = np.zeros((times.size, STATES + own.size))
        states[0] = start
        quiet = QUIET_CHANGE * values["K_t"] * most / values["R"], QUIET_CHANGE * most
        begin = tuple(start[: RIGID_STATES if rigid else STATES].tolist())
        used, k = gather(terms, values, watched, quiet) if terms else None, _coefficients(c)
        if fast:
            failed = _collocated(
                *(edges, volts, steps, samples, begin, start[STATES:], k, states, tracked, used),
                *(values, most, BEND_IN_SEARCH if least_step > 0 else BEND),
            )
        else:
            failed = runge_kutta(
                *(edges, volts, steps, long, samples, begin, start[STATES:], k),
                *(states, *tracked, used),
            )
        if failed >= 0:
            raise LdtError(
                f"the simulation of {self.name} diverged: its state is not finite "
                f"{times[failed]:g} s after the start"
            )
        return np.concatenate([states[:, :n], states[:, STATES:]], axis=1)

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


def _coefficients(c: Constants) -> Coefficients:
    return Coefficients(
        pull=c.torque_constant / c.inertia,
        drag=c.friction / c.inertia,
        ease=1.0 / c.inertia,
        weight=c.weight_torque / c.inertia,
        coupling=c.unbalance / c.inertia,
        supply=1.0 / c.inductance,
        loss=c.resistance / c.inductance,
        emf=c.torque_constant / c.inductance,
        lever=c.unbalance / c.mass,
        stiffness_x=c.stiffness_x / c.mass,
        stiffness_y=c.stiffness_y / c.mass,
        damping_x=c.damping_x / c.mass,
        damping_y=c.damping_y / c.mass,
    )


def _collocated(
    edges: Array,
    volts: Array,
    steps: NDArray[np.int64],
    samples: NDArray[np.int64],
    begin: tuple[float, ...],
    own: Array,
    c: Coefficients,
    states: Array,
    tracked: Tracked,
    terms: Terms | None,
    values: Values,
    most: float,
    bend: float,
) -> int:
    """`fast_current.collocate` with its table of moves; see there."""
    from ldt_core.physics.fast_current import collocate, moves

    length = np.diff(edges) / steps
    # Lengths that differ by rounding are the same.
    _, first, kind = np.unique(
        np.round(np.log(length) / SAME_LENGTH), return_index=True, return_inverse=True
    )
    motor = np.array([[-c.drag, c.pull], [-c.emf, -c.loss]])
    table = moves(motor, 1 / c.supply, length[first])
    volt = max(most, abs(begin[SPEED]) * values["K_t"], abs(begin[CURRENT]) * values["R"], TINY)
    scale = (volt / values["K_t"], volt / values["R"])
    return int(
        collocate(
            *(edges, volts, steps, kind.astype(np.int64), table, samples),
            *(begin, own, c, states, *tracked, terms, scale, bend * scale[0]),
        )
    )


def _edges(times: Array, at: Array, levels: Array) -> tuple[Array, Array, NDArray[np.int64]]:
    """Edges of the intervals of constant voltage, their levels, the sample at each edge or -1."""
    if np.array_equal(at, times):
        return times, levels[:-1], np.arange(times.size, dtype=np.int64)
    inside = at[(at > 0) & (at < times[-1])]
    edges = np.union1d(times, inside)
    volts = levels[np.searchsorted(at, edges[:-1], side="right") - 1]
    samples = np.full(edges.size, -1, dtype=np.int64)
    samples[np.searchsorted(edges, times)] = np.arange(times.size)
    return edges, np.ascontiguousarray(volts, dtype=np.float64), samples
