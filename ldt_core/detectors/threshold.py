"""Threshold detector: the maximum error of one experiment against two limits."""

from __future__ import annotations

import numpy as np

from ldt_core.base.errors import OptionError
from ldt_core.base.experiment import Level, Samples
from ldt_core.detectors.base import Detector, declared

#: Value of `warning_threshold` that means half the threshold, as in the paper's studies.
HALVED = -1.0


class Threshold(Detector):
    """Positive when the worst sample of an experiment is too far off (paper, eq. 5).

    With f_m = max_k |y_k - ŷ_k| the answer is 1 if f_m > θ_c, else 0 if f_m > θ_w, else -1. It has
    no memory: one outlier is enough, and a drift below θ_c is never found, however long it lasts.

    Args:
        threshold: θ_c [rad/s].
        warning_threshold: θ_w [rad/s], at most θ_c; -1 takes half of θ_c. At θ_c it never warns.

    Raises:
        OptionError: an argument outside its range.

    Examples:
        >>> from ldt_core.detectors.threshold import Threshold
        >>> detector = Threshold(threshold=3.0)
        >>> for worst in (1.0, 2.0, 4.0):
        ...     detector.update([0.1, -worst, 0.2])
        ...     print(detector.signal.word, detector.statistics)
        negative {'max_error': 1.0, 'warning_limit': 1.5, 'drift_limit': 3.0}
        warning {'max_error': 2.0, 'warning_limit': 1.5, 'drift_limit': 3.0}
        positive {'max_error': 4.0, 'warning_limit': 1.5, 'drift_limit': 3.0}

    References:
        Zhou, Walther, Verl: Learning digital twin, CIRP CMS 2024, eq. 5.
    """

    name = "threshold"
    resumable = True
    order_free = True

    def __init__(self, threshold: float = 3.0, warning_threshold: float = HALVED) -> None:
        self.threshold = declared("threshold", threshold)
        self.warning_threshold = declared("warning_threshold", warning_threshold)
        if self.warning_threshold != HALVED and not 0 <= self.warning_threshold <= self.threshold:
            raise OptionError(
                "warning_threshold",
                f"0 to the threshold ({self.threshold:g} rad/s), or -1 for half of it",
                self.warning_threshold,
            )
        self.reset()

    @property
    def warning_limit(self) -> float:
        """θ_w [rad/s]."""
        return self.threshold / 2 if self.warning_threshold == HALVED else self.warning_threshold

    def reset(self) -> None:
        """Forget the last experiment; there is nothing else to forget."""
        super().reset()
        self.max_error: float | None = None

    def judge(self, residual: Samples, deviation: Samples | None) -> Level:
        """Eq. 5; the deviation is not used."""
        self.max_error = float(np.abs(residual).max())
        if self.max_error > self.threshold:
            return Level.POSITIVE
        return Level.WARNING if self.max_error > self.warning_limit else Level.NEGATIVE

    @property
    def statistics(self) -> dict[str, float]:
        """max_error, warning_limit, drift_limit [rad/s]."""
        if self.max_error is None:
            return {}
        return {
            "max_error": self.max_error,
            "warning_limit": self.warning_limit,
            "drift_limit": self.threshold,
        }
