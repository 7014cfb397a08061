"""A study as tables: one row a run for other programs, and the paper's Table 1 for people."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from ldt_core.base.result_files import csv_text, write
from ldt_core.lab.study.robustness.robust_run import DEFAULT, score_run
from ldt_core.lab.study.scores import scores_of
from ldt_core.lab.study.study import Evidence, Study
from ldt_core.lab.study.study_plan import PAPER_DRIFTS

TABLE = "table.csv"
RUNS = "runs.csv"
ROBUST = "robustness.csv"
COLUMNS = (
    *("model", "detector", "seed", "mme", "mme_original"),
    *("adaptations", "precision", "recall"),
)
#: Groups whose runs are in the table.
TABULATED = ("paper", "better")
#: Parameters that tell the runs of a study apart.
SETTINGS = (
    *("gate", "data", "threshold", "warning_threshold", "error_threshold"),
    *("window", "degradation", "start"),
)
PAPER_ORIGINAL = 10.09  # rad/s, MME of the original model in the paper
#: Table 1 of the paper: one run of each model, under a detector that it does not name.
PAPER: dict[str, dict[str, float]] = {
    model: {
        "mme": mme,
        "mme_original": PAPER_ORIGINAL,
        "share": mme / PAPER_ORIGINAL,
        "adaptations": adaptations,
        "precision": precision,
        "recall": recall,
        "drifts": PAPER_DRIFTS,
    }
    for model, mme, adaptations, precision, recall in (
        ("linear", 8.86, 44, 0.06, 0.33),
        ("hybrid", 6.86, 25, 0.12, 0.33),
    )
}
FIGURES = ("mme", "mme_original", "share", "adaptations", "precision", "recall")


def table_rows(study: Study) -> list[dict[str, Any]]:
    """The rows of `table.csv`: one for each run of the groups paper and better."""
    runs = [e.result for e in study.entries if set(TABULATED) & set(e.groups)]
    scores = [scores_of(r, study.facts_of(r)) for r in runs]
    return [{n: getattr(s, n) for n in COLUMNS} for s in scores]


def run_rows(study: Study) -> list[dict[str, Any]]:
    """The rows of `runs.csv`: all figures of all runs, and of the original model by itself."""
    rows = []
    for entry in study.entries:
        resolved = entry.result.case.resolved
        scripted = entry.result.case.alarms is not None
        silent = ("threshold", "warning_threshold", "error_threshold", "window") if scripted else ()
        rows.append(
            {
                "groups": " ".join(entry.groups),
                **scores_of(entry.result, study.facts_of(entry.result)).as_dict(),
                **{n: None if n in silent else resolved[n] for n in SETTINGS},
                "seconds": entry.result.seconds,
                "beside": " ".join(entry.beside),
                "key": entry.result.case.key,
            }
        )
    return rows + _never_rows(study)


def robust_rows(study: Study) -> list[dict[str, Any]]:
    """The rows of `robustness.csv`: the figures of each run, and of the original by itself."""
    rows = []
    for run in study.robust:
        rows.append({**asdict(run.task), **asdict(score_run(run))})
        if run.task.setup == DEFAULT:
            original = sum(run.original) / sum(run.late)
            row = {**asdict(run.task), "setup": "never", "left": 1.0, "over_late": original}
            rows.append({**row, "learned": 1.0, "adaptations": 0, "worst_ten": 1.0})
    return rows


def summary_rows(study: Study) -> list[dict[str, Any]]:
    """For each model and detector of the groups paper and better: figures with their intervals.

    Each row has `group`, `model`, `detector`, `seeds`, the `FIGURES` as {value, low, high, count}
    (see `statistics.Estimate`), and `paper`, that model's row of the paper's Table 1 or None.
    """
    evidence, rows = Evidence(study), []
    for group in TABULATED:
        for (model, detector), results in study.pairs(group).items():
            estimates = {n: evidence.of(results, n).as_dict() for n in FIGURES}
            rows.append(
                {
                    "group": group,
                    "model": model,
                    "detector": detector,
                    "seeds": len(results),
                    **estimates,
                    "paper": PAPER.get(model) if group == "paper" else None,
                }
            )
    return rows


def write_tables(out: Path | str, study: Study) -> None:
    """Write `table.csv`, `runs.csv` and, where it has the group, `robustness.csv`.

    Undefined figures are empty.
    """
    out = Path(out)
    write(out / TABLE, csv_text(table_rows(study), COLUMNS))
    rows = run_rows(study)
    write(out / RUNS, csv_text(rows, () if rows else ["groups"]))
    if study.robust:
        write(out / ROBUST, csv_text(robust_rows(study)))


def _never_rows(study: Study) -> list[dict[str, Any]]:
    """One row for each stream: what the original model does without learning."""
    streams: dict[tuple[Any, ...], dict[str, Any]] = {}
    for entry in study.entries:
        case = entry.result.case
        resolved = case.resolved
        where = (case.seed, resolved["degradation"], resolved["start"])
        if where not in streams:
            never = study.baselines(entry.result)["never"]
            figures = scores_of(never, study.facts_of(never)).as_dict()
            settings = dict.fromkeys(SETTINGS)
            settings |= {n: resolved[n] for n in ("degradation", "start")}
            row = {"groups": "baseline", **figures, "model": "original", **settings}
            streams[where] = {**row, "seconds": None, "beside": "", "key": ""}
    return list(streams.values())
