"""The experiments of one stream and the truth about each, which no twin is shown."""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import msgs_config
from ldt_core.base.experiment import Experiment
from ldt_core.lab.study.region import in_region, speed_bands
from ldt_core.lab.study.study_case import StudyCase
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import Machine, load_machine, machine_from_dict

KEPT = 4  # streams in memory; 200 experiments of 2000 samples are 6 MB
GROUPS = ("plant", "run")  # of parameters that decide what a stream is


@dataclass(frozen=True, eq=False)
class Stream:
    """What a plant produced.

    Attributes:
        experiments: in order, from number 1.
        truth: value of what wears in each (the rotor: e [m]); 0 where nothing wears.
        effects: effect → its values, in each experiment.
        region: (L,) samples in the Sommerfeld region, in each experiment.
    """

    experiments: tuple[Experiment, ...]
    truth: tuple[float, ...]
    effects: tuple[Mapping[str, Mapping[str, float]], ...]
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
    return Stream(experiments, truth, effects, region)
