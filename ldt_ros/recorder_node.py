"""All recorded topics go into a rosbag2 recording, as they arrive."""

from __future__ import annotations

import time
from functools import partial
from typing import Any

import msgs_config
from ldt_core.recording.bag import BagWriter
from ldt_ros.node import TwinNode

FLUSH_PERIOD = 0.5  # s, what a crash can cost at most
QUIET = 0.2  # s without a message after which nothing more is under way, at the end of a run
PATIENCE = 3.0  # s that the end of a run waits for quiet at most


class RecorderNode(TwinNode):
    """Writes messages as they come, without decoding them.

    | received | what happens |
    |---|---|
    | any recorded topic | written with the time it arrived; flushed every 0.5 s |
    | a write fails (disk full) | counted, logged once; what was written stays readable; the twin goes on |
    """

    def __init__(self, **node_arguments: Any) -> None:
        super().__init__("recorder", "machine", "recorder", **node_arguments)
        self._writer = BagWriter(self.settings["bag"])
        self._last = 0.0
        self._written = 0
        for topic, declaration in msgs_config.topics().items():
            if declaration["recorded"]:
                name = self.resolve_topic_name(topic)
                self._writer.declare(name, topic)
                self.listens(topic, partial(self._write, name), raw=True)
        self.create_timer(FLUSH_PERIOD, self._writer.flush)

    def health(self) -> dict[str, Any]:
        """Messages written."""
        return {"written": self._written, "bag": self.settings["bag"]}

    #: How long a process waits for `quiet` when it is told to stop [s].
    patience = PATIENCE

    @property
    def quiet(self) -> bool:
        """Whether nothing has arrived for a while, health apart."""
        return time.monotonic() - self._last > QUIET

    def close(self) -> None:
        """Finish the recording."""
        self._writer.close()

    def _write(self, name: str, data: bytes) -> None:
        if name != "/diagnostics":
            self._last = time.monotonic()
        self._writer.write_raw(name, data, time.time_ns())
        self._written += 1
