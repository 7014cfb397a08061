"""The sections below the summary: the paper reproduced, beyond the paper, methods."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence

from ldt_core.base.sentences import number, spoken
from ldt_core.lab.statistics import Interval
from ldt_core.lab.study import GROUPS, NAMED_ONLY
from ldt_core.lab.study.study import Evidence, Study
from ldt_core.lab.study.study_case import RunResult
from ldt_core.lab.study.study_plan import PAPER_MODELS
from ldt_core.lab.study.study_tables import PAPER
from ldt_core.views.page.blocks import Cell, Item, Items, Links, Section, Table, Text, Value
from ldt_core.views.page.style import Drawing, look, pair

#: Row of table 1 → figure of `RunScore`.
TABLE_1 = {
    "MME [rad/s]": "mme",
    "MME of the original [rad/s]": "mme_original",
    "Adaptations": "adaptations",
    "Precision": "precision",
    "Recall": "recall",
    "Drifts": "drifts",
}
NO_RUNS = "this study has no runs for it (group {})."
BETTER = "this study has no runs beyond the paper (group better)."
FILES = ("table.csv", "runs.csv")
#: The choices of the group variants: how to say them, and which go without saying.
VARIANT = {"order": "order {}", "offset": "offset: {}", "gate": "gate {}"}
EMPTY = ("", 0, False)


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
    detectors = list(dict.fromkeys(d for m, d in pairs if m in PAPER_MODELS))
    if not detectors:
        return Text(f"Table 1: {NO_RUNS.format('paper')}", "missing")
    rows: list[list[Value]] = []
    for model in PAPER_MODELS:
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
        f"Ours: {_mean_over(seeds)}. The paper has one stream. It does not say which detector was "
        "used, and prints no unit. It does not print its rotor's parameters either, so the figures "
        "need not match. Nor does it print the number of drifts: its rows fit 9, of which 3 were "
        "found (3/9, 3/25, and 3/44 = 0.068, printed truncated). Our staircase has 12. The group "
        "`trials` has runs with 9.",
    )


def _mean_over(seeds: int) -> str:
    if seeds == 1:
        return "one seed, too few for an interval"
    return f"mean over {seeds} seeds, and the 95 % confidence interval of that mean"


def _variants(evidence: Evidence) -> Table | Text:
    """The same with other choices than those of the table."""
    study = evidence.study
    rows: list[list[Value]] = []
    alike: dict[str, list[RunResult]] = {}
    for result in study.results("variants"):
        case, resolved = result.case, result.case.resolved
        own = [how.format(resolved[n]) for n, how in VARIANT.items() if resolved[n] not in EMPTY]
        label = ", ".join([case.model, look(case.detector).label, *own])
        alike.setdefault(label, []).append(result)
    for label, results in alike.items():
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


def beyond(evidence: Evidence, drawings: Mapping[str, Drawing | None]) -> Section:
    """Shares, stream, detectability, false alarms, and where all numbers are."""
    section = Section("beyond", "Beyond the paper")
    section.blocks.append(
        Text(
            "The diagnosed model keeps the physics and fits the cause, the eccentricity, from the "
            "experiments that are still valid; the adequacy detector has at most a stated rate of "
            "false alarms. The references of each comparison are not zero: even the true model "
            "with the true eccentricity has an error, from the noise and from what the noisy "
            "first sample does to a machine near the edge of capture; and who learns from an "
            "experiment is one experiment late at every drift. They are no bounds: a twin that "
            "knows its start better can leave less."
        )
    )
    section.figure(drawings["shares"], f"What is left of the error: {BETTER}")
    section.figure(drawings["over_stream"], f"The error over one stream: {BETTER}")
    section.figure(drawings["detectable"], f"Which drifts can be found: {BETTER}")
    section.figure(
        drawings["false_alarms"],
        "Stated and observed false alarms: this study has no streams without drift.",
    )
    section.blocks.append(Links("The figures of every run, for your own analysis:", FILES))
    return section


def cell(estimate: Interval, digits: int = 3, scale: float = 1.0) -> Value:
    """A figure with its interval below it."""
    if estimate.value is None:
        return "–"
    text = number(estimate.value * scale, digits)
    if estimate.count < 2:
        return Cell(text, "one seed")
    low, high = number(estimate.low * scale, digits), number(estimate.high * scale, digits)
    return Cell(text, f"{low} to {high}")


METHODS = (
    (
        "Where the paper is silent.",
        "It prints no parameters of the rotor: masses, stiffness and damping are those of Bisoi "
        "et al. (2020), second-hand; motor, noise, voltage, staircase and thresholds are chosen. "
        "The Gaussian process learns the one-step residuals of the physics with an observer of "
        "the current. The linear model minimises the error of its free run in place of MATLAB's "
        "ssest, its order chosen on held-out data. LDDM raises no signal at an error rate of 0.",
    ),
    (
        "Errors and intervals.",
        "Each experiment is predicted in free run before it can be learned from; MME is the mean "
        "over a run of the largest |measured − predicted| speed. Figures are taken per seed, with "
        "Student's t interval over the seeds; comparisons are paired by seed, and rates of false "
        "alarms have exact Poisson intervals.",
    ),
    (
        "Precision and recall.",
        "Recall: drifts with a positive in their five experiments, the drift's own included. "
        "Precision: positives that are the first there. False alarms: positives in no drift's "
        "five. Periodic and random baselines train the same model as often as the run beside "
        "them adapted.",
    ),
    (
        "What can be known.",
        "References: the error of the true model with the true value of what wears, and of the "
        "true model one experiment late, with that of the experiment before. They know the truth "
        "(start angle, parameters), but start from the noisy first sample, so that they are no "
        "bounds. A drift Δy of the speed is detectable when a χ² test "
        "of its energy |Δy|² / σ² with one false alarm in 1000 finds it with probability 0.9.",
    ),
    (
        "Sommerfeld region.",
        "Where the measured speed lies between the lower stable speed at a fold's least voltage "
        "and the end of the unstable branch, for the true e.",
    ),
)
#: Detector → its parameters that a reader wants to know.
OWN = {
    "threshold": ("threshold", "warning_threshold"),
    "lddm": ("error_threshold", "warning_level", "drift_level"),
    "window": ("window",),
    "adequacy": ("false_alarm_every",),
}


def methods(evidence: Evidence, drawings: Mapping[str, Drawing | None]) -> Section:
    """How each figure is made, where that is not the paper's way, and how to do it again."""
    section = Section("methods", "Methods")
    section.blocks.append(Items([Item(text, name) for name, text in METHODS]))
    rows = [
        [group, pair(*names), _parameters(results)]
        for group in ("paper", "better")
        for names, results in evidence.study.pairs(group).items()
    ]
    if rows:
        head = ("group", "model, detector", "parameters")
        section.blocks.append(Table("Parameters of the detectors", head, rows, cards=True))
    section.blocks += [
        Text("To reproduce", "heading"),
        Text(command(evidence.study), "code"),
        Text("The last digits can differ on another processor, and decisions near a limit."),
    ]
    return section


def command(study: Study) -> str:
    """The command that makes this study."""
    words = ["ldt", "study"]
    for name in ("seeds", "first_seed", "experiments", "machine"):
        if name in study.settings:
            words += [f"--{name.replace('_', '-')}", str(study.settings[name])]
    usual = set(GROUPS) - set(NAMED_ONLY)
    groups = study.settings.get("groups", usual)
    for group in groups if set(groups) != usual else ():
        words += ["--only", str(group)]
    return shlex.join([*words, "--out", "my_study"])


def _parameters(results: Sequence[RunResult]) -> str:
    case = results[0].case
    resolved = case.resolved
    names = [n for n in OWN.get(case.detector, ()) if resolved[n] >= 0]
    return ", ".join(f"{spoken(name)} {resolved[name]:g}" for name in names) or "–"
