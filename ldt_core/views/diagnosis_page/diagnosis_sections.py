"""The sections of the page of a diagnosis, in the order in which they are read."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ldt_core.base.printable import as_argument
from ldt_core.base.sentences import counted, listed, ranges, spans
from ldt_core.diagnosis.diagnosis import Diagnosis, RankedCandidate, Refit
from ldt_core.diagnosis.sentence import applied, unsought
from ldt_core.views.diagnosis_page import gap_curves, ranking, time_curves
from ldt_core.views.diagnosis_page.headline import WORDS, headline, no_effect_needed
from ldt_core.views.diagnosis_page.next_step import machine_argument, next_step
from ldt_core.views.diagnosis_page.number_format import (
    NOTHING,
    amount,
    description,
    known,
    percent,
    percents,
    value_of,
)
from ldt_core.views.page.blocks import (
    Answer,
    Cell,
    Figure,
    Folded,
    Item,
    Items,
    Lines,
    Mark,
    Pairs,
    Section,
    Table,
    Text,
    Value,
)

FOOTER = "Made by ldt diagnose. For programs: diagnosis.json, next to this page."
TONES = {"none": "good", "effect": "found", "ambiguous": "vague", "unknown": "bad"}
MARKS = {"found": Mark("acts", "found"), "vague": Mark("may act", "vague")}
OPEN_ROWS = 10  # candidates in the table that is not folded
HEAD = ("effect", "verdict", "amounts (95 %)", "score", "error [rad/s]", "closes alone")
NOT_DRAWN = "No experiment is there to be drawn."
NEXT = "next"  # the section of the experiment to do next
HELD_OUT = "held out, never fitted"


def answer(diagnosis: Diagnosis, kept: Path) -> Answer:
    """The verdict in a short sentence, and what to do with it.

    The first section has the verdict in full. An experiment that would tell causes apart has a
    section of its own.
    """
    verdict = diagnosis.verdict
    words = WORDS.get(verdict.kind, verdict.kind)
    if no_effect_needed(diagnosis):
        words = "no effect needed"
    mark = Mark(words, TONES.get(verdict.kind, "open"))
    aside = f"confidence {percent(verdict.confidence)}".replace(" ", "\N{NO-BREAK SPACE}")
    aside = "" if unsought(verdict) else aside
    step, command = next_step(diagnosis, kept)
    if not command and diagnosis.next_experiment is not None:
        step = "record the experiment that would tell more"
    return Answer(mark, aside, headline(diagnosis), step, command, NEXT)


def lead(diagnosis: Diagnosis) -> str:
    """What was asked."""
    several = len(diagnosis.recordings) != 1
    names = f" {listed(diagnosis.recordings)}" if diagnosis.recordings else ""
    recordings = f"the recording{'s' if several else ''}{names}"
    held = diagnosis.experiments.get("held_out", ())
    part = "" if set(held).isdisjoint(diagnosis.experiments.get("fit", ())) else "parts of "
    count = f"{part}{counted(len(held), 'experiment')}"
    return (
        f"What {recordings} show{'' if several else 's'} of the machine {diagnosis.machine} that "
        f"its file does not know. Errors are those of free runs on {count} that the search never "
        "saw."
    )


def gap(diagnosis: Diagnosis, kept: Path) -> Section:
    """How large the gap was and is."""
    section = Section("gap", "How far the gap closes", [Text(diagnosis.verdict.sentence)])
    if not diagnosis.shown:
        section.blocks.append(Text(NOT_DRAWN, "missing"))
    found = diagnosis.gap
    rows: list[list[Value]] = [
        ["root mean square", *map(value_of, (found.before.rmse, found.after.rmse))],
        ["mean of the largest", *(value_of(e.mean_max_error) for e in (found.before, found.after))],
    ]
    rows[0].append(value_of(found.noise_std))
    rows[1].append(NOTHING)
    section.blocks.append(
        Table(
            "Error on held-out experiments [rad/s]",
            ("error", "before", "after", "noise"),
            rows,
            numbers=(1, 2, 3),
            note="Before: by the machine file. After: with the verdict's effects added.",
        )
    )
    closed = percent(found.closed_fraction)
    if found.closed_fraction_ci95 is not None:
        closed += f" ({percents(found.closed_fraction_ci95)})"
    if not known(found.closed_fraction):
        closed = "undefined: there is no gap beyond the noise to close"
        if found.closed_fraction_ci95 is not None:
            closed = f"{percents(found.closed_fraction_ci95)}, by the experiment"
    pairs = [("closed of the gap", closed)]
    pairs += [_added(diagnosis, e) for e in diagnosis.effects]
    groups = [g for g in diagnosis.verdict.acting if len(g) > 1]
    pairs += [("either", listed(g, "or")) for g in groups]
    section.blocks.append(Pairs(pairs))
    if diagnosis.effects:
        recording = as_argument(next(iter(diagnosis.recordings), "RECORDING"))
        command = (
            f"ldt predict {recording} --machine {machine_argument(diagnosis)} "
            f"--with {as_argument(str(kept))} --out predicted"
        )
        section.blocks += [
            Text("To predict this or another recording with what was found:"),
            Text(command, "code"),
        ]
    return section


def _added(diagnosis: Diagnosis, effect: Mapping[str, Any]) -> tuple[str, str]:
    """An effect of the verdict with its amounts, or a number of the file that was fitted along."""
    name = str(effect["effect"])
    # The first of a group was added; another of its names is the file's own number, fitted along.
    if name not in {group[0] for group in diagnosis.verdict.acting}:
        told = (f"{n} = {value_of(v)}" for n, v in effect["parameters"].items())
        return "fitted along", f"{name}: {', '.join(told)}"
    ranked = [c for c in diagnosis.candidates if c.effect == name]
    amounts = [amount(n, a) for c in ranked[:1] for n, a in c.parameters.items()]
    told = (f"{text} ({interval})" for text, interval in amounts)
    return "effect added", f"{name}: {', '.join(told)}"


def curves(diagnosis: Diagnosis) -> Figure | None:
    """Before and after over time, beside the answer; None where no experiment is held."""
    drawing = time_curves.before_after(diagnosis)
    return Figure.of(drawing, files=False) if drawing else None


def where(diagnosis: Diagnosis) -> Section:
    """The places of the gap."""
    section = Section("where", "Where the gap lies")
    section.figure(gap_curves.torque_drawing(diagnosis), NOT_DRAWN, files=False)
    clear = [p for p in diagnosis.where if p.share_of_data < gap_curves.EVERYWHERE]
    if clear:
        rows = [
            (
                f"{p.quantity}, when steady" if p.steady else p.quantity,
                gap_curves.span(p),
                percent(p.share_of_gap),
                percent(p.share_of_data),
            )
            for p in clear
        ]
        head = ("quantity", "range", "of the gap", "of the data")
        section.blocks.append(Table("Places, the clearest first", head, rows, numbers=(2, 3)))
    else:
        otherwise = "There is no gap to be found anywhere."
        if diagnosis.where:
            otherwise = "The gap lies everywhere: no range holds much more of it than of the data."
        section.blocks.append(Text(otherwise, "missing"))
    return section


def candidates(diagnosis: Diagnosis) -> Section:
    """How every effect fared."""
    section = Section("candidates", "What was tried")
    section.figure(
        ranking.bars(diagnosis), "There is no gap that a candidate could close.", files=False
    )
    named = [c for c in diagnosis.candidates if ranking.standing(diagnosis, c)]
    others = [c for c in diagnosis.candidates if c not in named]
    first = max(OPEN_ROWS - len(named), 0)
    order = [c for c in diagnosis.candidates if c in named or c in others[:first]]
    rest = others[first:]
    note = (
        "Score: part of the gap's power in the fitted experiments that the effect explains alone. "
        "Error and closed part: on the held-out experiments, with it alone."
    )
    if order:
        section.blocks.append(_ranked("Candidates, the best first", order, diagnosis, note))
    if rest:
        table = _ranked("The other candidates", rest, diagnosis, "")
        section.blocks.append(Folded(counted(len(rest), "other candidate"), table))
    return section


def _ranked(
    caption: str, rows: Sequence[RankedCandidate], diagnosis: Diagnosis, note: str
) -> Table:
    made = [_row(c, diagnosis) for c in rows]
    return Table(caption, HEAD, made, numbers=(3, 4, 5), note=note, cards=True)


def _row(c: RankedCandidate, diagnosis: Diagnosis) -> tuple[Value, ...]:
    mark: Value = c.rejected_because or NOTHING
    if standing := ranking.standing(diagnosis, c):
        mark = MARKS[standing]
    amounts = [Cell(*amount(n, a)) for n, a in c.parameters.items()]
    return (
        Cell(c.effect, about) if (about := description(c.effect)) else c.effect,
        mark,
        Lines(amounts) if amounts else NOTHING,
        percent(c.score),
        value_of(c.held_out_rmse),
        percent(c.closed_fraction),
    )


def contributions(diagnosis: Diagnosis) -> Section | None:
    """Shapley shares; None for less than two effects."""
    drawing = ranking.shares(diagnosis)
    if drawing is None:
        return None
    section = Section("shares", "Who contributes what")
    section.figure(drawing, "", files=False)
    return section


def remainder(diagnosis: Diagnosis) -> Section:
    """What is left, and how the closing fares by regime."""
    section = Section("remainder", "What is left")
    left = diagnosis.remainder
    structure = "yes: it is more than noise" if left.structured else "no: it is as noise"
    pairs = [("share of the gap", percent(left.share_of_gap)), ("structure", structure)]
    if left.depends_on:
        pairs.append(("can be predicted from", ", ".join(left.depends_on)))
    elif left.structured:
        pairs.append(("can be predicted from", "nothing that was tried"))
    section.blocks.append(Pairs(pairs))
    if diagnosis.gap.regimes:
        section.blocks.append(_regimes(diagnosis.gap.regimes))
    if diagnosis.refit:
        section.blocks.append(_refits(diagnosis.refit))
    return section


def _refits(found: Sequence[Refit]) -> Table:
    made: list[list[Value]] = [
        [
            r.parameter,
            f"× {r.factor:.3g}",
            "not determined" if r.ci95 is None else f"{r.ci95[0]:.3g} to {r.ci95[1]:.3g}",
            "unknown" if r.prior_std is None else f"± {percent(r.prior_std)}",
            percent(r.closed_fraction),
        ]
        for r in found
    ]
    head = ["parameter", "fitted", "95 % interval", "tolerance", "closed by all of these alone"]
    return Table("Nominal parameters that were fitted along", head, made, range(1, len(head)))


def _regimes(found: Sequence[Mapping[str, Any]]) -> Table:
    worse = [known(r["closed_fraction"]) and r["rmse_after"] > r["rmse_before"] for r in found]
    made: list[list[Value]] = [[r["regime"], *_regime_figures(r)] for r in found]
    head = ["regime", "samples", "RMSE before", "RMSE after", "closed"]
    if any(worse):
        head.insert(1, "")
        for row, bad in zip(made, worse, strict=True):
            row.insert(1, Mark("worse", "bad") if bad else "")
    numbers = range(len(head) - 4, len(head))
    count = sum(worse)
    note = f"In {count} of {len(found)} the error grew." if count else "In none did the error grow."
    return Table("By regime of the held-out experiments", head, made, numbers, note)


def _regime_figures(regime: Mapping[str, Any]) -> list[str]:
    errors = (value_of(float(regime[key])) for key in ("samples", "rmse_before", "rmse_after"))
    return [*errors, percent(regime["closed_fraction"])]


def blind(diagnosis: Diagnosis) -> Section:
    """What this recording could not have shown."""
    section = Section("blind", "What this recording could not have shown")
    if diagnosis.undetectable:
        section.blocks.append(
            Text("Were these there, the recording would look the same within its noise:")
        )
        section.blocks.append(Items([Item(description(n), n) for n in diagnosis.undetectable]))
    else:
        section.blocks.append(Text("Every candidate would have shown, had it been there."))
    if diagnosis.ambiguities:
        section.blocks.append(Text("These it cannot tell apart, whichever of a group acts:"))
        groups = [Item(listed(g, "or")) for g in diagnosis.ambiguities if g]
        section.blocks.append(Items(groups))
    else:
        section.blocks.append(Text("Any two candidates that show can be told apart."))
    return section


def following(diagnosis: Diagnosis) -> Section:
    """The experiment to do next."""
    section = Section(NEXT, "The next experiment")
    then = diagnosis.next_experiment
    if then is None or not len(then.voltage):
        section.blocks.append(Text("No further experiment is proposed.", "missing"))
        return section
    section.blocks.append(Text(f"{then.why[:1].upper()}{then.why[1:].rstrip('.')}."))
    section.figure(time_curves.voltage(then), "", files=False)
    length = len(then.voltage) * then.sample_period
    section.blocks.append(
        Pairs(
            [
                ("to record", ", ".join(then.channels)),
                ("samples", f"{len(then.voltage)}, every {then.sample_period:g} s"),
                ("voltage", f"{applied(then)}; next_experiment.voltage in diagnosis.json"),
            ]
        )
    )
    columns = {"voltage": "u", "speed": "n", "current": "i"}
    fields = [f"--{c} {columns[c]}" for c in columns if c in then.channels]
    recordings = " ".join(map(as_argument, diagnosis.recordings)) or "RECORDING"
    section.blocks += [
        Text("Once it is recorded as a table with these columns, and diagnosed with the rest:"),
        Text(
            f"ldt import next.csv {' '.join(fields)} --sample-period {then.sample_period:g} "
            f"--length {length:g} --out next\n"
            f"ldt diagnose {recordings} next --machine {machine_argument(diagnosis)} --out again",
            "code",
        ),
    ]
    return section


def done(diagnosis: Diagnosis) -> Section:
    """What was done with which data."""
    section = Section("done", "What was done")
    names = {"fit": "fitted", "held_out": HELD_OUT}
    pairs = [("machine", diagnosis.machine), ("recordings", ", ".join(diagnosis.recordings))]
    for key, found in diagnosis.experiments.items():
        pairs.append(
            (f"experiments {names.get(key, key)}", f"{ranges(spans(found))} ({len(found)})")
        )
    pairs.append(("candidates", str(len(diagnosis.candidates))))
    pairs.append(("noise of the speed", f"{value_of(diagnosis.gap.noise_std)} rad/s"))
    section.blocks.append(Pairs(pairs))
    if diagnosis.notes:
        section.blocks.append(Items([Item(note) for note in diagnosis.notes]))
    return section


SECTIONS: tuple[Callable[[Diagnosis], Section | None], ...] = (
    where,
    candidates,
    contributions,
    remainder,
    blind,
    following,
    done,
)
