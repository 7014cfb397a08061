"""What came out: the paper reproduced, detectors beside chance, beyond the paper, all runs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from ldt_core.base.sentences import number
from ldt_core.lab.study import GROUPS
from ldt_core.lab.study.evidence import Evidence
from ldt_core.lab.study.sections.methods import OWN
from ldt_core.lab.study.statistics import Interval
from ldt_core.lab.study.study import Study
from ldt_core.lab.study.study_case import RunResult
from ldt_core.lab.study.study_tables import PAPER
from ldt_core.views.page.blocks import Cell, Folded, Links, Section, Table, Text, Value
from ldt_core.views.page.style import Drawing, look, pair

MODELS = ("linear", "hybrid")
#: Row of table 1 → figure of `RunScore`.
TABLE_1 = {
    "MME [rad/s]": "mme",
    "MME of the original [rad/s]": "mme_original",
    "Adaptations": "adaptations",
    "Precision": "precision",
    "Recall": "recall",
}
NO_RUNS = "This study has no runs for it (group {})."
BETTER = "this study has no runs beyond the paper (group better)."
#: Columns of the table beside chance → figure of `RunScore`.
CHANCE_COLUMNS = {
    "MME [rad/s]": "mme",
    "adaptations": "adaptations",
    "recall": "recall",
    "precision": "precision",
    "recall of detectable": "recall_detectable",
    "delay": "delay",
    "false alarm rate": "false_alarm_rate",
}
#: Columns of the table of all runs → figure of `RunScore`, and its factor.
RUN_COLUMNS = {
    "MME [rad/s]": ("mme", 1.0),
    "of the original's [%]": ("share", 100.0),
    "adaptations": ("adaptations", 1.0),
    "positives": ("positives", 1.0),
    "recall": ("recall", 1.0),
    "precision": ("precision", 1.0),
}
FILES = ("table.csv", "runs.csv")
#: Group → the settings in which its runs differ; how to say them; which of them go without saying.
VARIED = {
    "sweep": ("threshold", "error_threshold"),
    "kinds": ("degradation", "start"),
    "variants": ("order", "offset", "gate"),
}
VARIANT = {"order": "order {}", "offset": "offset: {}", "gate": "gate {}"}
EMPTY = ("", None, 0, False)


def reproduction(evidence: Evidence, drawings: Mapping[str, Drawing | None]) -> Section:
    """Table 1 and all figures."""
    section = Section("reproduction", "The paper, reproduced")
    section.blocks += [_table(evidence), _variants(evidence)]
    paper, sweep = NO_RUNS.format("paper"), NO_RUNS.format("sweep")
    kept = "No experiment was kept whole, so none can be shown over time."
    section.figure(drawings["input_output"], f"Input and output of an experiment: {kept}")
    section.figure(drawings["staircase"], f"The wear over the stream: {paper}")
    section.figure(drawings["sommerfeld"], f"The Sommerfeld region: {kept}")
    section.figure(drawings["mme_by_level"], f"Error against the wear: {paper}")
    section.figure(drawings["adaptations_by_level"], f"Adaptations against the wear: {paper}")
    section.figure(drawings["thresholds"], f"The influence of the threshold: {sweep}")
    return section


def _table(evidence: Evidence) -> Table | Text:
    pairs = evidence.study.pairs("paper")
    detectors = list(dict.fromkeys(d for m, d in pairs if m in MODELS))
    if not detectors:
        return Text(f"Table 1: {NO_RUNS.format('paper')}", "missing")
    rows: list[list[Value]] = []
    for model in MODELS:
        rows.append([f"{model}: the paper", *(f"{PAPER[model][f]:g}" for f in TABLE_1.values())])
        for detector in detectors:
            if results := pairs.get((model, detector)):
                figures = [cell(evidence.of(results, figure)) for figure in TABLE_1.values()]
                rows.append([f"{model}: ours, {look(detector).label}", *figures])
    head = ("model, detector", *TABLE_1)
    seeds = len({r.case.seed for r in evidence.study.results("paper")})
    return Table(
        "Table 1 of the paper, and ours under each of its detectors",
        head,
        rows,
        range(1, len(head)),
        f"Ours: mean over {seeds} seeds, and the 95 % confidence interval of that mean. The paper "
        "has one stream, does not say which detector its table is of, and prints no unit; its "
        "rotor's parameters are not printed either, so that figures need not match.",
    )


def _variants(evidence: Evidence) -> Table | Text:
    """The same with other choices than those of the table."""
    study = evidence.study
    rows: list[list[Value]] = []
    for label, results in alike(study, "variants"):
        seeds = {r.case.seed for r in results}
        base = [
            r
            for r in study.results("paper", model=results[0].case.model, detector="threshold")
            if r.case.seed in seeds
        ]
        found = [cell(evidence.of(results, figure)) for figure in ("mme", "adaptations")]
        rows.append(
            [label, *found, cell(evidence.of(base, "mme")) if base else "-", str(len(seeds))]
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


def chance(evidence: Evidence, drawings: Mapping[str, Drawing | None]) -> Section:
    """The figure, and its figures in a table."""
    section = Section("chance", "Detectors beside chance")
    section.blocks.append(
        Text(
            "A score says something only beside what chance reaches: the original model that never "
            "learns, and alarms by the calendar (periodic) and drawn at random, on the same "
            "streams, as many as the run beside them has adaptations. Recall over detectable "
            "drifts leaves out those that the noise hides from any observer of one experiment."
        )
    )
    section.figure(drawings["detectors"], "This study has no runs for it.")
    rows = [row for group in ("paper", "better") for row in _beside_chance(evidence, group)]
    if rows:
        table = Table(
            "Mean over seeds, 95 % confidence interval below it",
            ("run", *CHANCE_COLUMNS),
            rows,
            range(1, 1 + len(CHANCE_COLUMNS)),
        )
        section.blocks.append(Folded("The same in figures", table))
    return section


def _beside_chance(evidence: Evidence, group: str) -> Iterable[Sequence[Value]]:
    for names, results in evidence.study.pairs(group).items():
        beside = {f: evidence.beside(results, f) for f in CHANCE_COLUMNS.values()}
        own = {f: evidence.of(results, f) for f in beside}
        yield [pair(*names) + ("" if group == "paper" else " (beyond)"), *map(cell, own.values())]
        for name in ("periodic", "random"):
            if name in beside["mme"]:
                yield [f"… {name} alarms", *(cell(found[name]) for found in beside.values())]


def beyond(evidence: Evidence, drawings: Mapping[str, Drawing | None]) -> Section:
    """Shares, stream, detectability, false alarms, kinds."""
    section = Section("beyond", "Beyond the paper")
    section.blocks.append(
        Text(
            "The diagnosed model keeps the physics and fits the cause, the eccentricity, from the "
            "experiments that are still valid; the calibrated detector keeps a stated rate of "
            "false alarms. The lower line of each comparison is not zero: even the true model with "
            "the true eccentricity has an error, from the noise and from what the unknown start "
            "does to a machine near the edge of capture; and who learns from an experiment is one "
            "experiment late at every drift."
        )
    )
    section.figure(drawings["shares"], f"What is left of the error: {BETTER}")
    section.figure(drawings["over_stream"], f"The error over one stream: {BETTER}")
    section.figure(
        drawings["estimate"],
        "The cause as the twin sees it: this study has no model that names one (group better).",
    )
    section.figure(drawings["detectable"], f"Which drifts can be found: {BETTER}")
    section.figure(
        drawings["false_alarms"],
        "Stated and observed false alarms: this study has no streams without drift.",
    )
    section.figure(
        drawings["kinds"],
        "Other kinds of drift: this study has no runs for them (group kinds).",
    )
    return section


def runs(evidence: Evidence, drawings: Mapping[str, Drawing | None]) -> Section:
    """Means of all runs, by group."""
    section = Section("runs", "All runs")
    section.blocks.append(Links("The figures of every run, for your own analysis:", FILES))
    for group, what in GROUPS.items():
        rows: list[list[Value]] = []
        for label, found in alike(evidence.study, group):
            figures = (cell(evidence.of(found, f), scale=by) for f, by in RUN_COLUMNS.values())
            rows.append([label, str(len(found)), *figures])
        if rows:
            head = ("run", "runs", *RUN_COLUMNS)
            table = Table(f"{group}: {what}", head, rows, range(1, len(head)))
            section.blocks.append(Folded(f"{group} ({len(rows)} rows)", table))
        else:
            section.blocks.append(Text(f"No runs of the group {group}.", "missing"))
    return section


def alike(study: Study, group: str) -> list[tuple[str, list[RunResult]]]:
    """(what sets them apart, results) of a group's runs that differ in their seed alone."""
    found: dict[str, list[RunResult]] = {}
    varied = VARIED.get(group, ())
    for result in study.results(group):
        case = result.case
        resolved = case.resolved if varied else {}
        own = [n for n in varied if group != "sweep" or n in OWN.get(case.detector, ())]
        extra = [VARIANT.get(n, "{}").format(resolved[n]) for n in own if resolved[n] not in EMPTY]
        label = ", ".join([case.model, look(case.detector).label, *extra])
        found.setdefault(label, []).append(result)
    return list(found.items())


def cell(estimate: Interval, digits: int = 3, scale: float = 1.0) -> Value:
    """A figure with its interval below it."""
    if estimate.value is None:
        return "–"
    text = number(estimate.value * scale, digits)
    if estimate.count < 2:
        return Cell(text, "one seed")
    low, high = number(estimate.low * scale, digits), number(estimate.high * scale, digits)
    return Cell(text, f"{low} to {high}")
