"""Texts of others' that are to be printed: nothing in them can move a cursor or hide a line.

Recordings, messages and file names hold whatever somebody has put there, and a terminal obeys what
it is sent.
"""

from __future__ import annotations

import re
import shlex

LONGEST_NAME = 40  # characters: of four bytes each, with what else stands there, 255 are allowed
#: Control characters but line feed and tab, marks and overrides of the writing's direction, line
#: separators, and halves of characters, which no stream can encode.
UNPRINTABLE = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]"
)


def printable(text: str) -> str:
    r"""The text with what a terminal would obey as the escapes of Python.

    >>> printable("rotor\x1b[2J, all is well")
    'rotor\\x1b[2J, all is well'
    """
    return UNPRINTABLE.sub(_escape, text)


def one_line(text: str) -> str:
    r"""The same on one line, so that a name cannot look like a line of ours.

    >>> one_line("rotor\nok  no damage")
    'rotor ok no damage'
    """
    return printable(" ".join(text.split()))


def as_argument(path: str) -> str:
    """A path as it stands in a command that is told: in quotes if need be, and never an option.

    >>> as_argument("my run"), as_argument("-x")
    ("'my run'", './-x')
    """
    return shlex.quote(f"./{path}" if path.startswith("-") else path)


def file_name(name: str) -> str:
    """A name as part of a file's: no path, and no longer than a file system takes.

    >>> file_name("press/../2"), len(file_name("x" * 5000))
    ('press_.._2', 40)
    """
    return re.sub(r"[^\w.-]", "_", name)[:LONGEST_NAME]


def _escape(match: re.Match[str]) -> str:
    return match.group().encode("unicode_escape").decode()
