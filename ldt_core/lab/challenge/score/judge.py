"""An answer against the truth of its case."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ldt_core.base.errors import LdtError
from ldt_core.effects import get_effect
from ldt_core.lab.challenge.rig import ALIKE
from ldt_core.lab.challenge.score.answer import CaseAnswer, realised
from ldt_core.lab.challenge.score.key import Truth

#: Of the gap on further experiments: an effect that closes so much is as good.
EQUIVALENT_SHARE = 0.95
LEAST_OVERLAP = 0.5  # intersection over union of a place with the true one
NINETY_OVER_95 = 1.645 / 1.96  # half width of a 90 % interval over that of 95 %
ROUNDING = 1e-9  # relative, by which the end of an interval may miss a value at a bound
INSIDE = ("single", "pair", "triple")  # kinds whose truth has a name


@dataclass(frozen=True)
class ParameterError:
    """A parameter as it was found, next to what it is.

    Attributes:
        effect: whose it is.
        parameter: its name.
        measure: size, factor or angle.
        error: relative to the true size; of a factor, to its true distance from 1; of an angle in
            rad. None where the true size is 0.
        absolute: error of a factor; None of others.
        covered: whether the 95 % and the 90 % interval hold the truth; None without an interval.
    """

    effect: str
    parameter: str
    measure: str
    error: float | None
    absolute: float | None
    covered: tuple[bool, bool] | None


@dataclass(frozen=True)
class Judged:
    """An answer and how right it is.

    Attributes:
        truth: of the case.
        answer: to it.
        outcome: see `outcome`.
        group: names for each effect that is said to act, on average; None where none is.
        amounts: of a truth that is named outright.
        place: whether the true place was found; None where the key has none.
        closure: excitation (same, another) to (promised, realised) closed fraction.
    """

    truth: Truth
    answer: CaseAnswer
    outcome: str
    group: float | None
    amounts: tuple[ParameterError, ...]
    place: bool | None
    closure: Mapping[str, tuple[float, float]]

    @property
    def right(self) -> bool:
        """Whether the answer is what it should be for a case of this kind."""
        right = {
            "none": ("none",),
            "outside": ("unknown",),
            "left_out": ("unknown", "equivalent"),
        }
        return self.outcome in right.get(self.truth.kind, ("outright", "group"))


def judge(truth: Truth, answer: CaseAnswer) -> Judged:
    """Compare an answer with the truth."""
    noise = truth.noise if truth.noise is not None else answer.noise
    result = outcome(truth, answer, noise)
    acting = answer.acting
    group = sum(map(len, acting)) / len(acting) if acting else None
    return Judged(
        truth,
        answer,
        result,
        group if truth.kind in INSIDE else None,
        _amounts(truth, answer) if result == "outright" else (),
        place(truth, answer),
        closure(truth, answer, noise),
    )


def outcome(truth: Truth, answer: CaseAnswer, noise: float | None) -> str:
    """What an answer is, in a word.

    none, unknown, failed, unnamed as the answer says; else outright: exactly the true effects;
    group: each true effect in a group of its own, and no group besides; part: true effects only,
    but not all; equivalent: of a truth that was left out, effects that close as much of the gap;
    wrong: a name that is not true.
    """
    if answer.kind not in ("effect", "ambiguous"):
        return answer.kind
    if truth.kind == "left_out":
        part = None if noise is None else realised(answer.further, noise, truth.further_noise)
        return "equivalent" if part is not None and part >= EQUIVALENT_SHARE else "wrong"
    acting, met = answer.acting, matched(truth.effects, answer.acting)
    if len(met) < len(acting) or not acting:
        return "wrong"
    if len(met) < len(truth.effects):
        return "part"
    return "outright" if all(len(group) == 1 for group in acting) else "group"


def matched(effects: Sequence[str], acting: Sequence[Sequence[str]]) -> dict[str, int]:
    """True effects to groups that may be theirs, each to its own, as many as can be."""
    best: dict[str, int] = {}
    for count in range(min(len(effects), len(acting)), 0, -1):
        for names in itertools.combinations(effects, count):
            for places in itertools.permutations(range(len(acting)), count):
                if all(n in acting[k] for n, k in zip(names, places, strict=True)):
                    return dict(zip(names, places, strict=True))
    return best


def _amounts(truth: Truth, answer: CaseAnswer) -> tuple[ParameterError, ...]:
    """Every parameter to which the key gives a value."""
    given = {c["effect"]: c["parameters"] for c in (answer.found or {}).get("candidates", [])}
    found = []
    for effect, own in (truth.parameters or {}).items():
        for name, known in own.items():
            value, there = known.get("value"), given.get(effect, {}).get(name)
            if value is not None and there is not None and there.get("value") is not None:
                found.append(_amount(effect, name, float(value), there))
    return tuple(found)


def _amount(effect: str, name: str, true: float, found: Mapping[str, Any]) -> ParameterError:
    off, measure = float(found["value"]) - true, _measure(effect, name)
    if measure == "angle":
        off = math.remainder(off, 2 * math.pi)
    size = {"angle": 1.0, "factor": abs(true - 1.0), "size": abs(true)}[measure]
    ends, covered = found.get("ci95"), None
    if ends is not None and None not in ends:
        # About the value found, so that an angle may lie a turn away.
        low, high = (float(end) - float(found["value"]) for end in ends)
        slack = ROUNDING * max(abs(true), abs(low), abs(high))
        inside, narrower = (
            k * low - slack <= -off <= k * high + slack for k in (1.0, NINETY_OVER_95)
        )
        covered = inside, narrower
    error = abs(off) / size if size > 0 else None
    return ParameterError(
        effect, name, measure, error, abs(off) if measure == "factor" else None, covered
    )


def _measure(effect: str, name: str) -> str:
    try:
        p = next(p for p in get_effect(effect).parameters if p.name == name)
    except (StopIteration, LdtError):
        return "size"
    if p.cyclic:
        return "angle"
    return "factor" if p.unit == "" and p.default == 1.0 and p.open_low else "size"


def place(truth: Truth, answer: CaseAnswer) -> bool | None:
    """Whether some place of the gap overlaps the true one by half.

    None if the key has no place, or only one that the recording does not reach.
    """
    if truth.place is None or answer.found is None:
        return None if truth.place is None else False
    quantity, size = truth.place["quantity"], bool(truth.place.get("either_sign"))
    reach = answer.seen.get("range", {}).get(quantity, [-math.inf, math.inf])
    low, high = _sizes(*reach) if size else (float(reach[0]), float(reach[1]))
    begin, end = truth.place.get("from"), truth.place.get("to")
    # What the recording does not reach is nobody's to find.
    true = (
        low if begin is None else min(max(float(begin), low), high),
        high if end is None else max(min(float(end), high), low),
    )
    if not true[1] > true[0]:
        return None
    for p in answer.found.get("where", []):
        if p["quantity"] == quantity and p["from"] is not None and p["to"] is not None:
            there = _sizes(p["from"], p["to"]) if size else (float(p["from"]), float(p["to"]))
            if overlap(true, there) >= LEAST_OVERLAP:
                return True
    return False


def _sizes(low: float, high: float) -> tuple[float, float]:
    """Range of the sizes of what lies between two numbers."""
    first, last = sorted((abs(low), abs(high)))
    return (0.0, last) if low < 0 < high else (first, last)


def overlap(a: tuple[float, float], b: tuple[float, float]) -> float:
    """Intersection over union of two ranges."""
    both = min(a[1], b[1]) - max(a[0], b[0])
    either = max(a[1], b[1]) - min(a[0], b[0])
    return max(both, 0.0) / either if either > 0 else float(a == b)


def closure(
    truth: Truth, answer: CaseAnswer, noise: float | None
) -> dict[str, tuple[float, float]]:
    """Promised and realised closed fraction, on further experiments of each excitation.

    Without those of which nothing is promised.
    """
    if answer.promised is None or noise is None:
        return {}
    if answer.kind not in ("effect", "ambiguous", "unnamed"):
        return {}
    parts = {"same": answer.further[:ALIKE]}
    if not answer.refused:
        parts["another"] = answer.further[ALIKE:]
    real = {name: realised(part, noise, truth.further_noise) for name, part in parts.items()}
    return {n: (answer.promised, r) for n, r in real.items() if r is not None}
