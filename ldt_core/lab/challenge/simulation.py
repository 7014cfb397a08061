"""One experiment of a machine of the challenge: what moves, and what its sensors show."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError
from ldt_core.lab.challenge.case_plant import STATES, TOLERANCES
from ldt_core.lab.challenge.dormand_prince import TOLERANCE, integrate

SUPPLY_KNEE = 8.0  # V, over which a supply's gain or offset departs from the library's
WALK_PERIOD = 0.01  # s, in which a wandering supply takes a step
WALK_MEMORY = 4.0  # s, after which it has forgotten where it was
MISSED_BURST = 0.3  # s, mean length of a time in which pulses are missed


class Unsteady(LdtError):
    """The numbers make no machine: its state grows without bound or changes too fast."""


@dataclass(frozen=True, eq=False)
class Drive:
    """How a machine is driven in an experiment.

    Args:
        volts: (W + L,) [V], each held for a period; the first W run before the first sample.
        warm: W.
        period: sample period [s].
        angle: at which a machine at rest starts [rad].
    """

    volts: Array
    warm: int
    period: float
    angle: float = 0.0


@dataclass(frozen=True, eq=False)
class Motion:
    """What a machine did: states (L, n) at the samples and the speed its sensor shows."""

    states: Array
    speed: Array

    @property
    def current(self) -> Array:
        """(L,) [A]."""
        return self.states[:, 2]


def motion_from_rest(plant: Any, drive: Drive, random: np.random.Generator) -> Motion:
    """The machine's motion from rest, without what was before the first sample.

    Args:
        plant: the machine's record.
        drive: how it is driven.
        random: for laws with chance in them.

    Raises:
        Unsteady: numbers that make no machine.
    """
    state = np.zeros(len(STATES))
    state[0] = drive.angle
    return _run(plant, drive.volts, drive.warm, drive.period, state, random)


def motion_from(plant: Any, drive: Drive, first: Array) -> Motion:
    """The motion of a machine that was in state `first` (n,) at the first sample."""
    volts = drive.volts[drive.warm :]
    return _run(plant, volts, 0, drive.period, first, np.random.default_rng(0))


def _run(
    plant: Any,
    volts: Array,
    warm: int,
    period: float,
    state: Array,
    random: np.random.Generator,
) -> Motion:
    times: Array = np.asarray((np.arange(volts.size) - warm) * period, dtype=np.float64)
    supplied = _supplied(plant, volts, random)
    edges, levels, keep = _edges(times, supplied, plant["delay"], warm)
    arguments = (state, plant, _active(plant), TOLERANCES, TOLERANCE)
    states, steady = integrate(edges, levels, keep, *arguments)
    if not steady or not np.isfinite(states).all():
        raise Unsteady("the simulated machine of a challenge diverged")
    return Motion(states, _shown(plant, states, times[warm:], random))


def _active(plant: Any) -> NDArray[np.int64]:
    """Indices of the states that move in this machine."""
    groups = [
        (True, (0, 1, 2)),
        (plant["unbalance"] != 0, (3, 4, 5, 6)),
        (plant["forward"] + plant["backward"] + plant["static"] + plant["gear"] > 0, (7,)),
        (plant["heat_winding"] > 0, (8, 9)),
        (plant["actuator_time"] > 0, (10,)),
        (plant["far"] > 0, (11, 12)),
        (plant["fluid"] > 0, (13,)),
        (plant["lag_1"] > 0, (14, 15)),
        (plant["hysteresis"] != 0 or plant["limiter_gain"] > 0, (16,)),
    ]
    return np.array([i for acts, states in groups if acts for i in states], dtype=np.int64)


def _supplied(plant: Any, volts: Array, random: np.random.Generator) -> Array:
    """(S,) what the drive makes of its commands [V]."""
    supplied = np.array(volts, dtype=np.float64)  # for read-only ones all would be compiled again
    if math.isfinite(plant["limit"]):
        size = np.abs(supplied)
        if plant["limit_sharpness"] > 0:
            power = plant["limit_sharpness"]
            supplied = supplied / (1.0 + (size / plant["limit"]) ** power) ** (1.0 / power)
        else:
            supplied = np.clip(supplied, -plant["limit"], plant["limit"])
    if plant["dead"] > 0:
        beyond = np.abs(supplied) - plant["dead"]
        softness = plant["dead_softness"] * plant["dead"]
        # Rounded at the zone's edge, and exactly 0 at a command of 0.
        size = 0.5 * (beyond + np.sqrt(beyond**2 + softness**2))
        least = 0.5 * (-plant["dead"] + math.hypot(plant["dead"], softness))
        supplied = np.sign(supplied) * np.maximum(size - least, 0.0)
    knee = np.tanh(np.abs(supplied) / SUPPLY_KNEE)
    offset = plant["supply_bias"] * (1.0 + plant["supply_bias_fall"] * knee)
    supplied = supplied * _gain(plant["supply_gain"], plant["supply_bend"] * knee) + offset
    if plant["walk"] > 0:
        steps = random.normal(0.0, 1.0, volts.size)
        keep = math.exp(-WALK_PERIOD / WALK_MEMORY)
        wander = np.empty(volts.size)
        level = random.normal()
        for k in range(volts.size):
            wander[k] = level
            level = keep * level + math.sqrt(1 - keep**2) * steps[k]
        supplied = supplied + plant["walk"] * wander
    return supplied


def _gain(gain: float, bend: Array) -> Array:
    """A gain whose departure from 1 is not the same everywhere."""
    return 1.0 + (gain - 1.0) * (1.0 + bend)


def _edges(
    times: Array, supplied: Array, delay: float, warm: int
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Times between which the voltage is constant, the levels, which edges are samples to keep."""
    samples = np.zeros(times.size, dtype=bool)
    samples[warm:] = True
    if delay <= 0:
        return times, supplied[:-1], samples
    late = times + delay
    late = late[late < times[-1]]
    edges = np.union1d(times, late)
    index = np.searchsorted(times + delay, edges[:-1] + 1e-12, side="right") - 1
    # Before the first command had arrived there was nothing.
    levels = np.where(index >= 0, supplied[np.maximum(index, 0)], 0.0)
    keep = np.zeros(edges.size, dtype=bool)
    keep[np.searchsorted(edges, times[warm:])] = True
    return edges, levels, keep


def _shown(plant: Any, states: Array, times: Array, random: np.random.Generator) -> Array:
    """(L,) speed as the sensor shows it, without noise [rad/s]."""
    column = 1 if plant["lag_1"] == 0 else 14 if plant["lag_2"] == 0 else 15
    speed = states[:, column]
    bent = _gain(plant["gain"], plant["gain_bend"] * np.tanh(speed / 30.0))
    wave = 1.0 + plant["bias_wave"] * np.sin(plant["bias_rate"] * times)
    shown = speed * bent + plant["bias"] * wave
    if plant["encoder"] != 0:
        shown = shown * (1.0 + plant["encoder"] * np.sin(states[:, 0] + plant["encoder_phase"]))
    if plant["missed"] != 0:
        missing = np.zeros(times.size)
        at = 0
        while at < times.size:
            free, burst = random.exponential(MISSED_BURST, 2) / (times[1] - times[0])
            begin = at + round(free)
            at = begin + 1 + round(burst)
            missing[begin:at] = plant["missed"] * random.uniform(0.5, 1.5)
        shown = shown * (1.0 - np.where(np.abs(speed) > plant["missed_speed"], missing, 0.0))
    return shown
