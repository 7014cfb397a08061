"""Effects' terms of eight free runs at once; see `terms.py`.

A term that takes no decision is compiled for lanes as it stands. Of any other, and of any that
numba refuses for lanes, the machine code for floats is called lane by lane.
"""

from __future__ import annotations

import dis
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.core.errors import NumbaError
from numba.extending import intrinsic
from numpy.typing import NDArray

from ldt_core.base.arrays import Array
from ldt_core.base.compiled import njit
from ldt_core.physics.lanes import (
    BYTES_OF_LANES,
    LANES,
    VECTOR,
    WIDTH,
    lane,
    lanes_of,
    load,
    store,
    where_less,
    with_lane,
)
from ldt_core.physics.term_helpers import called_by, code_of, compiled_with_helpers
from ldt_core.physics.terms import BYTES, _call, _call_with_states

_POINTER = types.CPointer(LANES)
TERM = LANES(types.float64, LANES, LANES, LANES, LANES, _POINTER)
TERM_WITH_STATES = LANES(types.float64, LANES, LANES, LANES, LANES, _POINTER, _POINTER, _POINTER)


#: Columns of `LaneTerms.table`: the machine code's address; whether it is of lanes, else of floats;
#: whether it gives a voltage, else a torque; how many states it has; the first parameter, the first
#: state; whether it asks for shorter steps than the machine in some lane.
COLUMNS = range(7)
ADDRESS, WHOLE, TERMINAL, OWN, PARAMETER, STATE, WATCHED = COLUMNS
LEAST, MOST, QUIET = range(3)


class LaneTerms(NamedTuple):
    """All terms of eight free runs, which have the same, each with its own parameters.

    Few arrays, since each costs time in each call.
    """

    table: NDArray[np.int64]  # (terms, 7)
    parameters: Array  # (P, WIDTH)
    by_lane: Array  # (WIDTH, P) the same
    #: (3, terms, WIDTH) least and most value of each watched term since `forget_lanes`, and by how
    #: much it may change: infinite where the lane does not watch it.
    watch: Array
    room: Array  # (2, own) for one lane's states and their rates


def compile_for_lanes(function: Callable[..., Any], stateful: bool) -> Any:
    """The function as machine code for lanes, None where it must be called lane by lane."""
    # What numba refuses is in no cache: every process would prepare the compiler to hear it again.
    if _decides(function):
        return None
    signature = TERM_WITH_STATES if stateful else TERM
    try:
        return compiled_with_helpers(signature, function)
    except (NumbaError, TypeError, NotImplementedError):
        return None


def _decides(function: Callable[..., Any]) -> bool:
    """Whether it, or what it calls, has a conditional jump, which lanes take only together."""
    all_of_it: list[Callable[..., Any]] = [function, *called_by(function)]
    codes = (code for f in all_of_it if (code := code_of(f)) is not None)
    names = (i.opname for code in codes for i in dis.get_instructions(code))
    return any("JUMP" in name and "IF" in name for name in names)


def _caller(pointers: int) -> Any:
    def lower(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        pointer = VECTOR.as_pointer()
        kind = ir.FunctionType(VECTOR, [ir.DoubleType(), *[VECTOR] * 4, *[pointer] * pointers])
        function = builder.inttoptr(args[0], kind.as_pointer())
        given = [builder.inttoptr(a, pointer) for a in args[6:]]
        return builder.call(function, [*args[1:6], *given])

    return LANES(types.int64, types.float64, *[LANES] * 4, *[types.int64] * pointers), lower


@intrinsic
def _call_lanes(typing, address, t, theta, omega, current, voltage, p):
    return _caller(1)


@intrinsic
def _call_lanes_with_states(typing, address, t, theta, omega, current, voltage, p, state, rate):
    return _caller(3)


@njit(nogil=True)
def _one_by_one(terms, j, t, theta, omega, current, volts, state, rate):  # pragma: no cover
    found = lanes_of(0.0)
    row = terms.table[j]
    for i in range(WIDTH):
        p = terms.by_lane.ctypes.data
        p += BYTES * (i * terms.by_lane.shape[1] + row[PARAMETER])
        now = lane(theta, i), lane(omega, i), lane(current, i), lane(volts, i)
        if row[OWN] > 0:
            for m in range(row[OWN]):
                terms.room[0, m] = state[row[STATE] + m, i]
            s = terms.room.ctypes.data
            r = s + BYTES * terms.room.shape[1]
            value: float = _call_with_states(row[ADDRESS], t, *now, p, s, r)
            for m in range(row[OWN]):
                rate[row[STATE] + m, i] = terms.room[1, m]
        else:
            value = _call(row[ADDRESS], t, *now, p)
        found = with_lane(found, i, value)
    return found


@njit(nogil=True, forceinline=True)
def evaluate_lanes(terms, t, y, volts, state, rate):  # pragma: no cover - compiled
    """As `terms.evaluate`, of lanes."""
    torque, terminal = lanes_of(0.0), volts
    if terms is None:
        return torque, terminal
    for j in range(terms.table.shape[0]):
        address = terms.table[j, ADDRESS]
        p = terms.parameters.ctypes.data + BYTES_OF_LANES * terms.table[j, PARAMETER]
        if not terms.table[j, WHOLE]:
            value = _one_by_one(terms, j, t, y[0], y[1], y[2], volts, state, rate)
        elif terms.table[j, OWN] > 0:
            s = state.ctypes.data + BYTES_OF_LANES * terms.table[j, STATE]
            r = rate.ctypes.data + BYTES_OF_LANES * terms.table[j, STATE]
            value = _call_lanes_with_states(address, t, y[0], y[1], y[2], volts, p, s, r)
        else:
            value = _call_lanes(address, t, y[0], y[1], y[2], volts, p)
        if terms.table[j, WATCHED]:
            of_least, of_most = j, terms.table.shape[0] + j
            least, most = load(terms.watch, of_least), load(terms.watch, of_most)
            store(terms.watch, of_least, where_less(value, least, value, least))
            store(terms.watch, of_most, where_less(most, value, value, most))
        if terms.table[j, TERMINAL]:
            terminal += value
        else:
            torque += value
    return torque, terminal


@njit(nogil=True)
def forget_lanes(terms):  # pragma: no cover - compiled
    """Begin to watch anew."""
    count = terms.table.shape[0]
    for j in range(count):
        store(terms.watch, j, lanes_of(math.inf))
        store(terms.watch, count + j, lanes_of(-math.inf))


@njit(nogil=True)
def is_quiet_lane(terms, i):  # pragma: no cover - compiled
    """Whether no watched term of lane i has changed by more than it may."""
    for j in range(terms.table.shape[0]):
        change = terms.watch[MOST, j, i] - terms.watch[LEAST, j, i]
        if terms.table[j, WATCHED] and not change <= terms.watch[QUIET, j, i]:
            return False
    return True
