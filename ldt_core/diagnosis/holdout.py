"""The hold-out: which experiments are never fitted, and how far effects close their gap."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.errors import BadInput, LdtError
from ldt_core.base.experiment import Experiment
from ldt_core.base.metrics import FreeRunError
from ldt_core.base.sentences import counted
from ldt_core.diagnosis.diagnosis import HeldOutErrors
from ldt_core.diagnosis.simulated_experiments import Use
from ldt_core.diagnosis.thresholds import THRESHOLDS
from ldt_core.machine.machine_file import Machine
from ldt_core.models.physics import PhysicsModel

FEWEST_EXPERIMENTS = 4  # with fewer, each is cut into so many parts to fit and to hold out
FEWEST_SAMPLES = 200  # of such a part: a shorter one shows little of the machine
FRAGMENT = 10  # samples: an experiment of fewer does not even show its start state
RESAMPLES = 2000  # bootstrap draws of experiments: the ends of a 95 % interval need fifty beyond
REGIME_SAMPLES = 20  # of a regime, at least: the error of fewer is chance
NOISE_DEVIATIONS = 3.0  # by which the noise here may differ from its average by chance
LEAST_REGIME_GAP = 0.1  # of the noise's power: the same for the few samples of a regime
STEADY_SLOPE = 0.05  # of the largest acceleration: below, a speed counts as steady


def without_fragments(experiments: Sequence[Experiment]) -> tuple[list[Experiment], str]:
    """(the experiments that show anything, a note or "" if that is all of them)."""
    whole = [e for e in experiments if len(e) >= FRAGMENT]
    out = len(experiments) - len(whole)
    note = f"{counted(out, 'experiment')} of fewer than {FRAGMENT} samples left out" if out else ""
    return whole, note


def split_at_random(
    experiments: Sequence[Experiment], holdout: float, seed: int
) -> tuple[list[Experiment], list[Experiment]]:
    """(to fit, held out); a few experiments are cut into parts first.

    Raises:
        BadInput: too few samples, or a share outside 0..1.
    """
    if not 0 < holdout < 1:
        raise BadInput("holdout", "a share between 0 and 1", f"{holdout:g}")
    whole, samples = list(experiments), sum(len(e) for e in experiments)
    if samples < FEWEST_SAMPLES:  # noise and gap cannot be told apart
        expected = f"at least {FEWEST_SAMPLES} samples, {FRAGMENT} an experiment"
        raise BadInput("the recording", expected, str(samples))
    if len(whole) < FEWEST_EXPERIMENTS:
        whole = [part for e in whole for part in _parts(e)]
    if len(whole) < 2:
        raise BadInput("the recording", f"at least {2 * FEWEST_SAMPLES} samples", str(samples))
    count = min(max(round(holdout * len(whole)), 1), len(whole) - 1)
    # Evenly spread over the recording, so that what changes in its course is in both parts.
    random = np.random.default_rng(seed)
    edges = np.linspace(0, len(whole), count + 1)
    held = {
        int(random.integers(int(a), max(int(b), int(a) + 1))) for a, b in itertools.pairwise(edges)
    }
    fit = [e for i, e in enumerate(whole) if i not in held]
    return fit, [e for i, e in enumerate(whole) if i in held]


def _parts(e: Experiment) -> list[Experiment]:
    count = max(1, min(FEWEST_EXPERIMENTS, len(e) // FEWEST_SAMPLES))
    edges = np.linspace(0, len(e), count + 1).astype(int)
    return [e.part(a, b) for a, b in itertools.pairwise(edges)]


def free_run(machine: Machine, experiment: Experiment, use: Use = ()) -> Array:
    """(L,) predicted speed [rad/s], exactly as `ldt predict` gives it; nan where it diverges."""
    try:
        return PhysicsModel(machine, effects=list(use)).predict(experiment).speed
    except LdtError:
        return np.full(len(experiment), math.nan)


def errors(experiments: Sequence[Experiment], predicted: Sequence[Array]) -> HeldOutErrors:
    """Root mean square over all samples, and mean over experiments of the largest error."""
    return errors_of([e.speed - run for e, run in zip(experiments, predicted, strict=True)])


def errors_of(residuals: Sequence[Array]) -> HeldOutErrors:
    """The same of what predictions leave of the speed, (L,) of each experiment [rad/s]."""
    found = FreeRunError()
    for residual in residuals:
        found.add(residual)
    return HeldOutErrors(found.rmse, found.mean_max_error)


def noise_there(
    experiments: Sequence[Experiment], predicted: Sequence[Array], noise: float, band: float
) -> float:
    """Deviation of the noise as it fell out in these experiments [rad/s].

    A gap smaller than the noise is the difference of two large powers: what the noise happened to
    be would count as part of it. Beyond the band in which a machine can be wrong it is measured;
    within, it is taken to be as everywhere.

    Args:
        predicted: (L,) speeds of each [rad/s].
        noise: its deviation on average [rad/s].
        band: highest frequency at which the predictions may be wrong [Hz].
    """
    power, count = 0.0, 0
    for e, run in zip(experiments, predicted, strict=True):
        squared = np.abs(np.fft.rfft(e.speed - run)) ** 2
        squared[1:] *= 2
        high = np.fft.rfftfreq(len(e), e.period) > band
        power += float(squared[high].sum()) / len(e) + noise**2 * 2 * float(np.sum(~high))
        count += len(e)
    there = math.sqrt(power / count) if math.isfinite(power) else noise
    chance = NOISE_DEVIATIONS / math.sqrt(2 * count)
    return min(max(there, noise * (1 - chance)), noise * (1 + chance))


def _chance(samples: Array | float) -> Any:
    """By which sums of so many squares of noise may differ from their mean, in its variance."""
    return NOISE_DEVIATIONS * np.sqrt(2.0 * samples)


def beyond_noise(error: float, noise: float, samples: int) -> float:
    """Power that an error has beyond what the noise may be by chance, at least 0 [rad^2/s^2]."""
    return max(error**2 - noise**2 * (1.0 + float(_chance(samples)) / samples), 0.0)


def closed(
    experiments: Sequence[Experiment],
    before: Sequence[Array],
    after: Sequence[Array],
    noise: float,
    seed: int = 0,
    count: int | None = None,
) -> tuple[float | None, tuple[float, float] | None]:
    """(closed fraction in 0..1, its 95 % interval): (before^2 - after^2) / (before^2 - noise^2).

    Args:
        count: experiments of each draw for the interval; None takes as many as there are.
    """
    size = np.array([len(e) for e in experiments], dtype=np.float64)
    was, now = (
        np.array([float(np.sum((e.speed - p) ** 2)) for e, p in zip(experiments, run, strict=True)])
        for run in (before, after)
    )
    gap = was - size * noise**2
    # A run that diverged is no number: nothing is said of what it closes.
    if (
        not math.isfinite(float(now.sum()))
        or not gap.sum() > THRESHOLDS.least_gap * noise**2 * size.sum()
    ):
        return None, None
    part = float(np.clip((was - now).sum() / gap.sum(), 0.0, 1.0))
    if len(experiments) < 2:
        return part, None
    pick = np.random.default_rng(seed).integers(0, size.size, (RESAMPLES, count or size.size))
    below, samples = gap[pick].sum(axis=1), size[pick].sum(axis=1)
    # Of experiments whose gap is no more than noise may be, there is no part to be closed.
    shown = below > noise**2 * np.maximum(THRESHOLDS.least_gap * samples, _chance(samples))
    if not shown.any():
        return part, None
    drawn = (was - now)[pick].sum(axis=1)[shown] / below[shown]
    low, high = np.clip(np.quantile(drawn, [0.025, 0.975]), 0.0, 1.0)
    return part, (float(low), float(high))


def regimes(
    experiments: Sequence[Experiment], before: Sequence[Array], after: Sequence[Array], noise: float
) -> list[dict[str, float | str | None]]:
    """Errors by regime: slow, medium and fast; speeding up, steady and slowing down."""
    speed = np.concatenate([e.speed for e in experiments])
    was, now = np.concatenate(before), np.concatenate(after)
    slope = np.concatenate(
        [np.gradient(p, e.period) for e, p in zip(experiments, after, strict=True)]
    )
    turning = STEADY_SLOPE * float(np.nanmax(np.abs(slope)))
    low, high = np.quantile(speed, [1 / 3, 2 / 3])
    parts = {
        f"speed below {low:.3g} rad/s": speed < low,
        f"speed {low:.3g} to {high:.3g} rad/s": (speed >= low) & (speed <= high),
        f"speed above {high:.3g} rad/s": speed > high,
        "speeding up": slope > turning,
        "steady": np.abs(slope) <= turning,
        "slowing down": slope < -turning,
    }
    found: list[dict[str, float | str | None]] = []
    for name, inside in parts.items():
        if np.count_nonzero(inside) < REGIME_SAMPLES:
            continue
        one, other = (float(np.mean((speed - run)[inside] ** 2)) for run in (was, now))
        gap = one - noise**2
        found.append(
            {
                "regime": name,
                "samples": int(np.count_nonzero(inside)),
                "rmse_before": math.sqrt(one),
                "rmse_after": math.sqrt(other),
                "closed_fraction": float(np.clip((one - other) / gap, 0.0, 1.0))
                if gap > LEAST_REGIME_GAP * noise**2
                else None,
            }
        )
    return found
