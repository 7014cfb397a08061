"""The sections of a run's page, in the order in which they are read."""

from __future__ import annotations

from markupsafe import Markup

from ldt_core.base.experiment import Level
from ldt_core.base.sentences import number
from ldt_core.views.detector_statistic import DetectorStatistic
from ldt_core.views.page.blocks import Answer, Mark, Own, Section, Table, Text
from ldt_core.views.page.page_builder import fill
from ldt_core.views.report import health_section, settings_section
from ldt_core.views.report.learning_section import adaptations, models
from ldt_core.views.report.reported_run import ReportedRun

FOOTER = (
    "Errors are maxima over an experiment of the distance between measured and predicted speed; "
    "predictions are free runs, which see the voltage alone. The page is whole: it loads nothing."
)
TONES = {Level.NEGATIVE: "good", Level.WARNING: "open", Level.POSITIVE: "bad"}
KINDS = {"none": "good", "effect": "found", "ambiguous": "vague", "unknown": "open"}


def title(run: ReportedRun) -> str:
    """Of the page."""
    return f"Run {run.name}"


def lead(run: ReportedRun) -> str:
    """What has run."""
    last = run.signals[-1]
    kind = run.models[0].kind if run.models else "unrecorded"
    machine = f"machine {run.bag.machine}" if run.bag.machine else "an unnamed machine"
    odd = len(health_section.remarks(run))
    warning = f" Mind the health of the recording: {_count(odd, 'remark')}." if odd else ""
    return (
        f"{_count(run.summary.experiments, 'experiment')} of {machine}, with a {kind} model and "
        f"the detector {last.detector}.{warning}"
    )


def answer(run: ReportedRun) -> Answer:
    """How well the twin followed, and where it stands."""
    summary, last = run.summary, run.signals[-1]
    mean, original = summary.mme or 0.0, summary.mme_original
    sentence = f"The twin's largest error in an experiment was {number(mean)} rad/s in the mean"
    if original:
        share = number(100 * mean / original, 2)
        sentence += f", {share} % of the {number(original)} rad/s of the model that never learns"
    worst = run.signals[run.worst_first[0]]
    sentence += (
        f"; the worst was experiment {worst.experiment} with {number(worst.max_error)}. "
        f"The detector was positive {_times(summary.positives)}, and "
        f"{_count(summary.adaptations, 'new model')} came into force."
    )
    aside = f"the last signal, of experiment {last.experiment}"
    return Answer(Mark(last.level.word, TONES[last.level]), aside, sentence)


def sections(run: ReportedRun, compared: DetectorStatistic) -> list[Section]:
    """All of them."""
    return [
        _course(compared),
        _experiment(run),
        Section("learning", "What was learned", [*adaptations(run), *models(run)]),
        _diagnoses(run),
        Section("setting", "Machine and settings", settings_section.blocks(run, compared)),
        health_section.section(run),
        _every(run),
    ]


def _course(compared: DetectorStatistic) -> Section:
    limits = "its limits" if any(compared.drift) else "no limits recorded"
    return Section(
        "course", "Over the run", [_template("course.html", label=compared.label, limits=limits)]
    )


def _experiment(run: ReportedRun) -> Section:
    note = "All samples are in the page."
    if run.thinned:
        kept = [step.packed.kept for step in run.steps if step.packed]
        note = (
            f"Samples are thinned to at most {max(kept)} in an experiment; the extremes of every "
            "curve over short stretches are among them."
        )
    bare = sum(step.packed is None for step in run.steps)
    if bare:
        note += f" The {bare} experiments with the least error are without samples: no room."
    return Section("experiment", "One experiment", [_template("chooser.html", note=note)])


def _diagnoses(run: ReportedRun) -> Section:
    section = Section("diagnoses", "Diagnoses")
    if run.diagnoses:
        rows = [
            (f"Experiment {d.experiment}", Mark(d.kind, KINDS.get(d.kind, "open")), d.sentence)
            for d in run.diagnoses
        ]
        head = ("after", "verdict", "in words")
        section.blocks.append(Table("What was to blame, at each positive", head, rows, cards=True))
    else:
        none = "None was made in this run: --diagnose makes one at a positive."
        section.blocks.append(Text(none, "missing"))
    return section


def _every(run: ReportedRun) -> Section:
    rows = [run.steps[index] for index in run.worst_first]
    link = "#experiment-{}"
    table = _template("every.html", rows=rows, link=link, number=number)
    return Section("every", "All experiments, worst first", [table])


def _template(name: str, **values: object) -> Own:
    return Own(Markup(fill(f"report/templates/{name}", **values)))


def _count(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def _times(count: int) -> str:
    return {0: "never", 1: "once", 2: "twice"}.get(count, f"{count} times")
