"""All figures of a score, one a row: who, which figure, of which cases."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ldt_core.lab.challenge.score.judge import INSIDE, Judged
from ldt_core.lab.study.statistics import Interval, proportion, resampled

POINTS = 0.05  # of a closed fraction
BINS = {  # signal to noise ratio: from, to
    "< 1": (0.0, 1.0),
    "1-3": (1.0, 3.0),
    "3-10": (3.0, 10.0),
    "> 10": (10.0, math.inf),
}
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
UNNAMED = ("wrong name", "called unknown", "called none", "failed")
#: Outcomes that cases of a kind can have; all but `equivalent` where the truth has a name.
POSSIBLE = {
    "none": UNNAMED,
    "outside": UNNAMED,
    "left_out": ("equivalent", *UNNAMED),
    EVERY: ("failed",),
}
NAMED = tuple(name for name in OUTCOMES if name != "equivalent")


@dataclass(frozen=True)
class ScoreRow:
    """A figure.

    Attributes:
        who: the diagnosis or a comparator.
        figure: its name.
        kind: of the cases, see KINDS.
        signal_to_noise: one of BINS, or all.
        estimate: value, interval and how many (cases, or parameters) it is from.
    """

    who: str
    figure: str
    kind: str
    signal_to_noise: str
    estimate: Interval

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        about = {"who": self.who, "figure": self.figure, "kind": self.kind}
        return {**about, "signal_to_noise": self.signal_to_noise, **_plain(self.estimate)}


class ScoreTable:
    """The rows of everybody.

    Args:
        judged: of each who answers, one for each case.
    """

    def __init__(self, judged: Mapping[str, Sequence[Judged]]) -> None:
        self.judged = judged
        self.rows = [row for who, found in judged.items() for row in _rows(who, found)]
        self._known = {(r.who, r.figure, r.kind, r.signal_to_noise): r.estimate for r in self.rows}

    def get(self, who: str, figure: str, kind: str = EVERY, bin: str = EVERY) -> Interval | None:
        """A figure; None where no case has it."""
        return self._known.get((who, figure, kind, bin))


def _rows(who: str, judged: Sequence[Judged]) -> list[ScoreRow]:
    found = []
    for kind in KINDS:
        of_kind = [j for j in judged if _is(j, kind)]
        for name in (EVERY, *BINS):
            chosen = [j for j in of_kind if name == EVERY or _within(j, name)]
            if not chosen or (kind == "none" and name != EVERY):
                continue
            for figure, estimate in _figures(chosen, kind).items():
                if estimate.count:
                    found.append(ScoreRow(who, figure, kind, name, estimate))
    return found


def _is(j: Judged, kind: str) -> bool:
    return kind in (EVERY, j.truth.kind) or (kind == "named" and j.truth.kind in INSIDE)


def _within(j: Judged, name: str) -> bool:
    ratio = j.truth.signal_to_noise
    return ratio is not None and BINS[name][0] <= ratio < BINS[name][1] and j.truth.kind != "none"


def _figures(judged: Sequence[Judged], kind: str) -> dict[str, Interval]:
    figures = {}
    if any(j.outcome != "unnamed" for j in judged):
        figures["right"] = _share([j.right for j in judged])
        figures |= {
            figure: _share([j.outcome == OUTCOMES[figure] for j in judged])
            for figure in POSSIBLE.get(kind, NAMED)
        }
    groups = [[j.group] for j in judged if j.group is not None]
    figures["names in a group"] = resampled(groups, _mean)
    figures |= _amounts(judged)
    figures["place right"] = _share([j.place for j in judged if j.place is not None])
    for excitation in ("same", "another"):
        figures |= _closure(judged, excitation)
    seconds = [[j.answer.seconds] for j in judged]
    figures["CPU seconds, median"] = resampled(seconds, _median)
    most = max(j.answer.seconds for j in judged)
    figures["CPU seconds, most"] = Interval(most, -math.inf, math.inf, len(judged))
    return figures


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
