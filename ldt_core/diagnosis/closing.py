"""How far effects close the gap: free runs of experiments that the diagnosis never fitted."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment
from ldt_core.base.metrics import FreeRunError
from ldt_core.diagnosis.result import Errors
from ldt_core.diagnosis.trials import Use
from ldt_core.machine.machine_file import Machine
from ldt_core.models.physics import PhysicsModel

Array = NDArray[np.float64]

DRAWS = 2000  # of the bootstrap over experiments
LEAST = 20  # samples of a regime
SURE = 3.0  # deviations of a noise's estimate, beyond which it is no chance
FLAT = 0.005  # of the noise's power: with a smaller gap before, a closed fraction says nothing


def free_run(machine: Machine, experiment: Experiment, use: Use = ()) -> Array:
    """(L,) predicted speed [rad/s], exactly as `ldt predict` gives it; nan where it diverges."""
    try:
        return PhysicsModel(machine, effects=list(use)).predict(experiment).speed
    except LdtError:
        return np.full(len(experiment), math.nan)


def errors(experiments: Sequence[Experiment], predicted: Sequence[Array]) -> Errors:
    """Root mean square over all samples, and mean over experiments of the largest error."""
    found = FreeRunError()
    for experiment, run in zip(experiments, predicted, strict=True):
        found.add(experiment.speed - run)
    return Errors(found.rmse, found.mean_max_error)


def noise_there(
    experiments: Sequence[Experiment], predicted: Sequence[Array], noise: float, band: float
) -> float:
    """Deviation of the noise as it fell out in these experiments [rad/s].

    A gap smaller than the noise is the difference of two large powers: what the noise happened to
    be would count as part of it. Beyond the band in which a machine can be wrong it is measured;
    within, it is taken to be as everywhere.

    Args:
        experiments: measured.
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
    chance = SURE / math.sqrt(2 * count)
    return min(max(there, noise * (1 - chance)), noise * (1 + chance))


def closed(
    experiments: Sequence[Experiment],
    before: Sequence[Array],
    after: Sequence[Array],
    noise: float,
    seed: int = 0,
) -> tuple[float | None, tuple[float, float] | None]:
    """(closed fraction in 0..1, its 95 % interval): (before^2 - after^2) / (before^2 - noise^2)."""
    size = np.array([len(e) for e in experiments], dtype=np.float64)
    was, now = (
        np.array([float(np.sum((e.speed - p) ** 2)) for e, p in zip(experiments, run, strict=True)])
        for run in (before, after)
    )
    gap = was - size * noise**2
    if not gap.sum() > FLAT * noise**2 * size.sum():
        return None, None
    part = float(np.clip((was - now).sum() / gap.sum(), 0.0, 1.0))
    if len(experiments) < 2:
        return part, None
    pick = np.random.default_rng(seed).integers(0, size.size, (DRAWS, size.size))
    below = gap[pick].sum(axis=1)
    drawn = (was - now)[pick].sum(axis=1)[below > 0] / below[below > 0]
    low, high = np.clip(np.quantile(drawn, [0.025, 0.975]), 0.0, 1.0)
    return part, (float(low), float(high))


def regimes(
    experiments: Sequence[Experiment],
    before: Sequence[Array],
    after: Sequence[Array],
    noise: float,
) -> list[dict[str, float | str | None]]:
    """Errors by regime: slow, medium and fast; speeding up, steady and slowing down."""
    speed = np.concatenate([e.speed for e in experiments])
    was, now = np.concatenate(before), np.concatenate(after)
    slope = np.concatenate(
        [np.gradient(p, e.period) for e, p in zip(experiments, after, strict=True)]
    )
    turning = 0.05 * float(np.nanmax(np.abs(slope)))
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
        if np.count_nonzero(inside) < LEAST:
            continue
        one, other = (float(np.mean((speed - run)[inside] ** 2)) for run in (was, now))
        gap = one - noise**2
        found.append(
            {
                "regime": name,
                "samples": int(np.count_nonzero(inside)),
                "rmse_before": math.sqrt(one),
                "rmse_after": math.sqrt(other),
                "closed_fraction": (one - other) / gap if gap > 0.1 * noise**2 else None,
            }
        )
    return found
