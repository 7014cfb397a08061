"""What the machine of a stream truly is, by the library of effects or by another simulator."""

from __future__ import annotations

import abc
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ldt_core.base.experiment import Samples
from ldt_core.effects import get_effect
from ldt_core.lab.challenge.case_plant import ideal
from ldt_core.lab.challenge.laws import LAWS, OUTSIDE
from ldt_core.lab.challenge.simulation import Drive, motion_from_rest
from ldt_core.machine.machine_file import Machine
from ldt_core.physics.base import ANGLE

#: What acts in an experiment: name of an effect or a law → its parameters. () is the bare machine.
Condition = tuple[tuple[str, tuple[tuple[str, float], ...]], ...]
#: Parameter of a law of the challenge's simulator that wears.
SIZE = "size"
SHAPE = 9  # random stream that shapes a law, apart from those of the experiments


def condition_of(acting: Mapping[str, Mapping[str, float]]) -> Condition:
    """These effects with their values, without those that change nothing."""
    return tuple(
        (name, tuple(sorted(given.items()))) for name, given in acting.items() if _acts(name, given)
    )


def _acts(name: str, given: Mapping[str, float]) -> bool:
    if SIZE in given:
        return given[SIZE] != 0
    effect = get_effect(name)
    return effect.check(given) != effect.neutral


@dataclass(frozen=True)
class TruePlant(abc.ABC):
    """A machine at rest that is driven by a voltage, in any of its conditions.

    Args:
        machine: with its true parameters.
        seed: of its stream.
    """

    machine: Machine
    seed: int

    @abc.abstractmethod
    def speed(self, acting: Condition, volts: Samples, angle: float = 0.0) -> Samples:
        """(L,) speed as the sensor shows it, without noise [rad/s].

        Args:
            acting: what acts beside the machine's own physics.
            volts: (L,) [V], each held for a sample period.
            angle: at which the machine starts, at rest [rad].
        """


@dataclass(frozen=True)
class LibraryPlant(TruePlant):
    """The project's own physics and effects."""

    def speed(self, acting: Condition, volts: Samples, angle: float = 0.0) -> Samples:
        """As `TruePlant.speed`."""
        physics, period = self.machine.model, self.machine.sample_period
        uses = [(e, e.check(dict(given))) for e, given in ((get_effect(n), g) for n, g in acting)]
        first = physics.initial_state(self.machine.parameters, 0.0)
        first[ANGLE] = angle
        # As `Plant` does it, so that the numbers are the same to the last bit.
        held = np.append(volts, volts[-1])
        states = physics.simulate(self.machine.parameters, held, period, first, uses)
        return physics.measure(states[: volts.size], period, uses)


@dataclass(frozen=True)
class ChallengePlant(TruePlant):
    """The challenge's simulator, with laws of its own that take a `SIZE`."""

    def speed(self, acting: Condition, volts: Samples, angle: float = 0.0) -> Samples:
        """As `TruePlant.speed`."""
        known = self.machine.parameters
        plant = ideal(known)
        for name, given in acting:
            law = LAWS[name] if name in LAWS else OUTSIDE[name]
            shape = law.draw(np.random.default_rng([self.seed, SHAPE]), known)
            law.put(plant, law.values(dict(given)[SIZE], shape, known), shape, 1.0)
        drive = Drive(np.asarray(volts), 0, self.machine.sample_period, angle)
        # None of the laws of the streams has chance in it.
        return motion_from_rest(plant, drive, np.random.default_rng(self.seed)).speed
