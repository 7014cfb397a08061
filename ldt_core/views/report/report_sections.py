"""The sections of a run's page, in the order in which they are read."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import PurePath

from markupsafe import Markup

import msgs_config
from ldt_core.base.experiment import Action, ModelRecord, Signal
from ldt_core.base.model_state import headline_state, shown_state, times_noise
from ldt_core.base.sentences import counted, listed, number, plain, ranges, spans, spoken
from ldt_core.base.settings import UNSET, as_options
from ldt_core.doctor.check import Finding, Grade
from ldt_core.doctor.recording_checks import findings
from ldt_core.recording.health import NO_DATE
from ldt_core.recording.run_settings import Setting
from ldt_core.views.page.blocks import (
    Answer,
    Block,
    Folded,
    Mark,
    Own,
    Pairs,
    Section,
    Table,
    Text,
    Value,
)
from ldt_core.views.page.page_builder import fill
from ldt_core.views.report.reported_run import ReportedRun
from ldt_core.views.step_view import ACTION_WORDS, LEVEL_WORDS, LIMITS, DetectorStatistic

FOOTER = (
    "Errors are maxima over an experiment of the distance between measured and predicted speed; "
    "predictions are free runs, which see the voltage alone. The page is whole: it loads nothing."
)
KINDS = {"none": "good", "effect": "found", "ambiguous": "vague", "unknown": "open"}
GRADES = {Grade.WARNING: "open", Grade.PROBLEM: "bad"}

MOST_ROWS = 5000  # of the table of experiments, 2 MB of the page; the plots have them all
OPEN_ROWS = 20  # of a table that stands open; a longer one would bury what follows it
MOST_TOLD = 1e9  # of a statistic: beyond it, evidence and errors of a run away only say "far"
MARKS = {
    Action.ADAPTED: Mark(ACTION_WORDS[Action.ADAPTED], "good"),
    Action.REFUSED: Mark(ACTION_WORDS[Action.REFUSED], "open"),
}

NOTHING = "-"
#: Settings that name files of the machine on which the run was.
PATHS = ("machine", "model", "detector", "cause", "effect", "play")


def lead(run: ReportedRun) -> str:
    """What has run."""
    last, worst = run.signals[-1], run.signals[run.worst_first[0]]
    kind = run.models[0].kind if run.models else "unrecorded"
    machine = f"machine {run.bag.machine}" if run.bag.machine else "an unnamed machine"
    odd = len(remarks(run))
    warning = f" Mind the health of the recording: {counted(odd, 'remark')}." if odd else ""
    return (
        f"{counted(run.summary.experiments, 'experiment')} of {machine}, with a {kind} model and "
        f"the detector {last.detector}. The worst was experiment {worst.experiment}, with an error "
        f"of {number(worst.max_error)} rad/s.{' '.join(['', *run.notes])}{warning}"
    )


def answer(run: ReportedRun) -> Answer:
    """Is the twin right now, since when, and what has happened."""
    summary, last = run.summary, run.signals[-1]
    mean = f"The mean of the experiments' largest errors was {number(summary.mme or 0.0)} rad/s."
    sentence = summary.outcome or mean
    alarms = counted(summary.positives, "alarm") if summary.positives else "no alarm"
    happened = f"There {'was' if summary.positives < 2 else 'were'} {alarms}"
    models = counted(summary.adaptations, "new model") if summary.adaptations else "no new model"
    learned = f" {summary.learned}" if summary.learned else ""
    sentence += f" {happened}, and {models} took over.{learned}{_blamed(run)}{_unjudged(run)}"
    state = headline_state(last)
    asides = [f"since experiment {_since(run)}" if _since(run) != last.experiment else ""]
    beside = times_noise(last.adequacy)
    asides += [f"error {beside}" if beside else "", f"detector: {LEVEL_WORDS[last.level]}"]
    asides.append(f"experiment {last.experiment}, the last")
    return Answer(Mark(state.words, state.tone), "; ".join(filter(None, asides)), sentence)


def _since(run: ReportedRun) -> int:
    """The first experiment of those in which the last state has been without a break."""
    state, first = shown_state(run.signals[-1]), run.signals[-1].experiment
    for signal in reversed(run.signals):
        if shown_state(signal) is not state:
            break
        first = signal.experiment
    return first


def _blamed(run: ReportedRun) -> str:
    """What the last diagnosis names."""
    last = run.diagnoses[-1] if run.diagnoses else None
    if last is None or not last.effects:
        return ""
    names = listed(map(spoken, last.effects), "or" if last.kind == "ambiguous" else "and")
    return f" The last diagnosis, at experiment {last.experiment}, names {names}."


def _unjudged(run: ReportedRun) -> str:
    """What is not known of the states; the strip above the errors counts them."""
    count, all_of_them = run.summary.states["not_judged"], run.summary.experiments
    if count == all_of_them:
        return " Whether the model held was not judged."
    return f" {counted(count, 'experiment')} of {all_of_them} not judged." if count else ""


def sections(run: ReportedRun, compared: DetectorStatistic) -> list[Section]:
    """All of them."""
    limits = ", and its limits" if any(compared.drift) else ""
    course = _template("course.html", label=compared.label, limits=limits)
    return [
        Section("course", "Over the run", [course]),
        _experiment(run),
        Section("learning", "What was learned", [*adaptations(run), *models(run)]),
        _diagnoses(run),
        Section("setting", "Machine and settings", _settings(run, compared)),
        _health(run),
        _every(run),
    ]


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
        few = counted(bare, "experiment")
        note += f" There is no room for the samples of {few} with the least error."
    return Section("experiment", "One experiment", [_template("chooser.html", note=note)])


def _diagnoses(run: ReportedRun) -> Section:
    section = Section("diagnoses", "Diagnoses")
    if run.diagnoses:
        rows = [
            (f"Experiment {d.experiment}", Mark(d.kind, KINDS.get(d.kind, "open")), d.sentence)
            for d in run.diagnoses
        ]
        head = ("after", "verdict", "in words")
        section.blocks.append(Table("What was to blame, at each alarm", head, rows, cards=True))
    else:
        none = "None was made in this run: --diagnose makes one at an alarm."
        section.blocks.append(Text(none, "missing"))
    return section


def _every(run: ReportedRun) -> Section:
    rows = [run.steps[index] for index in run.worst_first[:MOST_ROWS]]
    link = "#experiment-{}"
    own = {"state": shown_state, "number": number, "words": LEVEL_WORDS.get, "done": ACTION_WORDS}
    table = _template("every.html", rows=rows, link=link, **own)
    title = "All experiments, worst first"
    if len(rows) < len(run.steps):
        title = f"The {len(rows)} worst of {len(run.steps)} experiments"
    return Section("every", title, [table])


def _template(name: str, **values: object) -> Own:
    return Own(Markup(fill(f"report/templates/{name}", **values)))


def remarks(run: ReportedRun) -> list[Finding]:
    """Findings on the recording that are not well."""
    return [f for f in findings(run.health) if f.grade is not Grade.OK]


def _health(run: ReportedRun) -> Section:
    """The health of the recording, and of the nodes that made it."""
    found = Section("health", "Health of the recording")
    odd = remarks(run)
    if odd:
        head = ("what", "grade", "found", "what to do")
        rows = [
            (f.name, Mark(f.grade, GRADES[f.grade]), _without_place(f.message, run), f.remedy)
            for f in odd
        ]
        found.blocks.append(Table("What is odd about the recording", head, rows, cards=True))
    else:
        found.blocks.append(
            Text("No experiment is missing, repeated, late or unused, and no file is damaged.")
        )
    nodes = run.health.nodes
    if not nodes:
        absent = "No node's health was recorded: this was no run of the graph."
        found.blocks.append(Text(absent, "missing"))
        return found
    said: list[tuple[Value, ...]] = []
    for node in (nodes[name] for name in sorted(nodes)):
        rejected = "; ".join(f"{count} × {kind}" for kind, count in node.rejected.items())
        said.append((node.role, node.message, rejected or "nothing", node.last_rejection or "-"))
    head = ("node", "said last", "rejected", "why, the last time")
    found.blocks.append(Table("The nodes of the graph", head, said, cards=True, named=(2, 3)))
    return found


def _without_place(sentence: str, run: ReportedRun) -> str:
    """Without where the recording lay, no business of those to whom the page is sent."""
    path = str(run.health.path)
    for behind in (": ", ", ", "/"):
        sentence = sentence.replace(f"{path}{behind}", "")
    return sentence


def adaptations(run: ReportedRun) -> list[Block]:
    """One row for each alarm."""
    rows = []
    for step in run.steps:
        done = step.adaptation
        if done is not None and done.action in MARKS:
            rows.append((f"Experiment {step.number}", MARKS[done.action], done.reason))
    if not rows:
        return [Text("No new model was tried in this run.", "missing")]
    head = ("after", "done", "why")
    return [_folded(Table("What was learned at each alarm", head, rows, cards=True))]


def models(run: ReportedRun) -> list[Block]:
    """One row for each model, with what it learned from and how it did."""
    if not run.models:
        return [Text("No model was recorded.", "missing")]
    by_version: dict[int, list[Signal]] = {}
    for signal in run.signals:
        by_version.setdefault(signal.model_version, []).append(signal)
    rows: list[tuple[str, ...]] = []
    for model in {m.version: m for m in run.models}.values():
        used = by_version.get(model.version, [])
        errors = [signal.max_error for signal in used]
        learned = "nothing" if not model.trained_on else ranges(spans(model.trained_on))
        mean = number(sum(errors) / len(errors)) if errors else "-"
        force = ranges(spans(signal.experiment for signal in used))
        rows.append((f"Version {model.version}", model.kind, learned, force, mean, _cause(model)))
    head: tuple[str, ...] = (
        "model",
        "kind",
        "learned from experiments",
        "used in experiments",
        "mean max error [rad/s]",
        "cause, in SI units",
    )
    if not any(row[-1] for row in rows):
        head, rows = head[:-1], [row[:-1] for row in rows]
    return [_folded(Table("The models", head, rows, numbers=(4,), cards=True, named=(2, 3)))]


def _folded(table: Table) -> Block:
    if len(table.rows) <= OPEN_ROWS:
        return table
    return Folded(f"{table.caption} ({counted(len(table.rows), 'row')})", table)


def _cause(model: ModelRecord) -> str:
    """Effect and amounts of a diagnosed model."""
    cause = model.parameters.get("cause")
    if not isinstance(cause, dict) or not isinstance(cause.get("parameters"), dict):
        return ""
    amounts = [
        f"{name}\u00a0=\u00a0{number(value, 4)}"
        for name, value in cause["parameters"].items()
        if isinstance(value, int | float)
    ]
    return f"{spoken(str(cause.get('effect', '')))}: {', '.join(amounts)}"


def _settings(run: ReportedRun, compared: DetectorStatistic) -> list[Block]:
    """Machine, experiments, model and detector."""
    extent, numbers = run.extent, [step.number for step in run.steps]
    assert extent is not None  # of a run with a step
    pairs = [
        ("machine", run.bag.machine or "not recorded"),
        ("namespace", run.bag.namespace or "none"),
        ("recording", f"{run.name}, {_period(extent.begin, extent.end)}"),
        ("experiments", f"{len(numbers)}, numbers {numbers[0]} to {numbers[-1]}"),
        ("samples", f"{_span(list(extent.samples))} in an experiment"),
        ("sample period", f"{_span([1e3 * p for p in extent.period])} ms"),
        ("duration", f"{_span(list(extent.duration))} s"),
        ("voltage", f"{_outer([extent.voltage])} V"),
        ("speed", f"{_outer([extent.speed])} rad/s"),
        ("model", ", ".join(dict.fromkeys(m.kind for m in run.models)) or "not recorded"),
        ("detector", ", ".join(dict.fromkeys(s.detector for s in run.signals))),
        ("it compares", compared.label),
    ]
    limits = {"warns above": compared.warning, "alarm above": compared.drift}
    for words, row in limits.items():
        if values := [v for v in row if v is not None]:
            pairs.append((words, f"{_span(values)} {compared.unit}".strip()))
    shown = LIMITS if any(map(any, limits.values())) else ()
    own = {n: v for n, v in run.signals[-1].statistics.items() if n not in shown}
    if own:
        text = ", ".join(f"{spoken(name)} {_figure(v)}" for name, v in own.items())
        pairs.append(("last statistics", text))
    parameters = run.models[0].parameters.get("machine") if run.models else None
    if isinstance(parameters, dict):
        told = ", ".join(f"{name}\u00a0=\u00a0{_value(v)}" for name, v in parameters.items())
        pairs.insert(1, ("as its file has it", f"{told} (SI units)"))
    kept = {name: _bare(name, value) for name, value in run.health.settings.items()}
    if not kept:
        return [Pairs(pairs), Text("The recording holds no settings of the run.", "missing")]
    pairs.append(("run with", as_options(kept) or "the defaults alone"))
    return [Pairs(pairs), Folded("All settings of the run", _table(kept))]


def _figure(value: float) -> str:
    return f"over {MOST_TOLD:g}" if value > MOST_TOLD else f"{value:.3g}"


def _table(settings: Mapping[str, Setting]) -> Table:
    declared = msgs_config.parameters()
    rows = []
    for name, value in settings.items():
        words = _words(value)
        if words != NOTHING:
            words = f"{words} {declared.get(name, {}).get('unit', '')}".rstrip()
        rows.append((spoken(name), words, _default(name, value)))
    head = ("setting", "value", "default")
    return Table("What the run was started with", head, rows)


def _default(name: str, value: Setting) -> str:
    """What would hold today if it were not given."""
    declared = msgs_config.parameters().get(name)
    if declared is None:
        return "unknown to this version"
    return "the same" if value == declared["default"] else _words(declared["default"])


def _words(value: Setting) -> str:
    if value in UNSET:
        return NOTHING
    if isinstance(value, list):
        return ", ".join(value)
    return str(value).lower() if isinstance(value, bool) else _value(value)


def _bare(name: str, value: Setting) -> Setting:
    """Without where files lie, no business of those to whom the page is sent."""
    if name not in PATHS:
        return value
    if isinstance(value, list):
        return [PurePath(v).name for v in value]
    return PurePath(str(value)).name


def _value(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, int | float) else str(value)


def _period(begin: float, end: float) -> str:
    if begin < NO_DATE:
        return f"without a date, over {plain(end - begin, 4)} s"
    return f"from {_moment(begin)} to {_moment(end)}"


def _moment(seconds: float) -> str:
    try:
        moment = datetime.fromtimestamp(seconds, UTC)
    except (OverflowError, ValueError, OSError):
        return f"{seconds:.0f} s"
    return f"{moment:%Y-%m-%d %H:%M:%S} UTC"


def _span(values: list[float]) -> str:
    low, high = plain(min(values), 4), plain(max(values), 4)
    return low if low == high else f"{low} to {high}"


def _outer(ranges: list[tuple[float, float]]) -> str:
    low, high = min(r[0] for r in ranges), max(r[1] for r in ranges)
    return f"{number(low)} to {number(high)}"
