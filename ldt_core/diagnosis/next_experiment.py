"""The experiment that tells apart what this recording cannot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.experiment import Experiment
from ldt_core.base.sentences import listed, number, spoken
from ldt_core.diagnosis.diagnosis import NextExperiment
from ldt_core.diagnosis.effect_fit import EffectFit, by_member, used
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.simulated_experiments import SEARCH_STEP
from ldt_core.diagnosis.thresholds import THRESHOLDS

CURRENT_NOISE = 0.01  # share of the largest current, where nothing is known of its sensor
MOST_SAMPLES = 2000  # of a proposed experiment, so that people can still look at it
CURRENT_SENSOR_GAIN = 4.0  # times better, from which an experiment is worth a further sensor
# Chosen by hand: the design that tells most apart is taken, whatever these make of each.
LENGTH = 8.0  # memories of the machine, that a proposed experiment lasts at least
HOLD = 4.0  # memories at one voltage: the speed has settled to 2 %
LEAST_REVERSAL = 0.3  # of the largest voltage, so that each reversal passes what friction holds
SLOW_PERIODS = 2  # in an experiment, both ways through 0 twice: slow, and repeated
SMALL = 0.25  # of the largest voltage: near the friction that a shaft starts against
RUN_UP = 0.9  # of the largest voltage: short of where it might be limited


def next_experiment(
    residuals: FreeRunResiduals, alike: Sequence[EffectFit], seed: int = 0
) -> NextExperiment | None:
    """The design that splits sets which are as good as each other, or None if none does."""
    if len(alike) < 2:
        return None
    best: tuple[float, NextExperiment] | None = None
    measured = residuals.experiments[0].current is not None
    for name, volts in _designs(residuals, seed):
        for current in (False, True) if not measured else (True,):
            power = _separation(residuals, alike, volts, current)
            channels = ["voltage", "speed", *(["current"] if current else [])]
            # The plainer experiment is the better one unless the other tells far more.
            worth = power if not current or measured else power / CURRENT_SENSOR_GAIN
            if best is None or worth > best[0]:
                with_current = " with the current measured" if current and not measured else ""
                why = (
                    f"{name}{with_current} would tell "  # a name may be of several
                    f"{apart([f.names for f in alike])} apart: one such experiment moves them "
                    f"{number(math.sqrt(power))} noise deviations from each other, at least"
                )
                period = residuals.experiments[0].period
                best = worth, NextExperiment(why, [float(v) for v in volts], period, channels)
                enough = power
    return best[1] if best is not None and enough > THRESHOLDS.settling_distance else None


def apart(sets: Sequence[Sequence[str]]) -> str:
    """The names of sets of effects in words, by what not all of them have.

    >>> apart([["backlash", "inertia"], ["backlash"]]), apart([["backlash"], ["backlash"]])
    ('inertia and its absence', 'these amounts of backlash')
    """
    common = set.intersection(*map(set, sets))
    own = {tuple(spoken(n) for n in names if n not in common): None for names in sets}
    if len(own) == 1:  # the same effects, with other amounts
        return f"these amounts of {listed(sorted(map(spoken, common)))}"
    return listed(" with ".join(n) or "its absence" for n in sorted(own, key=bool, reverse=True))


def _designs(residuals: FreeRunResiduals, seed: int) -> list[tuple[str, Array]]:
    """Inputs within the machine's limits, each with its name, that move it.

    A machine that remembers for longer than an experiment may last is still at rest in some.
    """
    random = np.random.default_rng(seed)
    e = residuals.experiments[0]
    low, high = residuals.machine.voltage_limits
    top, seen = max(-low, high), max(float(np.abs(x.voltage).max()) for x in residuals.experiments)
    most = min(seen or top, top)
    length = min(max(len(e), round(LENGTH * residuals.memory / e.period)), MOST_SAMPLES)
    time = np.arange(length) * e.period
    hold = max(round(HOLD * residuals.memory / e.period), 1)
    index = np.arange(length) // hold
    steps = random.uniform(-1.0, 1.0, int(index[-1]) + 1)
    sign = np.where(np.arange(steps.size) % 2 == 0, 1.0, -1.0)
    both = (LEAST_REVERSAL + (1 - LEAST_REVERSAL) * np.abs(steps)) * sign
    turns = SLOW_PERIODS * time / time[-1]
    there = 1.0 - np.abs(1.0 - 2.0 * (2 * turns % 1.0))
    made = [
        ("stepping the voltage to and fro through 0", most * both[index]),
        ("a slow sine of voltage through 0", most * np.sin(2 * math.pi * turns)),
        ("small steps from standstill", SMALL * most * np.abs(steps)[index] * (index % 2)),
        ("running up and letting it run down", RUN_UP * most * (index // 2 % 2 == 0)),
        ("slow ramps from standstill to full voltage", most * there),
        ("steps up to the voltage's limit", max(high, most) * np.abs(steps)[index]),
    ]
    return [(name, volts) for name, v in made if (volts := np.clip(v, low, high)).any()]


def _separation(
    residuals: FreeRunResiduals, alike: Sequence[EffectFit], volts: Array, current: bool
) -> float:
    """Least distance between any two of the sets, after one has been fitted to the other."""
    e = residuals.experiments[0]
    rest = np.zeros(volts.size)
    blank = Experiment(1, 0.0, e.period, volts, rest, rest if current else None)
    noise = residuals.noise
    if current and e.current is None:
        largest = float(np.abs(volts).max()) / residuals.values["R"]
        noise = (residuals.noise[0], CURRENT_NOISE * largest)
    tried = FreeRunResiduals(residuals.machine, [blank], noise, 1)
    least = math.inf
    for f in alike:
        z = np.concatenate(f.z)
        base = _run(tried, f.use)
        columns = []
        for j, by in enumerate(np.concatenate([c.differences for c in f.members])):
            moved = z.copy()
            moved[j] += by
            use = used(f.members, by_member(f.members, moved))
            columns.append((_run(tried, use) - base) / by)
        span = np.linalg.qr(np.column_stack(columns))[0]
        for other in alike:
            if other is f:
                continue
            apart = _run(tried, other.use) - base
            apart = apart - span @ (span.T @ apart)
            least = min(least, float(apart @ apart))
    return least


def _run(residuals: FreeRunResiduals, use: Sequence[Any]) -> Array:
    """Free run in noise deviations, speed and current in one row."""
    speed, current = residuals.outputs(0, use, SEARCH_STEP, follow=False)
    if residuals.experiments[0].current is None:
        return speed / residuals.noise[0]
    return np.concatenate([speed / residuals.noise[0], current / residuals.noise[1]])
