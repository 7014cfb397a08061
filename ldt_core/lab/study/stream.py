"""The experiments of one stream and the truth about each: what wears, the Sommerfeld region."""

from __future__ import annotations

import functools
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import binary_closing, binary_opening

import msgs_config
from ldt_core.advice.bands import in_bands
from ldt_core.base.experiment import Experiment, rms
from ldt_core.lab.study.study_case import StudyCase
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import Machine, load_machine, machine_from_dict
from ldt_core.physics.steady_state import bands

#: s; a stay in a band or an absence from it that is shorter does not count. Noise on a speed near
#: an edge would cut the region into pieces otherwise, and a motor that accelerates through a
#: resonance within its own time constant (J R / K_t^2 = 0.22 s for the rotor) was not captured.
SHORTEST = 0.2

Band = tuple[float, float]


def speed_bands(machine: Machine, e: float) -> list[Band]:
    """The Sommerfeld bands [rad/s] of a machine with the eccentricity e [m].

    Up to the speed that the highest voltage would hold without eccentricity. None for a machine
    without a foundation.
    """
    values = {**machine.parameters, "e": e}
    if e <= 0 or any(name not in values for name in ("M", "K_x", "K_y")):
        return []
    k, most = values["K_t"], max(map(abs, machine.voltage_limits))
    return bands(values, most * k / (k**2 + values["R"] * values["b"]))


def in_region(
    speed: ArrayLike, period: float, where: Sequence[Band], shortest: float = SHORTEST
) -> NDArray[np.bool_]:
    """Which samples of an experiment lie in the region.

    Args:
        speed: (L,) [rad/s], measured or not.
        period: sample period [s].
        where: bands [rad/s], as from `speed_bands`.
        shortest: stays and absences below this [s] are smoothed away.

    Returns:
        (L,) mask.

    >>> in_region([15.0, 17.0, 17.0, 16.0, 17.0, 20.0], 0.2, [(16.5, 18.0)], shortest=0.4).tolist()
    [False, True, True, True, True, False]
    """
    inside = in_bands(np.asarray(speed, dtype=np.float64), where)
    samples = max(1, round(shortest / period))
    if samples == 1 or not inside.any():
        return inside
    # Padded with its own ends, so that the region may begin with the experiment and end with it.
    padded = np.pad(inside, samples, mode="edge")
    stay = np.ones(samples, dtype=bool)
    tidy = binary_opening(binary_closing(padded, stay), stay)
    return np.asarray(tidy[samples:-samples], dtype=np.bool_)


def intervals(mask: ArrayLike) -> list[tuple[int, int]]:
    """(first sample, sample behind the last) of each stretch of a mask.

    >>> intervals([True, False, True, True])
    [(0, 1), (2, 4)]
    """
    edges = np.flatnonzero(np.diff(np.asarray(mask, dtype=np.int8), prepend=0, append=0))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def region_rmse(residual: NDArray[Any], mask: NDArray[np.bool_]) -> float | None:
    """Root mean square of a residual (L,) [rad/s] inside a mask; None where that is empty."""
    return rms(residual[mask]) if mask.any() else None


KEPT = 4  # streams in memory; 200 experiments of 2000 samples are 6 MB
GROUPS = ("plant", "run")  # of parameters that decide what a stream is


@dataclass(frozen=True, eq=False)
class Stream:
    """What a plant produced.

    Attributes:
        experiments: in order, from number 1.
        truth: value of what wears in each (the rotor: e [m]); 0 where nothing wears.
        region: (L,) samples in the Sommerfeld region, in each experiment.
    """

    experiments: tuple[Experiment, ...]
    truth: tuple[float, ...]
    region: tuple[NDArray[np.bool_], ...]


def stream(case: StudyCase, machine: Machine | None = None) -> Stream:
    """The stream of a case: the same in every process, simulated once in each.

    Args:
        case: whose seed, experiments and parameters of the plant count.
        machine: that of the case, for a process that may not have the file.

    Raises:
        BadInput: a machine or parameters that cannot be used.
    """
    machine = machine or load_machine(case.machine)
    resolved = case.resolved
    plant = {name: resolved[name] for name in msgs_config.parameters(*GROUPS)}
    # A stream is no recording: its clock starts at 0, so that it is the same at any time.
    plant["start_time"] = 0.0
    return _stream(json.dumps(machine.as_dict(), sort_keys=True), machine.source, json.dumps(plant))


@functools.lru_cache(maxsize=KEPT)
def _stream(machine_json: str, source: str, settings_json: str) -> Stream:
    machine = machine_from_dict(json.loads(machine_json), source)
    settings: dict[str, Any] = json.loads(settings_json)
    plant = Plant.from_settings(machine, settings)
    numbers = range(1, settings["experiments"] + 1)
    experiments = tuple(plant.experiment(n) for n in numbers)
    truth = tuple(plant.schedule.value(n) for n in numbers)
    effects = tuple(plant.truth(n) for n in numbers)
    unbalance = [acting.get("unbalance", machine.parameters).get("e", 0.0) for acting in effects]
    bands = {e: speed_bands(machine, e) for e in set(unbalance)}
    region = tuple(
        in_region(x.speed, x.period, bands[e]) for x, e in zip(experiments, unbalance, strict=True)
    )
    return Stream(experiments, truth, region)
