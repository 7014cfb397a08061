"""Window detector: by the calendar, the passive comparison of the paper."""

from __future__ import annotations

from ldt_core.base.experiment import Level, Samples
from ldt_core.detectors.base import Detector, declared


class Window(Detector):
    """Positive every `window` experiments, whatever the error.

    In between it answers with a warning, which is what puts an experiment into the warning set
    S_w: at the positive, S_w and the present experiment are just the window (unless the memory is
    limited to less), and the model is trained on it. With `window` 1 every experiment is positive.

    Args:
        window: experiments from one positive to the next.

    Raises:
        OptionError: an argument outside its range.

    Examples:
        >>> from ldt_core.detectors.window import Window
        >>> detector = Window(window=3)
        >>> for i in range(1, 7):
        ...     detector.update([0.0])
        ...     print(i, detector.signal.word)
        1 warning
        2 warning
        3 positive
        4 warning
        5 warning
        6 positive
    """

    name = "window"
    resumable = True
    order_free = True

    def __init__(self, window: int = 10) -> None:
        self.window = declared("window", window)
        self.reset()

    def reset(self) -> None:
        """Begin a new window."""
        super().reset()
        self.experiments = 0

    def judge(self, residual: Samples, deviation: Samples | None) -> Level:
        """Count; neither argument is looked at."""
        self.experiments += 1
        return Level.POSITIVE if self.experiments >= self.window else Level.WARNING

    @property
    def statistics(self) -> dict[str, float]:
        """Experiments in this window so far, and where it ends."""
        return {"experiments": self.experiments, "drift_limit": self.window}
