"""The records that travel between the four parts of the twin.

All are frozen and check themselves when they are made, so that nothing behind the door checks
again. Arrays are float64, one-dimensional, and read-only.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ldt_core.base.arrays import real_numbers
from ldt_core.base.errors import ExperimentError, described

Samples = NDArray[np.float64]
Scalar = float | int | str | bool | None

#: Before EFFECT.PARAMETER, in the values of a diagnosis.
AMOUNT_PREFIX = "amount."
#: Relative difference of two sample periods that is rounding, of clocks and of text files.
PERIOD_TOLERANCE = 1e-6


def _samples(where: str, values: ArrayLike, length: int | None = None) -> Samples:
    try:
        array = real_numbers(values)
    except (TypeError, ValueError):
        raise ExperimentError(where, "a row of numbers", described(values)) from None
    if array.ndim != 1 or array.size == 0:
        raise ExperimentError(where, "a non-empty row of samples", f"shape {array.shape}")
    if length is not None and array.size != length:
        raise ExperimentError(where, f"{length} samples", f"{array.size}")
    if not np.isfinite(array).all():
        bad = np.flatnonzero(~np.isfinite(array))
        raise ExperimentError(
            where, "finite samples", f"{array[bad[0]]} at sample {bad[0]} ({bad.size} in all)"
        )
    array.setflags(write=False)
    return array


def _number(where: str, value: Any, least: int) -> int:
    number = _real(value)
    if not (number.is_integer() and least <= number < 2**53):  # beyond, float64 is not exact
        raise ExperimentError(where, f"a whole number from {least} below 2^53", described(value))
    return int(value)


def _real(value: Any) -> float:
    """As a number, not finite where it is none."""
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        return math.nan


def _time(where: str, start: Any, period: Any) -> tuple[float, float]:
    begin, step = _real(start), _real(period)
    if not math.isfinite(begin):
        raise ExperimentError(f"{where}, start time", "seconds since the epoch", described(start))
    if not (math.isfinite(step) and step > 0):
        raise ExperimentError(f"{where}, sample period", "seconds above 0", described(period))
    return begin, step


def rms(samples: Samples) -> float:
    """Root mean square of (L,) samples, in their unit."""
    return float(np.sqrt(np.mean(samples**2)))


@dataclass(frozen=True, eq=False)
class Experiment:
    """One finished experiment, measured.

    Args:
        number: from 1.
        start: time of the first sample [s since the epoch].
        period: sample period [s].
        voltage: (L,) [V], each held from its sample to the next.
        speed: (L,) [rad/s].
        current: (L,) [A], or None when the recording has none.

    Raises:
        ExperimentError: for empty, unequal, or non-finite samples.
    """

    number: int
    start: float
    period: float
    voltage: Samples
    speed: Samples
    current: Samples | None = None

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "number", _number("experiment number", self.number, 1))
        where = f"experiment {self.number}"
        start, period = _time(where, self.start, self.period)
        put(self, "start", start)
        put(self, "period", period)
        put(self, "voltage", _samples(f"{where}, voltage", self.voltage))
        put(self, "speed", _samples(f"{where}, speed", self.speed, self.voltage.size))
        if self.current is not None:
            put(self, "current", _samples(f"{where}, current", self.current, self.voltage.size))

    def __len__(self) -> int:
        return self.voltage.size

    def __repr__(self) -> str:
        length = f"{len(self)} samples at {self.period:g} s, {self.duration:g} s"
        return f"Experiment({self.number}, {length})"

    @property
    def time(self) -> Samples:
        """(L,) time since the first sample [s]."""
        return np.asarray(np.arange(len(self)) * self.period, dtype=np.float64)

    @property
    def duration(self) -> float:
        """L sample periods [s]: the last voltage is held for one period as well."""
        return len(self) * self.period

    @property
    def end(self) -> float:
        """When the experiment was finished [s since the epoch]."""
        return self.start + self.duration

    def same_period(self, other: Experiment) -> bool:
        """Whether the two were sampled alike."""
        return math.isclose(self.period, other.period, rel_tol=PERIOD_TOLERANCE)

    def part(self, begin: int, stop: int) -> Experiment:
        """An experiment of the same number with the samples from `begin` up to `stop`."""
        cut = slice(begin, stop)
        return Experiment(
            self.number,
            self.start + begin * self.period,
            self.period,
            self.voltage[cut],
            self.speed[cut],
            None if self.current is None else self.current[cut],
        )


@dataclass(frozen=True, eq=False)
class Prediction:
    """A model's free run of one experiment.

    Args:
        number: of the experiment.
        start: as in the experiment [s since the epoch].
        period: sample period [s].
        model_version: of the model that predicted.
        speed: (L,) [rad/s].
        speed_std: (L,) predictive standard deviation [rad/s], or None.
    """

    number: int
    start: float
    period: float
    model_version: int
    speed: Samples
    speed_std: Samples | None = None

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "number", _number("prediction number", self.number, 1))
        where = f"prediction {self.number}"
        start, period = _time(where, self.start, self.period)
        put(self, "start", start)
        put(self, "period", period)
        put(self, "model_version", _number(f"{where}, model version", self.model_version, 0))
        put(self, "speed", _samples(f"{where}, speed", self.speed))
        if self.speed_std is not None:
            std = _samples(f"{where}, speed_std", self.speed_std, self.speed.size)
            if std.min() < 0:
                raise ExperimentError(f"{where}, speed_std", "0 or more", std.min())
            put(self, "speed_std", std)

    def __len__(self) -> int:
        return self.speed.size

    def __repr__(self) -> str:
        return f"Prediction({self.number}, {len(self)} samples, model {self.model_version})"

    @property
    def experiment(self) -> int:
        """Number of the experiment."""
        return self.number

    def residual(self, experiment: Experiment) -> Samples:
        """(L,) measured minus predicted speed [rad/s].

        Raises:
            ExperimentError: when the two do not belong together.
        """
        if (self.number, len(self)) != (experiment.number, len(experiment)):
            wanted = f"experiment {experiment.number} with {len(experiment)} samples"
            raise ExperimentError(f"prediction {self.number}", wanted, f"{len(self)} samples")
        return experiment.speed - self.speed

    def max_error(self, experiment: Experiment) -> float:
        """max_k |y_k - ŷ_k| [rad/s], the paper's f_m."""
        return float(np.abs(self.residual(experiment)).max())


