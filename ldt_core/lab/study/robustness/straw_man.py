"""A detector in a few lines, which any other has to beat."""

from __future__ import annotations

from ldt_core.base.experiment import Level, Samples, rms
from ldt_core.detectors.base import Detector
from ldt_core.estimation.noise import roughness

#: Residual over its own roughness above which it is positive: white noise of 2000 samples stays
#: within 1 ± 0.07 (four deviations).
LIMIT = 1.2
#: Experiments to wait at most while learning does not help: it tries again within a stream.
LONGEST_WAIT = 32


class StrawMan(Detector):
    """Positive while the residual is larger than its own roughness, and learning helps.

    While learning does not help it waits 1, 2, 4 ... 32 experiments between two positives.
    """

    name = "straw_man"

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything seen."""
        super().reset()
        #: Experiments between two positives, and those still to wait.
        self.pause, self.wait = 0, 0

    def restart(self) -> None:
        """What it knows of its waiting outlasts a positive."""
        self.signal = Level.NEGATIVE

    def answered(self, adapted: bool) -> None:
        """Begin to wait, or wait longer; a model that helps ends that (`judge`)."""
        self.wait = self.pause
        self.pause = min(max(1, 2 * self.pause), LONGEST_WAIT)

    def judge(self, residual: Samples, deviation: Samples | None) -> Level:
        """The answer to one experiment."""
        if rms(residual) <= LIMIT * roughness(residual):
            self.pause = self.wait = 0
            return Level.NEGATIVE
        if self.wait > 0:
            self.wait -= 1
            return Level.WARNING
        return Level.POSITIVE
