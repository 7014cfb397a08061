"""Columns of numbers out of a CSV file, with the line in every complaint.

Understands what loggers and spreadsheets write: comma, semicolon, tab, bar or blanks between cells,
decimal commas, quotes, a byte-order mark, comment lines (# or %), a header or none, rows of units
and of other names below it, dates with a time (ISO 8601, or 31.12.2026 08:00), gzip. It is read as
a stream: in memory are the numbers of the columns that are asked for.
"""

from __future__ import annotations

import csv
import gzip
import itertools
import zlib
from codecs import getincrementaldecoder
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from io import TextIOWrapper
from operator import itemgetter
from pathlib import Path
from typing import IO, cast

import numpy as np

from ldt_core.base.bounded_file import open_regular
from ldt_core.base.errors import RecordingError, did_you_mean
from ldt_core.base.experiment import Samples
from ldt_core.base.sentences import counted
from ldt_core.base.units import is_unit
from ldt_core.recording.csv_column import LACKING, CsvColumn, is_date, is_number

GZIP_MAGIC = b"\x1f\x8b"
#: First bytes → how the text is encoded; the longer one first.
MARKS = {
    b"\xff\xfe\0\0": "utf-32",
    b"\0\0\xfe\xff": "utf-32",
    b"\xff\xfe": "utf-16",
    b"\xfe\xff": "utf-16",
}
COMMENTS = ("#", "%")
SEPARATOR = "sep="  # by which a spreadsheet is told, in the first line
DELIMITERS = ";\t,| "  # in this order: a decimal comma may stand between semicolons or tabs
MAX_BYTES = 2_000_000_000  # unpacked; a packed file may claim anything
PIECE = 1 << 20  # bytes that are unpacked at a time
FREE_BYTES = 50_000_000  # unpacked from anything
MOST_RATIO = 100  # of a larger text to what is packed; numbers reach 20
LOOK_AHEAD = 20  # rows by which the delimiter is chosen: beyond every header
LONGEST_LINE = 10_000_000  # characters; a million columns
BLOCK = 5000  # rows whose cells are held as text
NO_UNIT = "1"  # in a row of units: what has no dimension, as a counter
#: Of the rows that lack a value: a logger misses a few; more is a table of several rates, of which
#: whole rows would hold a voltage for too long.
MOST_LACKING = 0.1


