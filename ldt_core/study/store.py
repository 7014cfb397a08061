"""Results in a folder, one file a run, so that a study goes on where it was interrupted.

`OUT/runs/KEY.json`, KEY naming the run (`Case.key`). A file counts only if it was computed by this
version of LDT and of the libraries that decide its numbers, on the same machine file; anything else
is computed anew. Nothing is unpickled: the files are JSON.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ldt_core.machine import Machine
from ldt_core.study.case import Case, Result

FORMAT = "ldt-study-run-1"
FOLDER = "runs"
COLUMNS = {f.name for f in dataclasses.fields(Result)} - {"case", "kept", "seconds"}


class Store:
    """The results in the folder of a study.

    Args:
        out: folder of the study.
        stamp: what computes now, see `stamp.py`.
        machine: on which it computes.

    Attributes:
        notes: why files were not taken, a sentence each.
    """

    def __init__(self, out: Path | str, stamp: Mapping[str, str], machine: Machine) -> None:
        self.folder = Path(out) / FOLDER
        plain = json.dumps(machine.as_dict(), sort_keys=True)
        self.origin = {**stamp, "machine": hashlib.sha256(plain.encode()).hexdigest()[:12]}
        self.foreign = 0
        self.damaged: list[str] = []

    def path(self, case: Case) -> Path:
        """The file of a case."""
        return self.folder / f"{case.key}.json"

    def load(self, case: Case, any_origin: bool = False) -> Result | None:
        """The result of a case; None when it has to be computed.

        Args:
            case: whose result.
            any_origin: take what another version computed as well.
        """
        path = self.path(case)
        try:
            record = json.loads(path.read_text(encoding="utf-8"))
            if record["format"] != FORMAT or record["key"] != case.key:
                raise ValueError(f"format {record['format']!r}, key {record['key']!r}")
            result = _result(case, record["result"])
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
            self.damaged.append(path.name)
            return None
        if record.get("origin") != self.origin:
            self.foreign += 1
            return result if any_origin else None
        return result

    def save(self, result: Result) -> None:
        """Write a result; a reader sees all of it or nothing."""
        record = {
            "format": FORMAT,
            "key": result.case.key,
            "origin": self.origin,
            "case": dataclasses.asdict(result.case),
            "result": _plain(result),
        }
        self.folder.mkdir(parents=True, exist_ok=True)
        write(self.path(result.case), json.dumps(record, separators=(",", ":"), allow_nan=False))

    @property
    def notes(self) -> list[str]:
        """What was not taken from the folder, a sentence each."""
        notes = []
        if self.damaged:
            count, first = len(self.damaged), self.damaged[0]
            notes.append(f"{_files(count)} in {self.folder} could not be read, first {first}")
        if self.foreign:
            notes.append(
                f"{_files(self.foreign)} in {self.folder} came from another version of LDT, its "
                "libraries or the machine file"
            )
        return notes


def write(path: Path, text: str) -> None:
    """Write a file as a whole: a reader, or an interruption, never meets half of it."""
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        part.write_text(text, encoding="utf-8")
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def case_of(record: Mapping[str, Any]) -> Case:
    """A case from its JSON (`dataclasses.asdict`).

    Raises:
        TypeError, KeyError: it is none.
    """
    alarms = record["alarms"]
    own = {**record, "alarms": None if alarms is None else tuple(alarms)}
    return Case(**{**own, "keep": tuple(record["keep"])})


def _plain(result: Result) -> dict[str, Any]:
    plain = {name: getattr(result, name) for name in COLUMNS}
    kept = {str(number): series for number, series in result.kept.items()}
    return {**plain, "kept": kept, "seconds": result.seconds}


def _result(case: Case, plain: Mapping[str, Any]) -> Result:
    columns = {name: plain[name] for name in COLUMNS}
    if any(not isinstance(c, list) or len(c) != case.experiments for c in columns.values()):
        raise ValueError(f"columns that have not {case.experiments} rows")
    kept = {int(number): dict(series) for number, series in plain["kept"].items()}
    return Result(case=case, **columns, kept=kept, seconds=float(plain["seconds"]))


def _files(count: int) -> str:
    return "1 result" if count == 1 else f"{count} results"
