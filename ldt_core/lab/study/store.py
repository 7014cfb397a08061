"""Results in a folder, one file each, so that a study goes on where it was interrupted.

`OUT/runs/KEY.json`, KEY naming the run (`Case.key`), and `OUT/facts/KEY.json`, KEY naming the
stream. A file counts only if it was computed by this version of LDT and of the libraries that
decide its numbers, on the same machine file; anything else is computed anew. Nothing is unpickled:
the files are JSON.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from ldt_core.base.result_files import write
from ldt_core.lab.study.case import Case, Result
from ldt_core.lab.study.facts import Facts, stream_key
from ldt_core.machine.machine_file import Machine

FORMAT = "ldt-study-1"
COLUMNS = sorted({f.name for f in dataclasses.fields(Result)} - {"case", "kept", "seconds"})

Kind = TypeVar("Kind")


class Store:
    """The results in the folder of a study.

    Args:
        out: folder of the study.
        stamp: what computes now, see `stamp.py`.
        machine: on which it computes.
        any_origin: take what another version computed as well.
    """

    def __init__(
        self,
        out: Path | str,
        stamp: Mapping[str, str],
        machine: Machine,
        any_origin: bool = False,
    ) -> None:
        self.out = Path(out)
        plain = json.dumps(machine.as_dict(), sort_keys=True)
        self.origin = {**stamp, "machine": hashlib.sha256(plain.encode()).hexdigest()[:12]}
        self.any_origin = any_origin
        self._foreign = 0
        self._damaged: list[str] = []

    def result(self, case: Case) -> Result | None:
        """The result of a case; None when it has to be computed."""
        return self._read("runs", case.key, lambda plain: _result(case, plain))

    def facts(self, case: Case) -> Facts | None:
        """The facts of the stream of a case; None when they have to be computed."""
        return self._read("facts", stream_key(case), Facts.from_dict)

    def save_result(self, result: Result) -> None:
        """Write a result; a reader sees all of it or nothing."""
        plain = {name: getattr(result, name) for name in COLUMNS}
        kept = {str(number): series for number, series in result.kept.items()}
        plain |= {"kept": kept, "seconds": result.seconds}
        self._write("runs", result.case, result.case.key, plain)

    def save_facts(self, case: Case, facts: Facts) -> None:
        """Write the facts of the stream of a case; a reader sees all of it or nothing."""
        self._write("facts", case, stream_key(case), facts.to_dict())

    @property
    def notes(self) -> list[str]:
        """What in the folder is not as it should be, a sentence each."""
        notes = []
        done = "are shown all the same" if self.any_origin else "were computed anew"
        if self._damaged:
            count, first = len(self._damaged), self._damaged[0]
            rest = "were left out" if self.any_origin else "were computed anew"
            notes.append(f"{_files(count)} could not be read and {rest}, the first being {first}")
        if self._foreign:
            notes.append(
                f"{_files(self._foreign)} came from another version of LDT, of its libraries or of "
                f"the machine file and {done}"
            )
        return notes

    def _path(self, folder: str, key: str) -> Path:
        return self.out / folder / f"{key}.json"

    def _read(self, folder: str, key: str, parse: Callable[[Any], Kind]) -> Kind | None:
        path = self._path(folder, key)
        try:
            record = json.loads(path.read_text(encoding="utf-8"))
            if (record["format"], record["key"]) != (FORMAT, key):
                raise ValueError("another file's content")
            foreign = record["origin"] != self.origin
            found = None if foreign and not self.any_origin else parse(record["content"])
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
            self._damaged.append(str(path))
            return None
        self._foreign += foreign
        return found

    def _write(self, folder: str, case: Case, key: str, content: Mapping[str, Any]) -> None:
        path = self._path(folder, key)
        path.parent.mkdir(parents=True, exist_ok=True)
        record = {"format": FORMAT, "key": key, "origin": self.origin}
        record |= {"case": dataclasses.asdict(case), "content": content}
        write(path, json.dumps(record, separators=(",", ":"), allow_nan=False))


def _result(case: Case, plain: Mapping[str, Any]) -> Result:
    columns = {name: plain[name] for name in COLUMNS}
    if any(not isinstance(c, list) or len(c) != case.experiments for c in columns.values()):
        raise ValueError(f"columns that have not {case.experiments} rows")
    kept = {int(number): dict(series) for number, series in plain["kept"].items()}
    return Result(case=case, **columns, kept=kept, seconds=float(plain["seconds"]))


def _files(count: int) -> str:
    return "1 result" if count == 1 else f"{count} results"
