"""Where the records that a page shows come from."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment, Prediction
from ldt_core.base.registry import entry_points
from ldt_core.recording.bag import Bag, namespaces, read_bag
from ldt_core.recording.codec import DECODERS, decode_cdr
from ldt_core.recording.messages import deserialize
from ldt_core.recording.metadata import listed_topics
from ldt_core.recording.node_status import HEALTH_TOPIC
from ldt_core.recording.pace import parse_rate
from ldt_core.recording.storage import RawMessage, Storage
from ldt_core.views.watch.fleet import Fleet
from ldt_core.views.watch.playback_clock import PlaybackClock

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

    Each experiment is there with its prediction when the machine would begin it; the page shows
    its samples as time goes on. What else was recorded of it comes when it has ended.

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
        self.clock = PlaybackClock(self.rate, self._total())
        #: Whether it can be played again once it has come to its end, until it is told to stop.
        self.stays = False
        self._ends: dict[str, float] = {}

    def run(self, fleet: Fleet, stop: threading.Event, begun: Callable[[], object]) -> None:
        """Feed the fleet to the end of the recording, and again where somebody goes back."""
        fleet.playback = self.clock.state
        begun()
        self._expect(fleet)
        while self._played(fleet, stop):
            self.clock.rewind()
            fleet.reset()
            self._expect(fleet)

    def _expect(self, fleet: Fleet) -> None:
        fleet.say(f"recording {self.words}")
        for bag in self.bags:
            fleet.expect(bag.namespace, bag.machine)

    def _played(self, fleet: Fleet, stop: threading.Event) -> bool:
        """Play it; whether to play it again."""
        self._ends.clear()
        topics = {topic: bag.namespace for bag in self.bags for topic in bag.topics}
        for raw in self.storage.messages(list(topics)):
            if not self._take(raw, topics[raw.topic], fleet, stop):
                return True
            if stop.is_set():
                return False
        # Where the recording lies is no business of those who look at the page.
        path = str(self.storage.path)
        notes = "; ".join(
            n.removeprefix(f"{path}: ").replace(f"{path}/", "") for n in self.storage.notes
        )
        fleet.say(f"recording {self.words}, has ended{f' ({notes})' if notes else ''}")
        return self.stays and self.clock.wait_for_seek(stop)

    def _take(self, raw: RawMessage, namespace: str, fleet: Fleet, stop: threading.Event) -> bool:
        """Feed a message when its time has come; False where somebody goes back."""
        name = HEALTH_TOPIC if raw.topic == HEALTH_TOPIC else raw.topic.rpartition("/")[2]
        try:
            if name in DECODERS:
                record = decode_cdr(name, raw.kind, raw.data, raw.topic)
            else:
                record = deserialize(raw.data, raw.kind, raw.topic)
        except LdtError as error:
            fleet.misread(namespace, str(error))
            return True
        begins = isinstance(record, Experiment)
        if isinstance(record, Experiment):
            self._ends[namespace] = record.end
        moment = record.start if isinstance(record, Experiment) else self._ends.get(namespace)
        # Predictions are shown as the experiment goes on, all else once it has ended.
        if moment is not None and name != HEALTH_TOPIC and not isinstance(record, Prediction):
            ahead = self.clock.position + begins
            if not self.clock.reach(moment, ahead, stop):
                return False
            if stop.is_set():
                return True
        if isinstance(record, Experiment):
            self.clock.begin(record.start)
        if name in DECODERS or name == HEALTH_TOPIC:
            fleet.feed(namespace, name, record)
        return True

    def _total(self) -> int | None:
        """Experiments of the machines, where `metadata.yaml` counts them."""
        entries = listed_topics(self.storage.metadata)
        topics = [topic for bag in self.bags if (topic := bag.topic("experiment"))]
        counts = [entries[t].get("message_count") for t in topics if t in entries]
        numbers = [c for c in counts if isinstance(c, int)]
        return sum(numbers) if numbers and len(numbers) == len(topics) else None
