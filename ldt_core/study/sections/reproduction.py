"""The paper's table and figures, on our rotor."""

from __future__ import annotations

from collections.abc import Mapping

from ldt_core.study.blocks import Section, Table, Text, Value, cell
from ldt_core.study.figures.reading import Reading
from ldt_core.study.figures.style import Drawing, look

MODELS = ("linear", "hybrid")
#: Row of table 1 → (figure of `Score`, the paper's for linear and hybrid).
TABLE_1 = {
    "MME [rad/s]": ("mme", ("8.86", "6.86")),
    "MME of the original model [rad/s]": ("mme_original", ("10.09", "10.09")),
    "Number of adaptations": ("adaptations", ("44", "25")),
    "Precision": ("precision", ("0.06", "0.12")),
    "Recall": ("recall", ("0.33", "0.33")),
}
NO_RUNS = "This study has no runs for it (group {})."


def reproduction(reading: Reading, drawings: Mapping[str, Drawing | None]) -> Section:
    """Table 1 and all figures."""
    section = Section("reproduction", "The paper, reproduced")
    section.blocks.append(_table(reading))
    paper, sweep = NO_RUNS.format("paper"), NO_RUNS.format("sweep")
    kept = "No experiment was kept whole, so none can be shown over time."
    section.figure(drawings["input_output"], f"Input and output of an experiment: {kept}")
    section.figure(drawings["staircase"], f"The wear over the stream: {paper}")
    section.figure(drawings["sommerfeld"], f"The Sommerfeld region: {kept}")
    section.figure(drawings["mme_by_level"], f"Error against the wear: {paper}")
    section.figure(drawings["adaptations_by_level"], f"Adaptations against the wear: {paper}")
    section.figure(drawings["thresholds"], f"The influence of the threshold: {sweep}")
    return section


def _table(reading: Reading) -> Table | Text:
    detectors = [d for m, d in reading.study.pairs("paper") if m in MODELS]
    detectors = list(dict.fromkeys(detectors))
    if not detectors:
        return Text(f"Table 1: {NO_RUNS.format('paper')}", "missing")
    head = ["", "paper: linear", "hybrid"]
    head += [f"{look(d).label}: {m}" for d in detectors for m in MODELS]
    rows: list[list[Value]] = []
    for label, (figure, printed) in TABLE_1.items():
        row: list[Value] = [label, *printed]
        for detector in detectors:
            for model in MODELS:
                results = reading.study.results("paper", model=model, detector=detector)
                row.append(cell(reading.of(results, figure)))
        rows.append(row)
    seeds = len({r.case.seed for r in reading.study.results("paper")})
    return Table(
        "Table 1 of the paper, and ours under each of its detectors",
        head,
        rows,
        range(1, len(head)),
        f"Ours: mean over {seeds} seeds, and the 95 % confidence interval of that mean. The paper "
        "has one stream, does not say which detector its table is of, and prints no unit; its "
        "rotor's parameters are not printed either, so that figures need not match.",
    )
