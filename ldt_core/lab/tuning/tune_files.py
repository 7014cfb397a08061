"""What tuning leaves behind: tune.json, which other commands take, tune.csv, and the reasons."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgs_config
from ldt_core.base.result_files import csv_text, write
from ldt_core.base.sentences import counted, number
from ldt_core.lab.tuning.candidates import NEVER
from ldt_core.lab.tuning.choice import PARTS, SAME_ERROR, best_of, pareto
from ldt_core.lab.tuning.in_control import most
from ldt_core.lab.tuning.trial import Tried
from ldt_core.lab.tuning.tune import Tuning


def choice_sentence(found: Tuning) -> str:
    """The choice in two sentences, or that there is none."""
    choice, budget = found.choice, found.budget.text
    acting = len(found.tried) - 1
    if choice.chosen is None:
        assert choice.nearest is not None
        near = choice.nearest
        return (
            f"none of the {acting} settings tried keeps to {budget}; the nearest is {near.setting} "
            f"({near.setting.options}): {_figures(near)}{_rate(near)}"
        )
    best, kept = choice.chosen, len(choice.kept)
    least = min(t.mme for t in choice.tied)
    if best.mme == least:
        reason = f"least error, {_figures(best)}"
    else:
        reason = f"{_figures(best)}, the fewest within {SAME_ERROR:.0%} of the least MME"
    some = f"{kept} of {acting} settings tried keep" if kept > 1 else f"Only 1 of {acting} keeps"
    return f"{best.setting}: {reason}. {some} to {budget}."


def why(found: Tuning) -> list[str]:
    """What else there is to know of the choice, a sentence each."""
    return [*_rivals(found), *_alarms(found), *_checked(found)]


def _rivals(found: Tuning) -> Iterator[str]:
    """The other detectors, what the budget costs, and the untrained model."""
    chosen, never = found.choice.chosen, found.never.mme
    own = chosen.setting.detector if chosen else ""
    names = dict.fromkeys(t.setting.detector for t in found.tried if t.setting != NEVER)
    for name in (n for n in names if n != own):
        best = best_of([t for t in found.choice.kept if t.setting.detector == name])
        if best is not None:
            yield f"{name}: at best {_figures(best)} ({_value(best)})"
        elif chosen is not None:
            yield f"{name}: no setting keeps to the budget"
    free = best_of([t for t in found.tried if t.setting != NEVER])
    if chosen is not None and free is not None and free.mme < chosen.mme * (1 - SAME_ERROR):
        yield f"without the budget: {free.setting}, {_figures(free)}{_rate(free)}"
    if chosen is not None:
        left = f"{100 * chosen.mme / never:.0f} % of it is left" if never else "nothing to learn"
        yield f"without learning the MME is {number(never)} rad/s: {left}"
        if chosen.mme >= never * (1 - SAME_ERROR):
            yield (
                "learning gained nothing here: this recording says when to keep still, not when to "
                "learn"
            )


def _alarms(found: Tuning) -> Iterator[str]:
    control, best = found.control, found.choice.chosen
    if control is None:
        yield "no experiments without a change are known: the rate of false alarms is unknown"
        return
    size = len(control.numbers)
    source = "as given" if control.given else "as the adequacy detector judges"
    yield (
        f"unchanged machine: {counted(size, 'experiment')} ({control.text}, {source}); they can "
        f"only show at most one false alarm in {1 / most(0.0, size):.0f}"
    )
    if best is not None and best.false_alarms is not None:
        alarms, every = best.false_alarms, found.budget.every
        interval = f"95 % interval {_per(alarms.low)} to {_per(alarms.high)}"
        law = every is not None and alarms.high * every > 1
        more = f"; one in {every:g} is extrapolated" if law else ""
        yield f"false alarms of the choice: {_per(alarms.rate)} ({interval}){more}"


def _checked(found: Tuning) -> Iterator[str]:
    choice = found.choice
    if choice.checked is not None:
        yield (
            f"with each of {PARTS} parts of the recording judged by what the others choose, the "
            f"MME is {number(choice.checked)} rad/s"
        )


def _figures(tried: Tried) -> str:
    return f"MME {number(tried.mme)} rad/s with {counted(tried.adaptations, 'adaptation')}"


def _value(tried: Tried) -> str:
    return f"{tried.setting.parameter} {tried.setting.value:g}"


def _rate(tried: Tried) -> str:
    if tried.false_alarms is None:
        return ""
    return f", false alarms {_per(tried.false_alarms.rate)}"


def _per(rate: float) -> str:
    """A rate for people.

    >>> _per(0.0), _per(0.001), _per(1.0)
    ('none', 'one in 1000', 'one in 1')
    """
    return f"one in {1 / rate:.0f}" if rate > 0 else "none"


FILE, TABLE = "tune.json", "tune.csv"


def tuning_record(found: Tuning) -> dict[str, Any]:
    """All of it as plain JSON; `settings` is what other commands take (--settings FILE)."""
    choice, control = found.choice, found.control
    best = choice.chosen
    return {
        "settings": settings(found),
        "options": best.setting.options if best else None,
        "sentence": choice_sentence(found),
        "why": why(found),
        "budget": {
            "adaptations": found.budget.adaptations,
            "false_alarms_every": found.budget.every,
        },
        "mme": best.mme if best else None,
        "mme_checked": choice.checked,
        "mme_never": found.never.mme,
        "adaptations": best.adaptations if best else None,
        "experiments": len(found.numbers),
        "in_control": None
        if control is None
        else {
            "experiments": list(control.numbers),
            "given": control.given,
            "learned": control.learned,
        },
        "machine": found.machine.name,
        "matter": found.matter,
        "notes": list(found.notes),
        "tried": rows(found),
    }


def settings(found: Tuning) -> dict[str, Any] | None:
    """Model, its options and the adaptor's where they are not the default, and the choice."""
    if found.choice.chosen is None:
        return None
    declared = msgs_config.parameters("model", "adaptor")
    own = {
        name: found.settings[name]
        for name, one in declared.items()
        if name == "model" or found.settings[name] != one["default"]
    }
    return own | found.choice.chosen.setting.settings


