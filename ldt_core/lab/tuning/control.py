"""Experiments in control: which they are, and how far off a fixed model is in each of them."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from ldt_core.base.errors import LdtError, OptionError
from ldt_core.base.experiment import Experiment, Samples, rms
from ldt_core.detectors.calibrated import Calibrated
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
        return ranges_of(self.numbers)


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
    """Indices of the longest stretch that the calibrated detector accepts as unchanged.

    A stretch begins with a detector that knows nothing, ends before its first positive, and is cut
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
        detector = Calibrated(JUDGING_ALARM_EVERY)
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


def ranges_of(numbers: Sequence[int]) -> str:
    """Numbers in words.

    >>> ranges_of([1, 2, 3, 7])
    '1 to 3, 7'
    """
    runs: list[list[int]] = []
    for n in numbers:
        if runs and n == runs[-1][1] + 1:
            runs[-1][1] = n
        else:
            runs.append([n, n])
    return ", ".join(f"{a} to {b}" if b > a else f"{a}" for a, b in runs)


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
