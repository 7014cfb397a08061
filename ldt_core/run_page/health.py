"""Whether the recording can be trusted: gaps, pauses, what was not used, what nodes rejected."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ldt_core.run_page.run import Run, Turn

HEALTH = "/diagnostics"
LISTED = 5  # things of a kind that are named one by one
#: Share of an experiment's duration by which the next may begin late, or early, unmentioned.
PAUSE, OVERLAP = 1.0, 0.01


@dataclass(frozen=True)
class Node:
    """What a node of the graph said of itself last.

    Attributes:
        name: role, below the machine's namespace.
        message: its state in words.
        rejected: (topic and kind of error, how many).
        last: sentence of the last rejection, "" when there was none.
    """

    name: str
    message: str
    rejected: tuple[tuple[str, str], ...]
    last: str


def ranges(numbers: Sequence[int]) -> str:
    """Whole numbers in words.

    >>> ranges([7, 8, 9, 12]), ranges([4, 5]), ranges([])
    ('7 to 9, 12', '4, 5', 'none')
    """
    runs: list[list[int]] = []
    for number in sorted(set(numbers)):
        if runs and number == runs[-1][1] + 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    words = []
    for first, last in runs:
        between = ", " if last == first + 1 else " to "
        words.append(str(first) if first == last else f"{first}{between}{last}")
    return ", ".join(words) or "none"


def complaints(run: Run) -> list[str]:
    """A sentence for each thing that is odd about the recording; none is good."""
    # Where the recording lay is no business of those to whom the page is sent.
    path = str(run.bag.path)
    found = [n.removeprefix(f"{path}: ").replace(f"{path}/", "") for n in run.bag.notes]
    if run.unused:
        found.append(f"recorded, but not predicted and judged: {_named(run.unused)}")
    undone = [t.experiment for t in run.turns if t.adaptation is None]
    if undone:
        found.append(f"judged, but the adaptor's answer is not recorded: {_named(undone)}")
    return found + _times(run.turns)


def nodes(run: Run) -> list[Node]:
    """The nodes of a graph's run by name; none for a run without ROS.

    Raises:
        RecordingError: a message that cannot be read.
    """
    if HEALTH not in run.bag.topics:
        return []
    prefix = run.namespace.strip("/")
    last: dict[str, Any] = {}
    for message in run.bag.records(HEALTH):
        for status in getattr(message, "status", ()):
            namespace, _, role = status.name.strip("/").rpartition("/")
            if namespace == prefix:
                last[role] = status
    return [_node(role, last[role]) for role in sorted(last)]


def _node(role: str, status: Any) -> Node:
    values = {v.key: v.value for v in status.values}
    rejected = tuple(
        (key.removeprefix("rejected "), value)
        for key, value in values.items()
        if key.startswith("rejected ")
    )
    return Node(role, status.message, rejected, values.get("last rejection", ""))


def _times(turns: Sequence[Turn]) -> list[str]:
    late, early = [], []
    for before, after in itertools.pairwise(turns):
        wait, length = after.start - before.end, before.end - before.start
        if wait > PAUSE * length:
            late.append((wait, after.experiment))
        elif wait < -OVERLAP * length:
            early.append(after.experiment)
    found = []
    if late:
        longest = ", ".join(f"{s:.1f} s before experiment {n}" for s, n in sorted(late)[-LISTED:])
        found.append(f"pauses longer than an experiment: {len(late)}, the longest {longest}")
    if early:
        found.append(f"begun before the one before had ended: {_named(early)}")
    return found


def _named(numbers: Sequence[int]) -> str:
    kind = "experiment" if len(numbers) == 1 else "experiments"
    return f"{kind} {ranges(numbers)}"
