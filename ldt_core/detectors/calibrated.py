"""Calibrated detector: one false alarm in a stated number of experiments."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.optimize import brentq

from ldt_core.base.errors import OptionError
from ldt_core.base.experiment import Level, Samples
from ldt_core.detectors.base import Detector, declared
from ldt_core.detectors.control_chart import ALLOWANCE, limits, warning_limits
from ldt_core.detectors.reference import LEAST_KNOWN, Reference

#: Warnings (and positives) in as many experiments as there is one false alarm in.
WARNINGS = 10
#: Numbers in as many that are not learned from until the suspicion is over. With more, what is high
#: but usual would be missing too often: at 10 there were 15 % too many false alarms.
SUSPICIOUS = 3
#: So many times rarer than a false alarm, and the level has changed for certain.
CERTAIN = 100
#: Positives that follow the first before the present level is taken for the new normal.
RETRIES = 2
#: A false alarm of the sum has values of mean 1 (twice the allowance) and deviation 1; one whose
#: mean is so many standard errors above that is none.
STEEP = 2.5
#: The number of an uncertain positive is learned from as at most so many deviations above the mean:
#: of few numbers, one far out is not certain, but would make everything usual.
FAR = 3.3
#: After a positive the level is known as from so many experiments: the model may be another.
CARRIED = 10.0
#: Before anything is learned, an error of so many yardsticks is out of control. Noise that has a
#: memory reaches 3.5 times what its roughness shows at an autocorrelation of 0.9, 11 times at 0.99;
#: a rotor that has 5, 8, 12 mm of eccentricity instead of none is at 11, 30, 70.
GROSS = 20.0
#: Logarithm of a usual relative error that is the noise's alone.
NOISE_ALONE = 0.1
#: What is left of 11 neighbouring samples at their middle, without the polynomial of fifth degree
#: that fits them best (Savitzky, Golay 1964): of white noise a known share, of a wave of 30 rad/s,
#: sampled at 100 Hz, 3e-4 of its height.
ROUGH = -np.array([18, -45, -10, 60, 120, 143 - 429, 120, 60, -10, -45, 18]) / 429
#: Fewer samples than this do not show how rough they are.
LEAST_SAMPLES = 20
#: Lowest logarithm of a ratio to the white noise that is told from lower ones.
ROUGHEST = -2.0
#: Spread of a score, times the root of the number of samples, that there is at least: when
#: residuals repeat themselves exactly. White noise has 0.6.
LEAST_SPREAD = 0.1
#: Largest ratio to the white noise, and largest limit.
LARGEST = 1e6
#: Furthest logarithm of a ratio: its exponential is still a number.
MOST_LOG = 700.0
#: Least mean square: it must not vanish when its yardsticks differ by more than numbers can.
LEAST_SQUARE = 1e-300


class Calibrated(Detector):
    """Positive once in `false_alarm_every` experiments in control, and soon after a drift.

    Each experiment gives one number, its root mean square residual in yardsticks. The yardstick is
    the model's own predictive deviation, sample by sample, where it has one. Otherwise it is the
    white noise in the residual itself, by its roughness: noise that nobody could predict is no
    reason to learn again. As one number stands for the experiment, it does not matter how the
    samples within it hang together, nor that one voltage shakes the machine more than another; in
    control, experiments are taken to be alike in law and independent of each other.

    Which numbers are usual is learned from those seen so far (`reference.Reference`), which turns
    the next one into a value z that is standard normal in control, from the fourth experiment on.
    A chart with computed limits (`control_chart`) tests each z, for what is sudden, and their
    cumulative sum, for what is small and stays. Nothing is forgotten by age: a machine that wears
    slowly moves away from what was learned.

    - In the first three experiments only an error of more than 20 yardsticks is positive, and
      there are wide limits in the next ones: what is unknown cannot be unusual.
    - Warnings, and positives, come in one experiment of `false_alarm_every` / 10 in control (in one
      of five at most). The most suspicious are learned from only when the sum is back at 0. The
      number of a positive is learned from at once, limited in size, unless the positive is certain:
      a hundred times rarer than a false alarm, or steeper than the sum rises by chance. Left out,
      false alarms would make the usual look narrower than it is, and bring the next one sooner.
    - After a positive the model may be another: its level counts as known from ten experiments
      only, the sum begins at half its limit, all else stays. When two more certain positives follow
      before an experiment no worse than usual, learning did not help: then the present level is the
      new normal, and everything is learned from the beginning. So it is when the error has fallen
      for certain, and when the model begins, or ceases, to state a deviation, unless its errors
      were those of the noise alone: then they will be so by its own deviation, too.

    Measured, `tests/core/false_alarm_rates.py` counts anew: with a lognormal error (streams of 200
    experiments without a drift) there were 1.05 times the false alarms stated at one in 100
    (standard error 0.05) and 0.91 times (0.11) at one in 1000. On the wearing rotor (10 streams,
    120 drifts, noise 0.1 rad/s), with a learner that knows the start and, after each positive, the
    new eccentricity, recall was 1.00 and precision 1.00 at one in 1000, 0.98 at one in 200, 0.92 at
    one in 100.

    What it cannot know: a law with a far longer tail than what was seen suggests (Student's with 3
    degrees of freedom, for the logarithm, gives several times the false alarms stated); errors that
    become more erratic with wear while the model is right (a start state that matters more and
    more, in a model that states no deviation); and what changes from experiment to experiment in
    control (a season), which is a drift to it.

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
        >>> for i in range(1, 42):
        ...     detector.update(rng.normal(size=500) + (wave if i > 40 else 0))
        ...     if i in (3, 40, 41):
        ...         got = detector.statistics
        ...         words = [f"{n} {got[n]:.3f}" for n in ("relative_error", "drift_limit")]
        ...         print(i, detector.signal.word, *words)
        3 negative relative_error 0.959 drift_limit 20.000
        40 negative relative_error 1.018 drift_limit 1.125
        41 positive relative_error 1.245 drift_limit 1.125
    """

    name = "calibrated"
    resumable = True
    lifelong = True
    #: Scores that wait until the suspicion is over.
    suspects: list[float]

    def __init__(self, false_alarm_every: float = 1000.0) -> None:
        self.false_alarm_every = declared("false_alarm_every", false_alarm_every)
        self._limits = limits(self.false_alarm_every)
        self._sure = limits(CERTAIN * self.false_alarm_every)
        every = self.false_alarm_every
        self._warning_limits = warning_limits(every, WARNINGS / every)
        self._suspicion = warning_limits(every, SUSPICIOUS / every)
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
        yardstick, ratio = log_relative_error(residual, deviation)
        if yardstick != self.yardstick:
            self._change_to(yardstick)
        score, least = symmetric(ratio, yardstick), LEAST_SPREAD / math.sqrt(residual.size)
        self.last = {"relative_error": math.exp(ratio), **self._limits_now(least)}
        if self.reference.known:
            return self._judge(score, least)
        if math.exp(ratio) > self.last.get("drift_limit", math.inf):
            return Level.POSITIVE
        self.reference.take(score, least)
        return Level.NEGATIVE

    def _change_to(self, yardstick: str) -> None:
        known = self.reference.known and abs(self.reference.level) <= NOISE_ALONE
        self.yardstick, self.accepted, self.attempts = yardstick, False, 0
        if known and yardstick != "none":
            self.reference.doubt_level(LEAST_KNOWN)
        else:
            self._learn_anew()

    def _judge(self, score: float, least: float) -> Level:
        unusual = self.reference.unusual(score, least)
        self.risen = max(0.0, self.risen + unusual - ALLOWANCE)
        self.fallen = max(0.0, self.fallen - unusual - ALLOWANCE)
        self.rise = [self.rise[0] + 1, self.rise[1] + unusual]
        self.last |= {"unusual": unusual, "sum": self.risen}
        if self._above(self._limits, unusual):
            if not self._certain(unusual):
                self.attempts = -1
                self._take(self.suspects, least)
                self.reference.take(score, least, FAR)
            self.suspects = []
            return Level.POSITIVE
        if unusual < -self._sure[0] or self.fallen > self._sure[1]:
            self._learn_anew()
        if self._above(self._suspicion, unusual):
            self.suspects.append(score)
        else:
            self._take([score], least)
        if unusual <= ALLOWANCE:
            self.attempts = 0
        if self.risen == 0:
            self.rise = [0.0, 0.0]
            self._take(self.suspects, least)
            self.suspects = []
        return Level.WARNING if self._above(self._warning_limits, unusual) else Level.NEGATIVE

    def _above(self, pair: tuple[float, float], unusual: float) -> bool:
        return unusual > pair[0] or self.risen > pair[1]

    def _certain(self, unusual: float) -> bool:
        """Whether a positive is none of the false ones."""
        if unusual > self._limits[0]:
            return unusual > self._sure[0]
        values, total = self.rise
        return (total / values - 2 * ALLOWANCE) * math.sqrt(values) > STEEP

    def _take(self, scores: list[float], least: float) -> None:
        for score in scores:
            self.reference.take(score, least)

    def _limits_now(self, least: float) -> dict[str, float]:
        """Relative errors above which this experiment is a warning and a positive, if known."""
        pairs = {"warning_limit": self._warning_limits, "drift_limit": self._limits}
        if not self.reference.known:
            absolute = self.accepted or self.yardstick == "none"
            return {} if absolute else dict.fromkeys(pairs, GROSS)
        found, most = {}, math.log(LARGEST)
        for name, (single, total) in pairs.items():
            unusual = min(single, total + ALLOWANCE - self.risen)
            score = self.reference.quantile(unusual, least)
            if score < symmetric(most, self.yardstick):
                found[name] = math.exp(_ratio(score, self.yardstick))
        return found

    def _learn_anew(self) -> None:
        self.reference = Reference()
        self.risen = self.fallen = 0.0
        self.rise = [0.0, 0.0]
        self.suspects = []

    @property
    def statistics(self) -> dict[str, float]:
        """relative_error and its warning_limit and drift_limit [yardsticks]; unusual (z) and sum.

        The limits hold for this experiment, those of the sum included: it is positive just when its
        relative error is above the drift_limit. A limit is left out as long as there is none.
        """
        return dict(self.last)

    def state(self) -> dict[str, Any]:
        """All that changes, in JSON types; `restore` takes it back."""
        return super().state() | {"reference": self.reference.state()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state saved earlier by a detector with the same arguments.

        Raises:
            OptionError: the state is not this detector's; the detector then has seen nothing.
        """
        super().restore(state)
        try:
            self.reference = Reference.from_state(state["reference"])
            self.last = {str(name): float(value) for name, value in self.last.items()}
            self.suspects = [float(score) for score in self.suspects]
            values, total = self.rise
            self.rise = [float(values), float(total)]
        except (TypeError, ValueError) as error:
            self.reset()
            raise OptionError(f"state of detector {self.name}", "its own", str(error)) from error


