"""All recorded topics go into a rosbag2 recording, as they arrive."""

from __future__ import annotations

import time
from functools import partial
from typing import Any

import msgs_config
from ldt_core.errors import LdtError
from ldt_core.recording.node_status import HEALTH_TOPIC
from ldt_core.recording.run_settings import parse_settings
from ldt_core.recording.writer import BagWriter
from ldt_core.resume import key_text
from ldt_core.session import new_recording
from ldt_ros.interfaces import LISTENER_DEPTH
from ldt_ros.node import TwinNode

QUIET = 0.2  # s without a message after which nothing more is under way, at the end of a run
PATIENCE = 3.0  # s that the end of a run waits for quiet at most


class RecorderNode(TwinNode):
    """Writes messages as they come, without decoding them.

    | received | what happens |
    |---|---|
    | any recorded topic | written with the time it arrived; kept at most 0.25 s |
    | the same once more, of a node that was started again | left out, counted |
    | a write fails (disk full) | counted, logged once; what was written stays; the twin goes on |
    """

    def __init__(self, **node_arguments: Any) -> None:
        super().__init__("recorder", "machine", "recorder", "record", **node_arguments)
        machine = self.machine.name
        resume = self.settings["resume"]
        bag = resume or self.settings["bag"] or new_recording(machine)
        recorded = {
            topic: (self.resolve_topic_name(topic), declaration["type"])
            for topic, declaration in msgs_config.topics().items()
            if declaration["recorded"]
        }
        names = tuple(name for name, _ in recorded.values())
        told = self.settings["run_settings"]
        settings = parse_settings("run_settings", told) if told else None
        self._writer = BagWriter(
            bag,
            machine=machine,
            topics=names,
            settings=settings,
            split_size=self.settings["split_size"],
            resume=bool(resume),
            once=True,
            key=key_text(self.machine),
        )
        self._repeated = 0
        self._last = 0.0
        for topic, (name, kind) in recorded.items():
            self.listens(topic, partial(self._write, name, kind), raw=True, depth=LISTENER_DEPTH)

    def health(self) -> dict[str, Any]:
        """Messages written."""
        written = sum(self._writer.counts.values())
        values = {"written": written, "repeated": self._repeated}
        return {**values, "bag": str(self._writer.path)}

    #: How long a process waits for `quiet` when it is told to stop [s].
    patience = PATIENCE

    @property
    def quiet(self) -> bool:
        """Whether nothing has arrived for a while, health apart."""
        return time.monotonic() - self._last > QUIET

    def halt(self) -> None:
        """Begin to wait for quiet: what has come already may not have been taken yet."""
        self._last = time.monotonic()

    def close(self) -> None:
        """Finish the recording."""
        try:
            self._writer.close()
        except LdtError as error:
            if not self.rejected:  # else it was said when it happened
                self.get_logger().error(str(error))

    def _write(self, name: str, kind: str, data: bytes) -> None:
        if name != HEALTH_TOPIC:
            self._last = time.monotonic()
        if not self._writer.write_raw(name, kind, data, time.time_ns()):
            self._repeated += 1
