"""The sections of a run's page, in the order in which they are read."""

from __future__ import annotations

from importlib.resources import files

import jinja2
from markupsafe import Markup

from ldt_core.base.experiment import Level
from ldt_core.base.sentences import number
from ldt_core.views.page.blocks import Answer, Mark, Own, Section, Table, Text
from ldt_core.views.report import health, run_settings
from ldt_core.views.report.learning import adaptations, models
from ldt_core.views.report.recorded_run import Run
from ldt_core.views.report.statistic import Statistic

FOOTER = (
    "Errors are maxima over an experiment of the distance between measured and predicted speed; "
    "predictions are free runs, which see the voltage alone. The page is whole: it loads nothing."
)
TONES = {Level.NEGATIVE: "good", Level.WARNING: "open", Level.POSITIVE: "bad"}
KINDS = {"none": "good", "effect": "found", "ambiguous": "vague", "unknown": "open"}


def title(run: Run) -> str:
    """Of the page."""
    return f"Run {run.name}"


def lead(run: Run) -> str:
    """What has run."""
    last = run.turns[-1].signal
    kind = run.models[0].kind if run.models else "unrecorded"
    machine = f"machine {run.bag.machine}" if run.bag.machine else "an unnamed machine"
    odd = len(health.remarks(run))
    warning = f" Mind the health of the recording: {_count(odd, 'remark')}." if odd else ""
    return (
        f"{_count(run.summary.experiments, 'experiment')} of {machine}, with a {kind} model and "
        f"the detector {last.detector}.{warning}"
    )


def answer(run: Run) -> Answer:
    """How well the twin followed, and where it stands."""
    summary, last = run.summary, run.turns[-1].signal
    mean, original = summary.mme or 0.0, summary.mme_original
    sentence = f"The twin's largest error in an experiment was {number(mean)} rad/s in the mean"
    if original:
        share = number(100 * mean / original, 2)
        sentence += f", {share} % of the {number(original)} rad/s of the model that never learns"
    worst = run.turns[run.worst_first[0]]
    sentence += (
        f"; the worst was experiment {worst.experiment} with {number(worst.signal.max_error)}. "
        f"The detector was positive {_times(summary.positives)}, and "
        f"{_count(summary.adaptations, 'new model')} came into force."
    )
    aside = f"the last signal, of experiment {last.experiment}"
    return Answer(Mark(last.level.word, TONES[last.level]), aside, sentence)


def sections(run: Run, compared: Statistic) -> list[Section]:
    """All of them."""
    return [
        _course(compared),
        _experiment(run),
        Section("learning", "What was learned", [*adaptations(run), *models(run)]),
        _diagnoses(run),
        Section("setting", "Machine and settings", run_settings.blocks(run, compared)),
        health.section(run),
        _every(run),
    ]


def _course(compared: Statistic) -> Section:
    limits = "its limits" if any(compared.drift) else "no limits recorded"
    return Section(
        "course", "Over the run", [_template("course.html", label=compared.label, limits=limits)]
    )


def _experiment(run: Run) -> Section:
    note = "All samples are in the page."
    if run.thinned:
        kept = [t.samples.kept for t in run.turns if t.samples]
        note = (
            f"Samples are thinned to at most {max(kept)} in an experiment; the extremes of every "
            "curve over short stretches are among them."
        )
    bare = sum(turn.samples is None for turn in run.turns)
    if bare:
        note += f" The {bare} experiments with the least error are without samples: no room."
    return Section("experiment", "One experiment", [_template("chooser.html", note=note)])


def _diagnoses(run: Run) -> Section:
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


def _every(run: Run) -> Section:
    rows = [run.turns[index] for index in run.worst_first]
    link = "#experiment-{}"
    table = _template("every.html", rows=rows, link=link, number=number)
    return Section("every", "All experiments, worst first", [table])


def _template(name: str, **values: object) -> Own:
    """Markup of ours, every value in it escaped."""
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(_source),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
    )
    return Own(Markup(environment.get_template(name).render(**values)))


def _source(name: str) -> str:
    return (files("ldt_core.views.report") / "templates" / name).read_text(encoding="utf-8")


def _count(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def _times(count: int) -> str:
    return {0: "never", 1: "once", 2: "twice"}.get(count, f"{count} times")
