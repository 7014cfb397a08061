"""A study with its truths and scores at hand: what figures and page read, worked out once."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ldt_core.lab.study.case import Result
from ldt_core.lab.study.scores import Score, score
from ldt_core.lab.study.statistics import Estimate, mean
from ldt_core.lab.study.study import Study


class Reading:
    """A study as figures and page see it.

    Args:
        study: what was run.
    """

    def __init__(self, study: Study) -> None:
        self.study = study

        self._scores: dict[int, Score] = {}
        self._beside: dict[int, dict[str, Score]] = {}

    def score(self, result: Result) -> Score:
        """The figures of a run of the study, worked out once."""
        # By identity: the study holds its results, and naming a case costs more than scoring it.
        if id(result) not in self._scores:
            self._scores[id(result)] = score(result, self.study.facts_of(result))
        return self._scores[id(result)]

    def of(self, results: Iterable[Result], figure: str) -> Estimate:
        """Mean and interval over seeds of one figure of `Score`."""
        return mean(getattr(self.score(r), figure) for r in results)

    def beside(self, results: Sequence[Result], figure: str) -> dict[str, Estimate]:
        """Baseline → the same figure of it, on the same streams."""
        values: dict[str, list[float | None]] = {}
        for result in results:
            for name, found in self._baselines(result).items():
                values.setdefault(name, []).append(getattr(found, figure))
        return {name: mean(v) for name, v in values.items()}

    def best(self, model: str | None = None) -> tuple[str, str] | None:
        """(model, detector) beyond the paper with the least MME over the seeds.

        Args:
            model: whose detectors to choose from; None: of all.
        """
        found: list[tuple[float, tuple[str, str]]] = []
        for pair in self.study.pairs("better"):
            if model is None or pair[0] == model:
                results = self.study.results("better", model=pair[0], detector=pair[1])
                mme = self.of(results, "mme").value
                if mme is not None:
                    found.append((mme, pair))
        return min(found)[1] if found else None

    def _baselines(self, result: Result) -> dict[str, Score]:
        if id(result) not in self._beside:
            facts = self.study.facts_of(result)
            others = self.study.baselines(result)
            self._beside[id(result)] = {n: score(r, facts) for n, r in others.items()}
        return self._beside[id(result)]
