"""numba's `njit` and `cfunc`, with a cache that loads without preparing the compiler.

Before it loads what is cached, numba imports and registers all that could be compiled: 0.2 s of a
processor in every process. Machine code that is ready needs the memory manager alone. What is not
cached prepares the compiler as ever.

This looks into numba. It is for the version that was tried, any other loads as numba does, and for
code that asks for nothing else at run time: no hash of a text, no parallel loop.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable
from typing import Any

import numba
from numba.core.caching import FunctionCache
from numba.core.ccallback import CFunc
from numba.core.runtime import rtsys
from numba.core.sigutils import normalize_signature

from ldt_core.base import first_compilation

if numba.config.DISABLE_JIT:
    raise ImportError("numba must not compile (NUMBA_DISABLE_JIT is set), and LDT has to")

#: The version of numba whose cache was tried, the one that `constraints.txt` installs.
TRIED = "0.68.1"

NO_PLACE = (
    "no folder for compiled code can be written to, neither beside LDT nor in the home folder; "
    "set NUMBA_CACHE_DIR to one"
)


class _TellingCache(FunctionCache):  # type: ignore[misc]  # untyped
    """Tells of each function that was compiled, since the cache had it not.

    A cache that cannot be read or written costs time and nothing else. numba fails at a file that a
    power failure cut, at every start from then on, and at a full disk.
    """

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return self._load(sig, target_context)
        except Exception:  # whatever pickle makes of a damaged file
            with contextlib.suppress(OSError):
                self.flush()
            return None

    def _load(self, sig: Any, target_context: Any) -> Any:
        return super().load_overload(sig, target_context)

    def save_overload(self, sig: Any, data: Any) -> None:
        first_compilation.tell()
        with contextlib.suppress(Exception):  # also what could not be flushed is read here
            super().save_overload(sig, data)


class _ReadyCache(_TellingCache):
    """Loads what is ready before, not after, the compiler is."""

    def _load(self, sig: Any, target_context: Any) -> Any:
        rtsys.initialize(target_context)  # what is loaded calls it by addresses, unset before
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)


_Cache = _ReadyCache if numba.__version__ == TRIED else _TellingCache


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """As `numba.njit(cache=True, **options)`, for functions of LDT's own modules."""

    def compiled(function: Callable[..., Any]) -> Any:
        dispatcher = numba.njit(**options)(function)
        try:
            dispatcher._cache = _Cache(function)
        except RuntimeError as error:  # every process would compile all anew
            raise ImportError(NO_PLACE) from error
        return dispatcher

    return compiled


def cfunc(signature: Any, function: Callable[..., Any], cached: bool = True) -> Any:
    """As `numba.cfunc(signature, error_model="numpy")(function)`, from a cache where it can be.

    A division by zero gives inf, which the integrator reports.

    Raises:
        NumbaError, TypeError: numba cannot compile it.
    """
    # What is cached is found again by its module's name, which a user's file, given by path, lacks.
    if cached and getattr(function, "__module__", None) in sys.modules:
        with contextlib.suppress(RuntimeError):  # typed at a prompt, it comes from no file
            return _cached_cfunc(signature, function)
    return numba.cfunc(signature, error_model="numpy")(function)


def _cached_cfunc(signature: Any, function: Callable[..., Any]) -> Any:
    if not function.__module__.startswith("ldt_core."):  # who knows what it asks for
        return numba.cfunc(signature, cache=True, error_model="numpy")(function)
    found: Any = CFunc(function, normalize_signature(signature), {}, {"error_model": "numpy"})
    found._cache = _Cache(function)
    found.compile()
    return found
