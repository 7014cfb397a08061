"""The simulated machine publishes `experiment`."""

from __future__ import annotations

from typing import Any

from ldt_core.base.experiment import Experiment
from ldt_core.machine import Plant
from ldt_ros.nodes.source import SourceNode


class PlantNode(SourceNode):
    """Simulates one experiment after the other (see `SourceNode` for pacing)."""

    def __init__(self, **node_arguments: Any) -> None:
        super().__init__("plant", "machine", "plant", "run", **node_arguments)
        self.plant = Plant.from_settings(self.machine, self.settings)
        self._number = self._adapted

    def fetch(self) -> Experiment | None:
        """The next experiment of the run."""
        if self._number >= self.settings["experiments"]:
            return None
        self._number += 1
        return self.plant.experiment(self._number)
