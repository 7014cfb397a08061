"""Parameters as declared in `msgs_config/parameters.yaml`, checked once for nodes and commands."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterable, Mapping
from typing import Any

import msgs_config
from ldt_core.base.errors import OptionError, described, did_you_mean

#: Share of a recording's experiments by which a fit is judged, unless said otherwise.
HOLDOUT = 0.25
FROM_FILE = -1.0  # of a numerical option: take the machine file's value
#: Experiments of a run without an end: as many as can be counted.
ENDLESS = int(msgs_config.parameters()["experiments"]["range"][1])
#: Named configurations: what they set, whatever the defaults are. Paper: Zhou, Walther, Verl, CIRP
#: CMS 2024. Every new model is taken, S_w and the present experiment are learned from, f_d depends
#: on the speed alone, the linear model has no offset, no experiment is refused, and theta_w is half
#: of theta_c. The paper prints no theta_c; 3 rad/s is in the middle of the range that it tries.
PRESETS: Mapping[str, Mapping[str, Any]] = {
    "paper": {
        "model": "hybrid",
        "detector": "threshold",
        "threshold": 3.0,
        "warning_threshold": 1.5,
        "gate": "none",
        "data": "warning-set",
        "gp_inputs": ["speed"],
        "offset": False,
        "sensor_check": False,
    },
}
#: Defaults that mean "take it from elsewhere", not worth showing.
UNSET: tuple[Any, ...] = ("", FROM_FILE, [])


def resolve(given: Mapping[str, Any], *groups: str) -> dict[str, Any]:
    """All parameters of the groups: those given, checked, and the declared defaults.

    Args:
        given: parameter → value.
        groups: groups of `parameters.yaml`; none means all.

    Raises:
        OptionError: an unknown name, a wrong type, or a value outside its range or choices.
    """
    declared = msgs_config.parameters(*groups)
    for name in given:
        if name not in declared:
            raise OptionError("parameter", did_you_mean(name, declared), repr(name))
    return {n: check(n, given[n], d) if n in given else d["default"] for n, d in declared.items()}


def preset(name: str) -> dict[str, Any]:
    """What a named configuration sets; "" sets nothing.

    Raises:
        OptionError: an unknown name.
    """
    if name and name not in PRESETS:
        raise OptionError("preset", did_you_mean(str(name), PRESETS), repr(name))
    return dict(PRESETS[name]) if name else {}


def check(name: str, value: Any, declaration: Mapping[str, Any]) -> Any:
    """The value in its declared type.

    Raises:
        OptionError: a wrong type, or a value outside its range or choices.
    """
    kind = declaration["type"]
    if kind == "string_array":
        many = isinstance(value, Iterable) and not isinstance(value, str | Mapping)
        if not many or not all(isinstance(v, str) for v in value):
            raise OptionError(name, "a list of words", described(value))
        value = list(value)
    elif kind == "string":
        if not isinstance(value, str):
            raise OptionError(name, "a word", described(value))
    elif kind == "bool":
        if not isinstance(value, bool):
            raise OptionError(name, "true or false", described(value))
    else:
        value = _number(name, value, kind)
        low, high = declaration.get("range", (-math.inf, math.inf))
        if not low <= value <= high:
            unit = declaration.get("unit", "")
            raise OptionError(name, f"{low:g} to {high:g} {unit}".rstrip(), value)
    choices = declaration.get("choices")
    for word in value if isinstance(value, list) else [value]:
        if choices and word not in choices:
            raise OptionError(name, did_you_mean(str(word), filter(None, choices)), repr(word))
    return value


def flag_of(name: str) -> str:
    """The option of a parameter.

    >>> flag_of("split_size"), flag_of("bag")
    ('--split-size', '--out')
    """
    declared = msgs_config.parameters().get(name, {})
    return "--" + str(declared.get("flag", name.replace("_", "-")))


def idle_beside(name: str, settings: Mapping[str, Any]) -> str | None:
    """The other parameter, beside whose value this one changes nothing; None where it may.

    Beside a part of one's own any parameter may. What a named configuration sets counts as it does
    there: spelled out it is that configuration.

    >>> idle_beside("order", {"model": "hybrid", "order": 2})
    'model'
    """
    declared = msgs_config.parameters()
    if any(name in p and p[name] == settings.get(name) for p in PRESETS.values()):
        return None
    for other, served in declared[name].get("only_with", {}).items():
        if other not in settings:
            continue
        chosen = settings[other]
        if chosen not in served and chosen in declared[other].get("shipped", [chosen]):
            return other
    return next((o for o in declared[name].get("idle_beside", ()) if settings.get(o)), None)


def as_options(settings: Mapping[str, Any]) -> str:
    """Options of the command line that give these parameters.

    Those at their defaults, and those that change nothing, are left out.

    >>> as_options({"model": "auto", "seed": 3, "offset": False, "effect": ["unbalance:e=0.005"]})
    '--seed 3 --no-offset --effect unbalance:e=0.005'
    """
    declared = msgs_config.parameters()
    words: list[str] = []
    for name, value in settings.items():
        if name in declared and value == declared[name]["default"]:
            continue
        if name in declared and idle_beside(name, settings):
            continue
        flag = flag_of(name)[2:]
        if isinstance(value, bool):
            words.append(f"--{flag}" if value else f"--no-{flag}")
            continue
        for one in value if isinstance(value, list) else [value]:
            words += [f"--{flag}", shlex.quote(str(one))]
    return " ".join(words)


def _number(name: str, value: Any, kind: str) -> int | float:
    try:
        finite = not isinstance(value, bool) and math.isfinite(value)
    except (TypeError, OverflowError):  # no number, or a whole one beyond all floating point
        finite = False
    if not finite:
        raise OptionError(name, "a finite number", described(value))
    if kind == "double":
        return float(value)
    if not float(value).is_integer():
        raise OptionError(name, "a whole number", repr(value))
    return int(value)
