"""Whether a measured speed can be a machine's at all, before anything is learned from it.

A machine that wears is learned anew; a sensor that fails must not be. Asked is what no machine can
do: stand at one value to the last bit where noise was before, end sharply at one value, change its
speed faster than its motor could, or turn faster. The limits come from the machine file and from
the data themselves. A sensor that shows another plausible speed passes: telling it from a machine
that has changed is what a diagnosis is for (`sensor_bias`, `sensor_gain`, `sensor_lag`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from ldt_core.base.experiment import Experiment, Samples
from ldt_core.machine.machine_file import Machine

#: Probability of taking an experiment of a sound sensor for a faulty one's, at most.
FALSE_ALARM = 1e-6
#: Factor by which inertia, resistance or torque constant may differ from the file's: a machine that
#: has worn that far is still believed.
PARAMETER_FACTOR = 2.0
#: [median steps from sample to sample] A step above is no noise: of normal noise it is 6.7 standard
#: deviations, one in 5e10.
MOST_STEP = 10.0
#: Quantiles of the voltage: what is beyond has not had the time to move the machine.
TAILS = 0.1, 0.9
#: Sound experiments before, which tell enough of the sensor's noise.
EXPERIMENTS_BEFORE = 8
#: Share of the range of the speed, or of the voltage's size, that is rounding.
ROUNDING = 1e-9


def fault(machine: Machine, experiment: Experiment, recent: Sequence[Experiment] = ()) -> str:
    """What no machine like this can have made, in words; empty where the speed is plausible.

    Args:
        machine: as its file knows it.
        experiment: in question.
        recent: sound experiments before it, which tell what the sensor's noise is like.
    """
    return (
        _clipped(machine, experiment, recent)
        or _stuck(machine, experiment, recent)
        or _too_fast(machine, experiment)
        or _jump(machine, experiment, recent)
    )


def sound(machine: Machine, experiments: Sequence[Experiment]) -> tuple[list[Experiment], str]:
    """(the experiments before the first faulty one, what that shows or "" if none is faulty)."""
    kept: list[Experiment] = []
    for experiment in experiments:
        if found := fault(machine, experiment, kept[-EXPERIMENTS_BEFORE:]):
            return kept, f"in experiment {experiment.number} {found}"
        kept.append(experiment)
    return kept, ""


def _stuck(machine: Machine, e: Experiment, recent: Sequence[Experiment]) -> str:
    """The same speed to the last bit for longer than chance allows, while the voltage moves.

    At rest a sensor without noise may well show 0 for ever, so that only an experiment that is
    nothing else is refused then.
    """
    begin, stop = _longest_run(e.speed)
    value = float(e.speed[begin])
    whole = stop - begin == len(e)
    if stop - begin < 2 or (value == 0.0 and not whole):
        return ""
    if not _moves(machine, e.voltage[begin:stop], [e, *recent]):
        return ""
    if not whole:
        own, before = [e.speed[:begin], e.speed[stop:]], [r.speed for r in recent]
        usual = _usually(_longest, own, before)
        if _expected(stop - begin, len(e), usual, [*own, *before]) > FALSE_ALARM or _settles(
            e.speed, value
        ):
            return ""
    volts = e.voltage[begin:stop]
    end = not whole and value in (e.speed.min(), e.speed.max())
    cause = "a sensor that sticks or saturates" if end else "a sensor that sticks"
    if value == 0.0:
        cause = "a sensor that is dead, or a blocked rotor"
    return (
        f"the speed is {value:.4g} rad/s to the last digit for {(stop - begin) * e.period:.3g} s "
        f"while the voltage moves from {volts.min():.3g} to {volts.max():.3g} V: {cause}"
    )


def _clipped(machine: Machine, e: Experiment, recent: Sequence[Experiment]) -> str:
    """The highest or lowest value comes more often than values of this sensor ever do."""
    for value, which in ((e.speed.max(), "highest"), (e.speed.min(), "lowest")):
        at = e.speed == value
        count = int(at.sum())
        in_a_row = np.ptp(np.flatnonzero(at)) == count - 1  # which is judged as such
        if value == 0.0 or in_a_row or not _moves(machine, e.voltage[at], [e, *recent]):
            continue
        own, before = [e.speed[~at]], [r.speed for r in recent]
        if _expected(count, len(e), _usually(_most, own, before), [*own, *before]) > FALSE_ALARM:
            continue
        if not _settles(e.speed, float(value)):
            return (
                f"{count} of {len(e)} samples are the {which} one, {value:.4g} rad/s, to the last "
                "digit: a sensor that saturates"
            )
    return ""


def _jump(machine: Machine, e: Experiment, recent: Sequence[Experiment]) -> str:
    """A step from one sample to the next that is beyond the motor's torque, and beyond noise."""
    if len(e) < 2:
        return ""
    p = machine.parameters
    top = _volts(machine) / p["K_t"]
    # At top speed, with the voltage reversed, twice the torque that it has at rest.
    quickest = 2 * _volts(machine) * p["K_t"] / (p["R"] * p["J"])
    motion = PARAMETER_FACTOR * min(quickest * e.period, 2 * top)
    steps = np.abs(np.diff(e.speed))
    if steps.max() <= motion:
        return ""
    usual = _usual(e)
    if recent:
        usual = min(usual, max(_usual(r) for r in recent))
    limit = motion + MOST_STEP * usual
    beyond = steps > limit
    if not beyond.any():
        return ""
    at = int(np.argmax(beyond))
    return (
        f"the speed goes from {e.speed[at]:.4g} to {e.speed[at + 1]:.4g} rad/s within one sample "
        f"of {e.period:.3g} s ({int(beyond.sum())} such steps), {limit:.3g} rad/s at most are "
        "possible: a faulty sensor"
    )


