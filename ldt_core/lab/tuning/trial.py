"""One setting tried: the recording through the loop, and streams in control past its detector."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from ldt_core.base.code_version import code_version
from ldt_core.base.digest import json_digest
from ldt_core.base.errors import BadInput, LdtError, reason_of
from ldt_core.base.experiment import Action, Experiment, Level
from ldt_core.detectors import build_detector
from ldt_core.lab.tuning.candidates import DetectorSetting
from ldt_core.lab.tuning.in_control import FalseAlarms, Row, false_alarm_rate
from ldt_core.machine.machine_file import Machine
from ldt_core.twin.loop import Twin, faultless


@dataclass(frozen=True)
class Job:
    """What is the same for all settings.

    Attributes:
        machine: as the twin knows it.
        settings: all parameters, those of the detector by default.
        experiments: of the recording.
        rows: of the experiments in control; empty without any.
    """

    machine: Machine
    settings: Mapping[str, Any]
    experiments: Sequence[Experiment]
    rows: Sequence[Row]


@dataclass(frozen=True)
class Tried:
    """What came of a setting; rows have one entry an experiment, in order.

    Attributes:
        setting: that was tried.
        max_error: of the learning twin [rad/s].
        level: of the signal, 1, 0 or -1.
        action: of the adaptor.
        false_alarms: in control; None where nothing is known to be in control.
        seconds: that the loop took.
    """

    setting: DetectorSetting
    max_error: tuple[float, ...]
    level: tuple[int, ...]
    action: tuple[str, ...]
    false_alarms: FalseAlarms | None
    seconds: float

    @property
    def mme(self) -> float:
        """Mean maximum error [rad/s]."""
        return float(np.mean(self.max_error))

    @property
    def adaptations(self) -> int:
        """New models that came into force."""
        return self.action.count(Action.ADAPTED)

    @property
    def refusals(self) -> int:
        """Positives after which the model stayed."""
        return self.action.count(Action.REFUSED)

    @property
    def positives(self) -> int:
        """Positive signals."""
        return self.level.count(Level.POSITIVE)

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, plain: Mapping[str, Any], setting: DetectorSetting) -> Self:
        """What `to_dict` gave.

        Raises:
            KeyError, TypeError: it did not.
        """
        rows = {name: tuple(plain[name]) for name in ("max_error", "level", "action")}
        alarms = plain["false_alarms"]
        found = None if alarms is None else FalseAlarms(**alarms)
        return cls(setting, **rows, false_alarms=found, seconds=float(plain["seconds"]))


def try_setting(task: tuple[DetectorSetting, Job]) -> Tried:
    """What a worker does.

    Raises:
        BadInput: a setting that the detector refuses.
        LdtError: the run failed; the sentence says with which setting.
    """
    setting, job = task
    try:
        return _try(setting, job)
    except BadInput:
        raise
    except Exception as error:
        raise LdtError(f"{setting}: {reason_of(error)}") from error


def _try(setting: DetectorSetting, job: Job) -> Tried:
    settings = {**job.settings, **setting.settings}
    begin = time.perf_counter()
    twin = Twin.from_settings(job.machine, settings)
    steps = list(faultless(twin.steps(job.experiments, _refuse)))
    seconds = time.perf_counter() - begin
    detector = build_detector(setting.detector, settings)
    return Tried(
        setting=setting,
        max_error=tuple(s.signal.max_error for s in steps),
        level=tuple(int(s.signal.level) for s in steps),
        action=tuple(str(s.adaptation.action) for s in steps),
        false_alarms=false_alarm_rate(detector, job.rows) if job.rows else None,
        seconds=round(seconds, 3),
    )


def _refuse(error: LdtError) -> None:
    raise error


def job_key(job: Job) -> str:
    """SHA-256 of all that decides what comes of a setting, but the setting."""
    code = _code(job.settings["model"])
    return json_digest([code_version(), code, matter_key(job), _samples_digest(job.rows)])


def matter_key(job: Job) -> str:
    """SHA-256 of what is tuned: the recording, and the twin but for its detector."""
    rows = ((e.voltage, e.speed, e.current, [e.number, e.period]) for e in job.experiments)
    return json_digest([job.machine.as_dict(), dict(job.settings), _samples_digest(rows)])


def _samples_digest(rows: Iterable[Iterable[Any]]) -> str:
    parts = (samples for row in rows for samples in row)
    data = b"".join(b"|" if p is None else np.asarray(p, np.float64).tobytes() for p in parts)
    return hashlib.sha256(data).hexdigest()


def setting_key(setting: DetectorSetting) -> str:
    """Name of a setting's result."""
    return json_digest(setting.settings)[:20]


def _code(name: str) -> str:
    """The text of a user's own part, `file.py:Name`; "" of what is installed."""
    path = Path(name.rpartition(":")[0])
    return path.read_text(encoding="utf-8") if path.suffix == ".py" and path.is_file() else ""
