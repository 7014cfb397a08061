"""A stream whose truth is known, and the references that know it.

*Known* predicts each experiment with its true parameters, *late* with those of the experiment
before. Both are references and no bounds. Of the start they know what a twin may know: the machine
is at rest, at the angle where it always starts, or at any.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from ldt_core.base.experiment import Experiment, Samples
from ldt_core.estimation.grey_box import ANGLES
from ldt_core.lab.study.robustness.true_plant import Condition, LibraryPlant, TruePlant
from ldt_core.machine.machine_file import Machine


@dataclass(frozen=True)
class References:
    """Largest error of each experiment, by who knows the truth [rad/s].

    Attributes:
        known: with the experiment's own parameters.
        late: with those of the experiment before; by the machine file in the first.
    """

    known: tuple[float, ...]
    late: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class KnownStream:
    """What a twin gets, and the truth that it does not.

    Attributes:
        machine: as the twin's file knows it.
        experiments: in order, from number 1.
        plant: the true machine.
        conditions: what acts on it, one entry an experiment.
        noise: standard deviation of the white noise on the speed [rad/s].
        random_start: whether each experiment starts at an angle of its own.
    """

    machine: Machine
    experiments: tuple[Experiment, ...]
    plant: TruePlant
    conditions: tuple[Condition, ...]
    noise: float
    random_start: bool = False

    @property
    def changes(self) -> list[int]:
        """Numbers of the experiments in which the machine is another than before.

        The first counts where the machine is not what the file says.
        """
        as_file = self.machine.parameters == self.plant.machine.parameters
        pairs = zip((() if as_file else None, *self.conditions), self.conditions, strict=False)
        return [i for i, (old, new) in enumerate(pairs, start=1) if old != new]

    @functools.cached_property
    def references(self) -> References:
        """The errors of who knows the truth; computed when they are first asked for."""
        known, late = [], []
        for i, experiment in enumerate(self.experiments):
            own = self._error(self.plant, self.conditions[i], experiment)
            known.append(own)
            if i == 0:
                late.append(self._error(LibraryPlant(self.machine, 0), (), experiment))
            elif self.conditions[i] == self.conditions[i - 1]:
                late.append(own)
            else:
                late.append(self._error(self.plant, self.conditions[i - 1], experiment))
        return References(tuple(known), tuple(late))

    def _error(self, plant: TruePlant, acting: Condition, experiment: Experiment) -> float:
        return float(np.abs(experiment.speed - self._predicted(plant, acting, experiment)).max())

    def _predicted(self, plant: TruePlant, acting: Condition, experiment: Experiment) -> Samples:
        if not self.random_start:
            return plant.speed(acting, experiment.voltage)
        turns = np.arange(ANGLES) * 2 * np.pi / ANGLES
        runs = [plant.speed(acting, experiment.voltage, float(angle)) for angle in turns]
        return np.asarray(np.median(runs, axis=0), dtype=np.float64)
