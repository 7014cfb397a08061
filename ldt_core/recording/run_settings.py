"""The settings of a run, kept in its recording's metadata as one flat JSON text.

They come back as what a command, or a parameter file, would be given. Nothing is evaluated, and
what is no such text is refused as a whole.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from typing import Any

import msgs_config
from ldt_core.base.errors import OptionError, RecordingError
from ldt_core.base.settings import check
from ldt_core.recording.messages import quoted

KEY = "settings"  # of a recording's custom data
FORMAT = "ldt-settings-1"
SECURE = "secure"  # recorded is whether the run was, and not by which keys
#: What says where and how the run was recorded, and nothing of what it did.
LEFT_OUT = ("bag", "graph", "resume", "run_settings", SECURE, "split_size")
#: What a run may go on with otherwise: it decides when things happen, and not what.
CHANGEABLE = (
    *("adaptation_timeout", "checkpoint_every", "deadline", "hung_after"),
    *("processes", "rate", "real_time", "restarts"),
)
MAX_CHARACTERS = 100_000  # characters of the text; all parameters take about 2000
INTEGER_END = 2**63  # of a whole number, as ROS counts
NAME = re.compile(r"[a-z][a-z0-9_]{0,63}")

Setting = bool | int | float | str | list[str]


def settings_text(settings: Mapping[str, Any]) -> str:
    """The text of a run's parameters, by name.

    >>> settings_text({"model": "linear", "seed": 3, "bag": "my_run"})
    '{"format": "ldt-settings-1", "model": "linear", "seed": 3}'
    """
    kept = {name: value for name, value in settings.items() if name not in LEFT_OUT}
    if settings.get(SECURE):
        kept[SECURE] = True
    return json.dumps({"format": FORMAT, **kept}, allow_nan=False)


def parse_settings(where: str, text: Any) -> dict[str, Setting]:
    """The parameters in a text, by name.

    Args:
        where: what to call it in a sentence.
        text: whatever stands there.

    Raises:
        RecordingError: it is no such text, one of another version, or a parameter is not of its
            declared type or outside its range.
    """
    if not isinstance(text, str) or len(text) > MAX_CHARACTERS:
        raise RecordingError(where, f"a text of at most {MAX_CHARACTERS} characters", quoted(text))
    try:
        found = json.loads(text)
    except (ValueError, RecursionError):
        raise RecordingError(where, "settings in JSON", quoted(text)) from None
    if not isinstance(found, dict) or "format" not in found:
        raise RecordingError(where, "names with values, and their format", quoted(text))
    if found.pop("format") != FORMAT:
        raise RecordingError(where, f"settings of the format {FORMAT}", "those of another version")
    for name, value in found.items():
        if not NAME.fullmatch(name):
            raise RecordingError(where, "names in small letters", quoted(name))
        if not _is_setting(value):
            expected = "true or false, a finite number, a line of text, or a list of such lines"
            raise RecordingError(f"{where}, {name}", expected, quoted(value))
        declared = msgs_config.parameters().get(name)
        if declared is not None and name not in LEFT_OUT and not _same(value, declared["default"]):
            try:
                check(name, value, declared)
            except OptionError as error:
                raise RecordingError(f"{where}, {name}", error.expected, error.got) from None
    return found


def _same(value: Any, other: Any) -> bool:
    """As JSON has them: 1 is not true."""
    return type(value) is type(other) and bool(value == other)


def _is_setting(value: Any) -> bool:
    match value:
        case bool():
            return True
        case int():
            return abs(value) < INTEGER_END
        case float():
            return math.isfinite(value)
        case str():
            return value.isprintable()
        case list():
            return all(isinstance(v, str) and v.isprintable() for v in value)
    return False
