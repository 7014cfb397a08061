"""Results of a study in its folder, one file each, so that it goes on where it was interrupted.

`OUT/runs/KEY.json`, KEY naming the run (`StudyCase.key`), and `OUT/facts/KEY.json`, KEY naming the
stream. A file counts only if it was computed by this version of LDT and of the libraries that
decide its numbers, on the same machine file; anything else is computed anew.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path

from ldt_core.base.result_files import ResultFolder
from ldt_core.lab.study.facts import Facts, stream_key
from ldt_core.lab.study.study_case import RunResult, StudyCase
from ldt_core.machine.machine_file import Machine

FORMAT = "ldt-study-1"


class StudyStore:
    """What of a study has been computed, in memory and in its folder.

    Args:
        out: folder of the study.
        stamp: what computes now, see `code_version`.
        machine: on which it computes.
        any_origin: take what another version computed as well.
        fresh: take nothing that is there.
    """

    def __init__(
        self,
        out: Path | str,
        stamp: Mapping[str, str],
        machine: Machine,
        any_origin: bool = False,
        fresh: bool = False,
    ) -> None:
        plain = json.dumps(machine.as_dict(), sort_keys=True)
        origin = {**stamp, "machine": hashlib.sha256(plain.encode()).hexdigest()[:12]}
        self.folder = ResultFolder(out, FORMAT, origin, any_origin)
        self.fresh = fresh
        self.results: dict[str, RunResult] = {}
        self.facts: dict[str, Facts] = {}

    def result(self, case: StudyCase) -> RunResult | None:
        """The result of a case; None when it has to be computed."""
        return self.folder.read(f"runs/{case.key}", lambda p: RunResult.from_dict(case, p))

    def recall(self, cases: Iterable[StudyCase]) -> list[tuple[str, StudyCase]]:
        """Take what is there of these runs and their streams; the rest is returned, in order."""
        missing, streams = [], set(self.facts)
        for case in cases:
            if (key := stream_key(case)) not in streams:
                streams.add(key)
                facts = None if self.fresh else self.folder.read(f"facts/{key}", Facts.from_dict)
                if facts is not None:
                    self.facts[key] = facts
                else:
                    missing.append(("facts", case))
            if not self.fresh and (result := self.result(case)) is not None:
                self.results[case.key] = result
            else:
                missing.append(("run", case))
        return missing

    def keep(self, case: StudyCase, answer: RunResult | Facts) -> None:
        """Write down what was computed; a reader sees all of it or nothing."""
        about = {"case": dataclasses.asdict(case)}
        if isinstance(answer, Facts):
            key = stream_key(case)
            self.facts[key] = answer
            self.folder.write(f"facts/{key}", answer.to_dict(), about)
        else:
            self.results[case.key] = answer
            self.folder.write(f"runs/{case.key}", answer.to_dict(), about)

    @property
    def notes(self) -> list[str]:
        """What in the folder is not as it should be, a sentence each."""
        notes, folder = [], self.folder
        if folder.damaged:
            rest = "were left out" if folder.any_origin else "were computed anew"
            notes.append(
                f"{_files(len(folder.damaged))} could not be read and {rest}, "
                f"the first being {folder.damaged[0]}"
            )
        if folder.foreign:
            rest = "are shown all the same" if folder.any_origin else "were computed anew"
            notes.append(
                f"{_files(folder.foreign)} came from another version of LDT, of its libraries or "
                f"of the machine file and {rest}"
            )
        return notes


def _files(count: int) -> str:
    return "1 result" if count == 1 else f"{count} results"
