"""The runs of a study, put in order for those who draw conclusions from them."""

from __future__ import annotations

import functools
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ldt_core.lab.study.case import Result
from ldt_core.lab.study.facts import Facts
from ldt_core.lab.study.scores import Score, score
from ldt_core.lab.study.statistics import Estimate, geometric_mean, mean
from ldt_core.lab.study.study import Study

#: Detector → the parameter that is its threshold.
THRESHOLD_OF = {"threshold": "threshold", "lddm": "error_threshold"}
ACTIVE = ("threshold", "lddm")
PASSIVE = "window"
PAPER_DETECTORS = (*ACTIVE, PASSIVE)
PAPER_MODELS = ("linear", "hybrid")

#: Seed → run: what two groups of runs are compared by.
BySeed = dict[int, "Run"]


@dataclass(frozen=True)
class Run:
    """A run with its figures."""

    result: Result
    score: Score
    facts: Facts | None

    @functools.cached_property
    def levels(self) -> dict[float, list[int]]:
        """Value of what wears → places of its experiments in the rows."""
        places: dict[float, list[int]] = defaultdict(list)
        for place, value in enumerate(self.result.truth):
            places[value].append(place)
        return dict(sorted(places.items()))

    def by_level(self, row: Sequence[float]) -> tuple[list[float], list[float]]:
        """(values of what wears, mean of a row over the experiments with each)."""
        values = list(self.levels)
        return values, [float(np.mean([row[i] for i in self.levels[v]])) for v in values]

    @property
    def adapted(self) -> list[int]:
        """1 in each experiment after which a new model came into force, else 0."""
        return [int(action == "adapted") for action in self.result.action]


class Evidence:
    """A study by group, model, detector and threshold.

    Args:
        study: the runs, and the facts of their streams where there are any.
    """

    def __init__(self, study: Study) -> None:
        self.study = study
        self._runs: dict[int, Run] = {}

    def run(self, result: Result) -> Run:
        """A result with its figures, worked out once."""
        name = id(result)  # stays its own: the run holds the result
        if name not in self._runs:
            facts = self.study.facts_of(result)
            self._runs[name] = Run(result, score(result, facts), facts)
        return self._runs[name]

    @functools.cached_property
    def _groups(self) -> dict[tuple[str, str, str], BySeed]:
        groups: dict[tuple[str, str, str], BySeed] = defaultdict(dict)
        for entry in self.study.entries:
            case = entry.result.case
            for group in entry.groups:
                runs = groups[group, case.model, case.detector]
                runs.setdefault(case.seed, self.run(entry.result))
        return groups

    @functools.cached_property
    def _sweeps(self) -> dict[tuple[str, str], dict[float, BySeed]]:
        sweeps: dict[tuple[str, str], dict[float, BySeed]] = defaultdict(lambda: defaultdict(dict))
        for result in self.study.results("sweep"):
            case = result.case
            if case.detector in THRESHOLD_OF:
                value = float(case.resolved[THRESHOLD_OF[case.detector]])
                sweeps[case.model, case.detector][value][case.seed] = self.run(result)
        return sweeps

    def runs(self, model: str, detector: str, group: str = "paper") -> BySeed:
        """The runs of a model under a detector; empty when there are none."""
        return self._groups.get((group, model, detector), {})

    def sweep(self, model: str, detector: str) -> dict[float, BySeed]:
        """Threshold → runs, in order of the threshold; empty without a sweep."""
        return dict(sorted(self._sweeps.get((model, detector), {}).items()))

    def baseline(self, runs: BySeed, name: str) -> BySeed:
        """Of each run the baseline of that name beside it, where there is one."""
        found = {s: self.study.baselines(r.result).get(name) for s, r in runs.items()}
        return {s: self.run(result) for s, result in found.items() if result is not None}


def over(runs: Iterable[Run], figure: Callable[[Run], float | None]) -> Estimate:
    """Mean and interval over seeds of a figure of each run."""
    return mean(figure(r) for r in runs)


def difference(first: BySeed, second: BySeed, figure: Callable[[Run], float | None]) -> Estimate:
    """Mean and interval of first minus second, paired by seed: both ran on the same stream."""
    values = []
    for seed in sorted(first.keys() & second.keys()):
        one, other = figure(first[seed]), figure(second[seed])
        values.append(None if one is None or other is None else one - other)
    return mean(values)


def ratio(first: BySeed, second: BySeed, figure: Callable[[Run], float | None]) -> Estimate:
    """Geometric mean and interval of first / second, paired by seed: for errors."""
    values = []
    for seed in sorted(first.keys() & second.keys()):
        one, other = figure(first[seed]), figure(second[seed])
        values.append(one / other if one is not None and other else None)
    return geometric_mean(values)


def shares(runs: Iterable[Run], figure: Callable[[Run], float | None]) -> Estimate:
    """Geometric mean and interval over seeds of a share that each run has."""
    return geometric_mean(figure(r) for r in runs)


def left(run: Run) -> float | None:
    """What the learning twin leaves of the original's MME."""
    return run.score.share


def mme(run: Run) -> float:
    """MME of the learning twin [rad/s]."""
    return run.score.mme


def adaptations(run: Run) -> float:
    """Number of new models."""
    return float(run.score.adaptations)
