"""Free runs side by side: those that share sample times, steps and terms, eight at once.

A run takes a lane wherever `MotorDriven.simulate` would take steps of one length from sample to
sample; all others go there one by one. A lane does what the run would do alone, so what comes out
depends neither on the other runs nor on their order.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError
from ldt_core.base.threads import spread
from ldt_core.physics.base import FreeRun
from ldt_core.physics.effect import term_parameters
from ldt_core.physics.exponential_steps import exponential_moves
from ldt_core.physics.integrate import RIGID_STATES, STATES
from ldt_core.physics.lane_runs import run_lanes
from ldt_core.physics.lane_terms import (
    ADDRESS,
    COLUMNS,
    OWN,
    PARAMETER,
    QUIET,
    STATE,
    TERMINAL,
    WATCHED,
    WHOLE,
    LaneTerms,
)
from ldt_core.physics.lanes import BYTES_OF_LANES, WIDTH
from ldt_core.physics.run_plan import (
    GRIDS_REMEMBERED,
    STEP_SHARE,
    BegunRun,
    Plan,
    Plans,
    sample_times,
    steps_of,
)

MOST_SAMPLES = 100_000  # of a run in a lane: the states of eight then take 45 MB in each thread
ALONE = 25  # steps of a lane that a run without one takes a sample: 580 to 755 ns against 30
AT_ONCE = 16  # works of one thread in a row, and such rows of each: all end at about the same time
ROWS_OF_STATES = 8  # the effects' states, and room: `lane_steps._interval` and `_tried`


#: Places of runs, each with what came out.
Found = list[tuple[int, Array | LdtError]]


class _Lane(NamedTuple):
    place: int
    begun: BegunRun
    plan: Plan


class SideBySide:
    """Simulates many free runs of one physics; `max_step`, `least_step` as for `simulate`."""

    def __init__(self, physics: Plans, max_step: float, least_step: float) -> None:
        self.physics, self._max_step, self._least_step = physics, max_step, least_step

    def states(
        self, runs: Sequence[FreeRun], workers: int
    ) -> Iterator[tuple[int, Array | LdtError]]:
        """Of each run its place, and its (L, n) states or the error that ended it."""
        works: list[Callable[[], Found]] = []
        alike: dict[object, list[_Lane]] = {}
        for i, run in enumerate(runs):
            try:
                begun = self.physics.begun(run)
                lane = self._lane(i, begun)
            except LdtError as error:
                yield i, error
                continue
            if lane is None:
                if run.work is not None:
                    run.work.add(begun.times.size * (1 if begun.exact else ALONE))
                works.append(functools.partial(self._alone, i, begun, run.period))
            else:
                alike.setdefault(self._likeness(lane), []).append(lane)
        for lanes in alike.values():
            for k in range(0, len(lanes), WIDTH):
                works.append(functools.partial(self._together, lanes[k : k + WIDTH]))
        # A thread is given several at a time: one alone may take less time than to hand it over.
        some = min(AT_ONCE, max(1, len(works) // (workers * AT_ONCE)))
        parts = [works[k : k + some] for k in range(0, len(works), some)]
        for founds in spread(lambda k: [work() for work in parts[k]], len(parts), workers):
            for found in founds:
                yield from found

    def _alone(self, i: int, begun: BegunRun, period: float) -> Found:
        try:
            return [(i, self.physics.alone(begun, period, self._max_step, self._least_step))]
        except LdtError as error:
            return [(i, error)]

    def _lane(self, i: int, begun: BegunRun) -> _Lane | None:
        if begun.exact or not begun.on_grid or not 1 < begun.times.size <= MOST_SAMPLES:
            return None
        most = float(np.abs(begun.switches[1]).max())
        end = float(begun.times[-1])
        about = begun.values, most, end, begun.initial, begun.terms
        plan = self.physics.planned(*about, self._max_step, self._least_step)
        lane = _Lane(i, begun, plan)
        return lane if not plan.fast or (plan.explicit and _is_even(lane)) else None

    def exponential(self, begun: BegunRun) -> Array | None:
        """The states of one run by `exponential_steps`, None where they do not serve it.

        Raises:
            LdtError: as `simulate` does.
        """
        lane = self._lane(0, begun)
        if lane is None or not lane.plan.fast:
            return None
        found = self._together([lane])[0][1]
        if isinstance(found, LdtError):
            raise found
        return found

    def _likeness(self, lane: _Lane) -> object:
        """What runs share that are integrated side by side."""
        begun, plan = lane.begun, lane.plan
        counts = (_likeness(begun.times, longest) for longest in (plan.step, plan.calm))
        terms = tuple(id(effect) for effect, _ in begun.terms)
        seen, gain = begun.tracked
        about = id(begun.times), plan.rigid, plan.fast, terms, seen.size > 0, gain, plan.first.size
        return (*counts, *about)

    def _together(self, lanes: Sequence[_Lane]) -> Found:
        """The states of up to WIDTH runs that are alike, by their places."""
        begun, plan, n = lanes[0].begun, lanes[0].plan, len(self.physics.states)
        # The last run fills the lanes that are left over: nothing else is done for them.
        filled = [*lanes, *[lanes[-1]] * (WIDTH - len(lanes))]
        times, volts = begun.times, np.stack([x.begun.switches[1] for x in filled], axis=1)
        seen = np.stack([x.begun.tracked[0] for x in filled], axis=1)
        first = np.stack([x.plan.first for x in filled], axis=1)
        states = np.zeros((times.size, *first.shape))
        states[0] = first
        own = _aligned(ROWS_OF_STATES, first.shape[0] - STATES, WIDTH)
        own[0] = first[STATES:]
        failed = np.full(WIDTH, -1)
        coefficients = np.array([x.plan.coefficients for x in filled]).T.copy()
        moves = None
        if plan.fast:
            count = [steps_of(times[:2], longest)[0] for longest in (plan.step, plan.calm)]
            moves = exponential_moves(coefficients, times[1] / np.array(count))
        steps = steps_of(times, plan.step)
        long = steps if plan.calm == plan.step else steps_of(times, plan.calm)
        if begun.work is not None:  # where the long ones do not serve, both are taken
            both = int(steps.sum()) + (0 if long is steps else int(long.sum()))
            begun.work.add(0, (1 + len(begun.terms)) * both)
        run_lanes(
            *(times, volts, steps, long),
            *(first[:STATES], (0.0,) * (RIGID_STATES if plan.rigid else STATES)),
            coefficients,
            *(states, own, seen, begun.tracked[1], _gathered(filled), moves, failed),
        )
        found: Found = []
        for i, lane in enumerate(lanes):
            if failed[i] >= 0:
                found.append((lane.place, self.physics.diverged(float(times[failed[i]]))))
            else:
                whole = states[:, :n, i]  # no copy, since most ask for the speed alone
                if states.shape[1] > STATES:
                    whole = np.concatenate([whole, states[:, STATES:, i]], axis=1)
                found.append((lane.place, whole))
        return found


def _gathered(lanes: Sequence[_Lane]) -> LaneTerms | None:
    """The terms that all lanes have, each with its own parameters."""
    if not lanes[0].begun.terms:
        return None
    terms = lanes[0].begun.terms
    laid = [term_parameters(x.begun.terms, x.plan.values) for x in lanes]
    watched = np.array([x.plan.watched for x in lanes]).T
    table = np.zeros((len(terms), len(COLUMNS)), np.int64)
    for row, (effect, _) in zip(table, terms, strict=True):
        whole = effect.compiled_for_lanes
        row[ADDRESS] = (effect.compiled if whole is None else whole).address
        row[WHOLE], row[OWN] = whole is not None, len(effect.states)
        row[TERMINAL] = effect.terminal is not None
    table[:, WATCHED], (_, table[:, PARAMETER], table[:, STATE]) = watched.any(axis=1), laid[0]
    by_lane = np.array([parameters for parameters, _, _ in laid])
    parameters = _aligned(by_lane.shape[1], WIDTH)
    parameters[:] = by_lane.T
    voltage = table[:, TERMINAL]
    quiet = np.array([x.plan.quiet for x in lanes])[:, voltage].T
    watch = np.zeros((3, len(terms), WIDTH))
    watch[QUIET] = np.where(watched, quiet, np.inf)
    room = np.zeros((2, int(table[:, OWN].max())))
    return LaneTerms(table, parameters, by_lane, watch, room)


def _is_even(lane: _Lane) -> bool:
    """Whether all intervals of a run take the same number of steps."""
    counts = (_likeness(lane.begun.times, longest) for longest in (lane.plan.step, lane.plan.calm))
    return all(isinstance(count, int) for count in counts)


def _likeness(times: Array, longest: float) -> object:
    """What tells the steps of some runs from those of others: their number if it is one."""
    least, most = _distances(times.size, float(times[1]))
    few, many = (max(1, math.ceil(d / longest - STEP_SHARE)) for d in (least, most))
    return few if few == many else steps_of(times, longest).tobytes()


@functools.lru_cache(maxsize=GRIDS_REMEMBERED)
def _distances(length: int, period: float) -> tuple[float, float]:
    lengths = np.diff(sample_times(length, period))
    return float(lengths.min()), float(lengths.max())


def _aligned(*shape: int) -> Array:
    """Zeros that begin where a whole register may be loaded from."""
    count = math.prod(shape)
    room = np.zeros(count + WIDTH)
    begin = -room.ctypes.data % BYTES_OF_LANES // room.itemsize
    return room[begin : begin + count].reshape(shape)
