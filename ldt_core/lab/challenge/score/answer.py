"""Answers to sealed cases, kept in a folder so that a score goes on where it was interrupted.

`OUT/CASE/WHO.json` is what was found, for the diagnosis itself the `diagnosis.json` that `ldt
diagnose` writes; `OUT/CASE/WHO.run.json` says of which case and by which code, and what it cost. An
answer counts only if both still fit.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from ldt_core.base.result_files import keep, recall

FORMAT = "ldt-score-2"
DIAGNOSIS = "diagnosis"
LEAST_GAP = 0.005  # of a gap's power to the noise's: below, the part closed is chance


@dataclass(frozen=True)
class Further:
    """Errors on an experiment that nobody had seen.

    Attributes:
        number: of the experiment.
        samples: in it.
        before: sum of squared free-run errors by the machine file [(rad/s)^2].
        after: the same with what was found; infinite where that diverges.
    """

    number: int
    samples: int
    before: float
    after: float


@dataclass(frozen=True)
class CaseAnswer:
    """What somebody found in a case.

    Attributes:
        who: the diagnosis or a comparator.
        found: the keys of `diagnosis.json`, or as many of them as there are; None of a failure.
        further: errors on the further experiments; empty where nothing was found to add.
        seconds: of processor time.
        seen: of the case, see `Sealed.seen`.
        error: why it failed, in words.
        refused: why it promises nothing of the further experiments with another excitation; ""
            where it does.
    """

    who: str
    found: Mapping[str, Any] | None
    further: Sequence[Further] = ()
    seconds: float = 0.0
    seen: Mapping[str, Any] = field(default_factory=dict)
    error: str = ""
    refused: str = ""

    @property
    def kind(self) -> str:
        """None, effect, ambiguous, unknown; unnamed of who names nothing, failed of a failure."""
        return "failed" if self.found is None else str(self.found["verdict"]["kind"])

    @property
    def acting(self) -> list[list[str]]:
        """For each effect that acts, the names it may have."""
        if self.found is None or self.kind not in ("effect", "ambiguous"):
            return []
        return [list(group) for group in self.found["verdict"]["acting"]]

    @property
    def promised(self) -> float | None:
        """Closed fraction of the gap on experiments that were held back."""
        closed = None if self.found is None else self.found["gap"]["closed_fraction"]
        return None if closed is None else float(closed)

    @property
    def noise(self) -> float | None:
        """Deviation of the measured speed, as it was found [rad/s]."""
        return None if self.found is None else float(self.found["gap"]["noise_std"])


def realised(
    further: Sequence[Further],
    noise: float,
    fell: Mapping[int, float] | None = None,
) -> float | None:
    """Closed fraction of the gap on further experiments; None where there is too little of it.

    Args:
        further: experiments.
        noise: deviation of the measured speed [rad/s].
        fell: root mean square of the noise as it fell out, by number of the experiment [rad/s]:
            where a gap is smaller than the noise, its chance would be more than the gap.
    """
    floor = sum(f.samples * (fell or {}).get(f.number, noise) ** 2 for f in further)
    gap = sum(f.before for f in further) - floor
    if not further or not math.isfinite(gap) or not gap > LEAST_GAP * floor:
        return None
    return (sum(f.before for f in further) - sum(f.after for f in further)) / gap


class Answers:
    """The answers in a folder.

    Args:
        out: folder.
    """

    def __init__(self, out: str | Path) -> None:
        self.out = Path(out)

    def read(self, case: str, who: str, origin: Mapping[str, Any]) -> CaseAnswer | None:
        """An answer of the same origin; None if there is none that can be used."""
        found, run = self._files(case, who)
        kept = recall(run, found, FORMAT, origin)
        if kept is None:
            return None
        try:
            further = tuple(
                Further(**{**f, "after": math.inf if f["after"] is None else f["after"]})
                for f in kept.about["further"]
            )
            known = {name: kept.about[name] for name in ("seconds", "seen", "error", "refused")}
            return CaseAnswer(who, json.loads(kept.text), further, **known)
        except (ValueError, KeyError, TypeError, RecursionError):
            return None

    def write(self, case: str, answer: CaseAnswer, origin: Mapping[str, Any]) -> None:
        """Keep an answer; a reader sees all of it or nothing."""
        found, run = self._files(case, answer.who)
        text = json.dumps(answer.found, allow_nan=False, indent=1) + "\n"
        further = [asdict(f) for f in answer.further]
        for f in further:
            f["after"] = f["after"] if math.isfinite(f["after"]) else None
        about = {
            "seconds": answer.seconds,
            "error": answer.error,
            "seen": dict(answer.seen),
            "refused": answer.refused,
            "further": further,
        }
        keep(run, found, text, FORMAT, origin, about)

    def _files(self, case: str, who: str) -> tuple[Path, Path]:
        folder = self.out / case
        return folder / f"{who}.json", folder / f"{who}.run.json"
