"""The section about what might explain that the paper's hybrid leaves less than ours."""

from __future__ import annotations

from collections.abc import Mapping

from ldt_core.base.sentences import number
from ldt_core.lab.statistics import mean
from ldt_core.lab.study.drift_detection import Detection, detection
from ldt_core.lab.study.robustness.paper_trials import PAPER_TRIALS
from ldt_core.lab.study.robustness.robust_run import TRIAL, RobustRun, score_run
from ldt_core.lab.study.sections.findings import cell
from ldt_core.lab.study.study import Evidence
from ldt_core.lab.study.study_tables import PAPER
from ldt_core.views.page.blocks import Section, Table, Text, Value
from ldt_core.views.page.style import Drawing

MISSING = "Trials of the paper's hybrid: this study has none (ldt study --only trials)."
HEAD = (
    *("trial", "left [%]", "late [%]", "MME of the original [rad/s]", "adaptations"),
    *("precision", "recall"),
)


def trials(evidence: Evidence, drawings: Mapping[str, Drawing | None]) -> Section:
    """One row a trial, and the paper's row above."""
    section = Section("trials", "Why the paper's hybrid leaves less than ours")
    runs = [r for r in evidence.study.robust if r.task.setup == TRIAL]
    if not runs:
        section.blocks.append(Text(MISSING, "missing"))
        return section
    printed = PAPER["hybrid"]
    rows: list[list[Value]] = [
        [
            *("the paper, on its rotor", number(100 * printed["share"]), "–"),
            *(f"{printed[name]:g}" for name in ("mme_original", "adaptations")),
            *(f"{printed[name]:g}" for name in ("precision", "recall")),
        ]
    ]
    for name, trial in PAPER_TRIALS.items():
        found = [r for r in runs if r.task.stream == name]
        if found:
            rows.append([trial.about, *_figures(found)])
    section.blocks.append(
        Table(
            "One choice at a time, all else as in the preset paper, on a staircase of 9 drifts",
            HEAD,
            rows,
            range(1, len(HEAD)),
            "Mean and 95 % interval over the seeds. The last rows are what f_d can do at best: e "
            "stays, and the model learns every fifth experiment.",
        )
    )
    return section


def _figures(runs: list[RobustRun]) -> list[Value]:
    scores = [score_run(r) for r in runs]
    hits = [_detection(r) for r in runs]
    return [
        cell(mean(s.left for s in scores), scale=100),
        cell(mean(s.late_left for s in scores), scale=100),
        cell(mean(sum(r.original) / len(r.original) for r in runs)),
        cell(mean(s.adaptations for s in scores)),
        cell(mean(h.precision for h in hits), 2),
        cell(mean(h.recall for h in hits), 2),
    ]


def _detection(run: RobustRun) -> Detection:
    positives = [n for n, level in enumerate(run.level, start=1) if level == 1]
    return detection([n for n in run.changes if n > 1], positives)
