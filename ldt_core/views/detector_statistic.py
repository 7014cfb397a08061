"""Which of a signal's statistics the detector compares with its limits."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ldt_core.base.experiment import Signal
from ldt_core.base.sentences import spoken

LIMITS = ("warning_limit", "drift_limit")
#: Detector → (its statistic, what that is, unit).
KNOWN = {
    "threshold": ("max_error", "largest error in an experiment", "rad/s"),
    "lddm": ("p_plus_s", "rate of wrong samples, and its deviation", ""),
    "window": ("experiments", "experiments since the last positive", ""),
    "calibrated": ("relative_error", "error in yardsticks", ""),
    "river": ("input", "last value fed to river's detector", ""),
}


@dataclass(frozen=True)
class DetectorStatistic:
    """A detector's statistic in every experiment.

    Attributes:
        name: what it is.
        unit: "" where it has none.
        values: by experiment, None where there is none; so are the limits.
        warning: above which it warns.
        drift: above which it is positive.
    """

    name: str
    unit: str
    values: list[float | None]
    warning: list[float | None]
    drift: list[float | None]

    @property
    def label(self) -> str:
        """Name and unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


def statistic(signals: list[Signal]) -> DetectorStatistic:
    """What the detector of these signals compared.

    Of a detector that nobody knows it is the first figure that is no limit, or else the maximum
    error.
    """
    detector = signals[-1].detector
    own = [n for s in signals for n in s.statistics if n not in LIMITS]
    key, name, unit = KNOWN.get(detector, ("", "", ""))
    if not key and own:
        key = own[0]
        name = spoken(key)
    elif not key:
        key, name, unit = KNOWN["threshold"]
    rows = [{"max_error": s.max_error, **s.statistics} for s in signals]
    columns = [[_finite(row.get(column)) for row in rows] for column in (key, *LIMITS)]
    return DetectorStatistic(name, unit, *columns)


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
