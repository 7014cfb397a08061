"""Never: the detector of a twin that does not learn."""

from __future__ import annotations

from ldt_core.base.experiment import Level, Samples
from ldt_core.detectors.base import Detector


class Never(Detector):
    """Negative, always: the baseline that every other detector has to beat.

    Examples:
        >>> from ldt_core.detectors.never import Never
        >>> detector = Never()
        >>> detector.update([1e9])
        >>> detector.signal.word
        'negative'
    """

    name = "never"
    resumable = True
    warns = False
    order_free = True

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """There is nothing to forget."""
        super().reset()

    def judge(self, residual: Samples, deviation: Samples | None) -> Level:
        """Negative."""
        return Level.NEGATIVE
