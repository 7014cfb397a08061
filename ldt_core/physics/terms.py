"""Effects' terms in the equations of motion, as machine code that the integrator calls by address.

A term is a plain Python function of floats, compiled by itself. The kernel takes addresses, not
functions, so that it is compiled once and serves every combination of effects, also of effects that
did not exist when it was compiled.

    term(t, theta, omega, current, voltage, p) -> N m or V
    term(t, theta, omega, current, voltage, p, state, rate) -> N m or V, writes rate[:]

in s, rad, rad/s, A, V. `p` holds the effect's parameters in their order, then the machine's that it
`needs`; `state` and `rate` the effect's own states and their derivatives.
"""

from __future__ import annotations

import dis
import math
import re
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
from ldt_core.base.errors import OptionError
from ldt_core.physics.term_helpers import called_by, code_of, compiled_with_helpers

_F, _POINTER = types.float64, types.CPointer(types.float64)
TERM = _F(_F, _F, _F, _F, _F, _POINTER)
TERM_WITH_STATES = _F(_F, _F, _F, _F, _F, _POINTER, _POINTER, _POINTER)
BYTES = 8  # of a float64
COLOURS = re.compile("\x1b\\[[0-9;]*m")  # for a terminal, in numba's sentences
PREAMBLE = "Failed in nopython mode"  # above what is wrong
INNER_NAME = re.compile(r" for '\$.*")  # of a variable that nobody wrote
PLACE = re.compile(r'File ".+", line (\d+)')
#: What a term takes: s, rad, rad/s, A, V and its parameters.
ARGUMENTS = ("t", "theta", "omega", "current", "voltage", "p")
STATE_ARGUMENTS = (*ARGUMENTS, "state", "rate")


class Terms(NamedTuple):
    """All terms of one simulation, as the kernel takes them: arrays with one entry a term."""

    address: NDArray[np.int64]
    terminal: NDArray[np.bool_]  # a voltage, else a torque
    stateful: NDArray[np.bool_]
    first_parameter: NDArray[np.int64]
    first_state: NDArray[np.int64]
    parameters: Array
    watched: NDArray[np.bool_]  # those that ask for shorter steps than the machine itself does
    least: Array  # value of each watched term since `forget`, and
    most: Array
    quiet: Array  # by how much it may change in steps that are too long for it


def compile_term(where: str, function: Callable[..., float], stateful: bool) -> Any:
    """The function as machine code with a C interface; keep it as long as its address is used.

    Raises:
        OptionError: other arguments, an exception or output of its own, or numba cannot compile it.
    """
    arguments = STATE_ARGUMENTS if stateful else ARGUMENTS
    form = f"{getattr(function, '__name__', 'a term')}({', '.join(arguments)})"
    code = code_of(function)
    if code is not None:
        given = code.co_varnames[: code.co_argcount]
        if len(given) != len(arguments):
            raise OptionError(where, form, f"{code.co_name}({', '.join(given)})")
    # Machine code called by its address has nobody to raise to: it goes on with a torque of 0, and
    # what it prints may wait for a lock for ever.
    all_of_it: list[Callable[..., float]] = [function, *called_by(function)]
    for called in all_of_it:
        if (told := _speaking(called)) is not None:
            raise OptionError(where, f"{form} without raise, assert and print", told)
    signature = TERM_WITH_STATES if stateful else TERM
    try:
        return compiled_with_helpers(signature, function)
    except (NumbaError, TypeError) as error:
        expected = f"a function that numba compiles, {form} with p[0] for the first parameter"
        raise OptionError(where, expected, _told_by_numba(str(error))) from error


def _speaking(function: Callable[..., Any]) -> str | None:
    """What in a term, or in a function that it calls, raises or prints, with its line."""
    code = code_of(function)
    if code is None:
        return None
    for instruction in dis.get_instructions(code):
        line = instruction.positions.lineno if instruction.positions else None
        if instruction.opname == "RAISE_VARARGS":
            return f"{code.co_name}, which raises (line {line})"
        if instruction.opname == "LOAD_GLOBAL" and instruction.argval == "print":
            return f"{code.co_name}, which prints (line {line})"
    return None


def _told_by_numba(text: str) -> str:
    """Of numba's page, the line that says what is wrong, and the line of the file."""
    plain = COLOURS.sub("", text)
    lines = [line.strip() for line in plain.splitlines()]
    lines = [s for s in lines if s and not s.startswith(PREAMBLE)]
    reason = next(iter(lines), "none")
    if reason.endswith(":"):
        reason += next((s.removeprefix(">>>") for s in lines if s.startswith(">>>")), "")
    reason = INNER_NAME.sub("", reason)
    if reason.startswith("No conversion from none"):
        reason += ": it returns nothing"
    place = PLACE.search(plain)
    return reason + (f" (line {place[1]})" if place else "")


def _caller(pointers: int) -> Any:
    """An intrinsic that calls a term with so many pointers, all given as integer addresses."""

    def lower(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        real = ir.DoubleType()
        pointer = real.as_pointer()
        kind = ir.FunctionType(real, [real] * 5 + [pointer] * pointers)
        function = builder.inttoptr(args[0], kind.as_pointer())
        given = [builder.inttoptr(a, pointer) for a in args[6:]]
        return builder.call(function, [*args[1:6], *given])

    return types.float64(types.int64, *[types.float64] * 5, *[types.int64] * pointers), lower


@intrinsic
def _call(typing, address, t, theta, omega, current, voltage, p):
    return _caller(1)


@intrinsic
def _call_with_states(typing, address, t, theta, omega, current, voltage, p, state, rate):
    return _caller(3)


@njit()
def evaluate(terms, t, y, volts, state, rate):  # pragma: no cover - compiled
    """(sum of torques [N m], terminal voltage [V]); writes the rates of the effects' states.

    Without `terms` (None) the compiler leaves all of it out.
    """
    if terms is None:
        return 0.0, volts
    torque, terminal = 0.0, volts
    parameters = terms.parameters.ctypes.data
    for j in range(terms.address.size):
        p = parameters + BYTES * terms.first_parameter[j]
        if terms.stateful[j]:
            s = state.ctypes.data + BYTES * terms.first_state[j]
            r = rate.ctypes.data + BYTES * terms.first_state[j]
            value: float = _call_with_states(terms.address[j], t, y[0], y[1], y[2], volts, p, s, r)
        else:
            value = _call(terms.address[j], t, y[0], y[1], y[2], volts, p)
        if terms.watched[j]:
            terms.least[j] = min(terms.least[j], value)
            terms.most[j] = max(terms.most[j], value)
        if terms.terminal[j]:
            terminal += value
        else:
            torque += value
    return torque, terminal


@njit(nogil=True)
def forget(terms):  # pragma: no cover - compiled
    """Begin to watch anew."""
    if terms is None:
        return
    terms.least[:] = math.inf
    terms.most[:] = -math.inf


@njit(nogil=True)
def is_quiet(terms):  # pragma: no cover - compiled
    """Whether no watched term has changed by more than it may."""
    if terms is None:
        return True
    for j in range(terms.watched.size):
        if terms.watched[j] and not terms.most[j] - terms.least[j] <= terms.quiet[j]:
            return False
    return True
