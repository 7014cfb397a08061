"""What tuning leaves behind: tune.json, which other commands take, and tune.csv."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Any

import msgs_config
from ldt_core.base.result_files import write
from ldt_core.lab.tuning.candidates import NEVER
from ldt_core.lab.tuning.choice import pareto
from ldt_core.lab.tuning.reasons import sentence, why
from ldt_core.lab.tuning.trial import Tried
from ldt_core.lab.tuning.tune import Tuning

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
