"""Where the records that a page shows come from."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment
from ldt_core.base.registry import entry_points
from ldt_core.recording.bag import Bag, namespaces, read_bag
from ldt_core.recording.codec import DECODERS, decode
from ldt_core.recording.messages import deserialize
from ldt_core.recording.node_status import HEALTH_TOPIC
from ldt_core.recording.pace import parse_rate
from ldt_core.recording.storage import RawMessage, Storage
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
            stop: set when it is to end.
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


class Playback:
    """Plays all machines of a recording, or one of them.

    The first experiment is shown at once, each later one when a machine would have finished it;
    what was recorded of an experiment follows it without delay.

    Raises:
        RecordingError: no recording, or no such machine in it.
        OptionError: a rate that is none.
    """

    live = False

    def __init__(self, path: str | Path, namespace: str = "", rate: str = "1") -> None:
        self.rate = parse_rate(rate)
        self.storage = Storage(path)
        names = [namespace] if namespace else namespaces(self.storage.topics)
        self.bags: list[Bag] = [read_bag(path, name or "/") for name in names or [""]]
        pace = "as fast as it goes" if self.rate is None else f"at {self.rate:g} times real time"
        self.words = f"{self.storage.path.resolve().name}, played {pace}"
        self._begin: tuple[float, float] | None = None

    def run(self, fleet: Fleet, stop: threading.Event, begun: Callable[[], object]) -> None:
        """Feed the fleet to the end of the recording."""
        begun()
        fleet.say(f"recording {self.words}")
        topics = {topic: bag.namespace for bag in self.bags for topic in bag.topics}
        for bag in self.bags:
            fleet.expect(bag.namespace, bag.machine)
        for raw in self.storage.messages(list(topics)):
            if stop.is_set():
                return
            self._take(raw, topics[raw.topic], fleet, stop)
        # Where the recording lies is no business of those who look at the page.
        path = str(self.storage.path)
        notes = "; ".join(
            n.removeprefix(f"{path}: ").replace(f"{path}/", "") for n in self.storage.notes
        )
        fleet.say(f"recording {self.words}, has ended{f' ({notes})' if notes else ''}")

    def _take(self, raw: RawMessage, namespace: str, fleet: Fleet, stop: threading.Event) -> None:
        name = HEALTH_TOPIC if raw.topic == HEALTH_TOPIC else raw.topic.rpartition("/")[2]
        try:
            message = deserialize(raw.data, raw.kind, raw.topic)
            record = decode(name, message, raw.topic) if name in DECODERS else message
        except LdtError as error:
            fleet.misread(namespace, str(error))
            return
        if isinstance(record, Experiment):
            self._wait(record, stop)
        if name in DECODERS or name == HEALTH_TOPIC:
            fleet.feed(namespace, name, record)

    def _wait(self, experiment: Experiment, stop: threading.Event) -> None:
        if self.rate is None:
            return
        now = time.monotonic()
        if self._begin is None:
            self._begin = (now, experiment.end)
        began, first = self._begin
        stop.wait(max(0.0, began + (experiment.end - first) / self.rate - now))
