"""Jumps of a measured speed that no inertia whatever lets a machine make.

What a machine can do is judged by the experiment itself: where its speed follows the voltage only
over several samples, it cannot take a new value in one. A machine so quick that it can is left
alone, as is one whose voltage tells nothing of its speed.

The estimate is that of instrumental variables (Söderström, Stoica, "Instrumental Variable Methods
for System Identification", 1983): the voltages before are the instruments. Neither the sensor's
noise nor a slow drift make a machine look slower or quicker by that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from weakref import WeakKeyDictionary

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.experiment import Experiment

#: [median steps from sample to sample] A step above is no noise: of normal noise it is 6.7 standard
#: deviations, one in 5e10.
MOST_STEP = 10.0
#: Share of the range of the speed. A smaller jump is said, and learned from: it changes little.
RANGE_SHARE = 0.2
#: Quantiles between which the range is measured, so that what jumps does not make it.
TAILS = 0.05, 0.95
#: Times the largest step of the experiments before: noise of long tails jumps again and again.
AS_BEFORE = 2.0
#: Part of a speed kept from sample to sample, above which a machine takes several for a change:
#: in one sample it goes less than half the way.
KEPT = 0.5
#: Half, of the jump: what the machine's own dynamics leave unexplained, what stays, what returns.
HALF = 0.5
#: Of a jump: steps beside it that are larger belong to an oscillation, or to a quick run-up.
BESIDE = 0.25
#: Of an excursion: times the roughness of all else. Of noise whose tail falls with the third power
#: (Student with 3 degrees of freedom) the largest value is so far from the next one in 1000.
GAP = 10.0
#: Samples beside a jump in which nothing else may happen.
AROUND = 3
#: Samples that must lie between two jumps for a level of its own; below, it is an excursion.
LEVEL = 20
#: Jumps that are judged at most, for the time it takes.
MOST_JUDGED = 20
#: Samples back to which voltages are instruments.
LAGS = 0, 1, 2, 4, 8, 16, 32
#: F value of the voltages before, above which they tell enough of the speed (Staiger, Stock,
#: "Instrumental Variables Regression with Weak Instruments", Econometrica 65, 1997).
STRONG = 10.0
#: Standard deviations by which an estimate may be wrong.
SURE = 4.0


@dataclass(frozen=True)
class Jump:
    """One that no machine as slow as this can have made.

    Args:
        at: sample before it.
        returns: whether the speed came back as suddenly; otherwise it stayed.
        brief: whether it came back in the very next sample.
    """

    at: int
    returns: bool
    brief: bool = False


def impossible_jump(experiment: Experiment, recent: Sequence[Experiment] = ()) -> Jump | None:
    """The first of the jumps from one sample to the next that no change of the machine makes.

    A machine that keeps more than half of its speed from one sample to the next cannot leave a
    value and take it up again each within one sample. Nor can it be at a new level at once and stay
    there: a blow dies away, and a load that drops lets it run up. A rotor that jams and stays at
    rest is believed.
    """
    y = experiment.speed
    steps = np.diff(y)
    limit = step_limit(experiment, recent)
    beyond = [int(k) for k in np.flatnonzero(np.abs(steps) > limit)]
    if not 0 < len(beyond) <= steps.size // 4:  # more of them are noise, not jumps
        return None
    dynamics = _Dynamics(experiment, beyond)
    alone = [k for k in beyond if _quiet(steps, k, k) or (k + 1 in beyond)][:MOST_JUDGED]
    brief = 0
    for k in alone:
        found = _judged(dynamics, beyond, k, limit)
        if found is None:
            continue
        brief += found.brief
        # Noise of long tails makes a single excursion of one sample, hardly two.
        if not found.brief or brief > 1:
            return found
    return None


def step_limit(experiment: Experiment, recent: Sequence[Experiment] = ()) -> float:
    """Steps from sample to sample [rad/s] that are noise, or too small to matter."""
    usual = median_step(experiment)
    if recent:
        usual = min(usual, max(median_step(r) for r in recent))
    low, high = np.quantile(experiment.speed, TAILS)
    largest = float(np.median([_steps(r)[1] for r in recent])) if recent else 0.0
    return max(MOST_STEP * usual, RANGE_SHARE * float(high - low), AS_BEFORE * largest)


def median_step(experiment: Experiment) -> float:
    """From one sample to the next [rad/s], of motion and noise together."""
    return _steps(experiment)[0]


#: Of those that are held: each is asked for by eight experiments after it, several times by each.
_known: WeakKeyDictionary[Experiment, tuple[float, float]] = WeakKeyDictionary()


def _steps(experiment: Experiment) -> tuple[float, float]:
    """(median, largest) step from one sample to the next [rad/s]."""
    if experiment not in _known:
        steps = np.abs(np.diff(experiment.speed))
        middle = float(np.median(steps)) if steps.size else 0.0
        _known[experiment] = middle, float(steps.max(initial=0.0))
    return _known[experiment]


def _judged(dynamics: _Dynamics, beyond: Sequence[int], k: int, limit: float) -> Jump | None:
    steps = np.diff(dynamics.speed)
    size = steps[k]
    partners = [b for b in beyond if k < b <= k + LEVEL]
    for back in partners:
        quiet = _quiet(steps, k, back) and steps[back] * size < 0
        if not quiet or abs(size) < GAP * _roughness(dynamics.speed, beyond):
            continue
        left, again = dynamics.unexplained(k), dynamics.unexplained(back)
        sudden = min(abs(left), abs(again)) >= max(limit, HALF * abs(size))
        if sudden and abs(again + left) <= HALF * abs(left):
            return Jump(k, returns=True, brief=back == k + 1)
    if not _quiet(steps, k, k) or not dynamics.stays(k):
        return None
    left = dynamics.unexplained(k, after=True)
    return Jump(k, returns=False) if abs(left) >= max(limit, HALF * abs(size)) else None


def _quiet(steps: Array, first: int, last: int) -> bool:
    """Whether nothing happens around two jumps, and between them."""
    at = {first, last}
    around = range(max(first - AROUND, 0), min(last + AROUND + 1, steps.size))
    beside = steps[[i for i in around if i not in at]]
    return bool(np.all(np.abs(beside) <= BESIDE * abs(steps[first])))


def _roughness(speed: Array, beyond: Sequence[int]) -> float:
    """The largest distance of a sample from the median of five, away from jumps [rad/s]."""
    windows = np.lib.stride_tricks.sliding_window_view(speed, 5)
    away = np.abs(speed[2:-2] - np.median(windows, axis=1))
    beside = np.zeros(speed.size, dtype=bool)
    for k in beyond:
        beside[max(k - 2, 0) : k + 4] = True
    return float(away[~beside[2:-2]].max(initial=0.0))


class _Dynamics:
    """How fast the speed follows the voltage in one experiment: y' = a·y + b·u + c, c by level."""

    def __init__(self, experiment: Experiment, beyond: Sequence[int]) -> None:
        self.speed, self.voltage = experiment.speed, experiment.voltage
        # A machine that starts at rest had no voltage before.
        rest = abs(self.speed[0]) <= RANGE_SHARE * np.median(np.abs(self.speed))
        self.before = 0.0 if rest else float(self.voltage[0])
        size = self.speed.size - 1
        moved = np.abs(np.diff(self.voltage, prepend=self.before))[:size]
        # What the voltage may have caused tells how quick the machine is; the rest does not.
        follows = moved > RANGE_SHARE * np.ptp(np.append(self.voltage, self.before))
        self.sudden = [k for k in beyond if not (follows[k] or follows[max(k - 1, 0)])]

    def unexplained(self, k: int, after: bool = False) -> float:
        """Of the step from sample k to the next [rad/s]; 0 where the machine may be as quick.

        Args:
            k: sample before the step.
            after: whether only what comes after tells how quick the machine is.
        """
        fitted = self._fit(k, k + 1 if after else 0)
        if fitted is None:
            return 0.0
        kept, gain, level = fitted
        there = np.flatnonzero(~np.isnan(level))
        near = level[there[np.argmin(np.abs(there - k - 1))]]
        y, u = self.speed, self.voltage
        return float(y[k + 1] - kept * y[k] - gain * u[k] - near)

    def stays(self, k: int) -> bool:
        """Whether the speed is at a new level after the jump, and the machine still turns.

        A machine that keeps its speed for long falls back to the old level after a blow.
        """
        y, size = self.speed, self.speed[k + 1] - self.speed[k]
        before, after = y[max(k - AROUND, 0) : k + 1], y[k + 1 :]
        if np.median(after[: AROUND + 1]) - np.median(before) < HALF * size and size > 0:
            return False
        if np.median(after[: AROUND + 1]) - np.median(before) > HALF * size and size < 0:
            return False
        if np.median(np.abs(after[: 2 * LEVEL])) <= RANGE_SHARE * abs(y[k]) / 2:
            return False  # it stands still: jammed, as far as anybody can tell
        fitted = self._fit(k, 0)
        if fitted is None or np.isnan(fitted[2][[k, k + 1]]).any():
            return False
        kept, _, level = fitted
        return bool(HALF <= (level[k + 1] - level[k]) / (1 - kept) / size <= 1 / HALF)

    def _fit(self, k: int, begin: int) -> tuple[float, float, Array] | None:
        """(part of the speed that is surely kept, gain, level by sample), without the step at k."""
        y, u = self.speed, self.voltage
        bounds = [0, *(c + 1 for c in sorted({*self.sudden, k})), y.size]
        level, parts = np.full(y.size, -1), 0
        for first, stop in pairwise(bounds):
            if stop - first >= LEVEL and first >= begin:
                level[first:stop] = parts
                parts += 1
        rows = np.flatnonzero((level[:-1] == level[1:]) & (level[:-1] >= 0))
        if not parts or rows.size < 2 * (len(LAGS) + parts + 2):
            return None
        here = level[rows]
        count = np.bincount(here, minlength=parts)

        def centred(values: Array) -> tuple[Array, Array]:
            means = np.bincount(here, values, parts) / count
            return values - means[here], means

        padded = np.concatenate([np.full(max(LAGS), self.before), u])
        lags = [centred(padded[rows + max(LAGS) - lag])[0] for lag in LAGS]
        (speed, ys), (volts, us), (after, afters) = map(centred, (y[rows], u[rows], y[rows + 1]))
        instruments, free = np.column_stack(lags), rows.size - parts - len(LAGS)
        seen = instruments @ np.linalg.lstsq(instruments, speed, rcond=None)[0]
        power = max(float(volts @ volts), float(np.finfo(np.float64).tiny))
        # What the voltages before tell of the speed beyond what the present one does.
        told = seen - volts * (volts @ seen) / power
        apart = speed - seen
        strength = float(told @ told)
        if strength / len(LAGS) <= STRONG * (apart @ apart) / free:
            return None
        estimate = float(told @ after) / strength
        left = after - estimate * speed
        residual = left - volts * (volts @ left) / power
        error = math.sqrt(float(residual @ residual) / free / strength)
        kept = min(estimate - SURE * error, 1 - 1 / y.size)
        if not kept > KEPT:
            return None
        gain = float(volts @ (after - kept * speed)) / power
        levels = np.append(afters - kept * ys - gain * us, np.nan)
        return kept, gain, np.where(level >= 0, levels[level], np.nan)
