"""A recording's experiments are published again as `experiment`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ldt_core.base.experiment import Experiment
from ldt_core.recording.bag import read_bag
from ldt_ros.nodes.source import SourceNode


class PlayerNode(SourceNode):
    """Plays a recording (see `SourceNode` for pacing)."""

    def __init__(self, **node_arguments: Any) -> None:
        super().__init__("player", "machine", "player", **node_arguments)
        played = read_bag(self.settings["play"], self.settings["play_namespace"])
        if odd := played.other_machine(self.machine):
            self.get_logger().warning(odd)
        self._experiments: Iterator[Experiment] = played.experiments()

    def fetch(self) -> Experiment | None:
        """The next experiment of the recording."""
        return next(self._experiments, None)
