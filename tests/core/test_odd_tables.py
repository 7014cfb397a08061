"""Tables as loggers and spreadsheets write them: read right, or refused, never misread."""

from __future__ import annotations

import numpy as np
import pytest

from ldt_core.base.errors import RecordingError
from ldt_core.recording.importers import import_file

COUNT = 30
TIME = np.arange(COUNT) * 0.01
VOLTS = 6.0 + 3.0 * (np.arange(COUNT) // 10 % 2)
SPEED = np.round(10.0 + 5.0 * np.sin(np.arange(COUNT) / 4.0), 3)
CELLS = [(f"{t:.2f}", f"{u:.1f}", f"{n:.3f}") for t, u, n in zip(TIME, VOLTS, SPEED, strict=True)]
COMMAS = [tuple(cell.replace(".", ",") for cell in row) for row in CELLS]


def text(rows, head="t,u,n", mark=","):
    return "\n".join([head, *(mark.join(row) for row in rows)]) + "\n"


def load(folder, content, **options):
    (folder / "x.csv").write_bytes(content if isinstance(content, bytes) else content.encode())
    return import_file(folder / "x.csv", **{"voltage": "u", "speed": "n", "time": "t", **options})


READ = {
    "UTF-32": text(CELLS).encode("utf-32"),
    "a line that names the separator": "sep=;\n" + text(COMMAS, "t;u;n", ";"),
    "decimal commas between blanks": text(COMMAS, "t u n", " "),
    "3000 remarks above the names": "# setting\n" * 3000 + text(CELLS),
    "a remark with a semicolon": text([(*row, "a;b") for row in CELLS], "t,u,n,remark"),
    "a remark over two lines": text([(*row, '"a\nb"') for row in CELLS], "t,u,n,remark"),
    "quoted decimal commas": text([tuple(f'"{c}"' for c in row) for row in COMMAS]),
    "line ends of three kinds": text(CELLS).replace("\n", "\r\n", 9).replace("\r\n", "\r", 3),
    "empty cells at the ends": text([(*row, "", "") for row in CELLS]),
    "thousandths": text([(t, u, f"0{n[n.index('.') :]}") for t, u, n in CELLS]),
    "the same column by its number": text([(*row, row[1]) for row in CELLS], "t,u,n,u"),
}


@pytest.mark.parametrize("name", READ)
def test_what_is_written_so_is_read_as_meant(name, tmp_path):
    """Value for value."""
    numbered = {"voltage": "2"} if "number" in name else {}
    (one,) = load(tmp_path, READ[name], **numbered).experiments
    assert one.voltage.tolist() == VOLTS.tolist()
    assert one.speed.tolist() == (SPEED % 1 if name == "thousandths" else SPEED).round(3).tolist()


THOUSANDS = [f"{1 + i // 10},{100 + i:03d}" for i in range(COUNT)]
REFUSED = {
    "decimal commas between commas": (
        text(COMMAS),
        "line 2: expected 3 cells (a decimal comma needs quotes, or semicolons between cells), got",
    ),
    "a cell more than names, as R writes": (
        text([(str(i), *row) for i, row in enumerate(CELLS)]),
        "line 2: expected 3 cells",
    ),
    "thousands in quotes": (
        text([(t, u, f'"{n}"') for (t, u, _), n in zip(CELLS, THOUSANDS, strict=True)]),
        "line 2, column 'n': expected decimal points as in other columns, and no thousands",
    ),
    "thousands between decimal commas": (
        text(
            [(t, u, n.replace(",", ".")) for (t, u, _), n in zip(COMMAS, THOUSANDS, strict=True)],
            "t;u;n",
            ";",
        ),
        "line 2, column 'n': expected decimal commas as in other columns, and no thousands",
    ),
    "the header once more": (text(CELLS) + text(CELLS), "line 32, column 'u'"),
    "lines above the names": (
        "Logger\n\n" + text(CELLS),
        "delete the lines above the row of names",
    ),
    "milliseconds since 1970": (
        text([(str(1711850398000 + 10 * i), *row[1:]) for i, row in enumerate(CELLS)]),
        "times up to 9.2e+09 s (10 s between samples are long; if they are ms: --time t:ms)",
    ),
    "hexadecimal numbers": (text([(t, "0x0A", n) for t, _, n in CELLS]), "'0x0A' (30 such"),
    "a row twice": (
        text([*CELLS[:9], CELLS[8], *CELLS[9:]]),
        "line 11: expected increasing times (leave out what is there twice), got the same time",
    ),
    "a time zone that changes": (
        text(
            [
                (f"2024-03-31T01:59:00.{i:03d}+0{1 + i // 20}:00", *r[1:])
                for i, r in enumerate(CELLS)
            ]
        ),
        "line 22: expected increasing times (import each part by itself)",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_told_is_refused_with_its_line(name, tmp_path):
    """Rather than read as another number; without times, nothing else would notice."""
    content, words = REFUSED[name]
    options = {} if "t:ms" in words or "times" in words else {"time": None, "sample_period": 0.01}
    with pytest.raises(RecordingError) as caught:
        load(tmp_path, content, **options)
    assert words in str(caught.value)


def test_a_size_that_hardly_any_motor_has_is_told(tmp_path):
    """Millivolts, and a spreadsheet's days, of which the unit is not given."""
    milli = text([(t, f"{1000 * float(u):g}", n) for t, u, n in CELLS])
    assert "if they are mV: --voltage u:mV" in " ".join(load(tmp_path, milli).notes)
    days = text([(f"{45382 + i * 0.01 / 86400:.11f}", *row[1:]) for i, row in enumerate(CELLS)])
    assert "if they are days" in " ".join(load(tmp_path, days).notes)
    (one,) = load(tmp_path, days, time="t:d").experiments
    assert one.period == pytest.approx(0.01, rel=1e-3)
