"""Detectors of drift between prediction and measurement, one algorithm a file."""

from __future__ import annotations

import copy
import inspect
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import msgs_config
from ldt_core.base.errors import (
    FAULTS,
    ArgumentTypeError,
    BadInput,
    OptionError,
    described,
    did_you_mean,
    reason_of,
)
from ldt_core.base.plain_yaml import NO_YAML, load_yaml
from ldt_core.base.registry import Registry

if TYPE_CHECKING:
    from ldt_core.detectors.base import Detector

DETECTORS = Registry(
    "detector",
    {
        "threshold": "ldt_core.detectors.threshold:Threshold",
        "lddm": "ldt_core.detectors.lddm:LDDM",
        "window": "ldt_core.detectors.window:Window",
        "never": "ldt_core.detectors.never:Never",
        "adequacy": "ldt_core.detectors.adequacy:Adequacy",
        "river": "ldt_core.detectors.river_adapter:River",
    },
    "ldt.detector",
)


def as_detector(given: object) -> Detector:
    """A copy of a detector object, with what it has seen, as the loop uses it.

    Args:
        given: a `Detector`, or any object with river's `update(x)` and `drift_detected`.

    Raises:
        ArgumentTypeError: something else.
    """
    from ldt_core.detectors.base import Detector
    from ldt_core.detectors.foreign import Foreign, Updatable

    if isinstance(given, Detector):
        return copy.deepcopy(given)
    if isinstance(given, Updatable) and not isinstance(given, type):
        return Foreign(given)
    expected = "a name, a Detector, or an object with update(x) and drift_detected"
    raise ArgumentTypeError("detector", expected, described(given))


def build_detector(name: str | type[Detector], settings: Mapping[str, Any]) -> Detector:
    """The detector of that name, fresh, with the settings that its constructor names.

    Args:
        name: of `DETECTORS`, or `path/to/file.py:Name`; or a class.
        settings: parameters of the group detector (`parameters.yaml`); the rest is not looked at.
            `detector_argument` holds entries "NAME=VALUE" for arguments without a parameter.

    Raises:
        OptionError: an unknown detector or argument, or a value that the constructor refuses.
    """
    from ldt_core.detectors.base import Detector

    kind = DETECTORS.get(name) if isinstance(name, str) else name
    if not (isinstance(kind, type) and issubclass(kind, Detector)):
        raise OptionError(f"detector {name}", "a subclass of Detector", repr(kind))
    signature = inspect.signature(kind).parameters.values()
    named = [p.name for p in signature if p.kind is not p.VAR_KEYWORD]
    open_ended = len(named) < len(signature)
    declared = msgs_config.parameters("detector")
    arguments = {n: settings[n] for n in named if n in declared and n in settings}
    for entry in settings.get("detector_argument", ()):
        argument, value = _parse(entry)
        if argument not in named and not open_ended:
            known = did_you_mean(argument, named) if named else "none at all"
            raise OptionError(f"argument of detector {name}", known, repr(argument))
        arguments[argument] = value
    try:
        return kind(**arguments)
    except BadInput:
        raise
    except (TypeError, ValueError) as error:
        got = f"{arguments} ({error})"
        raise OptionError(f"detector {name}", "arguments that it takes", got) from error
    except FAULTS as error:  # of a detector of the user's own
        raise OptionError(f"detector {name}", "one that can be made", reason_of(error)) from error


def _parse(entry: str) -> tuple[str, Any]:
    """("NAME", value) of one entry "NAME=VALUE"; the value is a YAML scalar."""
    name, equals, text = entry.partition("=")
    if not (equals and name.strip().isidentifier()):
        raise OptionError("detector_argument", "NAME=VALUE", repr(entry))
    try:
        value = load_yaml(text)
    except NO_YAML:
        value = [text]  # refused below
    if not isinstance(value, str | int | float | bool | None):
        expected = "a number, a word, true, false or null after ="
        raise OptionError("detector_argument", expected, repr(entry))
    return name.strip(), value
