"""Adequacy detector: does the model explain the experiment, and has the machine changed?"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.errors import OptionError
from ldt_core.base.experiment import Experiment, Level, Samples, Signal
from ldt_core.detectors.base import Detector, declared
from ldt_core.detectors.excited_range import Hull, hull, inside, is_hull, joined, samples_within
from ldt_core.estimation.far_samples import MOST_LOG
from ldt_core.estimation.misfit import STRETCH, Misfit, Setting, misfit, setting
from ldt_core.estimation.noise import UsualNoise, sensor_step

#: Exponents of the bets on ranks (Vovk, Gammerman, Shafer, "Algorithmic Learning in a Random
#: World", 2022, section 8): small ones win by rare ranks, large ones by slightly low ones.
EXPONENTS = (0.1, 0.3, 0.5, 0.7)
#: Odds from which on outliers are taken for shocks, and most that are remembered either way. With
#: 10 or 40 in place of the usual 20 the same experiments of three gears with play do not hold; with
#: 10 a sensor's own outliers count as shocks up to five times in 120 experiments, not once.
ODDS = 20.0
#: Errors that the next one is ranked among, at most; their ranks resolve a chance of 1 in 500.
REMEMBERED = 500
#: Times the error that learning was tried on, beyond which an experiment is heard at once: between
#: experiments of one machine with random voltage the error of one model varies by half. Errors
#: that grow to g times the first are heard log(g) / log(NEWS) times at most.
NEWS = 1.5
#: Part of the largest speed that no sensor resolves: a residual of less is rounding.
ROUNDING = 1e-9
LEAST_NOISE = 1e-100  # rad/s: its logarithm is a number
#: Fewer samples than this do not show how rough they are.
LEAST_SAMPLES = 20
#: Samples that tell the parameters of a machine and a cause apart: ten for each of some ten (F. E.
#: Harrell, "Regression Modeling Strategies", 2nd edition 2015, section 4.4). From 50 to
#: 200, what experiments of 50 samples leave of the error is the same within a tenth.
ENOUGH_TO_LEARN = 100


class Adequacy(Detector):
    """Positive where the model does not explain the experiment and learning may help.

    Two questions are judged apart. *Does the model explain this experiment?* Neighbouring samples
    of what noise leaves agree in sign as often as not, and so does each with the voltage's last
    steps; its largest samples lie anywhere; and where it is louder than before, it remembers
    nothing (`estimation.misfit`). Samples of which the model claims to know less count less. *Has
    the machine changed?* is asked where it does not: against the experiments since learning was
    first tried and did not help.

    | state | what is known | answer |
    |---|---|---|
    | `learning` | too few samples to tell; or one behind a step of the voltage is too far out for \
    noise; or what is left the model claims not to know | negative, or positive to learn from |
    | `holds` | the model explains the experiment down to the noise, and samples enough show it | \
    negative |
    | `changed` | it does not any more | positive |
    | `inadequate` | it does not, learning was tried and no better model was found | warning |
    | `new_range` | it does not, but only where it never was right | negative, then positive |

    In the state `inadequate` learning is tried again, positive, after 1, 2, 4, 8 ... experiments
    (in each, as long as they have fewer than `ENOUGH_TO_LEARN` samples together). It is tried at
    once where the residuals are no longer like those since the first trial, or `NEWS` times as
    large as any that learning was tried on. So it is in the state `learning`, where the residual
    is no noise; once learning has not helped there, the experiments between are `inadequate`.
    Nothing is learned as usual from experiments that the model has not explained.

    A change of the machine is one of p(speed | voltage): it shows against what was seen of the same
    voltage before, and nowhere else. So a failure is `changed` only if the model also fails where
    it was right (`excited_range`): in what it learned from or has explained since. Elsewhere it is
    `new_range`: negative the first time that the machine is seen there, then positive. A model that
    has never been right has no such range; its failure is `changed`.

    **Guarantee.** While the model in force is the machine's, the mean number of experiments to a
    false positive is at least `false_alarm_every`, if the noise is symmetric about zero and
    independent from sample to sample and of the voltage before. Its law and its scale may be any,
    and differ from sample to sample, but samples beyond `far_samples.FAR` deviations come in no
    bursts, and those beyond half of it not behind the voltage's steps: given how many there are,
    any order is as likely. Experiments may have any length and any excitation. (Where a prediction
    begins at a measured sample, its noise must not exceed all others'.) Proof: given the past, an
    experiment's e-value e_n has mean 1 or less
    (`estimation.misfit`; what the model claims comes from the past). A positive needs
    M_n = e_n max(M_(n-1), 1) >= A = `false_alarm_every`. M is an e-detector of the CUSUM type:
    M_n <= e_n (M_(n-1) + 1) <= S_n for the Shiryaev-Roberts sum S_n = e_n (S_(n-1) + 1), and
    S_n - n is a supermartingale from 0. By optional stopping the first time T with S_T >= A has
    E[T] >= E[S_T] >= A (Shin, Ramdas, Rinaldo, "E-detectors", 2022, theorem 2.4). In the state
    `inadequate` the same holds of `changed`, if the logarithms of the relative errors since the
    first trial are exchangeable: then their ranks' p-values are independent and uniform, and mean
    over k of k p^(k-1) is an e-value.

    Noise that is not independent within an experiment breaks the first assumption: the first such
    experiment is positive. Learning finds nothing better, and the ranks go on from there.

    A swing near half the sample rate looks like noise, and only its size tells. So what is more
    than three times as loud as the experiments before let expect (`UsualNoise`) is no noise if it
    remembers itself. Of independent noise that is one in a million, by which the guarantee is less.

    Args:
        false_alarm_every: least mean number of experiments from one false positive to the next.

    Raises:
        OptionError: an argument outside its range.

    Examples:
        White noise, and from experiment 41 on a slow wave in it:

        >>> import numpy as np
        >>> from ldt_core.detectors.adequacy import Adequacy
        >>> rng, wave = np.random.default_rng(1), np.sin(np.linspace(0, 20, 500))
        >>> detector = Adequacy()
        >>> for i in range(1, 42):
        ...     detector.update(rng.normal(size=500) + (wave if i > 40 else 0))
        ...     if i >= 40:
        ...         print(i, detector.signal.word, f"{detector.adequacy:.2f}", detector.model_state)
        40 negative 0.98 holds
        41 positive 1.23 changed
    """

    name = "adequacy"
    resumable = True

    def __init__(self, false_alarm_every: float = 1000.0) -> None:
        self.false_alarm_every: float = declared("false_alarm_every", false_alarm_every)
        self.reset()

    def reset(self) -> None:
        """Forget everything seen."""
        super().reset()
        #: What is known after the last experiment, a state of the table above.
        self.model_state = "learning"
        #: Root mean square residual over the noise's; None while unknown.
        self.adequacy: float | None = None
        #: How often it was learned from in the state `learning`, experiments to wait before more,
        #: and the error over the noise in the last one that was.
        self.lessons, self.pause, self.heard = 0, 0, 0.0
        #: Ranges of excitation: what the model in force was right in, empty of one that never was;
        #: what the machine was ever seen in; and the last one.
        self.explained: Hull = []
        self.seen: Hull = []
        self.last: Hull = []
        #: Samples of the last experiment.
        self.length = 0
        #: The sensor's step, as the last experiment that moved enough showed it [rad/s].
        self.step = 0.0
        #: Of the experiments that a model has explained, a `UsualNoise`.
        self.noises: list[float] = list(UsualNoise())
        #: What bets have left that outliers are shocks behind the voltage's steps, and experiments
        #: judged, and those of them with outliers.
        self.outlier_odds, self.experiments, self.with_outliers = 1.0, 0, 0
        #: Deviation of the last one's noise [rad/s], no less than a sensor resolves.
        self.noise = 0.0
        self._voltage: Samples | None = None
        self._speed: Samples | None = None
        self._clear()

    def restore(self, state: Mapping[str, Any]) -> None:
        """As `Detector.restore`; ranges must be some, and errors numbers."""
        super().restore(state)
        ranges = all(is_hull(r) for r in (self.explained, self.seen, self.last))
        if not (ranges and all(type(e) in (int, float) for e in self.errors)):
            self.reset()
            raise OptionError(f"state of detector {self.name}", "ranges and errors", "others")

    def _clear(self) -> None:
        #: The e-detectors of misfit: beyond the noise, and beyond what the model claims as well.
        self.unexplained, self.misfit = 0.0, 0.0
        #: How often learning was tried without success, experiments to wait before the next trial.
        self.trials, self.wait = 0, 0
        #: Whether it was in the state `learning`, where more of it is put off.
        self.in_vain = False
        #: Logarithms of the relative errors since the first trial, and the e-detector of change.
        self.errors: list[float] = []
        self.change = 0.0

    def restart(self) -> None:
        """A new model: what was found of the old one says nothing about it."""
        self._clear()
        self.signal = Level.NEGATIVE

    def answered(self, adapted: bool) -> None:
        """Hear what came of a positive: a new model, or none."""
        if adapted:
            self._clear()
            self.explained = self.last
        elif self.model_state != "learning":
            enough = len(self.errors) * self.length >= ENOUGH_TO_LEARN
            self.trials = self.trials + 1 if enough else 1
            self.wait = 2 ** (self.trials - 1)
            self.unexplained, self.misfit, self.change = 0.0, 0.0, 0.0
        else:
            self.in_vain = True
        self.signal = Level.NEGATIVE  # said and dealt with: `update` must not start anew

    def judge(self, residual: Samples, deviation: Samples | None) -> Level:
        """The answer to one experiment."""
        self.length = residual.size
        voltage, self._voltage = self._voltage, None
        speed, self._speed = self._speed, None
        if voltage is None or voltage.size != residual.size:
            voltage = np.zeros(residual.size)  # of nothing else is known that it differs
        if speed is not None and speed.size != residual.size:
            speed = None
        predicted = None if speed is None else speed - residual
        largest = float(np.abs(residual if speed is None else speed).max())
        if speed is not None and np.abs(residual).max() <= ROUNDING * largest:
            residual = np.zeros_like(residual)
        self.step = self.step if speed is None else sensor_step([speed]) or self.step
        most = max(UsualNoise(*self.noises).most, ROUNDING * largest)
        self._under = setting(voltage, speed, self.step, predicted, most)
        self.noise = max(ROUNDING * largest, LEAST_NOISE)
        level = self._judged(residual, deviation, voltage)
        self._saw(hull(voltage))
        return level

    def take_over(self, signal: Signal, experiment: Experiment, deviation: Samples | None) -> bool:
        """Take over that the model holds, or is as inadequate as before: nearly all signals."""
        told = signal.statistics
        mine = type(self) is Adequacy and told.keys() == self.statistics.keys()
        if not mine or told["drift_limit"] != self.false_alarm_every or self.drift_detected:
            return False
        if not signal.adequacy or len(experiment) < LEAST_SAMPLES:
            return False
        last = hull(experiment.voltage)
        if not (self._held(signal) or self._failed_again(signal, deviation, last)):
            return False
        self.signal, self.model_state, self.adequacy = signal.level, signal.state, signal.adequacy
        self.unexplained, self.misfit = told["unexplained"], told["misfit"]
        self.change, self.noise = told["change"], told["noise"]
        self.experiments += 1
        self.outlier_odds, self.with_outliers = (
            told["outlier_odds"],
            int(told["experiments_with_outliers"]),
        )
        self.length = len(experiment)
        self.step = sensor_step([experiment.speed]) or self.step
        self._saw(last)
        return True

    def _held(self, signal: Signal) -> bool:
        """Whether it was said that the model holds, which then ends all trials."""
        told = signal.statistics
        if signal.state != "holds" or signal.level is not Level.NEGATIVE:
            return False
        if self.trials > 0:
            if told["unexplained"] or told["misfit"] or told["change"]:
                return False
            self._clear()
        return told["unexplained"] < self.false_alarm_every and told["change"] == self.change

    def _failed_again(self, signal: Signal, deviation: Samples | None, last: Hull) -> bool:
        """Whether it was said that the model fails as before; then its error is the adequacy."""
        if signal.state != "inadequate" or signal.level is not Level.WARNING:
            return False
        known = self.seen and inside(last, self.seen)
        if deviation is not None or self.trials == 0 or not known:
            return False
        error = math.log(signal.adequacy or 1.0)
        if self.wait < 2 or math.exp(error) >= NEWS * self.heard:
            return False
        self.wait -= 1
        self.errors = [*self.errors, error][-REMEMBERED:]
        return True

    def _saw(self, last: Hull) -> None:
        """Take note of the range of the last experiment, of which the state is known."""
        self.last = last
        self.seen = joined(self.seen, last) if self.seen else last
        if self.model_state == "holds":
            self.noises = list(UsualNoise(*self.noises).with_one(self.noise))
            self.explained = joined(self.explained, last) if self.explained else last

    def _judged(self, residual: Samples, deviation: Samples | None, voltage: Samples) -> Level:
        if residual.size < LEAST_SAMPLES:
            self.model_state, self.adequacy = "learning", None
            return Level.NEGATIVE
        plain = misfit(residual, None, self._under)
        found = plain if deviation is None else misfit(residual, deviation, self._under)
        self.adequacy, self.noise = plain.ratio, max(plain.noise, self.noise)
        shocks = self._shocks(plain)
        self.unexplained = min(plain.evidence * max(self.unexplained, 1.0), math.exp(MOST_LOG))
        self.misfit = min(found.evidence * max(self.misfit, 1.0), math.exp(MOST_LOG))
        if self.trials > 0 and (found.excess > 0 or not found.explained):
            return self._inadequate(residual, deviation, voltage)
        if self.trials > 0:
            self._clear()
        if self.unexplained < self.false_alarm_every:
            told = plain.explained and plain.small and not shocks
            self.model_state = "holds" if told else "learning"
            return Level.NEGATIVE
        if self.misfit >= self.false_alarm_every:
            self.lessons, self.pause, self.heard = 0, 0, found.relative
            if not self._fails_within(self.explained, residual, deviation, voltage):
                return self._beyond(residual, deviation, voltage)
            self.errors = [math.log(found.relative)]
            self.model_state = "changed"
            return Level.POSITIVE
        self.model_state = "learning"
        self.pause -= 1
        if self.pause > 0 and plain.ratio < NEWS * self.heard:
            self.unexplained = 0.0  # heard and put off: one that is explained is no occasion
            if not self.in_vain:
                return Level.NEGATIVE
            self.model_state = "inadequate"
            return Level.WARNING
        self.pause, self.heard = 2**self.lessons, plain.ratio
        self.lessons += 1
        return Level.POSITIVE

    def _shocks(self, found: Misfit) -> bool:
        """Whether outliers are likely to be the first shocks of a change, and not the sensor's.

        That they lie behind the voltage's steps speaks for it, and that they are rare here.
        """
        rarity = (1 + self.experiments) / (1 + self.with_outliers)
        self.outlier_odds = min(max(self.outlier_odds * found.outlier_odds, 1 / ODDS), ODDS)
        self.experiments += 1
        self.with_outliers += int(found.outliers > 0)
        return found.outliers > 0 and self.outlier_odds * rarity >= ODDS

    def _fails_within(
        self, tried: Hull, residual: Samples, deviation: Samples | None, voltage: Samples
    ) -> bool:
        """Whether the model does not explain what lies within a range either."""
        known = samples_within(voltage, tried)
        if known.all():
            return True
        if np.count_nonzero(known) < STRETCH:
            return False
        found = _misfit_where(known, residual, deviation, self._under)
        return found.evidence >= self.false_alarm_every

    def _beyond(self, residual: Samples, deviation: Samples | None, voltage: Samples) -> Level:
        """The model fails, but not where it has been right: only the excitation is another."""
        self.unexplained, self.misfit = 0.0, 0.0
        self.model_state = "new_range"
        again = self._fails_within(self.seen, residual, deviation, voltage)
        return Level.POSITIVE if again else Level.NEGATIVE

    def _inadequate(self, residual: Samples, deviation: Samples | None, voltage: Samples) -> Level:
        self.wait -= 1
        known = samples_within(voltage, self.seen)
        if np.count_nonzero(known) < min(STRETCH, residual.size):
            self.model_state = "new_range"
            return Level.NEGATIVE
        error = math.log(_misfit_where(known, residual, deviation, self._under).relative)
        rank = (1 + sum(e >= error for e in self.errors)) / (1 + len(self.errors))
        bet = float(np.mean([k * rank ** (k - 1) for k in EXPONENTS]))
        self.change = min(bet * max(self.change, 1.0), math.exp(MOST_LOG))
        self.errors = [*self.errors, error][-REMEMBERED:]
        if self.change >= self.false_alarm_every:
            self.trials = 0
            self.model_state = "changed"
            return Level.POSITIVE
        self.model_state = "inadequate"
        news = math.exp(error) >= NEWS * self.heard
        if news:
            self.trials = 0
        elif self.wait > 0:
            return Level.WARNING
        self.heard = max(self.heard, math.exp(error))
        return Level.POSITIVE

    def excited(self, voltage: Samples) -> None:
        """Hear the voltage of the experiment that the next update is about."""
        self._voltage = np.asarray(voltage, dtype=np.float64)

    def measured(self, speed: Samples) -> None:
        """Hear the measured speed of the experiment that the next update is about."""
        self._speed = np.asarray(speed, dtype=np.float64)

    @property
    def statistics(self) -> dict[str, float]:
        """The e-detectors and their limit, the noise [rad/s], and what is known of outliers."""
        return {
            "unexplained": self.unexplained,
            "misfit": self.misfit,
            "change": self.change,
            "drift_limit": self.false_alarm_every,
            "noise": self.noise,
            "outlier_odds": self.outlier_odds,
            "experiments_with_outliers": self.with_outliers,
        }


def _misfit_where(
    known: NDArray[np.bool_], residual: Samples, deviation: Samples | None, under: Setting
) -> Misfit:
    claim = None if deviation is None else deviation[known]
    return misfit(residual[known], claim, under.part(known))