def rows(found: Tuning) -> list[dict[str, Any]]:
    """One row a setting tried."""
    front = {t.setting for t in pareto(found.tried)}
    return [_row(found, t, t.setting in front) for t in found.tried]


def _row(found: Tuning, tried: Tried, on_front: bool) -> dict[str, Any]:
    setting, alarms, control = tried.setting, tried.false_alarms, found.control
    inside = set(control.numbers) if control else set()
    positive = zip(found.numbers, tried.level, strict=True)
    best = found.choice.chosen
    return {
        "detector": setting.detector,
        "parameter": setting.parameter or None,
        "value": setting.value if setting.parameter else None,
        "mme": tried.mme,
        "share_of_never": tried.mme / found.never.mme if found.never.mme else None,
        "adaptations": tried.adaptations,
        "refusals": tried.refusals,
        "positives": tried.positives,
        "positives_in_control": sum(n in inside and v == 1 for n, v in positive)
        if control
        else None,
        "false_alarm_rate": alarms.rate if alarms else None,
        "false_alarm_low": alarms.low if alarms else None,
        "false_alarm_high": alarms.high if alarms else None,
        "false_alarm_law": alarms.law if alarms else None,
        "keeps_budget": setting != NEVER and found.budget.kept(tried),
        "pareto": on_front,
        "chosen": best is not None and setting == best.setting,
        "seconds": tried.seconds,
        "options": setting.options,
    }


def is_of(out: Path | str, matter: str) -> bool:
    """Whether the results in a folder are a tuning of this: it goes on there, and replaces none."""
    try:
        record = json.loads((Path(out) / FILE).read_text(encoding="utf-8"))
        return bool(record["matter"] == matter)
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return False


def write_results(found: Tuning, out: Path | str) -> None:
    """Write tune.json and tune.csv."""
    write(Path(out) / FILE, json.dumps(tuning_record(found), indent=1, allow_nan=False))
    write(Path(out) / TABLE, csv_text(rows(found)))
