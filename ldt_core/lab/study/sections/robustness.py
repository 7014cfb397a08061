"""The section about streams of every kind: aims, table, figure."""

from __future__ import annotations

from collections.abc import Mapping

from ldt_core.base.sentences import number
from ldt_core.lab.statistics import mean
from ldt_core.lab.study.claims.robust_aims import robust_aims, scored
from ldt_core.lab.study.robustness.robust_run import DEFAULT, SETUPS
from ldt_core.lab.study.robustness.streams import STREAMS
from ldt_core.lab.study.sections.findings import cell
from ldt_core.lab.study.study import Evidence
from ldt_core.lab.study.study_tables import ROBUST
from ldt_core.views.page.blocks import Links, Mark, Section, Table, Text, Value
from ldt_core.views.page.style import Drawing

HEAD = (
    *("stream", "left [%]", "late [%]", "times late", "after the first [%]"),
    *("adaptations a change", "changes met late", "gross and “holds”", "inadequate"),
    *("worst ten", "seconds", "99 % of steps below [s]"),
)
MISSING = (
    "Streams of every kind: this study has no runs for it (ldt study --only robustness, hours)."
)


def robustness(evidence: Evidence, drawings: Mapping[str, Drawing | None]) -> Section:
    """How good the default is beside the references, and where it is not."""
    section = Section("robustness", "Streams of every kind")
    runs = evidence.study.robust
    section.figure(drawings["robust_streams"], MISSING)
    if not runs:
        return section
    verdicts = robust_aims(runs)
    met = sum(v.passed for v in verdicts)
    words = {True: Mark("met", "good"), False: Mark("missed", "bad")}
    rows = [(v.stream or "all", words[v.passed], v.aim, v.found) for v in verdicts]
    section.blocks += [
        Text(
            f"The default met {met} of {len(verdicts)} aims. Known: the true parameters; "
            "late: those of the experiment before. Both know no more of the start than a twin "
            "may. An aim is judged by the mean over the seeds, or by the worst run."
        ),
        Table("Aims of the default", ("stream", "verdict", "aim", "found"), rows, cards=True),
        _figures_of_default(evidence),
        _beside(evidence),
        Links("The figures of every run:", (ROBUST,)),
    ]
    return section


def _figures_of_default(evidence: Evidence) -> Table:
    rows: list[list[Value]] = []
    for name, entries in scored(evidence.study.robust).items():
        scores = [s for _, s in entries]
        rows.append(
            [
                name,
                cell(mean(s.left for s in scores), scale=100),
                cell(mean(s.late_left for s in scores), scale=100),
                cell(mean(s.over_late for s in scores)),
                cell(mean(s.learned for s in scores), scale=100),
                cell(mean(s.per_change for s in scores)),
                str(sum(s.late_changes for s in scores)),
                str(sum(s.gross_holds for s in scores)),
                str(sum(s.said_inadequate for s in scores)),
                number(max(s.worst_ten for s in scores)),
                cell(mean(s.seconds for s in scores)),
                number(max(s.p99_step for s in scores)),
            ]
        )
    return Table(
        "The default on each stream",
        HEAD,
        rows,
        range(1, len(HEAD)),
        "Worst ten: the largest sum of errors over ten experiments, over the original's. Gross: "
        "an error of more than ten times the noise. Counts are over all seeds.",
    )


def _beside(evidence: Evidence) -> Table:
    by_setup = {setup: scored(evidence.study.robust, setup) for setup in SETUPS}
    rows: list[list[Value]] = [
        [
            STREAMS[name].about,
            *(
                cell(mean(s.left for _, s in by_setup[setup].get(name, [])), scale=100)
                for setup in SETUPS
            ),
        ]
        for name in by_setup[DEFAULT]
    ]
    head = ("stream", *(f"{setup} [%]" for setup in SETUPS))
    return Table("Left, beside the paper's two and a simple detector", head, rows, range(1, 5))
