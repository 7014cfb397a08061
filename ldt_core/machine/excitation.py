"""The voltage of each experiment, from the machine file's `simulation.voltage`.

    {kind: steps, low: 6, high: 16, hold: 1}         random level in low..high, held for hold s
    {kind: ramp, low: 0, high: 24}                   from low to high and back, linear in time
    {kind: chirp, low: 6, high: 16, from: 0.05, to: 1}  sine between low and high, frequency rising
                                                     linearly from..to Hz, random phase
    {kind: constant, low: 6, high: 16}               one random level for the whole experiment

Levels in V. Without any, `steps` between one and three quarters of the machine's positive range.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.errors import MachineFileError, did_you_mean
from ldt_core.machine.file_values import check_keys, mapping_of, real_number
from ldt_core.machine.machine_file import Machine

KINDS = ("steps", "ramp", "chirp", "constant")
KEYS = {"steps": ("hold",), "ramp": (), "chirp": ("from", "to"), "constant": ()}
HOLDS = 20  # steps in an experiment, unless the file says how long each is held
CHIRP = (0.05, 1.0)  # Hz, from slow against the machine's mechanical time constant to fast


@dataclass(frozen=True)
class Excitation:
    """How the simulated machine is driven.

    Args:
        kind: steps, ramp, chirp or constant.
        low, high: voltages [V].
        hold: time that a level of `steps` is held [s].
        sweep: first and last frequency of `chirp` [Hz].
    """

    kind: str
    low: float
    high: float
    hold: float
    sweep: tuple[float, float] = CHIRP

    def voltage(self, samples: int, period: float, seed: np.random.SeedSequence) -> NDArray[Any]:
        """(samples,) [V], each held for one period [s]; the same for the same seed."""
        random = np.random.default_rng(seed)
        time = np.arange(samples) * period
        if self.kind == "steps":
            # The small shift keeps a switch on its sample when hold / period is rounded down.
            index = np.floor(time / self.hold + 1e-9).astype(np.int64)
            return random.uniform(self.low, self.high, int(index[-1]) + 1)[index]
        if self.kind == "ramp":
            there = 1.0 - np.abs(1.0 - 2.0 * np.arange(samples) / samples)
            return self.low + (self.high - self.low) * there
        if self.kind == "chirp":
            first, last = self.sweep
            cycles = first * time + (last - first) * time**2 / (2 * samples * period)
            wave = np.sin(2 * math.pi * (cycles + random.random()))
            return (self.low + self.high) / 2 + (self.high - self.low) / 2 * wave
        return np.full(samples, random.uniform(self.low, self.high))


@dataclass(frozen=True, eq=False)
class Given:
    """A voltage (samples,) [V] that is the same in every experiment."""

    volts: NDArray[Any]

    def voltage(self, samples: int, period: float, seed: np.random.SeedSequence) -> NDArray[Any]:
        """(samples,) [V]; neither period nor seed matters."""
        return self.volts[:samples]


def excitation(machine: Machine, kind: str = "") -> Excitation:
    """The excitation that a machine file asks for in `simulation.voltage`.

    `kind` is another than the file's, with the file's levels.

    Raises:
        MachineFileError: an unknown key or kind, or a level outside the machine's limits.
    """
    where = f"{machine.source}, simulation.voltage"
    given = mapping_of(where, machine.simulation.get("voltage", {}))
    own = given.get("kind", "steps")
    if own not in KINDS:
        raise MachineFileError(f"{where}.kind", did_you_mean(str(own), KINDS), repr(own))
    kind = kind or own
    if kind not in KINDS:
        raise MachineFileError("voltage", did_you_mean(kind, KINDS), repr(kind))
    check_keys(where, given, (), ("kind", "low", "high", *KEYS[own]))
    least, most = machine.voltage_limits
    base = max(least, 0.0) if most > 0 else least
    low = real_number(f"{where}.low", given.get("low", base + (most - base) / 4))
    high = real_number(f"{where}.high", given.get("high", base + 3 * (most - base) / 4))
    for name, level in (("low", low), ("high", high)):
        if not least <= level <= most:
            limits = f"{least:g} to {most:g} V (the machine's limits)"
            raise MachineFileError(f"{where}.{name}", limits, f"{level:g} V")
    if low > high:
        raise MachineFileError(f"{where}.low", f"at most high ({high:g} V)", f"{low:g} V")
    hold = real_number(f"{where}.hold", given.get("hold", machine.duration / HOLDS))
    if kind == "steps" and own == "steps" and "hold" in given and hold < machine.sample_period:
        expected = f"at least the sample period ({machine.sample_period:g} s)"
        raise MachineFileError(f"{where}.hold", expected, f"{hold:g} s")
    hold = max(hold, machine.sample_period)
    first = real_number(f"{where}.from", given.get("from", CHIRP[0]))
    last = real_number(f"{where}.to", given.get("to", CHIRP[1]))
    nyquist = 0.5 / machine.sample_period
    if kind == "chirp" and not (0 <= first <= nyquist and 0 <= last <= nyquist):
        expected = f"0 to {nyquist:g} Hz (half the sample rate)"
        raise MachineFileError(f"{where}, from and to", expected, f"{first:g}, {last:g}")
    return Excitation(kind, low, high, hold, (first, last))
