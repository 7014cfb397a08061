"""Functions of a user's own that an effect's term calls: found, and compiled with it.

numba compiles the one function that it is given. A plain Python function beside it would be "an
untyped global name", and whoever wrote it is not to think of numba.
"""

from __future__ import annotations

import dis
from collections.abc import Callable, Iterator
from types import CellType, CodeType, FunctionType
from typing import Any

import numba

from ldt_core.base.compiled import cfunc

OURS = "ldt_core."  # modules whose functions are compiled as they are to be


def code_of(function: Callable[..., Any]) -> CodeType | None:
    """The bytecode of a term, compiled by numba or not; None of what is no Python function."""
    found: CodeType | None = getattr(getattr(function, "py_func", function), "__code__", None)
    return found


def called_by(function: Callable[..., Any]) -> list[FunctionType]:
    """The Python functions of the user's own that it calls, directly or by another, once each."""
    found: list[FunctionType] = []
    waiting = [function]
    while waiting:
        for _, value in _named_in(waiting.pop()):
            plain = getattr(value, "py_func", value)
            if plain not in found:
                found.append(plain)
                waiting.append(plain)
    return found


def compiled_with_helpers(signature: Any, function: Callable[..., Any]) -> Any:
    """As `cfunc`, of a function that may call plain Python functions of the user's own.

    Raises:
        NumbaError, TypeError: numba cannot compile it.
    """
    all_of_it: list[Callable[..., Any]] = [function, *called_by(function)]
    files = {code.co_filename for f in all_of_it if (code := code_of(f)) is not None}
    # numba's cache notices a change of the function's own file alone.
    return cfunc(signature, _prepared(function, ()), cached=len(files) == 1)


def _prepared(function: Any, within: tuple[Any, ...]) -> Any:
    plain = getattr(function, "py_func", function)
    instead = {
        name: _compiled(value, (*within, plain))
        for name, value in _named_in(plain)
        if getattr(value, "py_func", value) not in (*within, plain)  # one that calls itself
    }
    instead = {name: new for name, new in instead.items() if new is not _value(plain, name)}
    if not instead:
        return function
    code = plain.__code__
    cells = zip(code.co_freevars, plain.__closure__ or (), strict=True)
    closure = tuple(CellType(instead[n]) if n in instead else cell for n, cell in cells)
    known = {**plain.__globals__, **instead}
    made = FunctionType(code, known, plain.__name__, plain.__defaults__, closure)
    made.__qualname__ = plain.__qualname__
    return made


def _compiled(helper: Any, within: tuple[Any, ...]) -> Any:
    made = _prepared(helper, within)
    return made if hasattr(made, "py_func") else numba.njit(made)


def _named_in(function: Callable[..., Any]) -> Iterator[tuple[str, Any]]:
    """Names in a function's code that stand for Python functions of the user's own, and these."""
    code, plain = code_of(function), getattr(function, "py_func", function)
    if code is None or not isinstance(plain, FunctionType):
        return
    for name in sorted({i.argval for i in dis.get_instructions(code) if _loads(i.opname)}):
        value = _value(plain, name)
        own = getattr(value, "py_func", value)
        if isinstance(own, FunctionType) and not own.__module__.startswith(OURS):
            yield name, value


def _loads(operation: str) -> bool:
    return operation in ("LOAD_GLOBAL", "LOAD_DEREF")


def _value(function: FunctionType, name: str) -> Any:
    free = function.__code__.co_freevars
    if name not in free:
        return function.__globals__.get(name)
    try:
        return (function.__closure__ or ())[free.index(name)].cell_contents
    except ValueError:  # not yet bound
        return None
