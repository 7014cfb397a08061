"""Who is told that code is compiled: the first run on a computer takes half a minute for it.

Apart from `compiled`, since numba takes longer to import than most commands run.
"""

from __future__ import annotations

from collections.abc import Callable

#: Called with how many functions were compiled, each time one more is. None tells nobody.
listener: Callable[[int], None] | None = None
_count = 0


def tell() -> None:
    """A function was compiled, since no cache had it."""
    global _count
    _count += 1
    if listener is not None:
        listener(_count)
