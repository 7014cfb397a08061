"""How often the default detector errs where nothing changes, and how late it is where it does.

*False alarms.* Residuals of a machine in control, of many laws. After a positive no new model comes
into force, as in the loop where learning does not help. A *first* positive is that of a detector
that has seen none: the guarantee is about these, and the detector starts anew behind each. What
follows in a row of experiments without a new start is counted beside.

*Delay.* White noise of deviation 1, and from one experiment on a wave of a stated energy in it. No
detector whose mean time to a false alarm is A has a mean delay below log(A) / KL (Lorden,
"Procedures for reacting to a change in distribution", Annals of Mathematical Statistics 42, 1971),
for large A, KL being the divergence of an experiment after the change from one before. With s^2 the
wave's energy over the noise's it is L s^2 / 2 where the wave is known, as CUSUM is told. Who sees
the ratio of energy to roughness alone has a normal number of mean sqrt(L) s^2: L s^4 / 2.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.signal import lfilter

from ldt_core.base.arrays import Array
from ldt_core.base.experiment import rms
from ldt_core.base.settings import resolve
from ldt_core.detectors import build_detector
from ldt_core.detectors.base import Detector

Rows = Array
#: Samples of an experiment, and experiments of a stream.
SAMPLES, EXPERIMENTS = 500, 5000
#: Experiments of the row that goes on behind its positives.
IN_A_ROW = 300
#: Experiments to a false alarm, as asked for.
EVERY = 1000.0
#: Experiments of a season of the excitation, in which the noise goes up and down by a half.
SEASON, SWING = 50, 0.5
#: Part of the experiments that are louder, and by how much: a supply or a machine next to it.
RARE, LOUD = 0.05, 5.0
#: Standard deviation of the logarithm of an experiment's scale: a factor of two either way is 95 %.
LOG_SCALE = 0.35
#: Deviations of the noise that a step of a coarse sensor has.
STEP = 1.0
#: Experiments in control before the change, and after it at most.
BEFORE, AFTER = 20, 300
#: Changes that a task makes.
CHANGES = 20
#: Energy of the wave over that of the noise.
SIZES = (0.02, 0.05, 0.1, 0.2, 0.25, 0.3, 0.4, 0.5, 1.0, 2.0)
PERIODS = 3  # of the wave in an experiment


def _coloured(memory: float) -> Callable[[np.random.Generator, int], Rows]:
    def rows(random: np.random.Generator, count: int) -> Rows:
        white = random.standard_normal((count, SAMPLES))
        white[:, 1:] *= math.sqrt(1 - memory**2)  # the first sample is as wide as all others
        return np.asarray(lfilter([1.0], [1.0, -memory], white, axis=1), dtype=np.float64)

    return rows


def _white(random: np.random.Generator, count: int) -> Rows:
    return random.standard_normal((count, SAMPLES))


def _student(random: np.random.Generator, count: int) -> Rows:
    return random.standard_t(3, (count, SAMPLES))


def _scaled(random: np.random.Generator, count: int) -> Rows:
    scale = np.exp(LOG_SCALE * random.standard_normal(count))
    return scale[:, None] * _white(random, count)


def _rarely_loud(random: np.random.Generator, count: int) -> Rows:
    scale = np.where(random.random(count) < RARE, LOUD, 1.0)
    return scale[:, None] * _white(random, count)


def _seasonal(random: np.random.Generator, count: int) -> Rows:
    scale = 1 + SWING * np.sin(2 * np.pi * np.arange(count) / SEASON)
    return scale[:, None] * _white(random, count)


def _quantised(random: np.random.Generator, count: int) -> Rows:
    return np.asarray(np.round(_white(random, count) / STEP) * STEP, dtype=np.float64)


#: Law of the residuals in control → (random, experiments) → (experiments, SAMPLES).
LAWS_IN_CONTROL: dict[str, Callable[[np.random.Generator, int], Rows]] = {
    "white": _white,
    "AR 0.9": _coloured(0.9),
    "AR 0.99": _coloured(0.99),
    "Student 3": _student,
    "lognormal scale": _scaled,
    "rarely loud": _rarely_loud,
    "season in the excitation": _seasonal,
    "quantised": _quantised,
}


@dataclass(frozen=True)
class AlarmTask:
    """What to count: false alarms under a law, or delays at a size of change (`law` is "")."""

    seed: int
    law: str = ""
    size: float = 0.0

    @property
    def key(self) -> str:
        """Name of the result."""
        what = self.law.replace(" ", "-") if self.law else f"delay-{self.size:g}"
        return f"{what}_{self.seed}"


#: Numbers that are counted, and lists.
COUNTS, DELAYS = ("experiments", "first", "in_a_row", "positives"), ("delays", "cusum")


@dataclass(frozen=True)
class AlarmCount:
    """What was counted.

    Attributes:
        task: of it.
        experiments: in control, of detectors that started anew behind each positive.
        first: their positives.
        in_a_row: experiments of one detector that went on.
        positives: its positives.
        delays: experiments from the change to the positive, 1 being the change's own; AFTER + 1
            where none came.
        cusum: the same of CUSUM, which knows the wave.
    """

    task: AlarmTask
    experiments: int = 0
    first: int = 0
    in_a_row: int = 0
    positives: int = 0
    delays: tuple[int, ...] = ()
    cusum: tuple[int, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, task: AlarmTask, plain: Mapping[str, Any]) -> AlarmCount:
        """The count of a task that `to_dict` gave.

        Raises:
            ValueError, KeyError, TypeError: it did not.
        """
        if dict(plain["task"]) != asdict(task):
            raise ValueError("another task's count")
        told: dict[str, Any] = {name: int(plain[name]) for name in COUNTS}
        told |= {name: tuple(map(int, plain[name])) for name in DELAYS}
        return cls(task, **told)


def over_seeds(counts: Sequence[AlarmCount]) -> list[AlarmCount]:
    """The sums over all seeds: one for each law, then one for each size, as far as counted."""
    found = []
    for task in alarm_tasks(range(1)):
        own = [c for c in counts if (c.task.law, c.task.size) == (task.law, task.size)]
        if own:
            told: dict[str, Any] = {name: sum(getattr(c, name) for c in own) for name in COUNTS}
            told |= {name: tuple(d for c in own for d in getattr(c, name)) for name in DELAYS}
            found.append(AlarmCount(task, **told))
    return found


def alarm_tasks(seeds: range) -> list[AlarmTask]:
    """Every law and size, for each seed."""
    laws = [AlarmTask(seed, law=law) for seed in seeds for law in LAWS_IN_CONTROL]
    return laws + [AlarmTask(seed, size=size) for seed in seeds for size in SIZES]


def count_alarms(task: AlarmTask) -> AlarmCount:
    """Do one task."""
    if not task.law:
        return _delays(task)
    random = np.random.default_rng([task.seed, *task.law.encode()])
    make = LAWS_IN_CONTROL[task.law]
    first, detector = 0, _fresh()
    for row in make(random, EXPERIMENTS):
        detector.update(row)
        if detector.drift_detected:
            first, detector = first + 1, _fresh()
    positives, detector = 0, _fresh()
    for row in make(random, IN_A_ROW):
        detector.update(row)
        if detector.drift_detected:
            positives += 1
            detector.answered(False)
    return AlarmCount(task, EXPERIMENTS, first, IN_A_ROW, positives)


def _delays(task: AlarmTask) -> AlarmCount:
    random = np.random.default_rng([task.seed, round(1000 * task.size)])
    wave = np.sin(2 * np.pi * PERIODS * np.arange(SAMPLES) / SAMPLES)
    wave *= math.sqrt(task.size) / rms(wave)
    own, cusum = [], []
    for _ in range(CHANGES):
        detector = _fresh()
        for row in _white(random, BEFORE):
            detector.update(row)
            if detector.drift_detected:  # a false alarm, which is counted elsewhere
                detector = _fresh()
        found = known = 0
        statistic = 0.0
        for number in range(1, AFTER + 1):
            row = wave + random.standard_normal(SAMPLES)
            detector.update(row)
            statistic = max(statistic, 0.0) + float(row @ wave - wave @ wave / 2)
            if not found and detector.drift_detected:
                found = number
            if not known and statistic >= math.log(EVERY):
                known = number
            if found and known:
                break
        own.append(found or AFTER + 1)
        cusum.append(known or AFTER + 1)
    return AlarmCount(task, delays=tuple(own), cusum=tuple(cusum))


def lorden(size: float, known: bool) -> float:
    """Least mean delay [experiments] of any detector with that mean time to a false alarm.

    Args:
        size: energy of the wave over that of the noise.
        known: whether the wave is known, or the ratio of energy to roughness alone is seen.
    """
    divergence = SAMPLES * (size if known else size**2) / 2
    return max(1.0, math.log(EVERY) / divergence)


def _fresh() -> Detector:
    settings = resolve({"false_alarm_every": EVERY}, "detector")
    return build_detector(settings["detector"], settings)
