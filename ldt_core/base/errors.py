"""Everything that can go wrong, as one family.

LdtError (exit code 1: the work itself failed)
├── UnansweredExperiment
└── BadInput (exit code 2: what the user gave cannot be used; also a ValueError)
    ├── MachineFileError
    ├── RecordingError
    ├── ExperimentError
    ├── ModelError
    ├── OptionError
    └── ArgumentTypeError (also a TypeError)

Each error is built from facts (where, what was expected, what came), so that every message
names the file, topic or parameter. One place, `ldt_core.cli.main`, turns it into one sentence
on standard error and the exit code.
"""

from __future__ import annotations

import difflib
import reprlib
from collections.abc import Iterable
from typing import Any

from ldt_core.base.printable import one_line

LONGEST_SHOWN = 60  # characters of a value in a message
LONGEST_GOT = 1000  # characters of what came, whatever it is
MOST_BESIDE_NEAREST = 20  # names beside the nearest: all units of a speed, not all effects
MOST_LISTED = 60  # names that exist; we have 40 commands and effects
LONGEST_REASON = 400  # characters of a reason that is passed on: foreign text may be of any size

#: Makes no more of a value's text than is shown; of a nested one, all of it may not fit in memory.
_BRIEF = reprlib.Repr()
_BRIEF.maxlevel = 3
_BRIEF.maxstring = _BRIEF.maxlong = _BRIEF.maxother = 4 * LONGEST_SHOWN
_BRIEF.maxlist = _BRIEF.maxtuple = _BRIEF.maxdict = _BRIEF.maxset = LONGEST_SHOWN // 2


class LdtError(Exception):
    """The work itself failed, with a sentence for the user."""

    exit_code = 1


class BadInput(LdtError, ValueError):
    """What the user gave cannot be used.

    Args:
        where: the file, topic or parameter at fault.
        expected: what would have been right.
        got: what came instead.
    """

    exit_code = 2

    def __init__(self, where: object, expected: str, got: object) -> None:
        self.where, self.expected, self.got = str(where), expected, _cut(str(got), LONGEST_GOT)
        super().__init__(f"{self.where}: expected {self.expected}, got {self.got}")

    def __reduce__(self) -> tuple[Any, ...]:  # errors cross process boundaries in parallel studies
        return type(self), (self.where, self.expected, self.got)


class MachineFileError(BadInput):
    """A machine file has an unknown or missing key, a wrong type, or an impossible value."""


class RecordingError(BadInput):
    """A recording is missing, empty, foreign, truncated, or lacks a topic."""


class ExperimentError(BadInput):
    """Samples that are no experiment: wrong shape, not finite, outside the machine's limits."""


class RepeatedExperiment(ExperimentError):
    """The same experiment once more: nothing is wrong with it, and it must not count twice."""


class UnansweredExperiment(LdtError):
    """An experiment that the twin could not deal with, though nothing is wrong with it.

    Args:
        number: of the experiment.
        reason: what was raised.
    """

    def __init__(self, number: int, reason: str) -> None:
        self.number, self.reason = number, reason
        super().__init__(f"experiment {number} is not answered: {reason}")

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.number, self.reason)


class ModelError(BadInput):
    """A model record that cannot become a model."""


class OptionError(BadInput):
    """An option or parameter outside its declared type or range."""


class ArgumentTypeError(BadInput, TypeError):
    """An argument of a Python function that is no object of the expected kind."""


#: Whatever a part may raise, one of the user's own as well; an interrupt asks to end.
FAULTS = (Exception, SystemExit)


def described(value: object) -> str:
    """What came, short enough for a message.

    >>> described([1.0, 2.0]), described("rotor")
    ('[1.0, 2.0]', "'rotor'")
    """
    shape = getattr(value, "shape", None)
    if shape:
        return f"an array of shape {shape}"
    return _cut(_BRIEF.repr(value), LONGEST_SHOWN)


def reason_of(error: BaseException) -> str:
    """What was raised, in one bounded line; of errors that are not this project's, with their kind.

    >>> reason_of(OptionError("x", "1", 2)), reason_of(ZeroDivisionError("division by zero"))
    ('x: expected 1, got 2', 'ZeroDivisionError: division by zero')
    """
    text = one_line(str(error))
    if isinstance(error, MemoryError):  # nobody's fault who is told of it
        text = f"out of memory ({text})" if text else "out of memory"
    elif not isinstance(error, LdtError):
        text = f"{type(error).__name__}: {text}" if text else type(error).__name__
    return _cut(text, LONGEST_REASON)


def _cut(text: str, most: int) -> str:
    return text if len(text) <= most else f"{text[: most - 3]}..."


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """One clause that lists what exists and the nearest name, for `expected`.

    Of a long list the nearest name stands alone: nobody finds it among all.

    >>> did_you_mean("lineer", ["linear", "hybrid"])
    "one of 'hybrid', 'linear' (did you mean 'linear'?)"
    >>> did_you_mean("rmp", map(str, range(30))).count("'")
    60
    >>> did_you_mean("rmp", [*map(str, range(30)), "rps", "rpm"])
    "one of 32 names (did you mean 'rpm'?)"
    """
    names = sorted(known)
    close = most_alike(name, names)
    if close and len(names) > MOST_BESIDE_NEAREST:
        return f"one of {len(names)} names (did you mean {close!r}?)"
    listed = ", ".join(repr(n) for n in names[:MOST_LISTED])
    if len(names) > MOST_LISTED:
        listed += f" and {len(names) - MOST_LISTED} more"
    return f"one of {listed}" + (f" (did you mean {close!r}?)" if close else "")


def most_alike(name: str, known: Iterable[str]) -> str | None:
    """The most similar name, if any is; letters that changed places come first.

    >>> most_alike("rmp", ["rps", "rpm"]), most_alike("x", ["rpm"])
    ('rpm', None)
    """
    close = difflib.get_close_matches(name, known)
    return next((n for n in close if sorted(n) == sorted(name)), close[0] if close else None)
