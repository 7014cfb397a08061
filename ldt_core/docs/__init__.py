"""The pages that `ldt docs` prints: one subject each, every command of theirs run by a test."""

from __future__ import annotations

from pathlib import Path

from ldt_core.base.errors import OptionError, did_you_mean

FOLDER = Path(__file__).parent


def names() -> list[str]:
    """Names of all pages, in the order in which a newcomer needs them."""
    order = (
        *("start", "watch", "python", "connect", "machine", "deploy", "network"),
        *("real", "diagnosis", "detector", "advice", "defaults", "effect", "physics", "simulator"),
        *("accuracy", "limits", "streams", "paper", "promises", "speed"),
    )
    found = {file.stem for file in FOLDER.glob("*.md")}
    return [n for n in order if n in found] + sorted(found.difference(order))


def path(name: str) -> Path:
    """File of a page.

    Raises:
        OptionError: no such page.
    """
    if name not in names():
        raise OptionError("page", did_you_mean(name, names()), repr(name))
    return FOLDER / f"{name}.md"


def text(name: str) -> str:
    """A page, as Markdown.

    Raises:
        OptionError: no such page.
    """
    return path(name).read_text(encoding="utf-8")


def title(name: str) -> str:
    """Heading of a page."""
    return text(name).partition("\n")[0].lstrip("# ")
