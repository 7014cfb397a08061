"""What a page is made of. The template draws each kind; nothing is computed there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from markupsafe import Markup

from ldt_core.views.page.style import NARROW, WIDE, Drawing, inline_svg


@dataclass(frozen=True)
class Mark:
    """A verdict: a word, a shape and a colour.

    Args:
        tone: good, bad, open, found (something was) or vague (one of several).
    """

    word: str
    tone: str


@dataclass(frozen=True)
class Cell:
    """Two lines in a cell, the second in small print."""

    text: str
    small: str


@dataclass(frozen=True)
class Lines:
    """Several lines in a cell."""

    lines: Sequence[str | Cell]


Value = str | Mark | Cell | Lines


@dataclass(frozen=True)
class Answer:
    """What a page is about, said in one sentence under its title.

    Args:
        step: what to do next, in words.
        command: that does it; "" where the section `place` of the page says how.
    """

    mark: Mark
    aside: str
    sentence: str
    step: str = ""
    command: str = ""
    place: str = ""


@dataclass(frozen=True)
class Text:
    """A paragraph; `kind` heading, missing or code sets it so."""

    text: str
    kind: str = "text"


@dataclass(frozen=True)
class Table:
    """Rows under a head.

    Args:
        rows: of cells, the first naming the row.
        cards: on a phone each row becomes a card (for cells of whole sentences).
        named: columns that say nothing without their name, which a card then repeats; figures
            are always named.
    """

    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[Value]]
    numbers: Sequence[int] = ()
    note: str = ""
    cards: bool = False
    named: Sequence[int] = ()
    kind: str = "table"


@dataclass(frozen=True)
class Folded:
    """A table that the reader opens."""

    title: str
    table: Table
    kind: str = "folded"


@dataclass(frozen=True)
class Item:
    """A point of a list."""

    text: str
    name: str = ""


@dataclass(frozen=True)
class Items:
    """A list of points."""

    items: Sequence[Item]
    kind: str = "items"


@dataclass(frozen=True)
class Pairs:
    """Names and values."""

    pairs: Sequence[tuple[str, str]]
    kind: str = "facts"


@dataclass(frozen=True)
class Links:
    """Files beside the page."""

    text: str
    files: Sequence[str]
    kind: str = "links"


@dataclass(frozen=True)
class Figure:
    """A drawing in both layouts, as SVG of our own making.

    Args:
        files: whether the same drawing lies beside the page, in `figures/`.
    """

    name: str
    title: str
    caption: str
    alt: str
    wide: str
    narrow: str
    files: bool = True
    kind: str = "figure"

    @classmethod
    def of(cls, drawing: Drawing, files: bool = True) -> Figure:
        """Draw it."""
        wide, narrow = (inline_svg(drawing, layout) for layout in (WIDE, NARROW))
        words = drawing.name, drawing.title, drawing.caption, drawing.alt
        return cls(*words, wide, narrow, files)


@dataclass(frozen=True)
class Own:
    """Markup of our own making, whose values are escaped already."""

    markup: Markup
    kind: str = "own"


Block = Text | Table | Folded | Items | Pairs | Links | Figure | Own


@dataclass
class Section:
    """A part of the page."""

    id: str
    title: str
    blocks: list[Block] = field(default_factory=list)

    def figure(self, drawing: Drawing | None, otherwise: str, files: bool = True) -> None:
        """Add a drawing (with its files beside the page, or without), or say why there is none."""
        self.blocks.append(Figure.of(drawing, files) if drawing else Text(otherwise, "missing"))
