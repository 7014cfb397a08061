"""Room to load the numerical libraries, asked for before they are."""

from __future__ import annotations

import mmap
import os

#: Bytes of address space that numba, LLVM and scipy take when they are loaded and compile, and each
#: core more for its thread of linear algebra: 490 MB on two cores, rounded up.
LIBRARIES, THREAD = 500_000_000, 50_000_000


def hold_room() -> None:
    """Refuse to load libraries that cannot be loaded, where `ulimit -v` leaves too little.

    OpenBLAS would ask for memory for ever, and LLVM end the program.

    Raises:
        MemoryError: the process may not have as much address space.
    """
    needed = LIBRARIES + THREAD * len(os.sched_getaffinity(0))
    try:
        # Without access nothing is taken but addresses, which no other limit counts.
        mmap.mmap(-1, needed, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS, prot=0).close()
    except OSError:
        raise MemoryError(
            f"loading the numerical libraries takes {needed // 10**6} MB of address space, and "
            "ulimit -v leaves less"
        ) from None
