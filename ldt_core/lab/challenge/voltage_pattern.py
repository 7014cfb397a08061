"""How the challenge's machines are driven: voltages a stranger might have recorded."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Kinds of excitation; those that turn the machine both ways.
KINDS = ("steps", "reversing", "multisine", "chirp", "reversing_multisine", "reversing_chirp")
REVERSING = tuple(kind for kind in KINDS if kind.startswith("reversing"))
SINES = 6  # in a multisine
BAND = (0.05, 2.0)  # Hz, of multisines


@dataclass(frozen=True)
class VoltagePattern:
    """One kind of voltage.

    Args:
        kind: see KINDS.
        low: lowest voltage [V].
        high: highest voltage [V].
        hold: shortest and longest time that a step is held [s].
        last: frequency in which a chirp ends [Hz].
    """

    kind: str
    low: float
    high: float
    hold: tuple[float, float] = (1.0, 1.0)
    last: float = 1.0

    @property
    def reversing(self) -> bool:
        """Whether the machine turns both ways."""
        return self.low < 0 < self.high

    def voltage(self, samples: int, period: float, random: np.random.Generator) -> Array:
        """(samples,) [V], each held for one period [s]."""
        middle, half = (self.low + self.high) / 2, (self.high - self.low) / 2
        time = np.arange(samples) * period
        if self.kind.endswith("chirp"):
            first = random.uniform(0.03, 0.1)
            cycles = first * time + (self.last - first) * time**2 / (2 * samples * period)
            return middle + half * np.sin(2 * math.pi * (cycles + random.random()))
        if self.kind.endswith("multisine"):
            lowest, highest = np.log(BAND)
            rates = np.exp(random.uniform(lowest, highest, SINES))
            phases = random.uniform(0, 2 * math.pi, SINES)
            wave = np.sin(2 * math.pi * rates[:, None] * time + phases[:, None]).sum(axis=0)
            return middle + half * wave / np.abs(wave).max()
        volts = np.empty(samples)
        at = 0
        while at < samples:
            stop = at + max(1, round(random.uniform(*self.hold) / period))
            volts[at:stop] = random.uniform(self.low, self.high)
            at = stop
        return volts


def draw_excitation(kind: str, random: np.random.Generator) -> VoltagePattern:
    """An excitation of this kind, its levels and times drawn."""
    last = float(random.uniform(0.5, 2.0))
    if kind in REVERSING:
        top = float(random.choice([10.0, 12.0, 14.0]))
        return VoltagePattern(kind, -top, top, (0.5, 2.0), last)
    if kind == "steps":  # the rotor's standard, more often than not
        hold = float(random.choice([0.5, 1.0, 1.0, 1.0, 2.0]))
        return VoltagePattern(kind, 6.0, 16.0, (hold, hold))
    middle, half = random.uniform(9, 11), random.uniform(3, 5)
    return VoltagePattern(kind, float(middle - half), float(middle + half), last=last)
