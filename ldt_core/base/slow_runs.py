"""Who is told that a simulator is slow: whoever waits for its runs cannot know how many come.

Apart from `Simulator`, which takes longer to import than most commands run.
"""

from __future__ import annotations

from collections.abc import Callable

#: Called once in a process, with a sentence. None tells nobody.
listener: Callable[[str], None] | None = None
#: s that a simulator's runs take together until somebody is told: a command of so many is no wait.
PATIENCE = 15.0
#: Runs of a diagnosis of six records: of a healthy machine, and of one whose cause has no name.
LEAST_RUNS, MOST_RUNS = 6_000, 60_000
_spent, _count = 0.0, 0


def tell(name: str, seconds: float) -> None:
    """A run of this simulator took so long [s]."""
    global _spent, _count
    before, _spent, _count = _spent, _spent + seconds, _count + 1
    if listener is not None and before < PATIENCE <= _spent:
        each = _spent / _count
        low, high = (max(1, round(each * runs / 60)) for runs in (LEAST_RUNS, MOST_RUNS))
        listener(
            f"a run of the simulator {name} takes {each:.2g} s, and a diagnosis of six records "
            f"{low} to {high} minutes; `ldt docs simulator` says what makes it faster"
        )
