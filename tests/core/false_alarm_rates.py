"""How often a detector is positive while nothing has changed, against what it states.

    from false_alarm_rates import KINDS, count
    rate = count("calibrated", KINDS["AR(0.9)"], every=1000)
    print(rate.observed, rate.interval, rate.stated)

A stream here is a row of experiments in control: residuals that are alike in law from experiment to
experiment, however they hang together inside one. A positive is a false alarm. It changes nothing
(there is no model that could be trained), so the next experiment is in control as well.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.stats import chi2

from ldt_core.base.experiment import Samples
from ldt_core.base.settings import resolve
from ldt_core.detectors import build_detector
from ldt_core.effects import parse_effect
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import Machine
from ldt_core.models.physics import PhysicsModel

STREAMS, EXPERIMENTS, SAMPLES = 200, 200, 500
EARLY = 20  # experiments: a detector that learns knows little then
CONFIDENCE = 0.95

#: (random, experiments, samples) → residuals (experiments, samples) and deviations, or None.
Kind = Callable[
    [np.random.Generator, int, int], tuple[NDArray[np.float64], NDArray[np.float64] | None]
]


@dataclass(frozen=True)
class Rate:
    """Alarms counted in streams without a drift.

    Attributes:
        stated: alarms per experiment that the detector promises.
        experiments: of each stream.
        alarms: in each stream.
        early: in the first `EARLY` experiments of each stream.
        warnings: in each stream.
    """

    stated: float
    experiments: int
    alarms: tuple[int, ...]
    early: tuple[int, ...]
    warnings: tuple[int, ...]

    @property
    def observed(self) -> float:
        """Alarms per experiment."""
        return sum(self.alarms) / (len(self.alarms) * self.experiments)

    @property
    def observed_warnings(self) -> float:
        """Warnings per experiment."""
        return sum(self.warnings) / (len(self.warnings) * self.experiments)

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the alarms per experiment.

        Exact for a Poisson law (Garwood 1936), and widened by the dispersion of the counts between
        streams where that is above 1, since alarms of a stream may come in flocks.
        """
        counts = np.asarray(self.alarms, dtype=float)
        total, spread = counts.sum(), 1.0
        if total and counts.size > 1:
            spread = max(1.0, counts.var(ddof=1) / counts.mean())
        tail = (1 - CONFIDENCE) / 2
        low = chi2.ppf(tail, 2 * total / spread) / 2 if total else 0.0
        high = chi2.ppf(1 - tail, 2 * total / spread + 2) / 2
        experiments = counts.size * self.experiments / spread
        return float(low / experiments), float(high / experiments)

    @property
    def keeps_its_word(self) -> bool:
        """Whether the interval holds the stated rate."""
        low, high = self.interval
        return low <= self.stated <= high


def count(
    detector: str,
    kind: Kind,
    every: float,
    settings: Mapping[str, Any] | None = None,
    *,
    streams: int = STREAMS,
    experiments: int = EXPERIMENTS,
    samples: int = SAMPLES,
    seed: int = 0,
    jobs: int = 1,
) -> Rate:
    """Count the alarms of a detector in streams without a drift.

    Args:
        detector: its name.
        kind: of residuals, one of `KINDS`, or `RowsAgain` of a machine's own.
        every: experiments for each false alarm, as stated; the detector `calibrated` is told.
        settings: of the detector (`parameters.yaml`).
        streams: to average over.
        experiments: of each stream.
        samples: of each experiment, where the kind makes them.
        seed: stream k of the same seed is the same for all detectors.
        jobs: processes.

    Raises:
        OptionError: a detector that cannot be built.
    """
    resolved = resolve({**(settings or {}), "false_alarm_every": float(every)}, "detector")
    work = (
        delayed(_one)(detector, resolved, kind, [seed, k], experiments, samples)
        for k in range(streams)
    )
    alarms, early, warnings = zip(*Parallel(n_jobs=jobs)(work), strict=True)
    return Rate(1 / every, experiments, alarms, early, warnings)


def _one(
    name: str,
    settings: Mapping[str, Any],
    kind: Kind,
    seed: Sequence[int],
    experiments: int,
    samples: int,
) -> tuple[int, int, int]:
    detector = build_detector(name, settings)
    rows, deviations = kind(np.random.default_rng(seed), experiments, samples)
    alarms = early = warnings = 0
    for i, row in enumerate(rows):
        detector.update(row, None if deviations is None else deviations[i])
        alarms += detector.drift_detected
        early += detector.drift_detected and i < EARLY
        warnings += detector.warning_detected
    return alarms, early, warnings


class Noise:
    """Normal residuals of deviation 1, of an experiment's own scale, with memory inside it.

    Args:
        memory: correlation of neighbouring samples.
        scale: (random, n) → the scale of each experiment; None for 1. The model's deviation stays
            1 then, so that the scale is nothing that the yardstick knows.
    """

    def __init__(
        self,
        memory: float = 0.0,
        scale: Callable[[np.random.Generator, int], Samples] | None = None,
    ) -> None:
        self.memory, self.scale = memory, scale

    def __call__(
        self, random: np.random.Generator, experiments: int, samples: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
        """Residuals and deviations of a stream."""
        rows = random.standard_normal((experiments, samples))
        rows[:, 1:] *= math.sqrt(1 - self.memory**2)  # the first sample is as wide as all others
        rows = lfilter([1.0], [1.0, -self.memory], rows, axis=1)
        if self.scale is None:
            return rows, None
        return rows * self.scale(random, experiments)[:, None], np.ones_like(rows)


class RowsAgain:
    """Streams drawn with replacement from residuals that a machine has really had.

    Args:
        rows: (n, L) residuals of n experiments in control [rad/s].
    """

    def __init__(self, rows: NDArray[np.float64]) -> None:
        self.rows = rows

    def __call__(
        self, random: np.random.Generator, experiments: int, samples: int
    ) -> tuple[NDArray[np.float64], None]:
        """Residuals of a stream; each experiment has the samples that it had."""
        return self.rows[random.integers(0, len(self.rows), experiments)], None


def machine_rows(
    machine: Machine, effect: str, experiments: int = 400, seed: int = 7
) -> NDArray[np.float64]:
    """(experiments, L) residuals [rad/s] of the machine file's physics against a machine unworn.

    Args:
        machine: as the twin knows it.
        effect: that acts in every experiment all the same, NAME[:param=value,...]; "" for none.
        experiments: to simulate.
        seed: of the plant.
    """
    effects = [parse_effect(effect)] if effect else []
    plant = Plant(machine, experiments=experiments, seed=seed, degradation="none", effects=effects)
    model = PhysicsModel(machine)
    numbers = range(1, experiments + 1)
    measured = (plant.experiment(number) for number in numbers)
    return np.array([model.predict(e).residual(e) for e in measured])


#: Kinds of residuals in control that need no machine.
KINDS: dict[str, Kind] = {
    "white": Noise(),
    "AR(0.9)": Noise(0.9),
    "AR(0.99)": Noise(0.99),
    "scale lognormal 0.5": Noise(0.9, lambda random, n: np.exp(0.5 * random.standard_normal(n))),
    "scale lognormal 1": Noise(0.9, lambda random, n: np.exp(random.standard_normal(n))),
    "scale gamma 2": Noise(0.9, lambda random, n: random.gamma(2.0, 0.5, n)),
    "scale Student 3": Noise(0.9, lambda random, n: np.exp(0.3 * random.standard_t(3, n))),
}
