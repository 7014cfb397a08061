"""All samples of a recording as one table, a row a sample: CSV or Parquet."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError
from ldt_core.views.export.predicted_runs import PredictedRun

#: Column → its unit; CSV names them in the help of `ldt export`, Parquet in each field's metadata.
UNITS = {
    "experiment": "",
    "time": "s since the epoch",
    "elapsed": "s since the first sample",
    "voltage": "V",
    "speed": "rad/s",
    "current": "A",
    "predicted_speed": "rad/s",
    "predicted_speed_std": "rad/s",
    "original_speed": "rad/s",
}
NUMBERS = ("experiment",)

GROUP_ROWS = 100_000  # of Parquet: what is held at once; each group has its entry in the footer


def columns(run: PredictedRun) -> dict[str, Array]:
    """Column → (L,) values of one experiment; what the recording lacks is NaN."""
    e, curves = run.experiment, run.curves()
    found: dict[str, Array] = {
        "experiment": np.full(len(e), e.number, dtype=np.float64),
        "time": e.start + e.time,
        "elapsed": e.time,
    }
    lacking = np.full(len(e), np.nan)
    return {name: found.get(name, curves.get(name, lacking)) for name in UNITS}


def write_csv(runs: Iterable[PredictedRun], file: Path) -> int:
    """Write a header and all rows; the number of rows. An empty cell is a value that is not there.

    Numbers are written so that they come back bit for bit.
    """
    count = 0
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(UNITS)
        for run in runs:
            made = columns(run)
            texts = [list(_texts(name, values)) for name, values in made.items()]
            writer.writerows(zip(*texts, strict=True))
            count += len(run.experiment)
    return count


def _texts(name: str, values: Array) -> Iterator[str]:
    for value in values.tolist():
        yield str(int(value)) if name in NUMBERS else "" if value != value else repr(value)


def write_parquet(runs: Iterable[PredictedRun], file: Path) -> int:
    """Write all rows, in groups of `GROUP_ROWS` and up to an experiment more; the number of rows.

    Raises:
        LdtError: pyarrow is not installed.
    """
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise LdtError(
            "Parquet needs the library pyarrow, which is not installed: pip install 'ldt[parquet]'"
        ) from error
    schema = pyarrow.schema(
        [
            pyarrow.field(
                name,
                pyarrow.int64() if name in NUMBERS else pyarrow.float64(),
                metadata={"unit": unit} if unit else None,
            )
            for name, unit in UNITS.items()
        ]
    )
    count = written = 0
    held: list[Any] = []
    with pyarrow.parquet.ParquetWriter(file, schema) as writer:
        for run in runs:
            arrays: list[Any] = []
            for name, values in columns(run).items():
                if name in NUMBERS:
                    arrays.append(pyarrow.array(values.astype(np.int64)))
                else:
                    arrays.append(pyarrow.array(values, mask=np.isnan(values)))
            held.append(pyarrow.Table.from_arrays(arrays, schema=schema))
            count += len(run.experiment)
            if count - written >= GROUP_ROWS:
                writer.write_table(pyarrow.concat_tables(held))
                held, written = [], count
        if held:
            writer.write_table(pyarrow.concat_tables(held))
    return count
