"""What is true of a stream whatever learns on it: its drifts, which show, and the references.

A drift can be found only by what it does to the measured speed. Let Dy be the speed with the new
value minus the speed with the old one, under the same voltage: (L,). With white noise of deviation
sigma, and nothing known of the shape of Dy, the energy of the residual is the test to take:

    |r|^2 / sigma^2 > c,   c the 1 - 1/N quantile of chi^2 with L degrees of freedom

is a false alarm once in N experiments, and finds the drift with the probability that a noncentral
chi^2 with |Dy|^2 / sigma^2 lies above c. S. M. Kay, "Fundamentals of Statistical Signal Processing:
Detection Theory", 1998, chapter 7.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy import optimize, stats

import msgs_config
from ldt_core.base.digest import json_digest
from ldt_core.base.experiment import Experiment, Samples
from ldt_core.lab.study.drift_detection import DETECTION_WINDOW, drifts_of
from ldt_core.lab.study.stream import GROUPS, stream
from ldt_core.lab.study.study_case import StudyCase
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import Machine, load_machine
from ldt_core.machine.plant import EffectUse
from ldt_core.models.physics import PhysicsModel

FALSE_ALARM = 1e-3  # of the test that decides what is detectable, per experiment: one in 1000
POWER = 0.9  # probability with which it has to find a drift in one experiment
PROMPT_WINDOW = 2  # experiments within which a drift of twice the detectable size is to be found


@dataclass(frozen=True)
class Drift:
    """One drift of a stream.

    Attributes:
        number: of the first experiment with the new value.
        last: of its window: five experiments, fewer when the value changes again or the run ends.
        before: value of what wears, before it.
        after: the new value.
        energy: largest |Dy|^2 / sigma^2 of an experiment in the window; infinite without noise.
        largest: largest |Dy| in the window [rad/s], what a threshold would see of it.
        detectable: whether the energy test finds it in at least one experiment of the window.
        twice: whether half of it were still detectable in one of its first two experiments.
    """

    number: int
    last: int
    before: float
    after: float
    energy: float
    largest: float
    detectable: bool
    twice: bool


@dataclass(frozen=True)
class Facts:
    """The truth about a stream; rows have one entry an experiment, from number 1.

    Attributes:
        seed: of the stream.
        noise: its deviation on the measured speed [rad/s].
        truth: value of what wears.
        floor: maximum error of the true model with the true value, in free run from the first
            measured sample as every twin's [rad/s]. A reference and no bound: it knows start
            angle and parameters, but not the first speed without its noise.
        late: the same one experiment late: with what was true in the experiment before; the
            machine file in the first.
        drifts: all of them.
    """

    seed: int
    noise: float
    truth: tuple[float, ...]
    floor: tuple[float, ...]
    late: tuple[float, ...]
    drifts: tuple[Drift, ...]

    @property
    def mme_floor(self) -> float:
        """MME of the true model [rad/s]."""
        return float(np.mean(self.floor))

    @property
    def mme_late(self) -> float:
        """MME of the true model one experiment late [rad/s]."""
        return float(np.mean(self.late))

    @property
    def detectable(self) -> list[int]:
        """Numbers of the drifts that can be found."""
        return [d.number for d in self.drifts if d.detectable]

    @property
    def twice(self) -> list[int]:
        """Numbers of the drifts of at least twice the detectable size."""
        return [d.number for d in self.drifts if d.twice]

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON, which knows no infinity."""
        plain = asdict(self)
        for drift in plain["drifts"]:
            drift["energy"] = drift["energy"] if math.isfinite(drift["energy"]) else None
        return plain

    @classmethod
    def from_dict(cls, plain: Mapping[str, Any]) -> Facts:
        """The facts that `to_dict` gave, JSON in between or not."""
        rows = {n: tuple(plain[n]) for n in ("truth", "floor", "late")}
        drifts = []
        for drift in plain["drifts"]:
            energy = math.inf if drift["energy"] is None else drift["energy"]
            drifts.append(Drift(**{**drift, "energy": energy}))
        return cls(**{**plain, **rows, "drifts": tuple(drifts)})


