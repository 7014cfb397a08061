"""Calibrated detector: one false alarm in a stated number of experiments."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ldt_core.detectors.base import Detector, declared
from ldt_core.detectors.control_chart import ALLOWANCE, limits, warning_limits
from ldt_core.detectors.reference import Reference
from ldt_core.errors import OptionError
from ldt_core.experiment import Level, Samples

#: Warnings (and positives) in as many experiments as there is one false alarm in.
WARNINGS = 10
#: So many times rarer than a false alarm, and the level has changed for certain.
CERTAIN = 100
#: Positives that follow the first before the present level is taken for the new normal.
RETRIES = 2
#: A false alarm of the sum has values of mean 1 (twice the allowance) and deviation 1; one whose
#: mean is so many standard errors above that is none.
STEEP = 2.0
#: After a positive the level is known as from so many experiments: the model may be another.
CARRIED = 10.0
#: Before anything is learned, an error of so many yardsticks is no control [1]. Noise that has a
#: memory reaches 4 times what its third differences show at an autocorrelation of 0.9, and 13 times
#: at 0.99; a rotor that has 8 mm of eccentricity instead of none is at 30.
GROSS = 20.0
#: Fewer samples than this have no third differences worth the name.
LEAST_SAMPLES = 8
#: Sum of the squares of the coefficients of a third difference.
THIRD_DIFFERENCE = 20.0
#: A residual that is smoother than so many yardsticks is told from none.
LARGEST = 1e6


class Calibrated(Detector):
    """Positive once in `false_alarm_every` experiments in control, and soon after a drift.

    Each experiment gives one number, its root mean square residual in yardsticks. The yardstick is
    the model's own predictive deviation, sample by sample, where it has one. Otherwise it is the
    white noise in the residual itself, by third differences: noise that nobody could predict is no
    reason to learn again, and a voltage that shakes the machine more does not count as drift. As
    one number stands for the experiment, it does not matter how the samples within it hang
    together; in control, experiments are taken to be alike in law, and independent.

    Which numbers are usual is learned from those seen so far (`reference.Reference`), which turns
    the next one into a value z that is standard normal in control, from the fourth experiment on.
    A chart with exact limits (`control_chart`) tests each z, for what is sudden, and their
    cumulative sum, for what is small and stays. Nothing is forgotten by age, so that a machine that
    wears slowly moves away from what was learned.

    - In the first three experiments only an error of more than 20 yardsticks is positive.
    - After a positive the level may be another, since the model may be: it counts as known from ten
      experiments only. What was learned stays otherwise. The score of a positive that is certain
      (a hundred times rarer than a false alarm) is not learned from.
    - When two more positives follow and no unsuspicious experiment in between, learning did not
      help. Then the present level is the new normal, and is learned from the beginning.
    - When the error has fallen for certain, the new level is learned, too.
    - Warnings: one experiment in `false_alarm_every` / 10 in control (one in five at most).

    What it cannot know: scores whose law has a far longer tail than learned from what it has seen,
    and what changes slowly from experiment to experiment in control (a season), which is a drift.

    Args:
        false_alarm_every: mean number of experiments in control from one positive to the next.

    Raises:
        OptionError: an argument outside its range.

    Examples:
        White noise, and from experiment 41 on a slow wave in it:

        >>> import numpy as np
        >>> from ldt_core.detectors.calibrated import Calibrated
        >>> rng, wave = np.random.default_rng(1), np.sin(np.linspace(0, 20, 500))
        >>> detector = Calibrated(false_alarm_every=1000)
        >>> for i in range(1, 43):
        ...     detector.update(rng.normal(size=500) + (wave if i > 40 else 0))
        ...     if i in (3, 40, 41):
        ...         print(i, detector.signal.word, round(detector.statistics["relative_error"], 3))
        3 negative 0.969
        40 negative 0.959
        41 positive 1.243
    """

    name = "calibrated"
    lifelong = True

    def __init__(self, false_alarm_every: float = 1000.0) -> None:
        self.false_alarm_every = declared("false_alarm_every", false_alarm_every)
        self._limits = limits(self.false_alarm_every)
        self._sure = limits(CERTAIN * self.false_alarm_every)
        share = WARNINGS / self.false_alarm_every
        self._warning_limits = warning_limits(self.false_alarm_every, share)
        self.reset()

    def reset(self) -> None:
        """Forget everything, what was learned in control as well."""
        super().reset()
        self.yardstick = ""
        self.accepted = False
        self.attempts = 0
        self.last: dict[str, float] = {}
        self._learn_anew()

    def restart(self) -> None:
        """After a positive: doubt the level, and remain suspicious for a while; see the class."""
        self.signal = Level.NEGATIVE
        self.attempts += 1
        if self.attempts > RETRIES:
            self.attempts, self.accepted = 0, True
            self._learn_anew()
            return
        self.reference.doubt_level(CARRIED)
        self.risen, self.fallen, self.rise = self._limits[1] / 2, 0.0, [0.0, 0.0]

    def judge(self, residual: Samples, deviation: Samples | None) -> Level:
        """The chart's answer to the score of this experiment."""
        if not residual.any():
            self.last = {"relative_error": 0.0}
            return Level.NEGATIVE
        yardstick, score = log_relative_error(residual, deviation)
        if yardstick != self.yardstick:
            self.yardstick, self.accepted, self.attempts = yardstick, False, 0
            self._learn_anew()
        # No root mean square of L samples is known better than that of white noise.
        least = 1 / math.sqrt(2 * residual.size)
        self.last = self._limits_now(least)
        self.last["relative_error"] = math.exp(score)
        if not self.reference.known:
            if math.exp(score) > self.last["drift_limit"]:
                return Level.POSITIVE
            self.reference.take(score, least)
            return Level.NEGATIVE
        return self._judge(score, least)

    def _judge(self, score: float, least: float) -> Level:
        unusual = self.reference.unusual(score, least)
        single, total = self._limits
        self.risen = max(0.0, self.risen + unusual - ALLOWANCE)
        self.fallen = max(0.0, self.fallen - unusual - ALLOWANCE)
        self.rise = [self.rise[0] + 1, self.rise[1] + unusual]
        self.last |= {"unusual": unusual, "sum": self.risen}
        if unusual > single or self.risen > total:
            if not self._certain(unusual):
                self.attempts = -1
                self._take([*self.suspects, score], least)
            self.suspects = []
            return Level.POSITIVE
        if unusual < -self._sure[0] or self.fallen > self._sure[1]:
            self._learn_anew()
        if unusual > self._warning_limits[0] or self.risen > self._warning_limits[1]:
            self.suspects.append(score)
            return Level.WARNING
        self._take([score], least)
        if unusual <= ALLOWANCE:
            self.attempts = 0
        if self.risen == 0:
            self.rise = [0.0, 0.0]
            self._take(self.suspects, least)
            self.suspects = []
        return Level.NEGATIVE

    def _certain(self, unusual: float) -> bool:
        """Whether a positive is none of the false ones."""
        values, total = self.rise
        steep = (total / values - 2 * ALLOWANCE) * math.sqrt(values) > STEEP
        return unusual > self._sure[0] or steep

    def _take(self, scores: list[float], least: float) -> None:
        for score in scores:
            self.reference.take(score, least)

    def _limits_now(self, least: float) -> dict[str, float]:
        """Relative errors above which this experiment is a warning and a positive."""
        if not self.reference.known:
            first = LARGEST if self.accepted or self.yardstick == "none" else GROSS
            return {"warning_limit": first, "drift_limit": first}
        found = {}
        for name, (single, total) in (
            ("warning_limit", self._warning_limits),
            ("drift_limit", self._limits),
        ):
            unusual = min(single, total + ALLOWANCE - self.risen)
            found[name] = math.exp(self.reference.quantile(unusual, least))
        return found

    def _learn_anew(self) -> None:
        self.reference = Reference()
        self.risen = self.fallen = 0.0
        self.rise = [0.0, 0.0]
        self.suspects: list[float] = []

    @property
    def statistics(self) -> dict[str, float]:
        """relative_error, warning_limit, drift_limit [yardsticks]; unusual, sum [deviations]."""
        return dict(self.last)

    def state(self) -> dict[str, Any]:
        """All that changes, in JSON types; `restore` takes it back."""
        reference, self.reference = self.reference, None
        try:
            return super().state() | {"reference": reference.state()}
        finally:
            self.reference = reference

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state saved earlier by a detector with the same arguments.

        Raises:
            OptionError: the state is not this detector's; the detector then has seen nothing.
        """
        super().restore(state)
        try:
            self.reference = Reference.from_state(state["reference"])
            self.last = {str(name): float(value) for name, value in self.last.items()}
        except (TypeError, ValueError) as error:
            self.reset()
            raise OptionError(f"state of detector {self.name}", "its own", str(error)) from error


def log_relative_error(residual: Samples, deviation: Samples | None) -> tuple[str, float]:
    """(name of the yardstick, logarithm of the root mean square residual in yardsticks).

    Args:
        residual: (L,) measured minus predicted [rad/s], not all zero.
        deviation: (L,) the model's own predictive standard deviation [rad/s], or None.

    Returns:
        "deviation" and the ratio to it; "white noise" and the ratio to the white noise in the
        residual, at most `LARGEST`; with fewer than `LEAST_SAMPLES` samples "none" and [rad/s].
    """
    if deviation is not None and (deviation > 0).all():
        residual = residual / deviation
    scale = float(np.abs(residual).max())
    row = residual / scale  # no overflow in the squares
    square = float(np.mean(row**2))
    if deviation is not None and (deviation > 0).all():
        return "deviation", math.log(scale) + 0.5 * math.log(square)
    if residual.size < LEAST_SAMPLES:
        return "none", math.log(scale) + 0.5 * math.log(square)
    white = float(np.mean(np.diff(row, 3) ** 2)) / THIRD_DIFFERENCE
    return "white noise", 0.5 * math.log(square / max(white, square / LARGEST**2))
