"""The paper's table and figures, on our rotor."""

from __future__ import annotations

from collections.abc import Mapping

from ldt_core.lab.study.cell import cell
from ldt_core.lab.study.figures.reading import Reading
from ldt_core.lab.study.sections.method import alike
from ldt_core.views.page.blocks import Section, Table, Text, Value
from ldt_core.views.page.style import Drawing, look

MODELS = ("linear", "hybrid")
#: Row of table 1 → (figure of `Score`, the paper's for linear and hybrid).
TABLE_1 = {
    "MME [rad/s]": ("mme", ("8.86", "6.86")),
    "MME of the original [rad/s]": ("mme_original", ("10.09", "10.09")),
    "Adaptations": ("adaptations", ("44", "25")),
    "Precision": ("precision", ("0.06", "0.12")),
    "Recall": ("recall", ("0.33", "0.33")),
}
NO_RUNS = "This study has no runs for it (group {})."


def reproduction(reading: Reading, drawings: Mapping[str, Drawing | None]) -> Section:
    """Table 1 and all figures."""
    section = Section("reproduction", "The paper, reproduced")
    section.blocks += [_table(reading), _variants(reading)]
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
    rows: list[list[Value]] = []
    for place, model in enumerate(MODELS):
        rows.append([f"{model}: the paper", *(printed[place] for _, printed in TABLE_1.values())])
        for detector in detectors:
            results = reading.study.results("paper", model=model, detector=detector)
            if results:
                figures = [cell(reading.of(results, figure)) for figure, _ in TABLE_1.values()]
                rows.append([f"{model}: ours, {look(detector).label}", *figures])
    head = ("model, detector", *TABLE_1)
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


def _variants(reading: Reading) -> Table | Text:
    """The same with other choices than those of the table."""
    study = reading.study
    rows: list[list[Value]] = []
    for label, results in alike(study, "variants"):
        seeds = {r.case.seed for r in results}
        base = [
            r
            for r in study.results("paper", model=results[0].case.model, detector="threshold")
            if r.case.seed in seeds
        ]
        found = [cell(reading.of(results, figure)) for figure in ("mme", "adaptations")]
        rows.append(
            [label, *found, cell(reading.of(base, "mme")) if base else "-", str(len(seeds))]
        )
    if not rows:
        return Text(f"Other choices: {NO_RUNS.format('variants')}", "missing")
    head = ("model, detector, choice", "MME [rad/s]", "Adaptations", "MME in the table", "seeds")
    return Table(
        "What the paper does not print, or does not do, one choice at a time",
        head,
        rows,
        range(1, len(head)),
        "The table above has the order chosen on held-out samples, no offset, and no gate; its "
        "mean over the same seeds stands beside.",
    )