def facts_of(case: StudyCase, machine: Machine | None = None) -> Facts:
    """The facts of the stream that a case runs on.

    Args:
        case: whose seed, experiments and parameters of the plant count.
        machine: that of the case, for a process that may not have the file.

    Raises:
        BadInput: a machine or settings that cannot be used.
    """
    machine = machine or load_machine(case.machine)
    plant = Plant.from_settings(machine, case.resolved)
    return facts_of_plant(plant, stream(case, machine).experiments, case.seed)


def stream_key(case: StudyCase) -> str:
    """Name of the stream of a case: the same for all cases whose facts are the same."""
    resolved = case.resolved
    decisive = {name: resolved[name] for name in ("machine", *msgs_config.parameters(*GROUPS))}
    del decisive["start_time"]
    return json_digest(decisive)[:20]


def facts_of_plant(plant: Plant, experiments: Sequence[Experiment], seed: int) -> Facts:
    """The facts of a plant's stream.

    Args:
        plant: that made the stream.
        experiments: all of them from number 1 on, as measured.
        seed: of the stream.
    """
    truth = [plant.schedule.value(e.number) for e in experiments]
    numbers = drifts_of(truth)
    speeds = [_free_run(plant, e, plant.acting(e.number)) for e in experiments]
    floor = [_max_error(e, y) for e, y in zip(experiments, speeds, strict=True)]
    drifts, late = [], list(floor)
    late[0] = _max_error(experiments[0], _free_run(plant, experiments[0], []))
    for number, following in itertools.pairwise([*numbers, len(truth) + 1]):
        last = min(number + DETECTION_WINDOW, following) - 1
        window = range(number - 1, last)  # places in the rows
        before = [_free_run(plant, experiments[i], plant.acting(number - 1)) for i in window]
        late[number - 1] = _max_error(experiments[number - 1], before[0])
        changes = [speeds[i] - old for i, old in zip(window, before, strict=True)]
        middle = (truth[number - 2] + truth[number - 1]) / 2
        halves = (
            _free_run(plant, experiments[i], _with_value(plant, number, middle)) - old
            for i, old in zip(window[:PROMPT_WINDOW], before, strict=False)
        )
        samples = len(experiments[number - 1])
        energy = max(_energy(change, plant.noise) for change in changes)
        detectable = energy >= energy_needed(samples)
        drifts.append(
            Drift(
                number=number,
                last=last,
                before=truth[number - 2],
                after=truth[number - 1],
                energy=energy,
                largest=max(float(np.abs(change).max()) for change in changes),
                detectable=detectable,
                twice=detectable
                and any(_energy(h, plant.noise) >= energy_needed(samples) for h in halves),
            )
        )
    rows = (tuple(truth), tuple(floor), tuple(late))
    return Facts(seed, plant.noise, *rows, tuple(drifts))


def _free_run(plant: Plant, experiment: Experiment, effects: Sequence[EffectUse]) -> Samples:
    """(L,) speed by the machine file and these effects, from the first measured sample [rad/s]."""
    return PhysicsModel(plant.machine, effects=effects).predict(experiment).speed


@functools.lru_cache(maxsize=64)
def energy_needed(samples: int) -> float:
    """|Dy|^2 / sigma^2 from which the energy test finds a change in an experiment of `samples`.

    >>> round(energy_needed(2000))
    293
    """
    limit = stats.chi2.isf(FALSE_ALARM, samples)
    return float(
        optimize.brentq(lambda nc: stats.ncx2.sf(limit, samples, nc) - POWER, 1e-6, 100 * limit)
    )


def _with_value(plant: Plant, number: int, value: float) -> list[EffectUse]:
    worn = plant.schedule
    return [
        (e, {**given, worn.parameter: value} if e.name == worn.effect else given)
        for e, given in plant.acting(number)
    ]


def _energy(change: Samples, noise: float) -> float:
    square = float(np.sum(change**2))
    return square / noise**2 if noise else math.inf if square else 0.0


def _max_error(experiment: Experiment, speed: Samples) -> float:
    return float(np.abs(experiment.speed - speed).max())
