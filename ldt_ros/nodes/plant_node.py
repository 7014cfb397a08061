"""The simulated machine publishes `experiment`."""

from __future__ import annotations

from typing import Any

from ldt_core.base.experiment import Experiment
from ldt_core.machine import Plant
from ldt_ros.nodes.experiment_source import GROUPS, ExperimentSource
from ldt_ros.nodes.node import LdtNode


class PlantNode(LdtNode):
    """Simulates one experiment after the other (see `ExperimentSource` for pacing)."""

    def __init__(self, **node_arguments: Any) -> None:
        super().__init__("plant", "machine", "plant", "run", *GROUPS, **node_arguments)
        self.source = ExperimentSource(self, self._next)
        self.parts = [self.source]
        self.plant = Plant.from_settings(self.machine, self.settings)
        self._number = self.source.adapted

    def _next(self) -> Experiment | None:
        if self._number >= self.settings["experiments"]:
            return None
        self._number += 1
        return self.plant.experiment(self._number)
