"""The section about the default detector: its false alarms and its delay beside the theory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ldt_core.base.sentences import number
from ldt_core.lab.statistics import mean, proportion
from ldt_core.lab.study.robustness.alarm_trials import (
    AFTER,
    EVERY,
    LAWS_IN_CONTROL,
    SAMPLES,
    SIZES,
    AlarmCount,
    lorden,
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
    counts = evidence.study.alarms
    if not counts:
        section.blocks.append(Text(MISSING, "missing"))
        return section
    section.blocks += [_rates(counts), _delays(counts)]
    return section


def _rates(counts: Sequence[AlarmCount]) -> Table:
    rows: list[list[Value]] = []
    for law in LAWS_IN_CONTROL:
        found = [c for c in counts if c.task.law == law]
        if not found:
            continue
        first, experiments = sum(c.first for c in found), sum(c.experiments for c in found)
        share = proportion(first, experiments)
        kept = share.low <= 1 / EVERY
        row = sum(c.positives for c in found) / sum(c.in_a_row for c in found)
        rows.append(
            [
                law,
                str(first),
                str(experiments),
                Cell(number(first / experiments), f"{number(share.low)} to {number(share.high)}"),
                Mark("yes", "good") if kept else Mark("no", "bad"),
                number(1000 * row),
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
    rows: list[list[Value]] = []
    for size in SIZES:
        found = [c for c in counts if not c.task.law and c.task.size == size]
        own = [d for c in found for d in c.delays]
        if own:
            rows.append(
                [
                    number(size),
                    cell(mean(own)),
                    f"{sum(d > AFTER for d in own)} of {len(own)}",
                    cell(mean(d for c in found for d in c.cusum)),
                    number(lorden(size, known=True)),
                    number(lorden(size, known=False)),
                ]
            )
    return Table(
        "Experiments from a change to the first positive, 1 being the change's own",
        DELAYS,
        rows,
        range(1, len(DELAYS)),
        f"A wave in white noise, {SAMPLES} samples. A change that was not found within {AFTER} "
        "experiments counts as one more. The bounds are Lorden's, at least one experiment; who "
        "knows the wave sees more than the residual's energy.",
    )
