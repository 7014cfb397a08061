"""What can be chosen: a detector with one value of the parameter that decides how soon it acts."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import msgs_config

#: Detector → the parameter by which it is tuned.
TUNED = {
    "threshold": "threshold",
    "lddm": "error_threshold",
    "window": "window",
    "adequacy": "false_alarm_every",
}
#: Values of `false_alarm_every` that are tried: fewest experiments, most.
RARITY = (20.0, 5000.0)
DIGITS = 3  # of a value, so that it can be pasted
#: Values between the best one and each of its neighbours that are tried in the second round.
BETWEEN = 2
#: Least ratio of the largest limit tried to the smallest, where noise is nearly all the error.
SMALLEST_RANGE = 1.5


@dataclass(frozen=True)
class DetectorSetting:
    """A detector with one value.

    Args:
        detector: its name.
        parameter: declared in `parameters.yaml`; "" for a detector that has none.
        value: of the parameter.
    """

    detector: str
    parameter: str = ""
    value: float = 0.0

    @property
    def settings(self) -> dict[str, Any]:
        """Parameters of the group detector that differ from their defaults."""
        if not self.parameter:
            return {"detector": self.detector}
        return {"detector": self.detector, self.parameter: self._plain}

    @property
    def options(self) -> str:
        """As it is typed after a command."""
        words = []
        for name, value in self.settings.items():
            text = f"{value:g}" if isinstance(value, float) else str(value)
            words.append(f"--{name.replace('_', '-')} {text}")
        return " ".join(words)

    @property
    def _plain(self) -> int | float:
        return int(self.value) if _is_whole(self.parameter) else float(self.value)

    def __str__(self) -> str:
        return f"{self.detector}{f' with {self.parameter} {self.value:g}' * bool(self.parameter)}"


NEVER = DetectorSetting("never")


def _is_whole(parameter: str) -> bool:
    return msgs_config.parameters("detector")[parameter]["type"] == "integer"


def first_round(
    detectors: Iterable[str], errors: Sequence[float], noise: float, values: int
) -> list[DetectorSetting]:
    """The settings that are tried at first, equally far apart in logarithm.

    A limit of the error is tried from what noise alone reaches to the largest error that the
    untrained model makes: below it no model stays silent, above it nothing is ever found. (The
    untrained model's least error would be no lower end: a trained one may fall below it.) A window
    is tried from 2 to half of the experiments.

    Args:
        detectors: names, each of `TUNED`.
        errors: (n,) maximum errors of the untrained model [rad/s].
        noise: maximum error that noise alone makes [rad/s].
        values: of each detector.
    """
    high = max(errors)
    low = min(max(noise, high * 1e-3), high / SMALLEST_RANGE)
    ranges = {
        "threshold": (low, high),
        "lddm": (low, high),
        "window": (2, max(3, len(errors) // 2)),
        "adequacy": RARITY,
    }
    return [
        s
        for name in detectors
        for s in candidate_settings(name, TUNED[name], np.geomspace(*ranges[name], values))
    ]


def candidate_settings(
    detector: str, parameter: str, values: Iterable[float]
) -> list[DetectorSetting]:
    """One setting a value, rounded, in order and without repetitions."""
    whole = _is_whole(parameter)
    rounded = {float(round(v)) if whole else float(f"{v:.{DIGITS}g}") for v in values}
    return [DetectorSetting(detector, parameter, v) for v in sorted(rounded)]


def second_round(best: DetectorSetting, tried: Iterable[DetectorSetting]) -> list[DetectorSetting]:
    """Settings between the best one of a detector and its neighbours."""
    rivals = [s for s in tried if (s.detector, s.parameter) == (best.detector, best.parameter)]
    values = sorted(s.value for s in rivals if s.value > 0)
    if best.value not in values:
        return []
    at = values.index(best.value)
    near = values[max(0, at - 1) : at + 2]
    between = [np.geomspace(a, b, BETWEEN + 2) for a, b in itertools.pairwise(near)]
    fresh = candidate_settings(
        best.detector, best.parameter, [float(v) for row in between for v in row]
    )
    return [s for s in fresh if s.value not in values]
