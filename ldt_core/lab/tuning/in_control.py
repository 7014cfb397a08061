"""Experiments in control: which they are, how far off a model is, how often an alarm is false."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from ldt_core.base.errors import LdtError, OptionError
from ldt_core.base.experiment import Experiment, Samples, rms
from ldt_core.base.sentences import ranges, spans
from ldt_core.detectors.adequacy import Adequacy
from ldt_core.detectors.base import Detector
from ldt_core.detectors.never import Never
from ldt_core.detectors.threshold import Threshold
from ldt_core.detectors.window import Window
from ldt_core.lab.statistics import CONFIDENCE
from ldt_core.models.base import Model

#: Fewer experiments in control tell nothing of how rare an alarm is.
LEAST_IN_CONTROL = 5
#: The detector that judges which experiments are in control raises a false alarm once in so many:
#: rather too soon, since a stretch with a drift in it would make false alarms look common.
JUDGING_ALARM_EVERY = 50.0
STRETCH_STARTS = 40  # places at which a stretch in control may begin
#: A trend of the error along a stretch that is so improbable by chance is a drift too slow to find.
TREND_PVALUE = 0.05
#: A learned model takes the untrained one's place if its error on experiments that it has not seen
#: is this much lower: 5 % is what the error of some 200 independent samples varies by anyway.
LEARNED_ERROR_SHARE = 0.95

#: Residual of an experiment and the model's own deviation, (L,) each [rad/s].
Row = tuple[Samples, Samples | None]


@dataclass(frozen=True)
class Control:
    """Experiments in control.

    Attributes:
        numbers: of the experiments.
        given: by the user; otherwise judged.
        rows: how far off a fixed model is in each.
        learned: whether that model had learned (each half of the experiments is then predicted by
            a model of the other half); otherwise it is the untrained one.
    """

    numbers: tuple[int, ...]
    given: bool
    rows: tuple[Row, ...]
    learned: bool

    @property
    def text(self) -> str:
        """Which they are, for a person."""
        return ranges(spans(self.numbers))


def parse_ranges(text: str) -> list[tuple[int, int]]:
    """First and last number of each range in "1:20,60:80".

    Raises:
        OptionError: text that is no such list.
    """
    found = []
    for part in filter(None, text.replace(" ", "").split(",")):
        match = re.fullmatch(r"(\d+)(?::(\d+))?", part)
        if not match or int(match[2] or match[1]) < int(match[1]):
            raise OptionError("in-control", "ranges such as 1:20,60:80", repr(text))
        found.append((int(match[1]), int(match[2] or match[1])))
    if text and not found:
        raise OptionError("in-control", "ranges such as 1:20,60:80", repr(text))
    return found


def chosen(ranges: Sequence[tuple[int, int]], numbers: Sequence[int]) -> list[int]:
    """Indices of the experiments whose numbers lie in the ranges.

    Raises:
        OptionError: a range beyond the recording, or too few experiments in them.
    """
    for low, high in ranges:
        if low < numbers[0] or high > numbers[-1]:
            span = f"numbers from {numbers[0]} to {numbers[-1]}, which are recorded"
            raise OptionError("in-control", span, f"{low}:{high}")
    found = [i for i, n in enumerate(numbers) if any(low <= n <= high for low, high in ranges)]
    if len(found) < LEAST_IN_CONTROL:
        raise OptionError("in-control", f"at least {LEAST_IN_CONTROL} experiments", len(found))
    return found


def judged(rows: Sequence[Row]) -> list[int]:
    """Indices of the longest stretch that the untrained model explains.

    A stretch begins with an adequacy detector, ends before its first positive, and is cut
    shorter until the error has no trend along it. Empty when none of `LEAST_IN_CONTROL` is
    accepted, as where the untrained model is far off everywhere.

    Args:
        rows: of all experiments, by the untrained model.
    """
    size = [math.log(max(rms(residual), 1e-300)) for residual, _ in rows]
    best = range(0)
    for begin in range(0, len(rows) - LEAST_IN_CONTROL + 1, max(1, len(rows) // STRETCH_STARTS)):
        if len(rows) - begin <= len(best):
            break
        detector = Adequacy(JUDGING_ALARM_EVERY)
        stop = begin
        while stop < len(rows):
            detector.update(*rows[stop])
            if detector.drift_detected:
                break
            stop += 1
        while stop - begin > max(len(best), LEAST_IN_CONTROL - 1) and _trend(size[begin:stop]):
            stop -= 1
        if stop - begin > max(len(best), LEAST_IN_CONTROL - 1):
            best = range(begin, stop)
    return list(best)


def control(
    experiments: Sequence[Experiment],
    rows: Sequence[Row],
    indices: Sequence[int],
    model: Model,
    given: bool,
) -> Control:
    """The experiments in control, and how far off a model that knows this machine is in them.

    The untrained model, or, where that is clearly better, models of half of these experiments, each
    on the other half.

    Args:
        experiments: all of them.
        rows: of all of them, by the untrained model.
        indices: of those in control.
        model: untrained.
        given: by the user.
    """
    inside = [experiments[i] for i in indices]
    untrained = [rows[i] for i in indices]
    numbers = tuple(e.number for e in inside)
    crossed = _crossed(inside, model) if model.adaptive else None
    if crossed and _error(crossed) < LEARNED_ERROR_SHARE * _error(untrained):
        return Control(numbers, given, tuple(crossed), True)
    return Control(numbers, given, tuple(untrained), False)


def row(model: Model, experiment: Experiment) -> Row:
    """How far off a model is in an experiment."""
    prediction = model.predict(experiment)
    return prediction.residual(experiment), prediction.speed_std


def _crossed(inside: Sequence[Experiment], model: Model) -> list[Row] | None:
    """Each half by a model of the other; None when none can be trained."""
    halves = [list(inside[0::2]), list(inside[1::2])]
    try:
        models = [model.fit(half) for half in reversed(halves)]
        return [row(models[i % 2], e) for i, e in enumerate(inside)]
    except (LdtError, ArithmeticError, np.linalg.LinAlgError):
        return None


def _error(rows: Sequence[Row]) -> float:
    return math.sqrt(float(np.mean([rms(residual) ** 2 for residual, _ in rows])))


def _trend(values: Sequence[float]) -> bool:
    return (
        len(set(values)) > 1 and stats.kendalltau(range(len(values)), values).pvalue < TREND_PVALUE
    )


#: Streams, each from another set of experiments that the machine might have made, and their length.
STREAMS, LENGTH = 40, 100
STREAM = (0, 5)  # of random numbers: the same for every detector, apart from the plant's
#: The largest error of an experiment scatters at least so much, relative to itself: a few
#: experiments whose largest errors agree better do so by chance.
LEAST_SCATTER = 0.01
#: The upper tail is a law's this share. It is doubted as if so many values in it had been seen: few
#: experiments in control have no more.
TAIL, TAIL_SEEN = 0.1, 10.0


@dataclass(frozen=True)
class FalseAlarms:
    """Alarms per experiment in control.

    Attributes:
        rate: over the streams.
        low: end of the 95 % interval.
        high: end of the 95 % interval.
        law: the rate by what is known of the detector, or extrapolated, where so few experiments
            cannot show it; None without such a law.
    """

    rate: float
    low: float
    high: float
    law: float | None

    def keep(self, every: float) -> bool:
        """Whether there is at most one alarm in so many experiments.

        By the interval if that shows it; otherwise by the law, if the streams had no more either.
        """
        if self.high * every <= 1:
            return True
        return self.law is not None and max(self.law, self.rate) * every <= 1 + 1e-9


def false_alarm_rate(detector: Detector, rows: Sequence[Row]) -> FalseAlarms:
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
    law = _law(detector, rows)
    if isinstance(detector, Window | Never):  # by the calendar: nothing to estimate
        assert law is not None
        return FalseAlarms(law, law, law, law)
    rng = np.random.default_rng(np.random.SeedSequence(list(STREAM)))
    rates = []
    for _ in range(STREAMS):
        there = rng.integers(len(rows), size=len(rows))
        fresh, alarms = detector.clone(), 0
        for index in there[rng.integers(len(rows), size=LENGTH)]:
            fresh.update(*rows[index])
            if fresh.drift_detected:
                alarms += 1
                fresh.answered(False)  # nothing has changed, so there is nothing to learn
        rates.append(alarms / LENGTH)
    rate = float(np.mean(rates))
    tail = (1 - CONFIDENCE) / 2
    low, high = (float(q) for q in np.quantile(rates, [tail, 1 - tail]))
    return FalseAlarms(rate, low, max(high, most(rate, len(rows))), law)


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


def limit_of(rows: Sequence[Row], every: float) -> float:
    """The limit that the largest error of the next experiment exceeds once in so many [rad/s]."""
    mean, spread, freedom = _law_of_largest(rows)
    chance = 1 / every
    if chance < TAIL:  # the inverse of `_doubted`
        chance = TAIL * math.exp(-TAIL_SEEN * ((chance / TAIL) ** (-1 / TAIL_SEEN) - 1))
    return math.exp(mean + spread * float(stats.t.isf(chance, freedom)))


def _law(detector: Detector, rows: Sequence[Row]) -> float | None:
    if isinstance(detector, Never):
        return 0.0
    if isinstance(detector, Window):
        return 1 / detector.window
    if isinstance(detector, Adequacy):
        return 1 / detector.false_alarm_every
    if isinstance(detector, Threshold) and detector.threshold > 0 and len(rows) > 1:
        mean, spread, freedom = _law_of_largest(rows)
        chance = stats.t.sf((math.log(detector.threshold) - mean) / spread, freedom)
        return _doubted(float(chance))
    return None


def _doubted(chance: float) -> float:
    """The chance of a number in the upper tail, where the law of the tail is not known.

    log(TAIL / chance) is exponential with mean 1 if the law is right. With the doubt about that
    mean it has a generalised Pareto law (Siffer et al., "Anomaly detection in streams with extreme
    value theory", KDD 2017).
    """
    if chance >= TAIL:
        return chance
    far = math.log(TAIL / max(chance, 1e-300))
    return float(TAIL * (1 + far / TAIL_SEEN) ** -TAIL_SEEN)


def _law_of_largest(rows: Sequence[Row]) -> tuple[float, float, int]:
    """Mean, spread and degrees of freedom of the law of the next logarithm of a largest error.

    If the logarithms are normal, of unknown mean and variance, the next one minus their mean, over
    their deviation times sqrt(1 + 1/n), has Student's law with n - 1 degrees of freedom.
    """
    logs = [math.log(max(float(np.abs(residual).max()), 1e-300)) for residual, _ in rows]
    deviation = max(float(np.std(logs, ddof=1)), LEAST_SCATTER)
    return float(np.mean(logs)), deviation * math.sqrt(1 + 1 / len(logs)), len(logs) - 1