def _too_fast(machine: Machine, e: Experiment) -> str:
    """Faster than the voltage could drive a motor without any load; or noise and nothing else."""
    top = PARAMETER_FACTOR * _volts(machine) / machine.parameters["K_t"]
    usual, speed = _usual(e), float(np.abs(e.speed).max())
    if usual > top / PARAMETER_FACTOR:
        return (
            f"the speed changes by {usual:.4g} rad/s from sample to sample in the median, as much "
            "as from rest to the highest one: a faulty sensor"
        )
    if speed <= top + MOST_STEP * usual:
        return ""
    most = top + MOST_STEP * usual
    return f"a speed of {speed:.4g} rad/s, {most:.4g} at most is possible: a faulty sensor"


def _volts(machine: Machine) -> float:
    return max(abs(limit) for limit in machine.voltage_limits)


def _usual(e: Experiment) -> float:
    """Median step from one sample to the next [rad/s], of motion and noise together."""
    return float(np.median(np.abs(np.diff(e.speed)))) if len(e) > 1 else 0.0


def _moves(machine: Machine, voltage: Samples, shown: Sequence[Experiment]) -> bool:
    """Whether the voltage moves the motor by more than the steps in which the sensor shows it."""
    low, high = np.quantile(voltage, TAILS)
    distinct = np.diff(np.unique(np.concatenate([e.speed for e in shown])))
    steps = distinct[distinct > ROUNDING * distinct.sum()]
    step = float(steps.min()) if steps.size else 0.0
    motion = float(high - low) / machine.parameters["K_t"]
    return motion > PARAMETER_FACTOR * step + ROUNDING * float(np.abs(voltage).max())


def _settles(speed: Samples, value: float) -> bool:
    """Whether other samples come so near that the machine comes to rest there, without noise."""
    others = np.abs(speed[speed != value] - value)
    return bool(others.size and others.min() <= ROUNDING * np.ptp(speed))


def _longest_run(speed: Samples) -> tuple[int, int]:
    """(first sample, end) of the longest stretch of equal samples."""
    edges = np.flatnonzero(np.diff(speed) != 0) + 1
    bounds = np.concatenate([[0], edges, [speed.size]])
    longest = int(np.argmax(np.diff(bounds)))
    return int(bounds[longest]), int(bounds[longest + 1])


def _longest(speed: Samples) -> int:
    begin, stop = _longest_run(speed) if speed.size else (0, 0)
    return stop - begin


def _most(speed: Samples) -> int:
    """Samples that have the most frequent value."""
    return int(np.unique(speed, return_counts=True)[1].max()) if speed.size else 0


def _usually(
    count: Callable[[Samples], int], own: Sequence[Samples], before: Sequence[Samples]
) -> float:
    """How often this sensor repeats a value: here, or in the median experiment before, as a fault
    may have begun unseen in the one that does it most.
    """
    here = float(max(count(speed) for speed in own))
    return max(here, float(np.median([count(s) for s in before]))) if before else here


def _expected(times: int, samples: int, usual: float, others: Sequence[Samples]) -> float:
    """How often a value may be expected so many `times` among so many `samples`, at most.

    Whatever the noise and the sensor's steps, one more repetition is as much less likely as the
    `usual` most that have been seen among the `others` say. That holds for repetitions that come by
    chance. A sensor that repeats itself more than a tossed coin does has steps so coarse that it
    stands still whenever the machine does: of it nothing is said.
    """
    count = sum(speed.size for speed in others) + 1
    if usual > 1 + math.log2(count):
        return math.inf
    return float(samples * count ** (-(times - 1) / max(usual, 1)))
