"""A whole study in memory: what scores, claims and page read, and nothing else."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from ldt_core.base.errors import OptionError, did_you_mean
from ldt_core.lab.study import GROUPS
from ldt_core.lab.study.baselines import never
from ldt_core.lab.study.facts import Facts, stream_key
from ldt_core.lab.study.study_case import RunResult, StudyCase

_CASE = tuple(f.name for f in dataclasses.fields(StudyCase))


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
        missing: runs of the plan that are not there (an interrupted study).
        notes: sentences for the reader.
    """

    settings: dict[str, Any]
    entries: tuple[Entry, ...]
    facts: Mapping[str, Facts] = field(default_factory=dict)
    missing: int = 0
    notes: tuple[str, ...] = field(default=())

    def results(self, group: str | None = None, **criteria: Any) -> list[RunResult]:
        """The results of one group (None: of all), in the order of the plan.

        Args:
            group: name in `GROUPS`.
            criteria: field of `StudyCase` or parameter (`parameters.yaml`) → the value it must
                have; a tuple or set of values: one of them.

        Raises:
            OptionError: no such group, field or parameter.

        Examples:
            study.results("paper", model="hybrid", detector="lddm")
            study.results("kinds", degradation=("abrupt", "ramp"))
        """
        if group is not None and group not in GROUPS:
            raise OptionError("group of a study", did_you_mean(group, GROUPS), repr(group))
        found = [e.result for e in self.entries if group is None or group in e.groups]
        return [r for r in found if all(_is(r.case, n, v) for n, v in criteria.items())]

    def facts_of(self, result: RunResult) -> Facts | None:
        """The truth about the stream of a run; None in an interrupted study."""
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


def _value(case: StudyCase, name: str) -> Any:
    if name in _CASE:
        return getattr(case, name)
    resolved = case.resolved
    if name not in resolved:
        known: Iterable[str] = [*_CASE, *resolved]
        raise OptionError("criterion of a study", did_you_mean(name, known), repr(name))
    return resolved[name]


def _is(case: StudyCase, name: str, wanted: Any) -> bool:
    value = _value(case, name)
    return value in wanted if isinstance(wanted, tuple | set | frozenset) else value == wanted
