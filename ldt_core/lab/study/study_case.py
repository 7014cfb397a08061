"""One run of a study: what to run, and what came of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from ldt_core.base.digest import json_digest
from ldt_core.base.settings import resolve


@dataclass(frozen=True)
class StudyCase:
    """One run: a model and a detector on one stream.

    Args:
        model: that learns.
        detector: as the table names it; with `alarms`, the baseline's name (periodic, random).
        seed: of the stream.
        experiments: of the stream.
        machine: name or file.
        settings: parameters (`parameters.yaml`) that differ from their defaults, of any group.
        alarms: numbers of the experiments whose signal is positive whatever the data say (a
            baseline); None asks the detector.
        keep: experiments whose predictions are kept for a figure.
    """

    model: str
    detector: str
    seed: int
    experiments: int = 200
    machine: str = "rotor"
    settings: Mapping[str, Any] = field(default_factory=dict)
    alarms: tuple[int, ...] | None = None
    keep: tuple[int, ...] = ()

    @property
    def resolved(self) -> dict[str, Any]:
        """All parameters of the run.

        Raises:
            OptionError: a setting that does not exist or is out of its range.
        """
        own = {"machine": self.machine, "model": self.model, "seed": self.seed}
        own["experiments"] = self.experiments
        if self.alarms is None:
            own["detector"] = self.detector
        return resolve({**self.settings, **own})

    @property
    def key(self) -> str:
        """Name of the result: the same for the same run, whatever the study it belongs to."""
        return json_digest({**asdict(self), "resolved": self.resolved})[:20]


@dataclass(frozen=True)
class RunResult:
    """What came of one run; all rows have one entry an experiment, in order.

    Attributes:
        case: what was run.
        number: of the experiment.
        truth: value of what wears in it (the rotor: e [m]).
        max_error: of the learning twin [rad/s].
        original: maximum error of the original model [rad/s].
        level: of the signal, 1, 0 or -1.
        action: of the adaptor.
        region_rmse: of the learning twin inside the Sommerfeld region [rad/s]; None where the
            experiment does not touch it.
        region_rmse_original: the same of the original model.
        kept: number → {"time", "voltage", "speed", "prediction", "original"}, each (L,), for the
            experiments to keep.
        seconds: of processor time that the loop took, without the simulation of the machine.
    """

    case: StudyCase
    number: list[int]
    truth: list[float]
    max_error: list[float]
    original: list[float]
    level: list[int]
    action: list[str]
    region_rmse: list[float | None]
    region_rmse_original: list[float | None]
    kept: dict[int, dict[str, list[float]]]
    seconds: float

    def to_dict(self) -> dict[str, Any]:
        """Plain values without the case, for JSON."""
        plain: dict[str, Any] = {name: getattr(self, name) for name in _rows()}
        kept = {str(number): series for number, series in self.kept.items()}
        return {**plain, "kept": kept, "seconds": self.seconds}

    @classmethod
    def from_dict(cls, case: StudyCase, plain: Mapping[str, Any]) -> RunResult:
        """The result of a case that `to_dict` gave, JSON in between or not.

        Raises:
            ValueError, KeyError, TypeError, AttributeError: it did not.
        """
        rows = {name: plain[name] for name in _rows()}
        if any(not isinstance(row, list) or len(row) != case.experiments for row in rows.values()):
            raise ValueError(f"rows that have not {case.experiments} entries")
        kept = {int(number): dict(series) for number, series in plain["kept"].items()}
        return cls(case=case, **rows, kept=kept, seconds=float(plain["seconds"]))

    @property
    def positives(self) -> list[int]:
        """Numbers of the experiments with a positive signal."""
        return [n for n, level in zip(self.number, self.level, strict=True) if level == 1]

    @property
    def adaptations(self) -> list[int]:
        """Numbers of the experiments after which a new model came into force."""
        pairs = zip(self.number, self.action, strict=True)
        return [n for n, action in pairs if action == "adapted"]


def _rows() -> list[str]:
    """Names of the fields with one entry an experiment."""
    return sorted({f.name for f in fields(RunResult)} - {"case", "kept", "seconds"})
