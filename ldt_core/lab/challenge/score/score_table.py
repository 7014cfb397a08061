"""All figures of a score, one a row: who, which figure, of which cases."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ldt_core.lab.challenge.score.judge import INSIDE, Judged
from ldt_core.lab.statistics import Interval, proportion, resampled

CONFIDENCES = (0.0, 0.5, 0.8, 0.9, 0.97, 1.0)  # edges of the bins of the reliability table
POINTS = 0.05  # of a closed fraction
EVERY = "all"
#: Kinds of cases as a score tells them apart; `named` is all whose truth has a name.
KINDS = (*INSIDE, "named", "none", "outside", "left_out", EVERY)
#: Figures that are shares of outcomes: name, outcomes.
OUTCOMES = {
    "named outright": "outright",
    "in its group": "group",
    "named in part": "part",
    "wrong name": "wrong",
    "called unknown": "unknown",
    "called none": "none",
    "equivalent": "equivalent",
    "failed": "failed",
}


@dataclass(frozen=True)
class ScoreRow:
    """A figure.

    Attributes:
        who: the diagnosis or a comparator.
        figure: its name.
        kind: of the cases, see KINDS.
        estimate: value, interval and how many (cases, or parameters) it is from.
    """

    who: str
    figure: str
    kind: str
    estimate: Interval

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {"who": self.who, "figure": self.figure, "kind": self.kind, **_plain(self.estimate)}


class ScoreTable:
    """The rows of everybody.

    Args:
        judged: of each who answers, one for each case.
    """

    def __init__(self, judged: Mapping[str, Sequence[Judged]]) -> None:
        self.judged = judged
        self.rows = [row for who, found in judged.items() for row in _rows(who, found)]
        self._known = {(r.who, r.figure, r.kind): r.estimate for r in self.rows}

    def get(self, who: str, figure: str, kind: str = EVERY) -> Interval | None:
        """A figure; None where no case has it."""
        return self._known.get((who, figure, kind))


def _rows(who: str, judged: Sequence[Judged]) -> list[ScoreRow]:
    found = []
    for kind in KINDS:
        if chosen := [j for j in judged if _is(j, kind)]:
            for figure, estimate in _figures(chosen).items():
                if estimate.count:
                    found.append(ScoreRow(who, figure, kind, estimate))
    return found


def _is(j: Judged, kind: str) -> bool:
    return kind in (EVERY, j.truth.kind) or (kind == "named" and j.truth.kind in INSIDE)


def _figures(judged: Sequence[Judged]) -> dict[str, Interval]:
    figures = {}
    if any(j.outcome != "unnamed" for j in judged):
        figures["right"] = _share([j.right for j in judged])
        figures |= {
            figure: _share([j.outcome == outcome for j in judged])
            for figure, outcome in OUTCOMES.items()
        }
        figures |= _reliability(judged)
    groups = [[j.group] for j in judged if j.group is not None]
    figures["names in a group"] = resampled(groups, _mean)
    figures |= _amounts(judged)
    figures["place right"] = _share([j.place for j in judged if j.place is not None])
    for excitation in ("same", "another"):
        figures |= _closure(judged, excitation)
    able = [j for j in judged if j.answer.promised is not None and j.answer.acting]
    figures["closure refused, another excitation"] = _share([bool(j.answer.refused) for j in able])
    seconds = [[j.answer.seconds] for j in judged]
    figures["CPU seconds, median"] = resampled(seconds, _median)
    most = max(j.answer.seconds for j in judged)
    figures["CPU seconds, most"] = Interval(most, -math.inf, math.inf, len(judged))
    return figures


def _reliability(judged: Sequence[Judged]) -> dict[str, Interval]:
    """Share of right answers among those of a stated confidence, bin by bin."""
    stated = [
        (float((j.answer.found or {}).get("verdict", {}).get("confidence") or 0.0), j.right)
        for j in judged
        if j.outcome not in ("failed", "unnamed")
    ]
    found = {}
    for low, high in itertools.pairwise(CONFIDENCES):
        inside = [(c, right) for c, right in stated if low < c <= high]
        found[f"confidence {low:g} to {high:g}: right"] = _share([r for _, r in inside])
        found[f"confidence {low:g} to {high:g}: stated"] = resampled(
            [[c] for c, _ in inside], _mean
        )
    return found


def _amounts(judged: Sequence[Judged]) -> dict[str, Interval]:
    def errors(*measures: str) -> list[list[float]]:
        return [
            [a.error for a in j.amounts if a.measure in measures and a.error is not None]
            for j in judged
        ]

    found = [a for j in judged for a in j.amounts]
    factors = [[a.absolute for a in j.amounts if a.absolute is not None] for j in judged]
    known = [a.covered for a in found if a.covered is not None]
    return {
        "amounts: relative error": resampled(errors("size", "factor"), _median),
        "amounts: error of a factor": resampled(factors, _median),
        "amounts: error of an angle [rad]": resampled(errors("angle"), _median),
        "amounts: with an interval": _share([a.covered is not None for a in found]),
        "amounts: 95 % interval covers": _share([c[0] for c in known]),
        "amounts: 90 % interval covers": _share([c[1] for c in known]),
    }


def _closure(judged: Sequence[Judged], excitation: str) -> dict[str, Interval]:
    pairs = [j.closure[excitation] for j in judged if excitation in j.closure]
    off = [abs(promised - real) for promised, real in pairs]
    where = f"{excitation} excitation"
    return {
        f"closure within 5 points, {where}": _share([o <= POINTS for o in off]),
        f"closure off by, {where}": resampled([[o] for o in off], _median),
        f"closure realised, {where}": resampled([[real] for _, real in pairs], _median),
    }


def _share(right: Sequence[bool | None]) -> Interval:
    return proportion(sum(map(bool, right)), len(right), method="wilson")


def _plain(estimate: Interval) -> dict[str, Any]:
    plain = estimate.as_dict()
    if plain["value"] is not None and not math.isfinite(plain["value"]):
        plain["value"] = None
    return plain


_mean: Callable[[np.ndarray], float] = np.mean
_median: Callable[[np.ndarray], float] = np.median
