"""What tuning leaves behind: tune.json, which other commands take, tune.csv, and the reasons."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import msgs_config
from ldt_core.base.result_files import write
from ldt_core.base.sentences import number
from ldt_core.lab.tuning.alarms import LENGTH, STREAMS, most, needed
from ldt_core.lab.tuning.candidates import NEVER
from ldt_core.lab.tuning.choice import PARTS, SAME_ERROR, best_of, count, pareto
from ldt_core.lab.tuning.trial import Tried
from ldt_core.lab.tuning.tune import Tuning

#: The next values of the same parameter have an error larger by so much: the choice is a lucky one.
PLATEAU_TOLERANCE = 0.05


def sentence(found: Tuning) -> str:
    """The choice in a sentence, or that there is none."""
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
        reason = f"least MME ({number(least)} rad/s, {count(best.adaptations, 'adaptation')})"
    else:
        reason = (
            f"{count(best.adaptations, 'adaptation')}, fewest among {len(choice.tied)} settings "
            f"whose MME ({number(best.mme)} rad/s) is within {SAME_ERROR:.0%} of the least"
        )
    some = f"the {kept} of {acting} settings tried" if kept > 1 else f"the only one of {acting}"
    verb = "keep" if kept > 1 else "keeps"
    return f"{best.setting}: {reason}, of {some} that {verb} to {budget}"


def why(found: Tuning) -> list[str]:
    """What else there is to know of the choice, a sentence each."""
    return [s for part in (_rivals, _never, _alarms, _checked, _neighbours) for s in part(found)]


def _rivals(found: Tuning) -> Iterator[str]:
    """The other detectors, and what the budget costs."""
    chosen = found.choice.chosen
    own = chosen.setting.detector if chosen else ""
    names = dict.fromkeys(t.setting.detector for t in found.tried if t.setting != NEVER)
    for name in (n for n in names if n != own):
        best = best_of(found.choice.kept, partial(_is_of, name))
        if best is not None:
            yield f"{name}: at best {_figures(best)} ({_value(best)})"
        elif chosen is not None:
            yield f"{name}: no setting keeps to the budget{_unproven(found, name)}"
    free = best_of(found.tried, lambda t: t.setting != NEVER)
    if chosen is not None and free is not None and free.mme < chosen.mme * (1 - SAME_ERROR):
        yield f"without the budget: {free.setting}, {_figures(free)}{_rate(free)}"


def _unproven(found: Tuning, name: str) -> str:
    """Whether a rate of false alarms is too low for the experiments to show, and has no law."""
    runs = [t.false_alarms for t in found.tried if t.setting.detector == name and t.false_alarms]
    if found.budget.every is None or not any(a.rate == 0 and a.law is None for a in runs):
        return ""
    return " (it has no law by which to extrapolate what the experiments in control cannot show)"


def _never(found: Tuning) -> Iterator[str]:
    best, never = found.choice.chosen, found.never.mme
    if best is None:
        return
    left = f"without learning the MME is {number(never)} rad/s"
    if best.mme < never * (1 - SAME_ERROR):
        yield f"{left}: {100 * best.mme / never:.0f} % of it is left"
    else:
        yield f"{left}: on this recording learning gained nothing, so that any choice is as good"


def _alarms(found: Tuning) -> Iterator[str]:
    control, best = found.control, found.choice.chosen
    if control is None:
        yield "no experiments are known to be in control: the rate of false alarms is unknown"
        return
    size = len(control.numbers)
    source = "as given" if control.given else "as the calibrated detector judges"
    model = "models of the other half" if control.learned else "the untrained model"
    yield (
        f"in control: {count(size, 'experiment')} ({control.text}, {source}), predicted by "
        f"{model}; they alone can show at most one false alarm in {1 / most(0.0, size):.3g}"
    )
    if not control.given:
        yield (
            "a stretch that was judged to be in control may hold drifts too small to find, which "
            "make false alarms look more frequent: --in-control says which experiments it truly are"
        )
    if best is None or best.false_alarms is None:
        return
    alarms, every = best.false_alarms, found.budget.every
    drawn = f"in {STREAMS} streams of {LENGTH} experiments drawn from these"
    interval = f"95 % interval {_per(alarms.low)} to {_per(alarms.high)}"
    if alarms.low == alarms.high == alarms.law:
        yield f"false alarms of the choice: {_per(alarms.rate)}, {alarms.how}"
    else:
        yield f"false alarms of the choice {drawn}: {_per(alarms.rate)} ({interval})"
        if every is not None and not alarms.shown(every):
            yield (
                f"one in {every:g} is more than they can show: it is extrapolated {alarms.how}; "
                f"{needed(every)} experiments in control without an alarm would show it"
            )


def _checked(found: Tuning) -> Iterator[str]:
    choice = found.choice
    if choice.chosen is None or choice.checked is None:
        return
    gap = choice.checked - choice.chosen.mme
    more = f"{number(abs(gap))} rad/s {'more' if gap > 0 else 'less'}" if gap else "the same"
    yield (
        f"an MME on the recording that it was chosen from flatters: with each of {PARTS} parts of "
        f"it judged by what the other parts choose, it is {number(choice.checked)} rad/s ({more}); "
        f"{choice.agreed} of {PARTS} times that is this setting, or one as good"
    )


def _neighbours(found: Tuning) -> Iterator[str]:
    """Whether the choice stands on a plateau, and whether it is the last value tried."""
    best = found.choice.chosen
    if best is None:
        return
    own = (best.setting.detector, best.setting.parameter)
    runs = [t for t in found.tried if (t.setting.detector, t.setting.parameter) == own]
    runs.sort(key=lambda t: t.setting.value)
    at = runs.index(best)
    near = [t for t in runs[max(0, at - 1) : at + 2] if t is not best]
    if near and min(t.mme for t in near) > best.mme * (1 + PLATEAU_TOLERANCE):
        beside = " and ".join(f"{number(t.mme)} rad/s at {t.setting.value:g}" for t in near)
        yield (
            f"beside it the MME is {beside}: part of its own is luck in when it adapted, which no "
            "part of one recording can take out; a longer recording, or several, would"
        )
    if len(runs) > 1 and at in (0, len(runs) - 1):
        end = "largest" if at else "least"
        yield f"{best.setting.value:g} is the {end} {best.setting.parameter} that was tried"


def _figures(tried: Tried) -> str:
    return f"MME {number(tried.mme)} rad/s with {count(tried.adaptations, 'adaptation')}"


def _value(tried: Tried) -> str:
    return f"{tried.setting.parameter} {tried.setting.value:g}"


def _rate(tried: Tried) -> str:
    if tried.false_alarms is None:
        return ""
    return f", false alarms in control {_per(tried.false_alarms.rate)}"


def _per(rate: float) -> str:
    """A rate for people.

    >>> _per(0.0), _per(0.001), _per(1.0)
    ('none', 'one in 1000', 'one in 1')
    """
    return f"one in {1 / rate:.3g}" if rate > 0 else "none"


def _is_of(detector: str, tried: Tried) -> bool:
    return tried.setting.detector == detector


FILE, TABLE = "tune.json", "tune.csv"


def as_dict(found: Tuning) -> dict[str, Any]:
    """All of it as plain JSON; `settings` is what other commands take (--settings FILE)."""
    choice, control = found.choice, found.control
    best = choice.chosen
    return {
        "settings": settings(found),
        "options": best.setting.options if best else None,
        "sentence": sentence(found),
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


def write_results(found: Tuning, out: Path | str) -> None:
    """Write tune.json and tune.csv."""
    write(Path(out) / FILE, json.dumps(as_dict(found), indent=1, allow_nan=False))
    table = rows(found)
    text = io.StringIO()
    writer = csv.DictWriter(text, list(table[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(table)
    write(Path(out) / TABLE, text.getvalue())
