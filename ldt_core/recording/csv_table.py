"""Columns of numbers out of a CSV file, with the line in every complaint.

Understands what loggers and spreadsheets write: comma, semicolon, tab, bar or blanks between cells,
decimal commas, quotes, a byte-order mark, comment lines (# or %), a header or none, a row of units
below it, gzip.
"""

from __future__ import annotations

import csv
import gzip
import io
import zlib
from collections.abc import Iterator, Sequence
from operator import itemgetter
from pathlib import Path

import numpy as np

from ldt_core.base.errors import RecordingError, did_you_mean
from ldt_core.base.experiment import Samples
from ldt_core.recording.messages import quoted

GZIP_MAGIC = b"\x1f\x8b"
UTF16_MARKS = (b"\xff\xfe", b"\xfe\xff")
COMMENTS = ("#", "%")
DELIMITERS = ";\t,| "  # in this order: a decimal comma may stand between semicolons or tabs
MAX_BYTES = 2_000_000_000  # unpacked; a packed file may claim anything
PIECE = 1 << 20  # bytes that are unpacked at a time
FREE_BYTES = 50_000_000  # unpacked from anything
MOST_RATIO = 100  # of a larger text to what is packed; numbers reach 20
LOOK_AHEAD = 20  # rows by which the delimiter is chosen: beyond every header


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
        self._text = self._read_text()
        self._delimiter = self._sniff()
        self._skip, self.names = self._find_header()

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
        expected = f"{did_you_mean(name, self.names)}, or a number from 1 to {len(self.names)}"
        raise RecordingError(f"{self.path}, column", expected, repr(name))

    def read(self, columns: Sequence[int]) -> tuple[np.ndarray, list[Samples]]:
        """(line of each row from 1, values of each column), all of one length.

        Args:
            columns: indices.

        Raises:
            RecordingError: no rows, a short row, or a cell that is no finite number.
        """
        pick = itemgetter(*columns) if len(columns) > 1 else lambda row: (row[columns[0]],)
        lines: list[int] = []
        cells: list[tuple[str, ...]] = []
        for line, row in self._rows():
            if line <= self._skip:
                continue
            try:
                cells.append(pick(row))
            except IndexError:
                raise RecordingError(
                    f"{self.path}, line {line}", f"{len(self.names)} cells", f"{len(row)}"
                ) from None
            lines.append(line)
        if lines and not any(_is_number(c) for c in cells[0]) and all(cells[0]):
            units = ", ".join(cells[0])
            self.notes.append(f"line {lines[0]} was taken for units ({units}) and not applied")
            del lines[0], cells[0]
        if not lines:
            raise RecordingError(self.path, "rows of numbers", "none")
        where = np.array(lines)
        by_column = zip(*cells, strict=True)
        return where, [self._numbers(i, c, where) for i, c in zip(columns, by_column, strict=True)]

    def _read_text(self) -> str:
        most = MAX_BYTES
        try:
            data = self.path.read_bytes()
            if data.startswith(GZIP_MAGIC):
                most = min(MAX_BYTES, max(FREE_BYTES, MOST_RATIO * len(data)))
                with gzip.open(io.BytesIO(data)) as stream:
                    # A buffer of what is allowed would be made at once.
                    data = b"".join(stream.read(PIECE) for _ in range(0, most + PIECE, PIECE))
        except (EOFError, zlib.error, gzip.BadGzipFile) as error:
            raise RecordingError(self.path, "an intact gzip file", error) from None
        except OSError as error:
            reason = error.strerror or str(error)
            raise RecordingError(self.path, "a readable CSV file or recording", reason) from None
        if len(data) > most:
            raise RecordingError(self.path, f"at most {most} bytes", f"{len(data)} or more")
        if data.startswith(UTF16_MARKS):
            return data.decode("utf-16", errors="replace")
        if b"\0" in data[:4096]:
            raise RecordingError(self.path, "text (CSV) or a recording", "a binary file")
        try:
            return data.decode("utf-8-sig")
        except UnicodeDecodeError:
            self.notes.append("the file is not UTF-8; read as Windows-1252")
            return data.decode("cp1252", errors="replace")

    def _lines(self) -> Iterator[str]:
        """Lines with comments blanked, so that numbers of lines stay right."""
        for line in self._raw_lines():
            yield "\n" if line.lstrip().startswith(COMMENTS) else line

    def _raw_lines(self) -> Iterator[str]:
        """Lines as they are, without a second copy of them all."""
        at = 0
        while at < len(self._text):
            end = self._text.find("\n", at) + 1 or len(self._text)
            yield self._text[at:end]
            at = end

    def _sniff(self) -> str:
        rows = [line.strip("\r\n ") for _, line in zip(range(500), self._lines(), strict=False)]
        rows = [line for line in rows if line][:LOOK_AHEAD]
        if not rows:
            raise RecordingError(self.path, "rows of numbers", "an empty file")
        return next((d for d in DELIMITERS if d in rows[-1]), ",")

    def _rows(self) -> Iterator[tuple[int, list[str]]]:
        """(line, cells) of each row that is not blank."""
        lines = self._lines()
        if self._delimiter == " ":
            lines = (line.strip() for line in lines)
        reader = csv.reader(lines, delimiter=self._delimiter, skipinitialspace=True)
        try:
            for row in reader:
                if row and any(row):
                    yield reader.line_num, row
        except csv.Error as error:
            raise RecordingError(
                f"{self.path}, line {reader.line_num}", "cells of text", error
            ) from None

    def _find_header(self) -> tuple[int, list[str]]:
        """(last line before the numbers, column names); numbers from 1 where there is no header."""
        line, row = next(self._rows(), (0, []))
        if not row:
            raise RecordingError(self.path, "rows of numbers", "only empty cells")
        if not all(_is_number(cell) for cell in row if cell):
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
        return line - 1, [str(number) for number in range(1, len(row) + 1)]

    def _numbers(self, index: int, cells: Sequence[str], lines: np.ndarray) -> Samples:
        where = f"column {self.names[index]!r}"
        text = "\n".join(cells)
        if "," in text:
            if "." in text:
                at = next(i for i, cell in enumerate(cells) if "." in cell)
                raise RecordingError(
                    f"{self.path}, line {lines[at]}, {where}",
                    "decimal commas as elsewhere in this column",
                    quoted(cells[at]),
                )
            cells = [cell.replace(",", ".") for cell in cells]
        try:
            values = np.array(cells, dtype=np.float64)
        except ValueError:
            values = np.array([float(c) if _is_number(c) else np.nan for c in cells])
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            at = int(bad[0])
            got = quoted(cells[at]) if cells[at].strip() else "an empty cell"
            more = f" ({bad.size} such cells)" if bad.size > 1 else ""
            raise RecordingError(
                f"{self.path}, line {lines[at]}, {where}", "a finite number", got + more
            )
        return values


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True
