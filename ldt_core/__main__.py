"""The program `ldt`, also as `python -m ldt_core`: it can be interrupted from the first on."""

from __future__ import annotations

import atexit
import gc
import os
import signal

#: New objects in containers after which the youngest are searched for circles. Loading numba makes
#: half a million that stay, and Python's 700 takes a tenth of a short command's time for them.
COLLECT_AFTER = 10_000
INTERRUPTED = 128 + signal.SIGINT  # exit code, as shells have it


def main() -> None:
    """Load the command line, which takes a moment, and run a command."""
    waits = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if waits:
        # Nothing has begun that could be left half done. A KeyboardInterrupt would show where in
        # the libraries it came, and some of them would take it for a failure of their own.
        signal.signal(signal.SIGINT, lambda *_: os._exit(INTERRUPTED))
    gc.set_threshold(COLLECT_AFTER)
    atexit.register(
        gc.freeze
    )  # 0.1 s: at the end Python would search all that is given back anyway
    from ldt_core.cli import main as run

    if waits:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    run()


if __name__ == "__main__":
    main()
