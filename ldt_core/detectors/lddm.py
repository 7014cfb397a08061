"""LDDM, the learning drift detection method: the rate of wrong samples against its best."""

from __future__ import annotations

import math

import numpy as np

from ldt_core.base.errors import OptionError
from ldt_core.base.experiment import Level, Samples
from ldt_core.detectors.base import Detector, declared


class LDDM(Detector):
    """Positive when the error rate has risen significantly above the lowest one (paper, eq. 6-8).

    A sample is an error when |y_k - ŷ_k| > θ_d. Over all samples since the beginning or the last
    positive, in the i-th experiment since then,

        p_i = errors / n,    s_i = sqrt(p_i (1 - p_i) / n),    n = samples so far,

    where n is the paper's i·L, counted sample by sample, so that experiments may differ in length.
    Whenever p_i + s_i < p_min + s_min, the registers p_min and s_min take over p_i and s_i; empty
    registers count as infinite. Then the answer is 1 if p_i + s_i ≥ p_min + 3 s_min, else 0 if
    p_i + s_i ≥ p_min + 2 s_min, else -1.

    The paper is silent on s_min = 0, where "≥" holds with equality: an error-free stream would be
    positive in every experiment. Here no signal is above -1 while p_i = 0, or before an earlier
    experiment has set the registers. `literal` drops both conditions. It knows no gate either:
    where a positive led to no new model, nothing starts anew, and the experiment does not count.
    Else the rate of a machine that has changed would become p_min, and the change be forgotten.

    What to know about it:

    - After error-free experiments (p_min = s_min = 0) the very first error is positive.
    - s_i takes samples for independent. Residuals of a free run are not, so that false alarms are
      far more frequent than three deviations suggest.
    - p_i averages over everything since the last positive: the later a drift comes, the longer
      it takes to be seen.

    Args:
        error_threshold: θ_d [rad/s].
        drift_level: deviations s_min above p_min that are a drift; 3 in the paper.
        warning_level: deviations that are a warning, at most `drift_level`; 2 in the paper.
        literal: the paper's inequalities to the letter.

    Raises:
        OptionError: an argument outside its range.

    Examples:
        One sample in ten is off, from experiment 5 on two in ten:

        >>> import numpy as np
        >>> from ldt_core.detectors.lddm import LDDM
        >>> detector = LDDM(error_threshold=1.0)
        >>> for i in range(1, 7):
        ...     off = 10 if i < 5 else 20
        ...     detector.update(np.repeat([2.0, 0.0], [off, 100 - off]))
        ...     print(i, detector.signal.word, round(detector.statistics["p_plus_s"], 4))
        1 negative 0.13
        2 negative 0.1212
        3 negative 0.1173
        4 negative 0.115
        5 warning 0.1345
        6 positive 0.1472

    References:
        Gama, Medas, Castillo, Rodrigues: Learning with drift detection, SBIA 2004.
        Zhou, Walther, Verl: Learning digital twin, CIRP CMS 2024, eq. 6-8.
    """

    name = "lddm"
    resumable = True
    order_free = True

    def __init__(
        self,
        error_threshold: float = 1.0,
        drift_level: float = 3.0,
        warning_level: float = 2.0,
        literal: bool = False,
    ) -> None:
        self.error_threshold = declared("error_threshold", error_threshold)
        self.drift_level = declared("drift_level", drift_level)
        self.warning_level = declared("warning_level", warning_level)
        self.literal = declared("literal", literal)
        if self.warning_level > self.drift_level:
            expected = f"0 to the drift_level ({self.drift_level:g})"
            raise OptionError("warning_level", expected, self.warning_level)
        self.reset()

    def reset(self) -> None:
        """Forget all experiments and both registers."""
        super().reset()
        self.errors = 0
        self.samples = 0
        #: Of these, in the last experiment.
        self.last_errors = 0
        self.last_samples = 0
        self.p_min: float | None = None
        self.s_min: float | None = None

    def judge(self, residual: Samples, deviation: Samples | None) -> Level:
        """Eq. 6-8; the deviation is not used."""
        self.last_errors = int(np.count_nonzero(np.abs(residual) > self.error_threshold))
        self.last_samples = residual.size
        self.errors += self.last_errors
        self.samples += self.last_samples
        p, s = self.error_rate
        first = self.p_min is None
        if self.p_min is None or self.s_min is None or p + s < self.p_min + self.s_min:
            self.p_min, self.s_min = p, s
        if not self.literal and (first or p == 0):
            return Level.NEGATIVE
        if p + s >= self.p_min + self.drift_level * self.s_min:
            return Level.POSITIVE
        if p + s >= self.p_min + self.warning_level * self.s_min:
            return Level.WARNING
        return Level.NEGATIVE

    def answered(self, adapted: bool) -> None:
        """Hear what came of a positive; without a new model the experiment does not count."""
        if not adapted:
            self.signal = Level.NEGATIVE
            self.errors -= self.last_errors
            self.samples -= self.last_samples

    @property
    def error_rate(self) -> tuple[float, float]:
        """(p_i, s_i), eq. 7."""
        p = self.errors / self.samples
        return p, math.sqrt(p * (1 - p) / self.samples)

    @property
    def statistics(self) -> dict[str, float]:
        """error_rate, p_plus_s, p_min, s_min, warning_limit, drift_limit (rates), samples."""
        if self.p_min is None or self.s_min is None or not self.samples:
            return {}
        p, s = self.error_rate
        return {
            "error_rate": p,
            "p_plus_s": p + s,
            "p_min": self.p_min,
            "s_min": self.s_min,
            "warning_limit": self.p_min + self.warning_level * self.s_min,
            "drift_limit": self.p_min + self.drift_level * self.s_min,
            "samples": self.samples,
        }
