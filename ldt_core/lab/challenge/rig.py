"""A sealed case's test bench: its known machine, voltages, sensors; and the gap on it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.experiment import Experiment, rms
from ldt_core.lab.challenge.case_plant import ideal
from ldt_core.lab.challenge.law import Law
from ldt_core.lab.challenge.laws import LAWS, OUTSIDE
from ldt_core.lab.challenge.simulation import Drive, Motion, motion_from, motion_from_rest

#: Kinds of excitation; those that turn the machine both ways.
KINDS = (
    *("steps", "reversing", "multisine", "chirp", "reversing_multisine", "reversing_chirp"),
    *("ramps", "reversing_ramps", "closed_loop"),
)
REVERSING = tuple(kind for kind in KINDS if kind.startswith("reversing"))
STEPPED = ("steps", "reversing")  # kinds whose levels may be 0 at times
SINES = 6  # in a multisine
BAND = (0.05, 2.0)  # Hz, of multisines
RAMPS = (0.5, 3.0)  # s, shortest and longest
#: Of a speed controller: times in an experiment at which it acts, and its proportional and integral
#: part, as shares of what makes up for an error of the steady speed at once.
CONTROLS, PROPORTIONAL, INTEGRAL = 50, 1.0, 0.3
LEEWAY = 8.0  # V, that the integral part adds at most


@dataclass(frozen=True)
class VoltagePattern:
    """One kind of voltage.

    Args:
        kind: see KINDS.
        low: lowest voltage [V].
        high: highest voltage [V].
        hold: shortest and longest time that a step is held [s].
        last: frequency in which a chirp ends [Hz].
        pauses: share of a step pattern's levels that are exactly 0.
    """

    kind: str
    low: float
    high: float
    hold: tuple[float, float] = (1.0, 1.0)
    last: float = 1.0
    pauses: float = 0.0

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
        if self.kind.endswith("ramps"):
            knots = np.cumsum(random.uniform(*RAMPS, round(samples * period / RAMPS[0]) + 2))
            levels = random.uniform(self.low, self.high, knots.size)
            return np.interp(time, knots - knots[0], levels)
        volts = np.empty(samples)
        at = 0
        while at < samples:
            stop = at + max(1, round(random.uniform(*self.hold) / period))
            volts[at:stop] = random.uniform(self.low, self.high)
            if self.pauses and random.random() < self.pauses:
                volts[at:stop] = 0.0
            at = stop
        return volts


def draw_excitation(kind: str, random: np.random.Generator) -> VoltagePattern:
    """An excitation of this kind, its levels and times drawn."""
    last = float(random.uniform(0.5, 2.0))
    if kind == "closed_loop":  # levels that a speed controller is to hold, as voltages of the file
        return VoltagePattern(kind, 5.0, 14.0, (2.0, 5.0))
    if kind in REVERSING:
        top = float(random.choice([10.0, 12.0, 14.0]))
        return VoltagePattern(kind, -top, top, (0.5, 2.0), last)
    if kind == "steps":  # the rotor's standard, more often than not
        hold = float(random.choice([0.5, 1.0, 1.0, 1.0, 2.0]))
        return VoltagePattern(kind, 6.0, 16.0, (hold, hold))
    middle, half = random.uniform(9, 11), random.uniform(3, 5)
    return VoltagePattern(kind, float(middle - half), float(middle + half), last=last)


SHOWN, ALIKE, OTHER = 10, 4, 3  # experiments: of the case, and further of its kind and another
PROBES = (1, 5, 9)  # experiments on which sizes are found
#: At rest at angle 0, at rest at any angle, each cut from a run, all cut from one long record.
STARTS = ("rest", "angle", "running", "cut")
VOLTAGE, ANGLE, NOISE, EACH, CHANCE = range(5)  # independent random streams of an experiment
FOUNDATION = 7  # states of the machine as its file knows it


@dataclass(frozen=True)
class Acting:
    """A law that acts in a case.

    Args:
        name: of the law.
        values: parameters of the library (of the law itself if it is outside).
        shape: the law's own numbers.
        odd: scale of its departures from the library's law.
    """

    name: str
    values: Mapping[str, float]
    shape: Mapping[str, float]
    odd: float = 1.0

    @property
    def law(self) -> Law:
        """The law of this name."""
        return LAWS[self.name] if self.name in LAWS else OUTSIDE[self.name]


@dataclass(frozen=True)
class CaseSetting:
    """All of a case but what acts in it.

    Args:
        physics: kind of machine, as in the machine file.
        known: the machine file's parameters.
        excitation: of the case, and of the first of its further experiments.
        other: excitation of the last of its further experiments.
        start: see STARTS.
        warm: samples that run before the first one is recorded, with start "running".
        noise: deviation on the speed [rad/s].
        current_noise: deviation on the current [A]; None when it is not recorded.
        seed: of everything random in the experiments.
        samples: in an experiment.
        period: of the samples [s].
        pace: how many times as slow the machine is as its voltages were meant for.
        quantum: step of the speed sensor [rad/s]; 0 for none.
        file: how the machine file came about, calibrated or datasheet.
    """

    physics: str
    known: Mapping[str, float]
    excitation: VoltagePattern
    other: VoltagePattern
    start: str
    warm: int
    noise: float
    current_noise: float | None
    seed: tuple[int, ...]
    samples: int = 2000
    period: float = 0.01
    pace: float = 1.0
    quantum: float = 0.0
    file: str = "calibrated"

    def random(self, number: int, stream: int) -> np.random.Generator:
        """The stream of random numbers of an experiment."""
        return np.random.default_rng(np.random.SeedSequence([*self.seed, number, stream]))


class CaseBench:
    """Simulates a setting's experiments with laws that act.

    Args:
        setting: of the case.
    """

    def __init__(self, setting: CaseSetting) -> None:
        self.setting = setting
        self._drives: dict[int, Drive] = {}
        self._ideal: dict[int, Array] = {}
        # The laws are kept with their motions, so that no other ones can take their place.
        self._motions: dict[tuple[int, ...], tuple[Sequence[Acting], Motion]] = {}

    def drive(self, number: int) -> Drive:
        """How experiment `number` (from 1) is driven."""
        if number not in self._drives:
            s, random = self.setting, self.setting.random(number, VOLTAGE)
            used = s.other if number > SHOWN + ALIKE else s.excitation
            warm = s.warm if s.start in ("running", "cut") else 0
            total = warm + s.samples
            if s.start == "cut" and number <= SHOWN:  # one record, with all that was before
                random, total = s.random(1, VOLTAGE), warm + SHOWN * s.samples
                warm += (number - 1) * s.samples
            volts = used.voltage(total, s.period / s.pace, random)[: warm + s.samples]
            angle = 0.0
            if s.start == "angle":
                angle = float(s.random(number, ANGLE).uniform(0, 2 * np.pi))
            self._drives[number] = Drive(volts, warm, s.period, angle)
        return self._drives[number]

    def plant(self, acting: Sequence[Acting], number: int) -> Any:
        """The record of the machine in an experiment."""
        p = ideal(self.setting.known)
        for a in acting:
            a.law.put(p, a.values, a.shape, a.odd)
            if a.law.each is not None:
                a.law.each(p, a.shape, number, self.setting.random(number, EACH))
        return p

    def run(self, acting: Sequence[Acting], number: int) -> Motion:
        """The motion in an experiment.

        Raises:
            Unsteady: numbers that make no machine.
        """
        key = (number, *map(id, acting))
        if key not in self._motions:
            chance = self.setting.random(number, CHANCE)
            motion = motion_from_rest(self.plant(acting, number), self.drive(number), chance)
            self._motions[key] = tuple(acting), motion
        return self._motions[key][1]

    def ideal_speed(self, number: int, first: Array) -> Array:
        """(L,) speed of the machine as its file has it, from a first state (n,) [rad/s]."""
        if number in self._ideal:
            return self._ideal[number]
        state = np.zeros_like(first)
        state[:FOUNDATION] = first[:FOUNDATION]
        speed = motion_from(self.plant((), number), self.drive(number), state).speed
        if self.setting.start not in ("running", "cut"):  # the same first state, whatever acts
            self._ideal[number] = speed
        return speed

    def gap(self, acting: Sequence[Acting], numbers: Sequence[int]) -> Array:
        """(len(numbers), L) speed as the sensor shows it, without noise, minus the file's.

        Both from the same state at the first sample.

        Raises:
            Unsteady: numbers that make no machine.
        """
        rows = []
        for number in numbers:
            motion = self.run(acting, number)
            rows.append(motion.speed - self.ideal_speed(number, motion.states[0]))
        return np.array(rows)

    def speeds(self, acting: Sequence[Acting], numbers: Sequence[int]) -> Array:
        """(len(numbers), L) speed as the sensor shows it, without noise [rad/s].

        Raises:
            Unsteady: numbers that make no machine.
        """
        return np.array([self.run(acting, number).speed for number in numbers])

    def gap_rms(self, acting: Sequence[Acting], numbers: Sequence[int] = PROBES) -> float:
        """Root mean square of the gap [rad/s]."""
        return rms(self.gap(acting, numbers).ravel())

    def experiment(self, acting: Sequence[Acting], number: int) -> Experiment:
        """An experiment as it is recorded, with noise."""
        s, (drive, motion) = self.setting, self._controlled(acting, number)
        random = s.random(number, NOISE)
        speed = self._shown(motion.speed, self._noise(random))
        current = None
        if s.current_noise is not None:
            current = motion.current + random.normal(0.0, s.current_noise, s.samples)
        volts = drive.volts[-s.samples :]
        start = (number - 1) * s.samples * s.period
        return Experiment(number, start, s.period, volts, speed, current)

    def _controlled(self, acting: Sequence[Acting], number: int) -> tuple[Drive, Motion]:
        """How an experiment went: under a speed controller, if it has one."""
        s, drive = self.setting, self.drive(number)
        used = s.other if number > SHOWN + ALIKE else s.excitation
        if used.kind != "closed_loop":
            return drive, self.run(acting, number)
        gain = s.known["K_t"] + s.known["R"] * s.known["b"] / s.known["K_t"]  # V s/rad, steady
        volts, wanted, total = drive.volts.copy(), drive.volts / gain, 0.0
        noise = self._noise(s.random(number, NOISE))
        block = -(-volts.size // CONTROLS)
        for begin in range(block, volts.size, block):
            part = replace(drive, volts=volts[: max(begin, drive.warm + 2)])
            motion = motion_from_rest(self.plant(acting, number), part, s.random(number, CHANCE))
            last = motion.speed.size - 1
            error = wanted[begin] - motion.speed[last] - noise[min(last, noise.size - 1)]
            total = float(np.clip(total + INTEGRAL * gain * error, -LEEWAY, LEEWAY))
            volts[begin : begin + block] = np.clip(
                drive.volts[begin : begin + block] + PROPORTIONAL * gain * error + total, 0.0, 24.0
            )
        driven = replace(drive, volts=volts)
        return driven, motion_from_rest(
            self.plant(acting, number), driven, s.random(number, CHANCE)
        )

    def _shown(self, speed: Array, noise: Array) -> Array:
        """(L,) as the sensor shows it."""
        quantum, shown = self.setting.quantum, speed + noise
        return np.round(shown / quantum) * quantum if quantum else shown

    def noise(self, number: int) -> float:
        """Root mean square of the noise as it fell out on an experiment's speed [rad/s]."""
        # A sensor's steps add their own, of deviation one over the root of twelve.
        own = rms(self._noise(self.setting.random(number, NOISE)))
        return math.hypot(own, self.setting.quantum / math.sqrt(12))

    def _noise(self, random: np.random.Generator) -> Array:
        return random.normal(0.0, self.setting.noise, self.setting.samples)
