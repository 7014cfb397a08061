"""A recording's experiments are published again as `experiment`."""

from __future__ import annotations

from typing import Any

from ldt_core.recording.bag import read_bag
from ldt_ros.nodes.experiment_source import GROUPS, ExperimentSource
from ldt_ros.nodes.node import LdtNode


class PlayerNode(LdtNode):
    """Plays a recording (see `ExperimentSource` for pacing)."""

    def __init__(self, **node_arguments: Any) -> None:
        super().__init__("player", "machine", "player", *GROUPS, **node_arguments)
        played = read_bag(self.settings["play"], self.settings["play_namespace"])
        if odd := played.other_machine(self.machine):
            self.get_logger().warning(odd)
        experiments = played.experiments()
        self.source = ExperimentSource(self, lambda: next(experiments, None))
        self.parts = [self.source]
