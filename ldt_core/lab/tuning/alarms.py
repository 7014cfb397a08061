"""How often a detector raises an alarm while nothing changes, from experiments in control."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.special import ndtr

from ldt_core.detectors.base import Detector
from ldt_core.detectors.calibrated import Calibrated
from ldt_core.detectors.never import Never
from ldt_core.detectors.reference import Reference
from ldt_core.detectors.threshold import Threshold
from ldt_core.detectors.window import Window
from ldt_core.lab.tuning.control import Row

CONFIDENCE = 0.95
#: Streams, each from another set of experiments that the machine might have made, and their length.
STREAMS, LENGTH = 40, 100
STREAM = (0, 5)  # of random numbers: the same for every detector, apart from the plant's
#: The largest error of an experiment scatters at least so much, relative to itself: a few
#: experiments whose largest errors agree better do so by chance.
LEAST_SCATTER = 0.01


@dataclass(frozen=True)
class FalseAlarms:
    """Alarms per experiment in control.

    Attributes:
        rate: over the streams.
        low: end of the 95 % interval.
        high: end of the 95 % interval.
        law: the rate by what is known of the detector, or extrapolated, where so few experiments
            cannot show it; None without such a law.
        how: where the law comes from, for a person.
    """

    rate: float
    low: float
    high: float
    law: float | None
    how: str

    def keep(self, every: float) -> bool:
        """Whether there is at most one alarm in so many experiments.

        By the interval if that shows it; otherwise by the law, if the streams had no more either.
        """
        if self.shown(every):
            return True
        return self.law is not None and max(self.law, self.rate) * every <= 1 + 1e-9

    def shown(self, every: float) -> bool:
        """Whether the experiments in control themselves show that, without a law."""
        return self.high * every <= 1


def false_alarms(detector: Detector, rows: Sequence[Row]) -> FalseAlarms:
    """The false-alarm rate of a detector.

    Streams are drawn with replacement from whole experiments, so that what hangs together within
    one stays together; the experiments themselves are taken to be independent. Each stream comes
    from a set of experiments that was drawn anew, which is what the interval accounts for. Since
    drawing shows nothing that these experiments have not shown, the upper end is at least that of a
    rate counted on so many (Clopper and Pearson; without an alarm, one-sided).

    Args:
        detector: as set; its state is not used.
        rows: of the experiments in control, by a fixed model.
    """
    law, how = _law(detector, rows)
    if isinstance(detector, Window | Never):  # by the calendar: nothing to estimate
        assert law is not None
        return FalseAlarms(law, law, law, law, how)
    rng = np.random.default_rng(np.random.SeedSequence(list(STREAM)))
    rates = []
    for _ in range(STREAMS):
        there = rng.integers(len(rows), size=len(rows))
        fresh, alarms = detector.clone(), 0
        for index in there[rng.integers(len(rows), size=LENGTH)]:
            fresh.update(*rows[index])
            alarms += fresh.drift_detected
        rates.append(alarms / LENGTH)
    rate = float(np.mean(rates))
    tail = (1 - CONFIDENCE) / 2
    low, high = (float(q) for q in np.quantile(rates, [tail, 1 - tail]))
    return FalseAlarms(rate, low, max(high, most(rate, len(rows))), law, how)


def most(rate: float, experiments: int) -> float:
    """Upper end of the 95 % interval of a rate counted on so many experiments.

    >>> round(1 / most(0.0, 20), 1)
    7.2
    """
    if rate <= 0:
        return 1 - (1 - CONFIDENCE) ** (1 / experiments)
    if rate >= 1:
        return 1.0
    alarms = rate * experiments
    return float(stats.beta.isf((1 - CONFIDENCE) / 2, alarms + 1, experiments - alarms))


def needed(every: float) -> int:
    """Experiments in control without an alarm that show a rate of one in so many.

    >>> needed(1000)
    2995
    """
    return math.ceil(math.log(1 - CONFIDENCE) / math.log1p(-1 / every) - 1e-9)


def limit_of(rows: Sequence[Row], every: float) -> float:
    """The limit that the largest error of the next experiment exceeds once in so many [rad/s]."""
    law = _law_of_largest(rows)
    unusual = -float(stats.norm.ppf(1 / every))
    return math.exp(law.quantile(unusual, LEAST_SCATTER))


def _law(detector: Detector, rows: Sequence[Row]) -> tuple[float | None, str]:
    if isinstance(detector, Never):
        return 0.0, "by the calendar"
    if isinstance(detector, Window):
        return 1 / detector.window, "by the calendar"
    if isinstance(detector, Calibrated):
        return 1 / detector.false_alarm_every, "by the law that the detector learns for itself"
    if isinstance(detector, Threshold) and detector.threshold > 0:
        law = _law_of_largest(rows)
        if law.known:
            unusual = law.unusual(math.log(detector.threshold), LEAST_SCATTER)
            return float(ndtr(-unusual)), "by a law fitted to their largest errors"
    return None, ""


def _law_of_largest(rows: Sequence[Row]) -> Reference:
    law = Reference()
    for residual, _ in rows:
        largest = float(np.abs(residual).max())
        law.take(math.log(max(largest, 1e-300)), LEAST_SCATTER)
    return law