class Level(enum.IntEnum):
    """The detector's answer D(S_p, S_m, θ) of the paper."""

    NEGATIVE = -1
    WARNING = 0
    POSITIVE = 1

    @property
    def word(self) -> str:
        """The answer in a word, as the `signal` topic has it."""
        return self.name.lower()


#: In an adaptation's details: nothing was to be learned; the machine file rules the speed out.
#: The detector (a signal's statistics have it too, and a lack of memory) or the adaptor failed.
PAUSED, DOUBTFUL, FAILED, NO_MEMORY = "paused", "doubtful_sensor", "failed", "out_of_memory"
#: In an adaptation's details: the sensor's fault, and nothing was learned.
FAULTY = "faulty_sensor"


class Action(enum.StrEnum):
    """What the adaptor did with an experiment."""

    KEPT = "kept"
    STORED = "stored"
    ADAPTED = "adapted"
    REFUSED = "refused"


class _AboutExperiment:
    experiment: int

    @property
    def number(self) -> int:
        """Of the experiment."""
        return self.experiment


@dataclass(frozen=True)
class Signal(_AboutExperiment):
    """The detector's answer to one experiment.

    Args:
        experiment: its number.
        level: positive, warning or negative.
        detector: name of the detector.
        model_version: of the model whose prediction was judged.
        max_error: max_k |y_k - ŷ_k| [rad/s].
        statistics: what the detector compared (its statistic and its limits), by name.
        state: what is known of the machine and the model: learning, holds, changed, new_range or
            inadequate; "" in older recordings.
        adequacy: root mean square residual over the noise's; None while unknown.
    """

    experiment: int
    level: Level
    detector: str
    model_version: int
    max_error: float
    statistics: Mapping[str, float] = field(default_factory=dict)
    state: str = ""
    adequacy: float | None = None

    def __repr__(self) -> str:
        error = f"max error {self.max_error:.4g} rad/s"
        return f"Signal({self.number}, {self.level.word}, {error}, {self.detector})"


