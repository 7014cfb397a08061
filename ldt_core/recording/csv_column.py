"""The numbers of one column of a table, from cells as loggers and spreadsheets write them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from ldt_core.base.errors import RecordingError
from ldt_core.base.experiment import Samples
from ldt_core.recording.messages import quoted

LACKING = ("", "null")  # in small letters; "nan" is what a program computed, and is refused
#: A date and the time of day, as loggers write them.
DATE = re.compile(r"\s*\d{4}-\d\d-\d\d[T ]\d\d:\d\d")
#: Day, month, year and hour of one with dots, and what follows; a slash would not tell the order.
DOTTED = re.compile(r"(\d\d?)\.(\d\d?)\.(\d{4})[T ](\d\d?)(:\d\d.*)")
EXAMPLES = "2026-03-31T08:00:00.5 or 31.03.2026 08:00:00,5"
#: What may be thousands: groups of three digits, and no zero before them.
GROUPED = re.compile(r"\s*[+-]?[1-9]\d{0,2}([.,]\d{3})+\s*")
#: Between digits → what is expected in its place.
MARKS = {".": "decimal commas", ",": "decimal points"}


class CsvColumn:
    """The numbers of a column, block by block.

    Args:
        where: what a complaint calls it.
        lacking: whether a cell may be empty; its number is NaN then.
        dated: whether cells may be dates.
    """

    def __init__(self, where: str, lacking: bool, dated: bool) -> None:
        self._where = where
        self._lacking = lacking
        self._dated = dated
        self._blocks: list[Samples] = []
        self._bad: tuple[int, str] | None = None  # line and cell of the first that is no number
        self._bad_count = 0
        self._first: dict[str, tuple[int, str]] = {}  # the same of the first with a point or comma
        self._grouped = True  # whether all of these may be thousands
        self._dates = False  # whether cells are dates

    def take(self, cells: Sequence[str], lines: Sequence[int]) -> None:
        """The next cells, and the lines that they stand in."""
        text = "\n".join(cells)
        for mark in MARKS:
            if mark not in self._first and mark in text:
                index = next(k for k, cell in enumerate(cells) if mark in cell)
                self._first[mark] = lines[index], cells[index]
        if self._grouped and self._first:
            parted = (cell for cell in cells if "." in cell or "," in cell)
            self._grouped = all(GROUPED.fullmatch(cell) for cell in parted)
        if "," in text:
            cells = [cell.replace(",", ".") for cell in cells]
        try:
            if "_" in text:
                raise ValueError("each cell by itself")
            values = np.array(cells, dtype=np.float64)
        except ValueError:
            self._dates = self._dated and (self._dates or is_date(cells[0]))
            number = seconds if self._dates else _number
            values = np.array([number(c) for c in cells])
        bad = [int(k) for k in np.flatnonzero(~np.isfinite(values))]
        if self._lacking:
            bad = [k for k in bad if cells[k].strip().lower() not in LACKING]
        if bad and self._bad is None:
            self._bad = lines[bad[0]], cells[bad[0]]
        self._bad_count += len(bad)
        self._blocks.append(values)

    def numbers(self, path: Path) -> Samples:
        """All of them.

        Raises:
            RecordingError: a cell is no finite number, or decimal commas and points are mixed.
        """
        clock = self._bad is not None and ":" in self._bad[1]
        if len(self._first) > 1 and not (self._dates or clock):
            raise self._separated_otherwise(path, ".", "elsewhere in this column")
        if self._bad is not None:
            line, cell = self._bad
            got = quoted(cell) if cell.strip() else "an empty cell"
            more = f" ({self._bad_count} such cells)" if self._bad_count > 1 else ""
            where = f"{path}, line {line}, {self._where}"
            date = f", or a date such as {EXAMPLES}" if self._dated else ""
            if is_date(cell) and not self._dated:
                date = " (a date is taken for --time alone, and has no unit)"
            empty = ", or an empty cell to skip the row" if self._lacking else ""
            raise RecordingError(where, f"a finite number{date}{empty}", got + more)
        return np.concatenate(self._blocks)

    @property
    def mark(self) -> str:
        """What separates decimals, or thousands: "." or ","; "" where nothing or a date does."""
        return "" if self._dates else next(iter(self._first), "")

    def refuse_thousands(self, path: Path, marks: Iterable[str]) -> None:
        """Refuse what may be thousands, where other columns separate decimals otherwise.

        Raises:
            RecordingError: a cell that would be a thousandth of what is meant.
        """
        if self._grouped and self.mark and set(marks) - {self.mark, ""}:
            raise self._separated_otherwise(path, self.mark, "in other columns")

    def _separated_otherwise(self, path: Path, mark: str, elsewhere: str) -> RecordingError:
        line, cell = self._first[mark]
        expected = f"{MARKS[mark]} as {elsewhere}, and no thousands separators"
        return RecordingError(f"{path}, line {line}, {self._where}", expected, quoted(cell))


def is_number(cell: str) -> bool:
    """Whether a cell is one, with a decimal point or comma."""
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return "_" not in cell  # of which only Python makes a number


def _number(cell: str) -> float:
    return float(cell) if is_number(cell) else np.nan


def is_date(cell: str) -> bool:
    """Whether a cell is a date with a time of day: in the order of ISO 8601, or with dots.

    >>> is_date("2026-03-01T08:00:00.010Z"), is_date("2026-03-01 08:00"), is_date("20260301")
    (True, True, False)
    >>> is_date("31.03.2026 8:00:00,010"), is_date("31.03.26 08:00"), is_date("03/31/2026 08:00")
    (True, False, False)
    """
    dated = DATE.match(cell) or DOTTED.fullmatch(cell.strip())
    return dated is not None and bool(np.isfinite(seconds(cell)))


def seconds(cell: str) -> float:
    """A date with a time of day as seconds since 1970 [s]; NaN of anything else.

    Without a time zone it is taken for UTC.

    >>> seconds("1970-01-01T00:01:00.5"), seconds("1970-01-01T01:00:00+01:00")
    (60.5, 0.0)
    >>> seconds("1.1.1970 00:01:00,5")
    60.5
    """
    text = cell.strip()
    if dotted := DOTTED.fullmatch(text):
        day, month, year, hour, rest = dotted.groups()
        text = f"{year}-{month:0>2}-{day:0>2}T{hour:0>2}{rest}"
    try:
        date = datetime.fromisoformat(text)
    except ValueError:
        return np.nan
    return (date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp()
