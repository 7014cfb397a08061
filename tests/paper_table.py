"""The tables of the page `ldt docs paper`, from the results of two studies.

ldt study --seeds 2 --only paper --only better --out study
ldt study --seeds 1 --only trials --out trials
python -m tests.paper_table study trials

keeps the columns that the tables need in `bags/paper.csv` and writes the tables anew. A study that
was interrupted gives the trials that it had finished.
"""

from __future__ import annotations

import csv
import statistics
import sys
from collections.abc import Iterable, Mapping
from itertools import groupby
from pathlib import Path

from ldt_core.base.sentences import listed
from ldt_core.lab.study.robustness.paper_trials import PAPER_TRIALS
from tests.benchmarks.kept import stamp
from tests.page_table import write_table
from tests.robustness_table import results as trial_results

KEPT = Path(__file__).parents[1] / "bags" / "paper.csv"
COLUMNS = ("model", "detector", "seed", "left", "adaptations", "precision", "recall", "taken")
TRIAL = "trial"  # in place of a model: its detector is the trial's name
HEAD = "| model | detector | remaining error | new models | precision | recall |"
Row = Mapping[str, str]


def results(study: Path, trials: Path) -> list[dict[str, str]]:
    """The kept columns of the runs in the folders of both studies."""
    found = []
    for line in _read(study / "table.csv"):
        left = float(line["mme"]) / float(line["mme_original"])
        found.append({**{n: line.get(n, "") for n in COLUMNS}, "left": f"{left:.4f}"})
    for line in trial_results(trials):
        if line["stream"] in PAPER_TRIALS and line["setup"] == TRIAL:
            told = {n: line.get(n, "") for n in ("seed", "adaptations")}
            row = {"model": TRIAL, "detector": line["stream"], "precision": "", "recall": ""}
            found.append({**row, **told, "left": f"{float(line['left']):.4f}"})
    return found


def _read(file: Path) -> list[dict[str, str]]:
    with file.open(newline="", encoding="utf-8") as text:
        return list(csv.DictReader(text))


def rows() -> list[dict[str, str]]:
    """The lines of the kept result file."""
    return _read(KEPT)


def table(found: Iterable[Row]) -> str:
    """Markdown: a line for each model and detector, means over seeds."""
    runs = sorted((r for r in found if r["model"] != TRIAL), key=_pair)
    lines = [HEAD, "|---" * 6 + "|"]
    for (model, detector), members in groupby(runs, key=_pair):
        own = list(members)
        left, precision, recall = (_shares(own, n) for n in ("left", "precision", "recall"))
        models = statistics.fmean(float(r["adaptations"]) for r in own)
        cells = (model, detector, left, f"{models:.0f}", precision, recall)
        lines.append(f"| {' | '.join(cells)} |")
    seeds = len({r["seed"] for r in runs})
    told = f"Means over {seeds} streams of 200 experiments, the least and the most in brackets."
    taken = listed(sorted({r["taken"] for r in runs}))
    return "\n".join([*lines, "", f"{told} Added on {taken}.", ""])


def trial_table(found: Iterable[Row]) -> str:
    """Markdown: a line for each trial, from the least that it leaves to the most."""
    runs = sorted((r for r in found if r["model"] == TRIAL), key=lambda r: float(r["left"]))
    lines = ["| what differs | remaining error |", "|---|---|"]
    for run in runs:
        about = PAPER_TRIALS[run["detector"]].about
        lines.append(f"| {about} | {100 * float(run['left']):.0f} % |")
    return "\n".join([*lines, ""])


def _pair(row: Row) -> tuple[str, str]:
    return row["model"], row["detector"]


def _shares(found: Iterable[Row], name: str) -> str:
    values = [100 * float(r[name]) for r in found if r[name]]
    if not values:
        return ""
    return f"{statistics.fmean(values):.0f} % ({min(values):.0f} to {max(values):.0f})"


def main(study: str, trials: str) -> int:
    """Write tables and kept columns."""
    with KEPT.open("w", newline="", encoding="utf-8") as text:
        writer = csv.DictWriter(text, COLUMNS)
        writer.writeheader()
        now = stamp()
        taken = f"{now['day']} with commit {now['commit']}"
        writer.writerows({**r, "taken": taken} for r in results(Path(study), Path(trials)))
    write_table("paper", table(rows()))
    write_table("paper", trial_table(rows()), "trials")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(*sys.argv[1:]))
