"""All recorded topics go into a rosbag2 recording, as they arrive."""

from __future__ import annotations

import contextlib
import shutil
import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.timer import Timer

import msgs_config
from ldt_core.base.errors import BadInput, LdtError
from ldt_core.doctor.computer_checks import LOW_DISK, MIB
from ldt_core.recording.node_status import (
    HEALTH_TOPIC,
    INTERRUPTIONS,
    LAST_INTERRUPTION,
    LITTLE_ROOM,
    WRONG_RECORDING,
)
from ldt_core.recording.run_settings import parse_settings
from ldt_core.recording.writer import BagWriter
from ldt_core.restart.run_key import key_text
from ldt_core.runs.fleet_members import new_recording
from ldt_ros.nodes.interfaces import LISTENER_DEPTH
from ldt_ros.nodes.node import LdtNode
from ldt_ros.nodes.statements import concerns

#: Time without a message after which nothing more is under way, at the end of a run [s].
QUIET_TIME = 0.2
#: Longest time that the end of a run waits for that [s].
PATIENCE = 3.0
#: Time after which a recording that failed is tried once more, then twice as long [s].
RETRY_TIME = 5.0
#: Longest time between two tries [s]: each reads the file that was cut short.
LONGEST_RETRY_TIME = 60.0
#: Time in which a slow medium must take one message, or the end does not wait for it [s].
STUCK_TIME = 20.0
#: Messages that may wait: 400 experiments of the loop.
MOST_MESSAGES = 2000
#: Size of those that may wait together [bytes]; one alone may be larger.
MOST_BYTES = 256 * 2**20


class Backlog:
    """Hands items to a thread in their order; what comes while too much waits is left out, counted.

    Args:
        work: is called with what was put, on the thread; must not raise.
        messages: most that may wait.
        most_bytes: of those together.
    """

    def __init__(
        self, work: Callable[..., None], messages: int = MOST_MESSAGES, most_bytes: int = MOST_BYTES
    ) -> None:
        self._work, self._messages, self._most = work, messages, most_bytes
        #: Kind → how many were left out.
        self.dropped: Counter[str] = Counter()
        self._waiting: deque[tuple[int, tuple[Any, ...]]] = deque()
        self._size = 0
        self._closed = self._busy = False
        self._news = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="backlog", daemon=True)
        self._thread.start()

    def __len__(self) -> int:
        """Items that wait, the one being worked on included."""
        with self._news:
            return len(self._waiting) + self._busy

    def put(self, kind: str, size: int, *item: Any) -> None:
        """Let an item wait its turn, or leave it out and count it."""
        with self._news:
            full = len(self._waiting) >= self._messages or self._size + size > self._most
            if self._closed or (self._waiting and full):
                self.dropped[kind] += 1
                return
            self._waiting.append((size, item))
            self._size += size
            self._news.notify()

    def close(self, patience: float) -> None:
        """Take nothing more, work on what waits, and give up on it when that takes too long.

        Args:
            patience: longest time without one item done [s].
        """
        with self._news:
            self._closed = True
            self._news.notify()
        left, since = len(self), time.monotonic()
        while self._thread.is_alive() and time.monotonic() - since < patience:
            self._thread.join(0.05)
            if len(self) != left:
                left, since = len(self), time.monotonic()

    def _run(self) -> None:
        while True:
            with self._news:
                self._busy = False
                while not (self._waiting or self._closed):
                    self._news.wait()
                if not self._waiting:
                    return
                size, item = self._waiting.popleft()
                self._size -= size
                self._busy = True
            self._work(*item)


