"""One step of the loop as the report, the live page and the plot show it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from ldt_core.base.experiment import (
    DOUBTFUL,
    FAILED,
    PAUSED,
    Action,
    Adaptation,
    Experiment,
    Level,
    Prediction,
    Signal,
)
from ldt_core.base.model_state import NOT_JUDGED, STATES, shown_state
from ldt_core.base.sentences import spoken
from ldt_core.recording.bag import Bag
from ldt_core.recording.codec import Record
from ldt_core.views.packed_samples import PackedSamples, pack

MARKS = (PAUSED, DOUBTFUL, FAILED)  # details of an adaptation that a summary tells of
UNMARKED: dict[str, float] = {}  # no other is kept: a run has 100,000 adaptations
DIGITS = 6  # of figures that are drawn; a screen shows four

Row = dict[str, Any]

#: What a detector says, for people; on the topics it is `Level.word`.
LEVEL_WORDS = {
    Level.NEGATIVE: "no alarm",
    Level.WARNING: "warning",
    Level.POSITIVE: "alarm",
}
#: What an adaptor does, for people; on the topics it is `Action`.
ACTION_WORDS = {
    Action.KEPT: "no new model needed",
    Action.STORED: "experiment stored to learn from",
    Action.ADAPTED: "new model",
    Action.REFUSED: "no better model",
}

LIMITS = ("warning_limit", "drift_limit")
#: Detector → (its statistic, what that is, unit).
KNOWN = {
    "threshold": ("max_error", "largest error in an experiment", "rad/s"),
    "lddm": ("p_plus_s", "rate of wrong samples, and its deviation", ""),
    "window": ("experiments", "experiments since the last alarm", ""),
    "adequacy": ("adequacy", "error over the noise", ""),
    "river": ("input", "last value fed to river's detector", ""),
}


#: For the pages' scripts: state of machine and model → (words, tone), and the words above.
SCRIPT_WORDS = {
    "states": {s.name: (s.words, s.tone) for s in (*STATES.values(), NOT_JUDGED)},
    "levels": {int(level): words for level, words in LEVEL_WORDS.items()},
    "actions": ACTION_WORDS,
}


@dataclass(slots=True)  # there may be a hundred thousand
class StepView:
    """An experiment and what the twin has made of it so far.

    Attributes:
        experiment: measured; None before it has come, and once its samples are packed.
        original: prediction of the model that never learns.
        original_error: maximum error of `original` [rad/s].
    """

    number: int
    experiment: Experiment | None = None
    prediction: Prediction | None = None
    original: Prediction | None = None
    signal: Signal | None = None
    adaptation: Adaptation | None = None
    original_error: float | None = None
    packed: PackedSamples | None = None

    def samples(self, most: int) -> PackedSamples | None:
        """Thinned to so many; None when nothing was measured."""
        if self.packed is not None or self.experiment is None:
            return self.packed
        prediction, original = (
            p if p is not None and belongs(p, self.experiment) else None
            for p in (self.prediction, self.original)
        )
        return pack(self.experiment, prediction, original, most)

    def settle(self, most: int | None) -> None:
        """Keep the samples thinned to so many, or none at all, and let the whole ones go."""
        self.packed = None if most is None else self.samples(most)
        self.experiment = self.prediction = self.original = None

    def row(self) -> Row:
        """Its figures, in JSON types."""
        signal, done = self.signal, self.adaptation
        return {
            "number": self.number,
            "error": drawn_number(signal.max_error) if signal else None,
            "original": drawn_number(self.original_error),
            "level": int(signal.level) if signal else None,
            "state": shown_state(signal).name if signal else "",
            "noise": drawn_number(signal.adequacy) if signal else None,
            "version": signal.model_version if signal else None,
            "action": str(done.action) if done else "",
            "reason": done.reason if done else "",
        }


class StepCollector:
    """Puts the steps of a run together from records in any order, each with all its samples.

    A step is given once it is whole; what comes of it later is put into it. The adaptation may be
    such a thing, and of what comes twice the last counts.

    Args:
        compared: whether there are predictions of the model that never learns to wait for.
    """

    TOPICS = ("experiment", "prediction", "original_prediction", "signal", "adaptation")

    def __init__(self, compared: bool) -> None:
        self._compared = compared
        self._open: dict[int, StepView] = {}
        self._done: dict[int, StepView] = {}

    def take(self, name: str, record: Record) -> StepView | None:
        """The step that a record of a topic makes whole, if it does."""
        if not isinstance(record, Experiment | Prediction | Signal | Adaptation):
            return None
        number = record.number
        step, done = self._open.get(number), self._done.get(number)
        if isinstance(record, Signal | Adaptation):
            if done is not None and (step is None or step.prediction is None):
                step = done
            elif step is None:
                step = self._open[number] = StepView(number)
            if isinstance(record, Signal):
                step.signal = record
            else:
                marks = {m: record.details[m] for m in MARKS if m in record.details}
                step.adaptation = replace(record, details=marks or UNMARKED)
                return None
        else:
            if step is None:
                step = self._open[number] = StepView(number)
            if isinstance(record, Experiment):
                step.experiment = record
            elif name == "prediction":
                step.prediction = record
            else:
                step.original = record
        if step is done or (self._compared and step.original is None) or not self._whole(step):
            return None
        return self._given(step)

    def rest(self) -> Iterator[StepView]:
        """Those of which the prediction of the model that never learns did not come."""
        for step in list(self._open.values()):
            if self._whole(step):
                yield self._given(step)

    def _whole(self, step: StepView) -> bool:
        experiment, prediction = step.experiment, step.prediction
        if experiment is None or prediction is None or step.signal is None:
            return False
        return belongs(prediction, experiment)

    def _given(self, step: StepView) -> StepView:
        assert step.experiment is not None
        if step.original is not None and not belongs(step.original, step.experiment):
            step.original = None
        if step.original is not None:
            step.original_error = step.original.max_error(step.experiment)
        self._done[step.number] = self._open.pop(step.number)
        return step


def recorded_steps(bag: Bag) -> Iterator[StepView]:
    """Steps of a run that were predicted and judged, one at a time with all samples.

    A step's adaptation may come into it when the next one is there.
    """
    collector = StepCollector(bag.topic("original_prediction") is not None)
    for raw, record in bag.usable(bag.messages(*StepCollector.TOPICS), whole=True):
        step = collector.take(raw.topic.rpartition("/")[2], record)
        if step is not None:
            yield step
    yield from collector.rest()


def belongs(prediction: Prediction, experiment: Experiment) -> bool:
    """Whether it is a prediction of this experiment: a number may come again in another run."""
    return prediction.start == experiment.start and len(prediction) == len(experiment)


def drawn_number(value: float | None) -> float | None:
    """Rounded to what is drawn; None where it is none."""
    if value is None or not math.isfinite(value):
        return None
    return float(f"{value:.{DIGITS}g}")


@dataclass(frozen=True)
class DetectorStatistic:
    """A detector's statistic in every experiment.

    Attributes:
        unit: "" where it has none.
        values: by experiment, None where there is none; so are the limits.
        warning: above which it warns.
        drift: above which it is an alarm.
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
    key, name, unit = KNOWN.get(detector, ("", "", ""))
    own = (n for s in signals for n in s.statistics if n not in LIMITS)
    if not key and (key := next(own, "")):
        name = spoken(key)
    elif not key:
        key, name, unit = KNOWN["threshold"]
    # What is over the noise has no limits: those recorded are of what that is as evidence.
    limits = ("", "") if key == "adequacy" else LIMITS
    columns = [[_finite(_figure(s, column)) for s in signals] for column in (key, *limits)]
    return DetectorStatistic(name, unit, *columns)


def _figure(signal: Signal, name: str) -> float | None:
    own = {"max_error": signal.max_error, "adequacy": signal.adequacy}.get(name)
    return signal.statistics.get(name, own)


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