def log_relative_error(residual: Samples, deviation: Samples | None) -> tuple[str, float]:
    """(name of the yardstick, logarithm of the root mean square residual in yardsticks).

    Args:
        residual: (L,) measured minus predicted [rad/s], not all zero.
        deviation: (L,) the model's own predictive standard deviation [rad/s], or None.

    Returns:
        "deviation" and the ratio to it, where it is above 0 throughout; "white noise" and the ratio
        to the white noise in the residual, at most `LARGEST`; with fewer than `LEAST_SAMPLES`
        samples "none" and [rad/s].
    """
    scale = float(np.abs(residual).max())
    row = residual / scale  # no overflow in the squares
    if deviation is not None and (deviation > 0).all():
        least = float(deviation.min())
        square = max(float(np.mean((row * (least / deviation)) ** 2)), LEAST_SQUARE)
        ratio = math.log(scale) - math.log(least) + 0.5 * math.log(square)
        return "deviation", min(max(ratio, -MOST_LOG), MOST_LOG)
    square = float(np.mean(row**2))
    if residual.size < LEAST_SAMPLES:
        return "none", math.log(scale) + 0.5 * math.log(square)
    rough = np.convolve(row, ROUGH, "valid")
    white = float(np.mean(rough**2)) / float(np.sum(ROUGH**2))
    return "white noise", 0.5 * math.log(square / max(white, square / LARGEST**2))


def symmetric(ratio: float, yardstick: str) -> float:
    """The number that an experiment gives, from the logarithm of its relative error.

    It is the logarithm itself, except for a ratio to the white noise. In a residual that is little
    else than that, the noise's share 1 / R^2 is symmetric, and the logarithm of R askew: there were
    1.3 times the false alarms stated. This is -1 / R^2 up to the second order there, and half of
    the logarithm, which has no effect on what is unusual, where R is large.
    """
    if yardstick != "white noise":
        return ratio
    ratio = max(ratio, ROUGHEST)
    return 0.5 * ratio - math.expm1(-4 * ratio) / 8


def _ratio(score: float, yardstick: str) -> float:
    """Inverse of `symmetric`."""
    if yardstick != "white noise":
        return score
    low, high = ROUGHEST, math.log(LARGEST)
    if score <= symmetric(low, yardstick):
        return low
    return float(brentq(lambda ratio: symmetric(ratio, yardstick) - score, low, high, xtol=1e-9))
