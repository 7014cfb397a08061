"""Probes and what they find: one line each, never a traceback, never longer than the time given."""

from __future__ import annotations

import enum
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from ldt_core.base.errors import reason_of
from ldt_core.base.registry import entry_points

#: Entry points that are lists of probes of parts that the core does not import.
ENTRY_POINT_GROUP = "ldt.check"
TIME_LIMIT = 12.0  # s for all probes together, so that the whole command takes less than 15 s


class Grade(enum.StrEnum):
    """How bad a finding is."""

    OK = "ok"
    WARNING = "warning"
    PROBLEM = "problem"


@dataclass(frozen=True)
class Finding:
    """One line of the report.

    Args:
        grade: a problem keeps `ldt up` from running, or makes a recording incomplete.
        remedy: what to do about it, in one sentence; "" when all is well.
    """

    name: str
    grade: Grade
    message: str
    remedy: str = ""

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


def ok(name: str, message: str) -> Finding:
    """All is well."""
    return Finding(name, Grade.OK, message)


def warning(name: str, message: str, remedy: str) -> Finding:
    """It works, but not as it could."""
    return Finding(name, Grade.WARNING, message, remedy)


def problem(name: str, message: str, remedy: str) -> Finding:
    """It does not work."""
    return Finding(name, Grade.PROBLEM, message, remedy)


@dataclass(frozen=True)
class Probe:
    """Something to look at.

    Args:
        look: gives the findings; what it raises becomes one.
    """

    name: str
    look: Callable[[], Sequence[Finding]]


def run_probes(probes: Sequence[Probe], limit: float = TIME_LIMIT) -> list[Finding]:
    """Run all probes side by side; the findings stand in the order of the probes.

    Args:
        limit: seconds for all of them; one that has not ended by then is a problem itself.
    """
    found: dict[int, Sequence[Finding]] = {}

    def run(index: int, probe: Probe) -> None:
        try:
            found[index] = list(probe.look())
        except Exception as error:  # whatever a broken machine does to a probe
            sentence = f"the check itself failed: {reason_of(error)}"
            remedy = "look at the rest of this list first, this may follow from it"
            found[index] = [problem(probe.name, sentence, remedy)]

    # Daemons: a dead network drive can hold a thread for minutes, and nobody waits for it.
    threads = [
        threading.Thread(target=run, args=(i, p), name=p.name, daemon=True)
        for i, p in enumerate(probes)
    ]
    for thread in threads:
        thread.start()
    end = time.monotonic() + limit
    for thread in threads:
        thread.join(max(0.0, end - time.monotonic()))
    late = "try again when the machine is less busy; if it stays, what it looks at hangs"
    findings: list[Finding] = []
    for index, probe in enumerate(probes):
        silent = [problem(probe.name, f"no answer within {limit:g} s", late)]
        findings += found.get(index, silent)
    return findings


def found_probes() -> list[Probe]:
    """Probes of other parts, by entry point; one that cannot be loaded is a probe that fails."""
    probes: list[Probe] = []
    for entry in sorted(entry_points(ENTRY_POINT_GROUP), key=lambda e: e.name):
        try:
            probes += entry.load()
        except Exception as error:  # whatever that package does
            probes.append(Probe(entry.name, _raiser(error)))
    return probes


def _raiser(error: Exception) -> Callable[[], Sequence[Finding]]:
    def look() -> Sequence[Finding]:
        raise error

    return look


def passed(findings: Sequence[Finding]) -> bool:
    """Whether none is a problem."""
    return all(f.grade is not Grade.PROBLEM for f in findings)