class RecorderNode(LdtNode):
    """Writes messages as they come, without decoding them.

    | received | what happens |
    |---|---|
    | any recorded topic | written with the time it arrived, by a thread; kept at most 0.25 s |
    | more than 2000, or 256 MB, while the medium is slow | the newest is left out and counted |
    | the same once more, of a node that was started again | left out, counted |
    | less than 1 GiB is free | told, before the disk is full |
    | a write fails (disk full) | told, logged once; what was written stays; the twin goes on |
    | there is room again | a new file of the recording; the last 100 of each topic are asked for |
    """

    def __init__(self, **node_arguments: Any) -> None:
        super().__init__("recorder", "machine", "recorder", "record", **node_arguments)
        machine = self.machine.name
        resume = self.settings["resume"]
        bag = resume or self.settings["bag"] or new_recording(machine)
        self._recorded = {
            topic: (self.resolve_topic_name(topic), declaration["type"])
            for topic, declaration in msgs_config.topics().items()
            if declaration["recorded"]
        }
        self._refuse_other_names()
        told = self.settings["run_settings"]
        settings = parse_settings("run_settings", told) if told else None
        self._open = partial(
            BagWriter,
            bag,
            machine=machine,
            topics=tuple(name for name, _ in self._recorded.values()),
            settings=settings,
            split_size=self.settings["split_size"],
            once=True,
            key=key_text(self.machine, settings or {}),
        )
        self.writer = self._open(resume=bool(resume))
        self._repeated = 0
        self._interruptions = 0
        self._interruption: LdtError | None = None  # the last one
        self.backlog = Backlog(self._write)
        self._last = 0.0
        self._again_after = RETRY_TIME
        self._trial: Timer | None = None
        self._listen()

    def _refuse_other_names(self) -> None:
        """By its topics' names, and one namespace, a recording is read as that of a machine."""
        namespace = self.get_namespace().rstrip("/")
        for topic, (name, _) in self._recorded.items():
            own = topic if topic.startswith("/") else f"{namespace}/{topic}"
            if name != own:
                expected = f"{own}, by which recordings are read; remap the machine's topic to it"
                raise BadInput(topic, expected, f"a remapping to {name}")

    def _listen(self) -> None:
        for topic, (name, kind) in self._recorded.items():
            take = partial(self._take, topic, name, kind)
            self.topics.listens(topic, take, raw=True, depth=LISTENER_DEPTH)

    def health(self) -> dict[str, Any]:
        """Messages written."""
        written = sum(self.writer.counts.values())
        values: dict[str, Any] = {"written": written, "repeated": self._repeated}
        values["waiting"] = len(self.backlog)
        lost = self.backlog.dropped
        values["dropped"] = lost.total()
        values |= {f"dropped {topic}": count for topic, count in lost.items()}
        if self.writer.failure is not None:
            self._interrupted(self.writer.failure)
            values[WRONG_RECORDING] = self._stopped()
        elif words := self._little_room():
            values[LITTLE_ROOM] = words
        if self._interruption is not None:
            values[INTERRUPTIONS] = self._interruptions
            values[LAST_INTERRUPTION] = self._interruption
        return {**values, "bag": str(self.writer.path)}

    def complaint(self) -> str:
        """Why nothing is recorded now, and what is lacking since the medium was too slow."""
        lost = self.backlog.dropped.total()
        slow = f"{lost} messages not recorded: the medium is too slow" if lost else ""
        return "; ".join(filter(None, [self._stopped() or self._little_room(), slow]))

    def _stopped(self) -> str:
        failure = self.writer.failure
        return f"{failure}; it goes on by itself once it can" if failure else ""

    def _little_room(self) -> str:
        """That the disk will soon be full, "" while it has room."""
        try:
            free = shutil.disk_usage(self.writer.path).free
        except OSError:  # the folder has gone, which whoever writes notices
            return ""
        if free >= LOW_DISK:
            return ""
        return f"only {free // MIB} MiB are free where {self.writer.path} is: make room"

    @property
    def patience(self) -> float:
        """Longest time that a process waits for `quiet` when it is told to stop [s]."""
        return PATIENCE

    @property
    def quiet(self) -> bool:
        """Whether nothing has arrived for a while, health apart."""
        return time.monotonic() - self._last > QUIET_TIME

    def halt(self) -> None:
        """Begin to wait for quiet: what has come already may not have been taken yet."""
        self._last = time.monotonic()

    def close(self) -> None:
        """Write what waits, and finish the recording."""
        self.backlog.close(STUCK_TIME)
        try:
            self.writer.close()
        except LdtError as error:
            self._interrupted(error)

    def _take(self, topic: str, name: str, kind: str, data: bytes) -> None:
        if name != HEALTH_TOPIC:
            self._last = time.monotonic()
        elif not concerns(data, self.get_namespace()):
            return  # another machine's twin, which has a recording of its own
        self.backlog.put(topic, len(data), topic, name, kind, data, time.time_ns())
        if self.writer.failure is not None:
            self._interrupted(self.writer.failure)
            self._go_on_later()

    def _interrupted(self, failure: LdtError) -> None:
        """Count it, and log it once."""
        if failure is not self._interruption:
            self._interruption = failure
            self._interruptions += 1
            self.get_logger().error(str(failure))

    def _write(self, topic: str, name: str, kind: str, data: bytes, at: int) -> None:
        writer = self.writer
        try:
            if not writer.write_raw(name, kind, data, at):
                self._repeated += 1
        except Exception as error:  # would be lost in the thread
            if error is not writer.failure:
                self.topics.reject(topic, error)

    def _go_on_later(self) -> None:
        # Not from the callback of a message: it would do away with its own subscription.
        if self._trial is None:
            self._trial = self.create_timer(self._again_after, self._go_on, clock=self.steady)

    def _go_on(self) -> None:
        """Take the recording up in a new file, if there is room for one by now."""
        assert self._trial is not None
        self.destroy_timer(self._trial)
        self._trial = None
        with contextlib.suppress(LdtError):  # which was said when it happened
            self.writer.close()
        try:
            self.writer = self._open(resume=True)
        except LdtError:
            self._again_after = min(2 * self._again_after, LONGEST_RETRY_TIME)
            self._go_on_later()
            return
        self._again_after = RETRY_TIME
        self.get_logger().warning(
            f"{self.writer.path}: recording goes on in a new file; what was missed is asked for "
            "again, as far as the others keep it"
        )
        self._listen()
