"""A study with its truths and scores at hand: what figures and page read, worked out once."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Sequence

from ldt_core.study.case import Result
from ldt_core.study.scores import Score, score
from ldt_core.study.statistics import Estimate, mean
from ldt_core.study.study import Study


class Reading:
    """A study as figures and page see it.

    Args:
        study: what was run.
    """

    def __init__(self, study: Study) -> None:
        self.study = study

    @functools.cached_property
    def scores(self) -> dict[str, Score]:
        """`Case.key` → score, of every run."""
        return {r.case.key: score(r, self.study.facts_of(r)) for r in self.study.results()}

    def of(self, results: Iterable[Result], figure: str) -> Estimate:
        """Mean and interval over seeds of one figure of `Score`."""
        return mean(getattr(self.scores[r.case.key], figure) for r in results)

    def beside(self, results: Sequence[Result], figure: str) -> dict[str, Estimate]:
        """Baseline → the same figure of it, on the same streams."""
        values: dict[str, list[float | None]] = {}
        for result in results:
            for name, other in self.study.baselines(result).items():
                found = score(other, self.study.facts_of(result))
                values.setdefault(name, []).append(getattr(found, figure))
        return {name: mean(v) for name, v in values.items()}
