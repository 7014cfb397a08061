"""The section about the default detector: its false alarms and its delay beside the theory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ldt_core.base.sentences import number
from ldt_core.lab.statistics import mean, proportion
from ldt_core.lab.study.robustness.alarm_trials import (
    AFTER,
    EVERY,
    SAMPLES,
    AlarmCount,
    lorden,
    over_seeds,
)
from ldt_core.lab.study.sections.findings import cell
from ldt_core.lab.study.study import Evidence
from ldt_core.views.page.blocks import Cell, Mark, Section, Table, Text, Value
from ldt_core.views.page.style import Drawing

MISSING = "False alarms and delay: this study has no trials of it (ldt study --only alarms)."
RATES = (
    *("residuals", "first positives", "experiments", "rate an experiment", "at most the stated"),
    "positives in a row, a thousand",
)
DELAYS = (
    *("energy over the noise's", "mean delay", "never found"),
    *("CUSUM, wave known", "bound, wave known", "bound, energy alone"),
)


def alarms(evidence: Evidence, drawings: Mapping[str, Drawing | None]) -> Section:
    """Two tables."""
    section = Section("alarms", "False alarms and delay of the default detector")
    counts = over_seeds(evidence.study.alarms)
    if not counts:
        section.blocks.append(Text(MISSING, "missing"))
        return section
    section.blocks += [_rates(counts), _delays(counts)]
    return section


def _rates(counts: Sequence[AlarmCount]) -> Table:
    rows: list[list[Value]] = []
    for c in counts:
        if not c.task.law:
            continue
        share = proportion(c.first, c.experiments)
        kept = share.low <= 1 / EVERY
        rows.append(
            [
                c.task.law,
                str(c.first),
                str(c.experiments),
                Cell(
                    number(c.first / c.experiments), f"{number(share.low)} to {number(share.high)}"
                ),
                Mark("yes", "good") if kept else Mark("no", "bad"),
                number(1000 * (c.positives / c.in_a_row)),
            ]
        )
    return Table(
        f"False positives where nothing changes; stated: one in {EVERY:g} experiments",
        RATES,
        rows,
        (1, 2, 3, 5),
        f"{SAMPLES} samples an experiment. First: of a detector that starts anew behind each "
        "positive, for which the guarantee holds; with the exact binomial 95 % interval. In a "
        "row: one detector goes on, and learning never helps. Noise that hangs together within "
        "an experiment is outside the guarantee.",
    )


def _delays(counts: Sequence[AlarmCount]) -> Table:
    rows: list[list[Value]] = [
        [
            number(c.task.size),
            cell(mean(c.delays)),
            f"{sum(d > AFTER for d in c.delays)} of {len(c.delays)}",
            cell(mean(c.cusum)),
            number(lorden(c.task.size, known=True)),
            number(lorden(c.task.size, known=False)),
        ]
        for c in counts
        if c.delays
    ]
    return Table(
        "Experiments from a change to the first positive, 1 being the change's own",
        DELAYS,
        rows,
        range(1, len(DELAYS)),
        f"A wave in white noise, {SAMPLES} samples. A change that was not found within {AFTER} "
        "experiments counts as one more. The bounds are Lorden's, at least one experiment; who "
        "knows the wave sees more than the residual's energy.",
    )
