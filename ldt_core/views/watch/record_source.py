"""Where the records that a page shows come from."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Protocol

from ldt_core.base.errors import LdtError
from ldt_core.base.registry import entry_points
from ldt_core.views.watch.fleet import Fleet

GROUP = "ldt.watch"
GRAPH = "graph"


class RecordSource(Protocol):
    """Feeds a fleet until it is told to stop."""

    #: What is watched, for people.
    words: str
    #: Whether silence means that something is wrong.
    live: bool

    def run(self, fleet: Fleet, stop: threading.Event, begun: Callable[[], object]) -> None:
        """Feed the fleet; return soon after `stop` is set, or when nothing more can come.

        Runs on a thread of its own.

        Args:
            fleet: is fed.
            stop: set when it is to end.
            begun: called once nothing keeps it from feeding any more.
        """


def graph(namespace: str = "") -> RecordSource:
    """The running graph.

    Args:
        namespace: the one machine to watch; "" for all there are.

    Raises:
        BadInput: ROS 2 cannot be used here, or the namespace cannot exist.
        LdtError: no part of this installation knows of graphs.
    """
    for entry in entry_points(GROUP):
        if entry.name == GRAPH:
            made: RecordSource = entry.load()(namespace)
            return made
    raise LdtError("this installation of LDT is without its ROS part: reinstall it")
