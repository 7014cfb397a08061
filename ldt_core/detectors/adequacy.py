"""Adequacy detector: does the model explain the experiment, and has the machine changed?"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import chdtrc, ndtri

from ldt_core.base.experiment import Level, Samples
from ldt_core.detectors.base import Detector, declared
from ldt_core.estimation.noise import roughness

#: Variance that a model may leave beyond the noise, as a part of the noise's, and still explain an
#: experiment: with 0.2 a prediction is at most 10 % worse than the best there can be.
TOLERATED = 0.2
#: Sizes, in standard deviations, of the misfits that the e-value is sensitive to.
MISFITS = (1.0, 2.0, 4.0, 8.0)
#: Exponents of the bets on ranks (Vovk, Gammerman, Shafer, "Algorithmic Learning in a Random
#: World", 2022, section 8): small ones win by rare ranks, large ones by slightly low ones.
EXPONENTS = (0.1, 0.3, 0.5, 0.7)
#: Deviations of its misfit up to which a model explains an experiment: one true model in 740 does
#: not.
EXPLAINED = 3.0
#: Errors that the next one is ranked among, at most; their ranks resolve a chance of 1 in 500.
REMEMBERED = 500
#: Fewer samples than this do not show how rough they are.
LEAST_SAMPLES = 20
#: Roughness [of the residual's largest value] below which it is rounding and no noise.
ROUNDING = 1e-9
#: Mean square [(rad/s)^2] of a residual that vanishes altogether; a division by it is a number.
LEAST_SQUARE = 1e-200
#: Largest deviation and logarithm that are told apart: their exponentials are still numbers.
MOST_DEVIATIONS, MOST_LOG = 30.0, 600.0


class Adequacy(Detector):
    """Positive where the model does not explain the experiment and learning may help.

    Two questions are judged apart. *Does the model explain this experiment?* Its squared residual
    is compared with the noise, by the residual's own roughness, plus the variance that the model
    claims beyond its own least. *Has the machine changed?* is asked where it does not: against the
    experiments since learning was first tried and did not help.

    | state | what is known | answer |
    |---|---|---|
    | `learning` | too few samples, or what is left the model claims not to know | negative |
    | `holds` | the model explains the experiment down to the noise | negative |
    | `changed` | it does not any more | positive |
    | `inadequate` | it does not, learning was tried and no better model was found | warning |

    In the state `inadequate` learning is tried again, positive, after 1, 2, 4, 8 ... experiments,
    and at once where the residuals are no longer like those since the first trial. Nothing is
    learned as usual from experiments that the model has not explained.

    **Guarantee.** While the model in force explains the machine, the mean number of experiments to
    a false positive is at least `false_alarm_every`, if residuals are white noise of any law with
    finite fourth moment, scale and length, which may differ between experiments, and long enough
    for the normal approximation of the roughness ratio. Proof: under these conditions the deviation
    z of the ratio is standard normal or below (its null mean is 0 at the tolerated misfit, less
    under it). Hence the e-value e = mean over m of exp(m z - m^2/2) has mean 1 or less given the
    past. M_n = e_n max(M_(n-1), 1) is an e-detector of the CUSUM type, and M_n - n is then a
    supermartingale from 0; by optional stopping the first time T with M_T >= 1 / alpha has
    E[T] >= E[M_T] >= 1 / alpha (Shin, Ramdas, Rinaldo, "E-detectors", 2022, theorem 2.4). In the
    state `inadequate` the same holds of positives out of turn, if the logarithms of the relative
    errors since the first trial are exchangeable: then their ranks' p-values are independent and
    uniform, and mean over k of k p^(k-1) is an e-value.

    Noise that is not white within an experiment breaks the first assumption: the first such
    experiment is positive. Learning finds nothing better, and the ranks go on from there.

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
        self._clear()

    def _clear(self) -> None:
        #: The e-detector of misfit.
        self.misfit = 0.0
        #: How often learning was tried without success, experiments to wait before the next trial.
        self.trials, self.wait = 0, 0
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
        else:
            self.trials += 1
            self.wait = 2 ** (self.trials - 1)
            self.misfit, self.change = 0.0, 0.0
        self.signal = Level.NEGATIVE  # said and dealt with: `update` must not start anew

    def judge(self, residual: Samples, deviation: Samples | None) -> Level:
        """The answer to one experiment."""
        if residual.size < LEAST_SAMPLES:
            self.model_state, self.adequacy = "learning", None
            return Level.NEGATIVE
        z, ratio, plain = deviations(residual, deviation)
        self.adequacy = math.sqrt(plain)
        known = deviations(residual, None)[0] < EXPLAINED
        self.misfit = min(_e_value(z) * max(self.misfit, 1.0), math.exp(MOST_LOG))
        if self.trials == 0:
            if self.misfit >= self.false_alarm_every:
                self.errors = [0.5 * math.log(ratio)]
                self.model_state = "changed"
                return Level.POSITIVE
            self.model_state = "holds" if known else "learning"
            return Level.NEGATIVE
        if z <= 0:
            self._clear()
            self.model_state = "holds" if known else "learning"
            return Level.NEGATIVE
        return self._inadequate(0.5 * math.log(ratio))

    def _inadequate(self, error: float) -> Level:
        rank = (1 + sum(e >= error for e in self.errors)) / (1 + len(self.errors))
        bet = float(np.mean([k * rank ** (k - 1) for k in EXPONENTS]))
        self.change = min(bet * max(self.change, 1.0), math.exp(MOST_LOG))
        self.errors = [*self.errors, error][-REMEMBERED:]
        self.wait -= 1
        if self.change >= self.false_alarm_every:
            self.trials = 0
            self.model_state = "changed"
            return Level.POSITIVE
        self.model_state = "inadequate"
        return Level.POSITIVE if self.wait <= 0 else Level.WARNING

    @property
    def statistics(self) -> dict[str, float]:
        """The e-detectors and their limit."""
        return {
            "misfit": self.misfit,
            "change": self.change,
            "drift_limit": self.false_alarm_every,
        }


def deviations(residual: Samples, deviation: Samples | None) -> tuple[float, float, float]:
    """Of an experiment the misfit in standard deviations, and its squared relative errors.

    Returns:
        z: standard normal or below if the residual is what noise and model claim, with the
            tolerated misfit.
        ratio: mean squared residual over noise and claim.
        plain: mean squared residual over the noise alone.
    """
    floor = ROUNDING * float(np.abs(residual).max())
    noise = max(roughness(residual) ** 2, floor**2, LEAST_SQUARE)
    square = np.square(residual, dtype=np.float64)
    claimed = np.zeros(residual.size)
    if deviation is not None:
        claimed = deviation**2 - float(np.min(deviation)) ** 2
    ratio = float(np.mean(square / (noise + claimed)))
    # Relative variance of the ratio: of noise and roughness 1 / L (von Neumann 1941). What the
    # model claims hangs together along a run, at worst as one number for all samples.
    share = float(np.mean(claimed / (noise + claimed)))
    variance = 1.0 / residual.size + 2.0 * share**2
    freedom = 2.0 / variance
    tail = float(chdtrc(freedom, freedom * ratio / (1.0 + TOLERATED)))
    z = MOST_DEVIATIONS if tail < 1e-190 else float(-ndtri(tail))
    return min(z, MOST_DEVIATIONS), max(ratio, 1e-300), float(np.mean(square)) / noise


def _e_value(z: float) -> float:
    return float(np.mean([math.exp(min(m * z - m * m / 2, MOST_LOG)) for m in MISFITS]))
