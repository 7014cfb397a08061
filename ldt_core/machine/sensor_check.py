"""Whether a measured speed can be a machine's at all, before anything is learned from it.

A machine that wears is learned anew; a sensor that fails must not be. Refused is only what no
change of any parameter could bring about: a speed that stands at one value to the last bit where
noise was before, that ends sharply at one value, that is 0 now and then, that jumps as no inertia
lets it (`speed_jumps`), or noise and nothing else. All of that is judged by the data themselves.

What the machine file alone rules out is doubtful, and learned from: the machine may have changed.
Telling a sensor that shows another plausible speed from such a machine is what a diagnosis is for
(`sensor_bias`, `sensor_gain`, `sensor_lag`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from ldt_core.base.experiment import Experiment, Samples
from ldt_core.machine.machine_file import Machine
from ldt_core.machine.speed_jumps import MOST_STEP, impossible_jump, median_step, step_limit
from ldt_core.machine.unit_check import other_unit

#: Probability of taking an experiment of a sound sensor for a faulty one's, at most.
FALSE_ALARM = 1e-6
#: Factor by which inertia, resistance or torque constant may differ from the file's without a word.
PARAMETER_FACTOR = 2.0
#: Times the speed measured that the file's motor reaches without its load: no load that moves takes
#: so much off, and a wrong unit is a thousand.
SLOW_FACTOR = 100.0
#: Share of the highest voltage below which friction may hold any motor.
SLOW_VOLTS = 0.25
#: Quantiles of the voltage: what is beyond has not had the time to move the machine.
TAILS = 0.1, 0.9
#: Sound experiments before, which tell enough of the sensor's noise.
EXPERIMENTS_BEFORE = 8
#: Share of the range of the speed, or of the voltage's size, that is rounding.
ROUNDING = 1e-9
#: Share of the file's highest speed: noise as large leaves nothing of the machine to be seen.
USELESS = 0.25
#: A smooth speed shown in steps stays longest at its peak, times the next longest stay: 4.8 for a
#: parabola, 10.6 for a peak as flat as the fourth power.
FLATTEST = 12.0
#: Samples back to which pure noise has nothing to do with voltage or speed.
MEMORY = 8


def fault(machine: Machine, experiment: Experiment, recent: Sequence[Experiment] = ()) -> str:
    """What no machine whatever can have made, in words; empty where one can.

    Args:
        machine: as its file knows it, of which only a size for noise is taken.
        experiment: in question.
        recent: sound experiments before it, which tell what the sensor's noise is like.
    """
    return (
        _clipped(experiment, recent)
        or _stuck(machine, experiment, recent)
        or _drops_out(experiment)
        or _jumps(experiment, recent)
        or _noise_alone(machine, experiment, recent)
    )


def doubt(machine: Machine, experiment: Experiment, recent: Sequence[Experiment] = ()) -> str:
    """What a machine does only if it differs much from its file, in words; otherwise empty.

    Args:
        machine: as its file knows it.
        experiment: that is no plain `fault`.
        recent: sound experiments before it.
    """
    return (
        _too_fast(machine, experiment)
        or _too_slow(machine, experiment)
        or _too_sudden(machine, experiment, recent)
        or _unmoved(machine, experiment)
        or (len(recent) < EXPERIMENTS_BEFORE and other_unit(machine, experiment))
        or ""
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
    nothing else is refused then. After experiments without noise even that is not, unless the
    voltage turns its sign and a shaft that is said to turn does not care. Nor is it at voltages
    that friction may withstand. It may show any one value before the machine begins to move, and
    for long where the speed is at a peak.
    """
    begin, stop = _longest_run(e.speed)
    value = float(e.speed[begin])
    whole = stop - begin == len(e)
    if stop - begin < 2 or (value == 0.0 and not whole):
        return ""
    if not _moves(value, e.voltage[begin:stop], [e, *recent]):
        return ""
    low, high = np.quantile(e.voltage, TAILS)
    turns = value != 0.0 and low < 0.0 < high
    if whole and not turns and any(not _noisy(r) for r in recent):
        return ""  # blocked, or driven by a supply that gives no more
    if whole and value == 0.0 and _held(machine, e) and not any(_noisy(r) for r in recent):
        return ""
    if not whole:
        own, before = [e.speed[:begin], e.speed[stop:]], [r.speed for r in recent]
        if value in (e.speed.min(), e.speed.max()):
            own = [_between_ends(e.speed, part) for part in own]
        usual = _usually(_longest, own, before)
        smooth = not _noisy(e) and (begin == 0 or stop - begin <= FLATTEST * usual)
        if (
            smooth
            or _expected(stop - begin, len(e), usual, [*own, *before]) > FALSE_ALARM
            or _settles(e.speed, value)
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


def _clipped(e: Experiment, recent: Sequence[Experiment]) -> str:
    """The highest or lowest value comes more often than values of this sensor ever do.

    Neither tells how often others come: a sensor may saturate at both ends.
    """
    between = _between_ends(e.speed, e.speed)
    for value, which in ((e.speed.max(), "highest"), (e.speed.min(), "lowest")):
        at = e.speed == value
        count = int(at.sum())
        in_a_row = np.ptp(np.flatnonzero(at)) == count - 1  # which is judged as such
        if value == 0.0 or in_a_row or not _moves(float(value), e.voltage[at], [e, *recent]):
            continue
        own, before = [between], [r.speed for r in recent]
        if _expected(count, len(e), _usually(_most, own, before), [*own, *before]) > FALSE_ALARM:
            continue
        if not _settles(e.speed, float(value)):
            return (
                f"{count} of {len(e)} samples are the {which} one, {value:.4g} rad/s, to the last "
                "digit: a sensor that saturates"
            )
    return ""


def _drops_out(e: Experiment) -> str:
    """Zeros to the last digit between samples of one sign that are far from it.

    Two: a sound sensor may show one by chance, of noise with long tails.
    """
    turning = e.speed[e.speed != 0]
    if turning.size < 2:
        return ""
    usual = float(np.median(np.abs(np.diff(turning))))
    far = MOST_STEP * max(usual, _resolution([e]))
    before, between, after = e.speed[:-2], e.speed[1:-1], e.speed[2:]
    lost = (between == 0) & (np.minimum(before, after) > far)
    lost |= (between == 0) & (np.maximum(before, after) < -far)
    if np.count_nonzero(lost) < 2:
        return ""
    beside = float(np.median(np.abs(before[lost])))
    return (
        f"{int(np.count_nonzero(e.speed == 0))} of {len(e)} samples are 0 rad/s to the last digit, "
        f"between others of {beside:.4g} rad/s: a sensor that drops out"
    )


def _jumps(e: Experiment, recent: Sequence[Experiment]) -> str:
    """Jumps that a machine as slow as this one shows itself to be cannot make."""
    found = impossible_jump(e, recent)
    if found is None:
        return ""
    at = found.at
    after = "and comes back as suddenly" if found.returns else "and stays there"
    return (
        f"the speed goes from {e.speed[at]:.4g} to {e.speed[at + 1]:.4g} rad/s within one sample "
        f"of {e.period:.3g} s {after}, though it follows the voltage only over several: "
        "a faulty sensor"
    )


def _noise_alone(machine: Machine, e: Experiment, recent: Sequence[Experiment]) -> str:
    """Much more noise than before, and nothing that the voltage has to do with.

    A blocked rotor shows noise alone too, though not more of it: that is the sensor's. Of the
    first experiment the noise may be a share of the highest speed at most.
    """
    usual = median_step(e)
    if recent:
        most = MOST_STEP * max(median_step(r) for r in recent)
    else:
        most = USELESS * _volts(machine) / machine.parameters["K_t"]
    if usual <= most or not _is_noise(e):
        return ""
    return (
        f"the speed changes by {usual:.4g} rad/s from sample to sample in the median, whatever "
        "it was before and whatever the voltage is: a faulty sensor"
    )


def _is_noise(e: Experiment) -> bool:
    """Whether neither voltages nor speeds before tell anything of a speed (F test)."""
    rows = len(e) - MEMORY
    lags = range(MEMORY)
    x = np.column_stack(
        [e.voltage[MEMORY - i : len(e) - i] for i in lags]
        + [e.speed[MEMORY - 1 - i : len(e) - 1 - i] for i in lags]
        + [np.ones(max(rows, 0))]
    )
    if rows <= 2 * x.shape[1]:
        return False
    y = e.speed[MEMORY:]
    left = y - x @ np.linalg.lstsq(x, y, rcond=None)[0]
    spread = float(np.sum((y - y.mean()) ** 2))
    # Of pure noise the share explained is the number of terms over that of the rows, in the mean;
    # five times as much is far in the tail of the F distribution for these 16 terms (p < 1e-10).
    return spread - float(left @ left) <= 5 * (x.shape[1] - 1) / rows * spread


def _too_fast(machine: Machine, e: Experiment) -> str:
    """Faster than the voltage, or the first speed, drives the motor of the file without a load."""
    volts = float(np.abs(e.voltage).max())
    top = PARAMETER_FACTOR * max(volts / machine.parameters["K_t"], abs(float(e.speed[0])))
    most, speed = top + MOST_STEP * median_step(e), float(np.abs(e.speed).max())
    if speed <= most:
        return ""
    words = f"a speed of {speed:.4g} rad/s at up to {volts:.4g} V"
    return f"{words}, {most:.4g} at most by the machine file: another unit, or another machine"


def _too_slow(machine: Machine, e: Experiment) -> str:
    """Hardly any of the speed to which the voltage brings the motor of the file without a load.

    In its time constant it makes 1 - 1/e of the way to what the mean voltage of that time holds.
    """
    p = machine.parameters
    constant = p["J"] * p["R"] / p["K_t"] ** 2 / e.period
    samples = math.ceil(min(constant, len(e) + 1))
    whole = e.voltage[: len(e) // samples * samples].reshape(-1, samples)
    if not whole.size:
        return ""
    volts = float(np.abs(whole.mean(axis=1)).max())
    reached, speed = (1 - 1 / math.e) * volts / p["K_t"], float(np.abs(e.speed).max())
    if volts <= SLOW_VOLTS * _volts(machine) or reached <= SLOW_FACTOR * speed:
        return ""
    words = f"a speed of {speed:.4g} rad/s at most, where the machine file's motor reaches"
    return f"{words} {reached:.4g} with {volts:.4g} V: another unit, or blocked"


def _too_sudden(machine: Machine, e: Experiment, recent: Sequence[Experiment]) -> str:
    """A step from one sample to the next beyond the torque of the file's motor, and noise."""
    p = machine.parameters
    # At top speed, with the voltage reversed, twice the torque that it has at rest.
    quickest = 2 * _volts(machine) * p["K_t"] / (p["R"] * p["J"])
    motion = PARAMETER_FACTOR * min(quickest * e.period, 2 * _volts(machine) / p["K_t"])
    limit = motion + step_limit(e, recent)
    steps = np.abs(np.diff(e.speed))
    if not np.any(steps > limit):
        return ""
    at = int(np.argmax(steps > limit))
    return (
        f"a step from {e.speed[at]:.4g} to {e.speed[at + 1]:.4g} rad/s within one sample of "
        f"{e.period:.3g} s, {limit:.3g} rad/s at most by the machine file"
    )


def _unmoved(machine: Machine, e: Experiment) -> str:
    """The same speed throughout, with a sensor without noise."""
    if np.ptp(e.speed) or not np.ptp(e.voltage) or (e.speed[0] == 0 and _held(machine, e)):
        return ""
    return f"{e.speed[0]:.4g} rad/s to the last digit throughout, while the voltage moves"


def _held(machine: Machine, e: Experiment) -> bool:
    """Whether the voltage is so low throughout that friction may hold any motor."""
    return float(np.abs(e.voltage).max()) <= SLOW_VOLTS * _volts(machine)


def _volts(machine: Machine) -> float:
    return max(abs(limit) for limit in machine.voltage_limits)


def _moves(value: float, voltage: Samples, shown: Sequence[Experiment]) -> bool:
    """Whether the voltage moves the speed away from a value by more than the sensor's steps.

    Whatever the parameters, a speed goes at least in proportion to the voltage once it follows.
    """
    low, high = np.quantile(voltage, TAILS)
    most = float(np.abs(voltage).max())
    moved = float(high - low)
    if moved <= ROUNDING * most:
        return False
    return value == 0.0 or abs(value) * moved / most > PARAMETER_FACTOR * _resolution(shown)


def _resolution(shown: Sequence[Experiment]) -> float:
    """The least step in which the sensor shows a speed [rad/s]."""
    distinct = np.diff(np.unique(np.concatenate([e.speed for e in shown])))
    steps = distinct[distinct > ROUNDING * distinct.sum()]
    return float(steps.min()) if steps.size else 0.0


def _noisy(e: Experiment) -> bool:
    """Whether the sensor has noise, which it then shows at rest as well.

    White noise has third differences 3.2 times as large as first ones, any motion smaller ones.
    Those of a smooth speed in steps are at most four of the steps.
    """
    first, third = np.abs(np.diff(e.speed)), np.abs(np.diff(e.speed, 3))
    if not third.size:
        return False
    return bool(np.median(third) > max(np.median(first), 4 * _resolution([e])))


def _between_ends(speed: Samples, part: Samples) -> Samples:
    """Those of a part that are neither the highest nor the lowest of all."""
    return part[(part != speed.max()) & (part != speed.min())]


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
