"""Machines driven by a DC motor, whose equations this project integrates itself."""

from __future__ import annotations

import abc
import functools
import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

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
    FreeRun,
    Physics,
    Tracked,
    Work,
    first_states,
)
from ldt_core.physics.motor_rates import inductance, memory, motor_rate
from ldt_core.physics.parameter import Values
from ldt_core.physics.run_plan import (
    STEP_SHARE,
    BegunRun,
    Coefficients,
    Constants,
    Plan,
    coefficients_of,
    sample_times,
    steps_of,
)
from ldt_core.physics.zero_order_hold import zero_order_hold

if TYPE_CHECKING:
    from ldt_core.physics.terms import Terms

#: Explicit steps for one by collocation: eight runs side by side take so many in the same time.
WORTH_SHORTER = 20
DISCRETISATIONS_REMEMBERED = 256  # machines at a sample period; each is some 100 numbers
SAME_LENGTH = 1e-9  # of a step, the rounding of its ends: sample times are sums
#: Of the largest speed, what a step may get wrong where a term bends; a search is content with a
#: hundredth of a usual sensor's noise.
BEND, BEND_IN_SEARCH = 3e-7, 1e-5
USUAL_ROUNDS = 4  # of Newton's method in a step, which the limit of a search counts for it
ROUND_PRICE = 4  # steps that take as long as a further round: 30 to 80 ns against 0.2 us
TINY = 1e-9  # V, so that a machine at rest without a voltage divides by no 0
MAX_STEPS = 100_000_000  # of one simulation: 6 s of computing; more is a mistake
#: Of the time in which the motor forgets its speed, an L/R with which it does so fastest.
SETTLED = 0.25
FINEST = (
    64  # parts of an explicit method's step, to which one is halved where the current is solved
)
STABLE = 2.8  # rate times step, beyond which a Runge-Kutta step of an effect's own states grows
#: What a term must not read for its rate to be a decay: a ripple asks for steps that follow it.
SMOOTH = frozenset({"t", "theta"})
#: rad that a term's ripple may turn on in a step: its stages are half a step apart, and one with
#: more than half a period between them may seem quiet.
RIPPLE = 2 * math.pi
QUIET_CHANGE = 1e-3  # of stall torque and voltage: a term that changes less needs no short steps


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
        run = self.begun(FreeRun(values, voltage, period, initial, effects, tracked))
        if run.exact:  # most of a calibration's runs, of short experiments
            return self.alone(run, period, max_step, least_step)
        from ldt_core.physics.side_by_side import SideBySide  # see `integrate`

        states = SideBySide(self, max_step, least_step).exponential(run)
        return self.alone(run, period, max_step, least_step) if states is None else states

    def alone(self, run: BegunRun, period: float, max_step: float, least_step: float) -> Array:
        """The states of a run that has begun and takes no lane; see `simulate`."""
        from ldt_core.physics.integrate import propagate  # see `integrate`

        tracked = _writable(run.tracked[0]), run.tracked[1]
        if run.exact:
            ad, bd = self.discretised(run.values, period)
            first = run.initial[: len(self.states)]
            return propagate(ad, bd, _writable(run.switches[1]), first, *tracked)
        switches = run.switches[0], _writable(run.switches[1])
        about = run.values, run.times, switches, run.initial, run.terms, max_step
        return self.integrate(*about, tracked, least_step, run.work)

    def simulate_all(
        self,
        runs: Sequence[FreeRun],
        max_step: float = MAX_STEP,
        least_step: float = 0.0,
        workers: int = 1,
    ) -> Iterator[tuple[int, Array | LdtError]]:
        """Eight at once where they share their steps and terms; see `Physics`."""
        from ldt_core.physics.side_by_side import SideBySide  # see `integrate`

        return SideBySide(self, max_step, least_step).states(runs, workers)

    def begun(self, run: FreeRun) -> BegunRun:
        """The run with its effects on parameters and voltage done."""
        volts = np.ascontiguousarray(run.voltage, dtype=np.float64)
        tracked = np.ascontiguousarray(run.tracked[0], dtype=np.float64), run.tracked[1]
        state = np.ascontiguousarray(run.initial, dtype=np.float64)
        values = run.changed
        if values is None:
            values = self.changed(run.values, run.effects)
        times = sample_times(volts.size, run.period)
        switches = times, volts
        if any(effect.on_voltage is not None for effect, _ in run.effects):
            switches = self.switches(values, times, volts, state, run.effects)
        on_grid = switches[0] is times or np.array_equal(switches[0], times)
        terms = [(term, p) for e, p in run.effects for term in e.terms]
        exact = on_grid and not terms and self.is_linear(values)
        return BegunRun(values, times, switches, on_grid, state, terms, tracked, exact, run.work)

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
        work: Work | None = None,
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
            work: as of `FreeRun`.

        Returns:
            (L, n) states, effects' states in further columns.

        Raises:
            BadInput: so stiff that it would take more than MAX_STEPS steps.
            LdtError: the state grows without bound.
        """
        # With its compiler it takes longer to import than all else that loads a machine.
        from ldt_core.physics.effect import gather
        from ldt_core.physics.integrate import RIGID_STATES, STATES, runge_kutta

        at, levels = switches
        most = float(np.abs(levels).max())
        plan = self.planned(values, most, float(times[-1]), initial, terms, max_step, least_step)
        edges, volts, samples = _edges(times, at, levels)
        steps = steps_of(edges, plan.step)
        long = steps if plan.calm == plan.step else steps_of(edges, plan.calm)
        states = np.zeros((times.size, plan.first.size))
        states[0] = plan.first
        begin = tuple(plan.first[: RIGID_STATES if plan.rigid else STATES].tolist())
        used = gather(terms, plan.values, plan.watched, plan.quiet) if terms else None
        k, own = plan.coefficients, plan.first[STATES:]
        if plan.fast and steps.size:  # of one sample there is nothing to solve
            failed, rounds = _collocated(
                *(edges, volts, steps, samples, begin, own, k, states, tracked, used),
                *(plan.values, most, BEND_IN_SEARCH if least_step > 0 else BEND, plan.finest),
            )
            if work is not None:
                # An effect's own states may ask for far shorter steps than the plan was made for.
                usual = USUAL_ROUNDS * int(steps_of(edges, max_step).sum())
                more = ROUND_PRICE * max(0, rounds - usual)
                work.add(more, (1 + len(terms)) * min(rounds, usual))
        else:
            failed = runge_kutta(
                *(edges, volts, steps, long, samples, begin, own, k),
                *(states, *tracked, used),
            )
        if failed >= 0:
            raise self.diverged(float(times[failed]))
        return np.concatenate([states[:, : len(self.states)], states[:, STATES:]], axis=1)

    def planned(
        self,
        values: Values,
        most: float,
        end: float,
        initial: Array,
        terms: Effects,
        max_step: float,
        least_step: float,
    ) -> Plan:
        """How to integrate a machine at up to `most` volts until `end` [s]; see `integrate`."""
        from ldt_core.physics.integrate import MAX_STEP_RATE, STATES

        values = {**values, "L": inductance(values)}
        c = self.constants(values)
        own_rate = self.rate(values, most)
        rates = [effect.rate(values, most, given) for effect, given in terms]
        solved = [effect.terminal is not None and not effect.states for effect, _ in terms]
        electrical = [r for r, one in zip(rates, solved, strict=True) if one]
        fast = max([motor_rate(values), *electrical]) * MAX_STEP > MAX_STEP_RATE
        finest, explicit, asked = 0.0, False, rates
        if fast:  # then the current is solved for, and asks for no shorter steps
            settled = max(values["L"], SETTLED * values["R"] * memory(values))
            own_rate = self.rate({**values, "L": settled}, most)
            rates = [0.0 if one else r for r, one in zip(rates, solved, strict=True)]
            steepest = max(own_rate, *rates) if rates else own_rate
            finest = max(min(max_step, MAX_STEP_RATE / steepest), least_step) / FINEST
            own_states = [r for r, (e, _) in zip(rates, terms, strict=True) if e.states]
            if least_step > 0 and max(own_states, default=0.0) * least_step > STABLE:
                raise LdtError(
                    f"{self.name}: an effect's own states move within {1 / max(own_states):.3g} s, "
                    f"which steps of {least_step:g} s do not follow"
                )
            # So is what falls off with the speed alone: where that bends, a step is halved.
            sharp = [bool(e.states) or not SMOOTH.isdisjoint(e.reads) for e, _ in terms]
            rates = [r if one else 0.0 for r, one in zip(rates, sharp, strict=True)]
        rate = max(own_rate, *rates) if rates else own_rate
        step = max(min(max_step, MAX_STEP_RATE / rate), least_step)
        if fast:
            blind = all(e.torque is not None and "current" not in e.reads for e, _ in terms)
            explicit = blind and steepest * step <= WORTH_SHORTER * MAX_STEP_RATE + STEP_SHARE
            # Collocation halves a step where a term bends: no other limit is needed.
            longest = max(MAX_STEP_RATE / rate, least_step)
            step = min(step, MAX_STEP_RATE / steepest) if explicit else longest
        if end / step > MAX_STEPS:
            raise BadInput(
                "machine parameters",
                f"a fastest rate of at most {MAX_STEPS / end:.3g} 1/s (sqrt(K_x / (M + m)), "
                "for instance)",
                f"{rate:.3g} 1/s, which takes steps of {step:.3g} s",
            )
        calm, watched = step, [False] * len(terms)
        if least_step > 0 and terms and (explicit or not fast):  # a search can do with less
            turning = (not SMOOTH.isdisjoint(e.reads) for e, _ in terms)
            ripples = [r for r, one in zip(asked, turning, strict=True) if one and r > 0]
            longest = min([max_step, MAX_STEP_RATE / own_rate, *(RIPPLE / r for r in ripples)])
            calm = max(longest, least_step)
            watched = [min(MAX_STEP_RATE / r, calm) < calm if r > 0 else False for r in asked]
        n = len(self.states)
        own = initial[n:]
        if own.size == 0:
            own = np.array(first_states(terms, initial))
        first = np.zeros(STATES + own.size)
        first[:n], first[STATES:] = initial[:n], own
        rigid = bool(c.unbalance == 0 and not first[3:STATES].any())
        quiet = QUIET_CHANGE * values["K_t"] * most / values["R"], QUIET_CHANGE * most
        steps = step, calm, watched, quiet
        return Plan(values, coefficients_of(c), *steps, first, rigid, fast, explicit, finest)

    def discretised(self, values: Values, period: float) -> tuple[Array, Array]:
        """Ad (n, n), Bd (n,) of the linear system over a sample period [s], exactly."""
        return _discretised(self, tuple(values[p.name] for p in self.parameters), period)


def _writable(numbers: Array) -> Array:
    """A record's arrays are read-only: kernels would be compiled once more for them."""
    return numbers if numbers.flags.writeable else numbers.copy()