class CsvTable:
    """A CSV file, opened: its column names are known, its rows are not read yet.

    Args:
        path: CSV file, also gzip-compressed.

    Raises:
        RecordingError: missing, empty, or no text.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        #: What was decided in reading, a sentence each.
        self.notes: list[str] = []
        self._encoding = self._find_encoding()
        self._delimiter = self._sniff()
        self._skip, self.names = self._find_header()
        #: Below the names, of each column: its unit, "" where none stands there.
        self.units = self._find_units()

    @property
    def headed(self) -> bool:
        """Whether a line names the columns; else they have numbers from 1 alone."""
        return self.names != _numbers(len(self.names))

    @property
    def columns(self) -> dict[str, str]:
        """Name or number of each column → the unit in the row below the names, or ""."""
        numbers = {str(index): unit for index, unit in enumerate(self.units, 1)}
        return {**numbers, **dict(zip(self.names, self.units, strict=False))}

    @property
    def dated(self) -> list[int]:
        """Indices of the columns that hold dates."""
        return [i for i, cell in enumerate(self._first_row()) if is_date(cell)]

    @property
    def unnamed(self) -> bool:
        """Whether a column that holds something has no name: the names may stand further below."""
        cells = zip(self.names, self._first_row(), strict=False)
        return any(cell.strip() and not name for name, cell in cells)

    def described(self, index: int) -> str:
        """A column in words: its name, the unit below it, whether it holds dates."""
        if not self.headed:
            return f"column {index + 1} of {len(self.names)} without names"
        unit = f" in {self.units[index]}" if self.units[index] else ""
        return f"{self.names[index]!r}{unit}{' with dates' if index in self.dated else ''}"

    def column(self, name: str) -> int:
        """Index of a column by its header, or by its number from 1.

        Raises:
            RecordingError: no such column, or several of that name.
        """
        if self.names.count(name) == 1:
            return self.names.index(name)
        if name in self.names:
            raise RecordingError(
                f"{self.path}, column {name!r}", "one of that name (or its number)", "several"
            )
        if name.isdecimal() and 1 <= int(name) <= len(self.names):
            return int(name) - 1
        known = did_you_mean(name, filter(None, self.names))
        expected = f"{known}, or a number from 1 to {len(self.names)}"
        if self.unnamed or len(self.names) == 1:
            expected += " (delete the lines above the row of names)"
        raise RecordingError(f"{self.path}, column", expected, repr(name))

    def read(
        self, columns: Sequence[int], timed: bool = False, dated: int | None = None
    ) -> tuple[np.ndarray, list[Samples]]:
        """(line of each row from 1, values of each column), all of one length.

        Args:
            columns: indices.
            timed: whether a row says its time, so that one that lacks a value can be left out.
            dated: index of the column that may hold dates; they become seconds since 1970.

        Raises:
            RecordingError: no rows, a short row, a cell that is no finite number, or too many rows
                that lack a value.
        """
        pick = itemgetter(*columns) if len(columns) > 1 else lambda row: (row[columns[0]],)
        lines: list[np.ndarray] = []
        read = [CsvColumn(f"column {self.names[i]!r}", timed, i == dated) for i in columns]
        rows = (
            (line, self._picked(pick, line, row)) for line, row in self._rows() if line > self._skip
        )
        while block := list(itertools.islice(rows, BLOCK)):
            at, cells = [line for line, _ in block], [picked for _, picked in block]
            lines.append(np.array(at, dtype=np.int64))
            for column, texts in zip(read, zip(*cells, strict=True), strict=False):
                column.take(texts, at)
        where = np.concatenate(lines) if lines else np.empty(0, dtype=np.int64)
        if not where.size:
            raise RecordingError(self.path, "rows of numbers", "none")
        values = [column.numbers(self.path) for column in read]
        marks = [column.mark for column in read]
        for column in read:
            column.refuse_thousands(self.path, marks)
        whole = ~np.logical_or.reduce([np.isnan(column) for column in values])
        if (lacking := np.flatnonzero(~whole)).size:
            told = f"{counted(lacking.size, 'row')} of {where.size}"
            first = f"the first in line {where[lacking[0]]}"
            if lacking.size > MOST_LACKING * where.size:
                expected = f"a value in at least {1 - MOST_LACKING:.0%} of the rows"
                raise RecordingError(self.path, expected, f"none in {told}, {first}")
            self.notes.append(f"{told} left out for a value that they lack, {first}")
        return where[whole], [column[whole] for column in values]

    def _picked(
        self, pick: Callable[[list[str]], tuple[str, ...]], line: int, row: list[str]
    ) -> tuple[str, ...]:
        expected, most = counted(len(self.names), "cell"), len(self.names)
        if len(row) > most and any(row[most:]):  # nobody can say which of them the names are of
            if self._delimiter == ",":
                expected += " (a decimal comma needs quotes, or semicolons between cells)"
        else:
            with suppress(IndexError):
                return pick(row)
            if any("\n" in cell for cell in row):
                expected += ", and each quote closed"
        raise RecordingError(f"{self.path}, line {line}", expected, f"{len(row)}")

    @contextmanager
    def _open(self) -> Iterator[IO[bytes]]:
        with open_regular(self.path) as stream:
            packed = stream.read(len(GZIP_MAGIC)) == GZIP_MAGIC
            stream.seek(0)
            if not packed:
                yield stream
                return
            with gzip.open(stream) as unpacked:
                yield cast("IO[bytes]", unpacked)

    def _find_encoding(self) -> str:
        """How the bytes become text; all of them are looked at once, and counted."""
        most, count, decoder = MAX_BYTES, 0, getincrementaldecoder("utf-8")()
        unpacked = ""
        encoding = "utf-8-sig"
        try:
            with open_regular(self.path) as stream:
                if stream.read(len(GZIP_MAGIC)) == GZIP_MAGIC:
                    size = self.path.stat().st_size
                    most = min(MAX_BYTES, max(FREE_BYTES, MOST_RATIO * size))
                    unpacked = " unpacked, for a file of its size (unpack it by gunzip)"
            with self._open() as stream:
                while piece := stream.read(PIECE):
                    marked = next((m for m in MARKS if piece.startswith(m)), b"")
                    if count == 0 and marked:
                        encoding = MARKS[marked]
                    elif count == 0 and b"\0" in piece[:4096]:
                        raise RecordingError(
                            self.path, "a recording, or text: export it as CSV", "a binary file"
                        )
                    count += len(piece)
                    if count > most:
                        raise RecordingError(self.path, f"at most {most} bytes{unpacked}", "more")
                    if encoding == "utf-8-sig":
                        try:
                            decoder.decode(piece)
                        except UnicodeDecodeError:
                            encoding = "cp1252"
        except (EOFError, zlib.error, gzip.BadGzipFile) as error:
            raise RecordingError(self.path, "an intact gzip file", error) from None
        except OSError as error:
            reason = error.strerror or str(error)
            raise RecordingError(self.path, "a readable CSV file or recording", reason) from None
        if encoding == "cp1252":
            self.notes.append("the file is not UTF-8; read as Windows-1252")
        return encoding

    def _lines(self) -> Iterator[str]:
        """Lines with comments blanked, so that numbers of lines stay right."""
        for number, line in enumerate(self._raw_lines()):
            told = number == 0 and line.startswith(SEPARATOR)
            yield "\n" if told or line.lstrip().startswith(COMMENTS) else line

    def _raw_lines(self) -> Iterator[str]:
        """Lines as they are, one at a time."""
        with self._open() as stream:
            text = TextIOWrapper(stream, self._encoding, errors="replace", newline="")
            for number in itertools.count(1):
                line = text.readline(LONGEST_LINE)
                if len(line) == LONGEST_LINE:
                    where = f"{self.path}, line {number}"
                    raise RecordingError(where, f"less than {LONGEST_LINE} characters", "more")
                if not line:
                    return
                yield line

    def _sniff(self) -> str:
        filled = filter(None, (line.strip("\r\n ") for line in self._lines()))
        rows = list(itertools.islice(filled, LOOK_AHEAD))
        if not rows:
            raise RecordingError(self.path, "rows of numbers", "an empty file")
        # A remark may hold another one, which the row of names has not.
        found = [d for d in DELIMITERS if d in rows[-1]] or [","]
        return min(found, key=lambda d: d not in rows[0])

    def _rows(self) -> Iterator[tuple[int, list[str]]]:
        """(line in which it begins, cells) of each row that is not blank."""
        lines = self._lines()
        if self._delimiter == " ":
            lines = (line.strip() for line in lines)
        reader = csv.reader(lines, delimiter=self._delimiter, skipinitialspace=True)
        begin = 1  # a quoted cell may go on over many lines
        try:
            for row in reader:
                if row and any(row):
                    yield begin, row
                begin = reader.line_num + 1
        except csv.Error as error:
            raise RecordingError(
                f"{self.path}, line {reader.line_num}", "cells of text", error
            ) from None

    def _find_header(self) -> tuple[int, list[str]]:
        """(last line before the numbers, column names); numbers from 1 where there is no header."""
        line, row = next(self._rows(), (0, []))
        if not row:
            raise RecordingError(self.path, "rows of numbers", "only empty cells")
        if not all(is_number(cell) or is_date(cell) for cell in row if cell):
            return line, [cell.strip() for cell in row]
        comments = [
            text.lstrip(" #%").rstrip("\r\n")
            for text, _ in zip(self._raw_lines(), range(line - 1), strict=False)
            if text.lstrip().startswith(COMMENTS)
        ]
        if comments:  # numpy's savetxt writes the header as a comment
            (names,) = csv.reader(comments[-1:], delimiter=self._delimiter, skipinitialspace=True)
            if len(names) == len(row):
                return line - 1, [name.strip() for name in names]
        return line - 1, _numbers(len(row))

    def _first_row(self) -> list[str]:
        """Of the numbers."""
        return next((row for line, row in self._rows() if line > self._skip), [])

    def _find_units(self) -> list[str]:
        """Of the rows of words below the names the one of units, without its brackets.

        Some loggers give long names, units and short names: the most known units tell which it is.
        """
        found = [""] * len(self.names)
        known = -1
        for line, row in itertools.islice(self._rows(), LOOK_AHEAD):
            if line <= self._skip:
                continue
            cells = [cell.strip().strip("[](){}") for cell in row]
            words = [cell for cell in cells if not (is_number(cell) or cell.lower() in LACKING)]
            values = [c for c in cells if (is_number(c) and c != NO_UNIT) or is_date(c)]
            if values or not words or len(row) < len(self.names):
                break
            self._skip = line
            if (count := sum(is_unit(cell) for cell in cells)) > known:
                found, known = ["" if cell == NO_UNIT else cell for cell in cells], count
        return found


def _numbers(count: int) -> list[str]:
    return [str(number) for number in range(1, count + 1)]
