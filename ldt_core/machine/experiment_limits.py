"""What no experiment of a machine can be, told before anything is computed from it.

| of an experiment | held to |
|---|---|
| sample period | `PERIOD_FACTOR` times the file's at most, and as much below it |
| samples | `MOST_SAMPLES` |
| duration | `LONGEST`, or ten times the file's duration where that is more |
| start time | 0 to `LATEST` |
| voltage | the file's limits |
| speed, current | `AMPLITUDE_FACTOR` times what the file's motor reaches at the highest voltage |

Whatever keeps these limits can be squared and summed in floating point, and simulated in seconds.
A simulation of more than 10^8 integration steps (`motor_driven.MAX_STEPS`) is refused where it
begins, and nothing is learned from an experiment that is longer than `LONGEST_LEARNED`, or ten
times the file's duration where that is more. So the computing time of each experiment has a bound,
which is the same on every computer: the clock is not asked.

A speed that is merely strange is judged elsewhere (`sensor_check`): the machine may have changed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from ldt_core.base.clock import LATEST
from ldt_core.base.errors import FAULTS, ExperimentError, MachineFileError
from ldt_core.base.experiment import Experiment, Samples
from ldt_core.physics.base import Physics

VOLTAGE_SLACK = 1e-6  # of the range: measured voltages are rounded when they are written to text
#: A unit's error makes it a thousand; sampling in earnest differs by a hundred from the file's.
PERIOD_FACTOR = 300.0
#: A thousand is a unit's error or a strange machine, of which the twin warns; a million is none.
AMPLITUDE_FACTOR = 1e4
#: Four times the longest experiment that is measured in the growth tables; 64 MB of a message.
MOST_SAMPLES = 4_000_000
#: 10^8 Runge-Kutta steps of 0.25 ms, 6 s of a processor for one free run [s].
LONGEST = 25_000.0
#: 10^7 such steps, 0.6 s for one free run, of which learning takes hundreds [s].
LONGEST_LEARNED = 2500.0
#: Times the declared duration that a slow machine's experiment may last.
DURATION_FACTOR = 10.0


#: What a recording can tell apart, and many times the sampling of any oscilloscope's motor [s].
SHORTEST_PERIOD = 1e-9

#: Of a machine [1/s]: of the 16 digits of a float64 four are left for what takes a second.
FASTEST = 1e12


class HasDuration(Protocol):
    """A machine, of which no more is asked here."""

    @property
    def duration(self) -> float:
        """Of an experiment [s]."""


class Declared(NamedTuple):
    """What a machine file says of experiments.

    Args:
        name: of the machine.
        voltage_limits: (lowest, highest) [V].
        sample_period, duration: [s].
        parameters: of its physics, SI units.
    """

    name: str
    voltage_limits: tuple[float, float]
    sample_period: float
    duration: float
    parameters: Mapping[str, float]


def refuse_too_fast(source: str, physics: Physics, values: Mapping[str, float]) -> None:
    """Refuse a machine beside whose fastest rate floating point has no digits for a second.

    Raises:
        MachineFileError: says how fast it would be; mostly a unit or a power of ten is wrong.
    """
    try:
        rates = np.abs(np.linalg.eigvals(physics.state_space(values)[0]))
    except FAULTS:  # a physics of the user's own, which says so where it is simulated
        return
    fastest = float(rates.max(initial=0.0))
    if not fastest <= FASTEST:
        expected = f"a machine whose speed and current settle at rates up to {FASTEST:g} 1/s"
        got = f"{fastest:.3g} 1/s (its inertia, resistance or inductance is off by powers of ten?)"
        raise MachineFileError(f"{source}, parameters", expected, got)


def refuse_period(experiment: Experiment) -> None:
    """Refuse (ExperimentError) what no machine was sampled at, where none is declared."""
    if not SHORTEST_PERIOD <= experiment.period <= LATEST:
        where = f"experiment {experiment.number}, sample period"
        expected = f"{SHORTEST_PERIOD:g} to {LATEST:g} s"
        raise ExperimentError(where, expected, f"{experiment.period:g} s")


def refuse_impossible(machine: Declared, experiment: Experiment) -> None:
    """Refuse what the machine cannot have made, or nobody can compute.

    Raises:
        ExperimentError: says which limit is broken, and where.
    """
    where = f"experiment {experiment.number}"
    _refuse_time(machine, experiment, where)
    low, high = machine.voltage_limits
    slack = VOLTAGE_SLACK * (high - low)
    _refuse_beyond(
        experiment.voltage,
        (low - slack, high + slack),
        f"{where}, voltage",
        (f"{low:g} to {high:g} V (`limits` in the file of machine {machine.name!r})", "V"),
    )
    for name, samples, most, unit in _amplitudes(machine, experiment):
        expected = f"at most {most:.3g} {unit} either way ({AMPLITUDE_FACTOR:g} times what machine "
        expected += f"{machine.name!r} reaches)"
        _refuse_beyond(samples, (-most, most), f"{where}, {name}", (expected, unit))


def _refuse_time(machine: Declared, experiment: Experiment, where: str) -> None:
    declared = machine.sample_period
    low, high = declared / PERIOD_FACTOR, declared * PERIOD_FACTOR
    if not low <= experiment.period <= high:
        expected = f"{low:.3g} to {high:.3g} s (machine {machine.name!r}: {declared:g} s)"
        raise ExperimentError(f"{where}, sample period", expected, f"{experiment.period:g} s")
    if len(experiment) > MOST_SAMPLES:
        expected = f"at most {MOST_SAMPLES} samples"
        raise ExperimentError(where, expected, f"{len(experiment)}")
    longest = max(LONGEST, DURATION_FACTOR * machine.duration)
    if experiment.duration > longest:
        expected = f"at most {longest:g} s, which can be computed in time"
        raise ExperimentError(f"{where}, duration", expected, f"{experiment.duration:g} s")
    if not (experiment.start >= 0 and experiment.end <= LATEST):
        expected = f"0 to {LATEST:g} s since the epoch, which a recording can hold"
        raise ExperimentError(f"{where}, start time", expected, f"{experiment.start:g} s")


def _amplitudes(
    machine: Declared, experiment: Experiment
) -> Iterator[tuple[str, Samples, float, str]]:
    """(channel, samples, highest size, unit) of what the voltage brings about."""
    volts = max(abs(limit) for limit in machine.voltage_limits)
    values = machine.parameters
    # Physics of a user's own may lack these; nothing is known of its amplitudes then.
    if values.get("K_t", 0.0) > 0:
        yield "speed", experiment.speed, AMPLITUDE_FACTOR * volts / values["K_t"], "rad/s"
    if values.get("R", 0.0) > 0 and experiment.current is not None:
        yield "current", experiment.current, AMPLITUDE_FACTOR * volts / values["R"], "A"


def _refuse_beyond(
    samples: Samples, limits: tuple[float, float], where: str, told: tuple[str, str]
) -> None:
    """`told` is what was expected, and the samples' unit."""
    outside = (samples < limits[0]) | (samples > limits[1])
    if outside.any():
        at = int(np.argmax(outside))
        expected, unit = told
        got = f"{samples[at]:g} {unit} at sample {at} ({int(outside.sum())} in all)"
        raise ExperimentError(where, expected, got)


def outsized(sizes: Sequence[float]) -> list[int]:
    """Places of what is `AMPLITUDE_FACTOR` times the others, where no machine file says more.

    Args:
        sizes: the largest size of a channel, one an experiment; no order.
    """
    moving = np.sort([s for s in sizes if s > 0])
    if not moving.size:
        return []
    middle = moving[(moving.size - 1) // 2]  # the lower one: of two the smaller
    return [place for place, size in enumerate(sizes) if size / AMPLITUDE_FACTOR > middle]


def too_long_to_learn(machine: HasDuration | None, experiment: Experiment) -> str:
    """Why nothing can be learned from an experiment in time, "" where it can.

    Args:
        machine: as its file has it; None where the model has none.
        experiment: that came.
    """
    longest = max(LONGEST_LEARNED, DURATION_FACTOR * machine.duration if machine else 0.0)
    if experiment.duration <= longest:
        return ""
    return f"{experiment.duration:g} s are too long for it, more than {longest:g} s"
