"""How sure a verdict is: how often such verdicts were right on cases whose truth was known.

Fitted to cases of `ldt challenge`, for each kind of verdict: a rate while they are few, else a
logistic regression of what speaks for it or against it. `python -m tests.confidence_calibration`
writes `confidence.json`. It is a frequency among those cases, and no more: on a machine unlike them
it may be another one.
"""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

#: What speaks for a verdict or against it; a kind's regression takes those that its table names.
GROUNDS = {
    "effects": "effects that act",
    "names": "names for each of them, on average",
    "agreement": "logarithm of the odds that draws of the experiments give the same verdict",
    "left": "decimal logarithm of what is left of the gap's power, in the speed",
    "over_noise": "decimal logarithm of the error on held-out experiments over the noise",
    "margin": "decimal logarithm of what the next set leaves over what this one does",
    "weakest": "decimal logarithm of the gap over what its weakest effect explains beside others",
    "strength": "decimal logarithm of the gap over the noise",
    "prior": "deviations by which the machine file's numbers moved, at most",
    "objected": "1 where a set was found that does not stand by itself",
    "spent": "1 where the search ended at its limit of work",
}
TABLE = Path(__file__).with_name("confidence.json")
#: Ends of a ground: beyond, the cases were too few to tell.
LEAST, MOST = -4.0, 6.0


@functools.cache
def table() -> Mapping[str, Any]:
    """The regressions by kind of verdict (`named`, `unknown`, `none`), and where they are from."""
    return dict(json.loads(TABLE.read_text(encoding="utf-8")))


def decades(power: float, other: float) -> float:
    """Decimal logarithm of a ratio of powers in noise deviations, of which none is below 1.

    Less than one deviation is chance, and may be below 0.
    """
    return math.log10(max(power, 1.0) / max(other, 1.0))


def all_grounds(
    fitted: Mapping[str, float],
    acting: Sequence[Sequence[str]],
    over_noise: float,
    objected: bool,
) -> dict[str, float]:
    """All that speaks for a verdict or against it, by the names of `GROUNDS`.

    Args:
        fitted: what the fitted experiments tell.
        acting: for each effect that acts, the names that it may have.
        over_noise: error on held-out experiments over the noise.
        objected: whether a set was found that does not stand by itself.
    """
    over = math.log10(over_noise) if 0 < over_noise < math.inf else MOST
    names = sum(map(len, acting)) / len(acting) if acting else 0.0
    found = {**fitted, "effects": float(len(acting)), "names": names}
    found |= {"over_noise": over, "objected": float(objected)}
    return {name: round(value, 4) for name, value in found.items()}


def regression(kind: str) -> str:
    """Which regression a verdict of this kind takes."""
    return "named" if kind in ("effect", "ambiguous") else kind


def confidence(kind: str, grounds: Mapping[str, float]) -> float:
    """Probability that such a verdict is right.

    Args:
        kind: none, effect, ambiguous or unknown.
        grounds: by the names of `GROUNDS`; one that is missing counts as 0.
    """
    return probability(table()[regression(kind)], grounds)


def probability(fitted: Mapping[str, Any], grounds: Mapping[str, float]) -> float:
    """The same by one regression of the table."""
    total = float(fitted["constant"])
    for name, slope in fitted["slopes"].items():
        total += slope * min(max(grounds.get(name, 0.0), LEAST), MOST)
    low, high = fitted["range"]
    return float(min(max(1.0 / (1.0 + math.exp(-total)), low), high))