@dataclass(frozen=True)
class ModelRecord:
    """A model as it is sent and stored: plain JSON values, never code.

    Args:
        version: 0 for the model that nobody has trained, then counting.
        kind: name in the model registry.
        trained_on: numbers of the experiments it learned from.
        parameters: all that makes the model, in JSON types.
    """

    version: int
    kind: str
    trained_on: tuple[int, ...]
    parameters: Mapping[str, Any]


@dataclass(frozen=True)
class Adaptation(_AboutExperiment):
    """What the adaptor did with one experiment, and with which model the twin goes on.

    Args:
        experiment: its number.
        action: kept, stored, adapted or refused.
        model_version: of the model that predicts the next experiment.
        reason: a sentence for a person.
        details: figures that explain the reason (held-out errors, size of S_w, …), by name.
    """

    experiment: int
    action: Action
    model_version: int
    reason: str
    details: Mapping[str, float] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"Adaptation({self.number}, {self.action}, model {self.model_version})"


@dataclass(frozen=True)
class DiagnosisRecord(_AboutExperiment):
    """The verdict of a gap diagnosis.

    Args:
        experiment: number of the one from which on it takes part; `asked_at` in the values asked.
        model_version: of the model whose prediction was judged.
        sentence: for a person.
        effects: that the verdict names.
        values: the scalars of `diagnosis.json`, `verdict.kind` for one; None where undefined.
    """

    experiment: int
    model_version: int
    sentence: str
    effects: tuple[str, ...]
    values: Mapping[str, Scalar]

    @property
    def kind(self) -> str:
        """Of the verdict: none, effect, ambiguous or unknown."""
        return str(self.values["verdict.kind"])

    @property
    def cause(self) -> str | None:
        """The effect that explains most of the gap; None where none is named."""
        cause = self.values.get("cause")
        return cause if isinstance(cause, str) else None

    @property
    def amounts(self) -> dict[str, dict[str, float]]:
        """Effect → its parameters, of all that the verdict's free run has."""
        found: dict[str, dict[str, float]] = {}
        for key, value in self.values.items():
            effect, dot, parameter = key.removeprefix(AMOUNT_PREFIX).rpartition(".")
            if not (key.startswith(AMOUNT_PREFIX) and dot):
                continue
            if isinstance(value, int | float) and not isinstance(value, bool):
                found.setdefault(effect, {})[parameter] = float(value)
        return found


@dataclass(frozen=True)
class AdviceRecord(_AboutExperiment):
    """What the people at the machine are advised; never a command.

    Args:
        experiment: number of the last one that it is about, 0 if it is about none.
        model_version: of the model that predicts.
        warning: whether the machine is where it had better not be, or near.
        sentence: for a person.
        values: what it rests on, by dotted name; lists as JSON; None where undefined.
    """

    experiment: int
    model_version: int
    warning: bool
    sentence: str
    values: Mapping[str, Scalar] = field(default_factory=dict)


@dataclass(frozen=True)
class Step:
    """All that one turn of the loop produced for one experiment."""

    experiment: Experiment
    prediction: Prediction
    original: Prediction
    signal: Signal
    adaptation: Adaptation
    model: ModelRecord | None = None
    diagnosis: DiagnosisRecord | None = None
    advice: AdviceRecord | None = None

    def __repr__(self) -> str:
        return f"Step({self.number}, {self.signal.level.word}, {self.adaptation.action})"

    @property
    def number(self) -> int:
        """Of the experiment."""
        return self.experiment.number
