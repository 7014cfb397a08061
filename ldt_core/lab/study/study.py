"""A whole study in memory, with the scores of its runs: what claims, figures, tables, page read."""

from __future__ import annotations

import functools
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ldt_core.base.errors import OptionError, did_you_mean
from ldt_core.lab.statistics import Interval, geometric_mean, mean
from ldt_core.lab.study import GROUPS
from ldt_core.lab.study.baselines import never
from ldt_core.lab.study.facts import Facts, stream_key
from ldt_core.lab.study.robustness.alarm_trials import AlarmCount
from ldt_core.lab.study.robustness.robust_run import RobustRun
from ldt_core.lab.study.scores import RunScore, scores_of
from ldt_core.lab.study.study_case import RunResult


@dataclass(frozen=True)
class Entry:
    """One run in its place.

    Args:
        result: what came of it.
        groups: names in `GROUPS` that it serves.
        beside: keys (`StudyCase.key`) of the runs whose baseline it is.
    """

    result: RunResult
    groups: tuple[str, ...]
    beside: tuple[str, ...] = ()


@dataclass(frozen=True)
class Study:
    """All runs of a study.

    Args:
        settings: what was asked for: seeds, experiments, machine, groups, …
        entries: the runs, in the order of the plan.
        facts: `stream_key` → the truth about that stream.
        notes: sentences for the reader.
        robust: the runs of the groups robustness and trials.
        alarms: the counts of the group alarms.
    """

    settings: dict[str, Any]
    entries: tuple[Entry, ...]
    facts: Mapping[str, Facts] = field(default_factory=dict)
    notes: tuple[str, ...] = field(default=())
    robust: tuple[RobustRun, ...] = field(default=())
    alarms: tuple[AlarmCount, ...] = field(default=())

    def results(
        self, group: str | None = None, model: str = "", detector: str = ""
    ) -> list[RunResult]:
        """The results of one group (None: of all), in the order of the plan.

        Args:
            group: name in `GROUPS`.
            model: whose runs alone.
            detector: whose runs alone.

        Raises:
            OptionError: no such group.
        """
        if group is not None and group not in GROUPS:
            raise OptionError("group of a study", did_you_mean(group, GROUPS), repr(group))
        found = [e.result for e in self.entries if group is None or group in e.groups]
        return [
            r
            for r in found
            if r.case.model == (model or r.case.model)
            and r.case.detector == (detector or r.case.detector)
        ]

    def facts_of(self, result: RunResult) -> Facts | None:
        """The truth about the stream of a run, where it is known."""
        return self.facts.get(stream_key(result.case))

    def baselines(self, result: RunResult) -> dict[str, RunResult]:
        """The runs to compare a run with: "never" always; "periodic" and "random" where planned.

        "never" is the original model on the same stream, "periodic" and "random" learned as often
        as the run, by the calendar and by chance.
        """
        key = result.case.key
        beside = [e.result for e in self.entries if key in e.beside]
        return {"never": never(result)} | {r.case.detector: r for r in beside}

    def pairs(self, group: str) -> dict[tuple[str, str], list[RunResult]]:
        """(model, detector) → results of the group, in the order of the plan."""
        found: dict[tuple[str, str], list[RunResult]] = {}
        for result in self.results(group):
            found.setdefault((result.case.model, result.case.detector), []).append(result)
        return found


#: Detector → the parameter that is its threshold.
THRESHOLD_OF = {"threshold": "threshold", "lddm": "error_threshold"}

#: Seed → run: what two groups of runs are compared by.
BySeed = dict[int, "ScoredRun"]
Figure = Callable[["ScoredRun"], float | None]


@dataclass(frozen=True)
class ScoredRun:
    """A run with its figures."""

    result: RunResult
    score: RunScore
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
    """A study by group, model, detector and threshold; every score is worked out once.

    Args:
        study: the runs, and the facts of their streams where there are any.
    """

    def __init__(self, study: Study) -> None:
        self.study = study
        # By identity: naming a case costs more than scoring it, and a run holds its result.
        self._runs: dict[int, ScoredRun] = {}
        self._baselines: dict[int, dict[str, ScoredRun]] = {}

    def run(self, result: RunResult) -> ScoredRun:
        """A result with its figures."""
        if id(result) not in self._runs:
            facts = self.study.facts_of(result)
            self._runs[id(result)] = ScoredRun(result, scores_of(result, facts), facts)
        return self._runs[id(result)]

    def baselines(self, result: RunResult) -> dict[str, ScoredRun]:
        """Name → the run that a run is compared with, see `Study.baselines`."""
        if id(result) not in self._baselines:
            found = self.study.baselines(result)
            self._baselines[id(result)] = {name: self.run(r) for name, r in found.items()}
        return self._baselines[id(result)]

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
        found = {seed: self.baselines(run.result).get(name) for seed, run in runs.items()}
        return {seed: run for seed, run in found.items() if run is not None}

    def of(self, results: Iterable[RunResult], figure: str) -> Interval:
        """Mean and interval over seeds of one figure of `RunScore`."""
        return mean(getattr(self.run(r).score, figure) for r in results)

    def best(self, model: str | None = None) -> tuple[str, str] | None:
        """(model, detector) beyond the paper with the least MME over the seeds.

        Args:
            model: whose detectors to choose from; None: of all.
        """
        found: list[tuple[float, tuple[str, str]]] = []
        for pair, results in self.study.pairs("better").items():
            if model is None or pair[0] == model:
                mme = self.of(results, "mme").value
                if mme is not None:
                    found.append((mme, pair))
        return min(found)[1] if found else None


def over(runs: BySeed | Iterable[ScoredRun], figure: Figure) -> Interval:
    """Mean and interval over seeds of a figure of each run."""
    return mean(figure(r) for r in _each(runs))


def shares(runs: BySeed | Iterable[ScoredRun], figure: Figure) -> Interval:
    """Geometric mean and interval over seeds of a share that each run has."""
    return geometric_mean(figure(r) for r in _each(runs))


def difference(first: BySeed, second: BySeed, figure: Figure) -> Interval:
    """Mean and interval of first minus second, paired by seed: both ran on the same stream."""
    pairs = _pairs(first, second, figure)
    return mean(None if a is None or b is None else a - b for a, b in pairs)


def ratio(first: BySeed, second: BySeed, figure: Figure) -> Interval:
    """Geometric mean and interval of first / second, paired by seed: for errors."""
    pairs = _pairs(first, second, figure)
    return geometric_mean(a / b if a is not None and b else None for a, b in pairs)


def _each(runs: BySeed | Iterable[ScoredRun]) -> Iterable[ScoredRun]:
    return runs.values() if isinstance(runs, dict) else runs


def _pairs(
    first: BySeed, second: BySeed, figure: Figure
) -> list[tuple[float | None, float | None]]:
    common = sorted(first.keys() & second.keys())
    return [(figure(first[seed]), figure(second[seed])) for seed in common]