@functools.lru_cache(maxsize=DISCRETISATIONS_REMEMBERED)
def _discretised(
    physics: MotorDriven, numbers: tuple[float, ...], period: float
) -> tuple[Array, Array]:
    names = (p.name for p in physics.parameters)
    return zero_order_hold(*physics.system(dict(zip(names, numbers, strict=True))), period)


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
    finest: float,
) -> tuple[int, int]:
    """`fast_current.collocate` with its table of moves; see there."""
    from ldt_core.physics.fast_current import collocate, moves

    length = np.diff(edges) / steps
    # Lengths that differ by rounding are the same.
    _, first, kind = np.unique(
        np.round(np.log(length) / SAME_LENGTH), return_index=True, return_inverse=True
    )
    halvings = max(0, math.ceil(math.log2(length.max() / finest) - STEP_SHARE))
    table = moves(c, length[first], halvings)
    volt = max(most, abs(begin[SPEED]) * values["K_t"], abs(begin[CURRENT]) * values["R"], TINY)
    scale = (volt / values["K_t"], volt / values["R"])
    failed, rounds = collocate(
        *(edges, volts, steps, kind.astype(np.int64), table, samples),
        *(begin, own, c, states, *tracked, terms, scale, bend),
    )
    return int(failed), int(rounds)


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
