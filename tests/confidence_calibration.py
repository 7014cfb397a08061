"""Fit `ldt_core/diagnosis/confidence.json` to scored challenges.

    python -m tests.confidence_calibration FOLDER.score...

Each folder is what `ldt challenge score` left: the answers and `score.json`. A ridge keeps slopes
near 0 that few cases speak for. No probability is stated beyond what so many cases can show: the
ends are Laplace's rule, (right + 1) / (cases + 2) of none right and of all.
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

from ldt_core.base.result_files import write
from ldt_core.diagnosis.confidence import GROUNDS, LEAST, MOST, TABLE, regression

#: Grounds of each kind of verdict; `none` has no search behind it that could speak for it. On 60
#: earlier cases with each left out in turn, the log loss of names falls from 0.40 of the rate alone
#: to 0.38, of unknowns from 0.69 to 0.46; with all grounds it rises to 0.57: few were wrong.
TAKEN = {"named": ("effects",), "unknown": ("left",), "none": ()}
RIDGE = 1.0  # of squared slopes, of grounds in their own deviations: a case's worth of doubt
FEWEST = 12  # cases of a kind, below which only their rate is taken


def cases(folders: Sequence[Path]) -> list[tuple[str, dict[str, float], bool]]:
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


def fitted(known: Sequence[tuple[str, dict[str, float], bool]], kind: str) -> dict[str, Any]:
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


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description="Fit how sure verdicts are.")
    parser.add_argument("folders", nargs="+", type=Path, help="scores to fit it to")
    given = parser.parse_args()
    known = cases(given.folders)
    made = {kind: fitted(known, kind) for kind in TAKEN}
    about = {n: GROUNDS[n] for kind in TAKEN for n in made[kind]["slopes"]}
    write(TABLE, json.dumps({**made, "grounds": about}, indent=1) + "\n")
    print({kind: (m["right"], m["cases"]) for kind, m in made.items()})


if __name__ == "__main__":
    main()
