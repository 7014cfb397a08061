"""Fit `ldt_core/diagnosis/confidence.json` to scored challenges.

    python -m tests.confidence_calibration [FOLDER.score...]

Each folder is what `ldt challenge score` left: the answers and `score.json`. What the fit needs of
them is kept in `bags/confidence_cases.json`; without a folder, it is fitted to these cases. Printed
is how well cases are foretold that took no part in a fit.

A ridge keeps slopes near 0 that few cases speak for. No probability is stated beyond what so many
cases can show: the ends are Laplace's rule, (right + 1) / (cases + 2) of none right and of all.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize

from ldt_core.base.arrays import Array
from ldt_core.base.result_files import write
from ldt_core.diagnosis.confidence import GROUNDS, LEAST, MOST, TABLE, probability, regression
from tests.challenge_table import BINS

KEPT = Path(__file__).parents[1] / "bags" / "confidence_cases.json"
#: Grounds of each kind of verdict; `none` has no search behind it that could speak for it. Of the
#: sets tried, these foretell the cases that are left out of a fit best; and a search that ended
#: early has not shown that no known effect explains a gap. (Two names did: too few to tell.)
TAKEN = {
    "named": ("margin", "weakest", "left"),
    "unknown": ("left", "over_noise", "strength", "spent"),
    "none": (),
}
RIDGE = 1.0  # of squared slopes, of grounds in their own deviations: a case's worth of doubt
FEWEST = 12  # cases of a kind, below which only their rate is taken
FOLDS = 10
Known = tuple[str, dict[str, float], bool]


def cases(folders: Sequence[Path]) -> list[Known]:
    """(regression, grounds, whether it was right) of every scored answer."""
    found = []
    for folder in folders:
        score = json.loads((folder / "score.json").read_text(encoding="utf-8"))
        for case in score["cases"]:
            if case["who"] != "diagnosis" or case["verdict"] == "failed":
                continue
            text = (folder / case["case"] / "diagnosis.json").read_text(encoding="utf-8")
            verdict = json.loads(text)["verdict"]
            found.append((regression(verdict["kind"]), verdict["grounds"], bool(case["right"])))
    return found


def kept_cases() -> list[Known]:
    """Those that the table is fitted to."""
    return [(kind, grounds, right) for kind, grounds, right in json.loads(KEPT.read_text("utf-8"))]


def fitted(known: Sequence[Known], kind: str) -> dict[str, Any]:
    """The regression of one kind of verdict."""
    own = [(g, right) for k, g, right in known if k == kind]
    right = np.array([r for _, r in own], dtype=float)
    rate = (right.sum() + 1) / (right.size + 2)
    about: dict[str, Any] = {"cases": len(own), "right": int(right.sum())}
    about["range"] = [round(1 / (len(own) + 2), 4), round((len(own) + 1) / (len(own) + 2), 4)]
    if len(own) < FEWEST or not 0 < right.sum() < right.size or not TAKEN[kind]:
        return {**about, "constant": round(math.log(rate / (1 - rate)), 5), "slopes": {}}
    names = TAKEN[kind]
    x = np.array([[g.get(n, 0.0) for n in names] for g, _ in own]).reshape(len(own), len(names))
    x = np.clip(x, LEAST, MOST)
    middle, size = x.mean(axis=0), np.maximum(x.std(axis=0), 1e-9)
    x = (x - middle) / size

    def loss(b: np.ndarray) -> float:
        z = b[0] + x @ b[1:]
        return float(np.sum(np.logaddexp(0.0, z) - right * z) + 0.5 * RIDGE * np.sum(b[1:] ** 2))

    start = np.concatenate([[math.log(rate / (1 - rate))], np.zeros(len(names))])
    found = minimize(loss, start).x
    slopes = found[1:] / size
    return {
        **about,
        "constant": round(float(found[0] - slopes @ middle), 5),
        "slopes": {n: round(float(s), 5) for n, s in zip(names, slopes, strict=True)},
    }


def foretold(known: Sequence[Known], kind: str) -> tuple[Array, Array]:
    """(probability of each case by a fit to the other nine tenths, whether it was right)."""
    own = [c for c in known if c[0] == kind]
    found = np.zeros(len(own))
    for fold in np.array_split(np.random.default_rng(0).permutation(len(own)), FOLDS):
        left_out = set(fold.tolist())
        made = fitted([c for i, c in enumerate(own) if i not in left_out], kind)
        found[fold] = [probability(made, own[i][1]) for i in fold]
    return found, np.array([right for *_, right in own])


def report(known: Sequence[Known], kind: str) -> str:
    """Mean log loss by the rate alone and by the regression, and the share right by confidence."""
    p, right = foretold(known, kind)
    rate = (right.sum() + 1) / (right.size + 2)
    losses = (-np.log(np.where(right, q, 1 - q)).mean() for q in (np.full(right.size, rate), p))
    lines = ["{}: log loss {:.3f} by the rate, {:.3f} foretold".format(kind, *losses)]
    for low, high in BINS:
        inside = (p > low) & (p <= high)
        if inside.any():
            count = int(inside.sum())
            shares = f"{p[inside].mean():.2f} stated, {right[inside].mean():.2f} right"
            lines.append(f"  above {low}: {shares} of {count}")
    return "\n".join(lines)


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description="Fit how sure verdicts are.")
    parser.add_argument("folders", nargs="*", type=Path, help="scores to fit it to")
    given = parser.parse_args()
    if given.folders:
        write(KEPT, "[\n" + ",\n".join(map(json.dumps, cases(given.folders))) + "\n]\n")
    known = kept_cases()
    made = {kind: fitted(known, kind) for kind in TAKEN}
    about = {n: GROUNDS[n] for kind in TAKEN for n in made[kind]["slopes"]}
    write(TABLE, json.dumps({**made, "grounds": about}, indent=1) + "\n")
    for kind, m in made.items():
        print(f"{m['right']} of {m['cases']} right, " + report(known, kind))


if __name__ == "__main__":
    main()
