"""Detector objects of other libraries, by river's convention: `update(x)`, `drift_detected`."""

from __future__ import annotations

import copy
from typing import Any, Protocol, runtime_checkable

import numpy as np

from ldt_core.base.errors import OptionError
from ldt_core.base.experiment import Level, Samples
from ldt_core.detectors.base import Detector


@runtime_checkable
class Updatable(Protocol):
    """What river's drift detectors are, and those of others who follow them."""

    @property
    def drift_detected(self) -> bool:
        """Whether the last value showed a drift."""

    def update(self, x: float, /) -> Any:
        """Take in one value."""


class Foreign(Detector):
    """An object with river's convention, fed with the maximum error of each experiment [rad/s].

    Positive when it detects a drift, a warning when it has `warning_detected` and that holds. After
    a positive a copy of the object as it was given begins anew; where no new model came of it, the
    object as it was before that experiment goes on.

    Args:
        detector: the object, which is copied and never changed.

    Raises:
        OptionError: a detector of river that is made for yes and no instead of numbers.

    Examples:
        >>> from ldt_core.detectors.foreign import Foreign
        >>> class Above:
        ...     drift_detected = False
        ...     def update(self, x):
        ...         self.drift_detected = x > 1.0
        >>> detector = Foreign(Above())
        >>> detector.update([0.5, -2.0])
        >>> detector.signal.word
        'positive'
    """

    def __init__(self, detector: Updatable) -> None:
        self.detector = detector
        self.name = type(detector).__name__  # type: ignore[misc]
        if any(kind.__name__ == "BinaryDriftDetector" for kind in type(detector).__mro__):
            expected = f"detector='river' with river_detector={self.name} and input=errors"
            raise OptionError("detector", expected, f"river's {self.name}, which takes yes and no")
        self.reset()

    def reset(self) -> None:
        """Begin with a new copy."""
        super().reset()
        self._copy = copy.deepcopy(self.detector)
        self._before = self._copy
        self._last = 0.0

    def judge(self, residual: Samples, deviation: Samples | None) -> Level:
        """Feed the maximum error; the deviation is not used."""
        self._last = float(np.abs(residual).max())
        self._before = copy.deepcopy(self._copy)
        self._copy.update(self._last)
        if self._copy.drift_detected:
            return Level.POSITIVE
        warned = getattr(self._copy, "warning_detected", False)
        return Level.WARNING if warned else Level.NEGATIVE

    def answered(self, adapted: bool) -> None:
        """Hear what came of a positive; without a new model the experiment does not count."""
        if not adapted:
            self.signal = Level.NEGATIVE
            self._copy = self._before

    @property
    def statistics(self) -> dict[str, float]:
        """The value fed last."""
        return {"input": self._last}
