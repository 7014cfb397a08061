"""How far a model version is from an experiment."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment, Prediction, Samples, rms
from ldt_core.estimation.misfit import EXPLAINED, misfit, setting
from ldt_core.estimation.noise import correlation_time
from ldt_core.models.base import Model
from ldt_core.models.grey_box import GreyBoxModel

#: A model comes into force on data that it has not learned from if its error is less than this part
#: of the present one's: chance makes the errors of equally good models differ by less.
BETTER = 0.95


def alike(one: Model, other: Model) -> bool:
    """Whether two versions are the same model."""
    return one.kind == other.kind and one.parameters == other.parameters


def same(one: Experiment, other: Experiment) -> bool:
    """Whether two are one experiment; a number comes again where a counter began anew."""
    return (one.number, one.start) == (other.number, other.start)


def largest_error(model: Model, experiment: Experiment) -> float:
    """Largest error [rad/s]; infinite where the model cannot predict."""
    try:
        return model.predict(experiment).max_error(experiment)
    except LdtError:
        return float("inf")


def rms_error(model: Model, experiment: Experiment) -> float:
    """Root mean square error [rad/s]; infinite where the model cannot predict."""
    try:
        return rms(model.predict(experiment).residual(experiment))
    except LdtError:
        return float("inf")


def fit_of(
    model: Model, experiment: Experiment, said: Prediction | None = None
) -> tuple[bool, float]:
    """Whether a model explains an experiment, and its root mean square error there [rad/s].

    Args:
        said: a prediction that is recorded; if it is this model's none is computed.
    """
    if said is None or said.model_version != model.version:
        return explains(model, experiment), rms_error(model, experiment)
    return _is_explained(said, experiment), rms(said.residual(experiment))


def explains(model: Model, experiment: Experiment) -> bool:
    """Whether what it leaves is noise, or what it claims not to know."""
    try:
        prediction = model.predict(experiment)
    except LdtError:
        return False
    return _is_explained(prediction, experiment)


def explaining(versions: Sequence[Model], experiment: Experiment, error: float) -> Model | None:
    """The version that explains an experiment best, if better than an error [rad/s]."""
    best, least = None, error
    for version in versions:
        error = rms_error(version, experiment)
        if error < least and explains(version, experiment):
            best, least = version, error
    return best


def _is_explained(prediction: Prediction, experiment: Experiment) -> bool:
    under = setting(experiment.voltage, experiment.speed, predicted=prediction.speed)
    return misfit(prediction.residual(experiment), prediction.speed_std, under).explained


def pays(model: Model, present: Model, judged: Sequence[Experiment], learned: int = 0) -> bool:
    """Whether it errs so much less than the present one that it is worth another version.

    Also beyond chance, of which there is the more the longer the noise remembers: then few samples
    tell. So many times the logarithm of the errors' ratio, the likelihood ratio under noise of
    unknown size, has to be worth `EXPLAINED` (Markov's inequality, as it is an e-value), and to pay
    the price of what was learned from the same experiments (Schwarz, Annals of Statistics 6, 1978).

    Args:
        learned: how many parameters the model has learned from the experiments that judge it.
    """
    errors = [sum(rms_error(m, e) ** 2 for e in judged) for m in (model, present)]
    if not errors[0] < BETTER**2 * errors[1]:
        return False
    return errs_less([model.predict(e).residual(e) for e in judged], errors[1], learned)


def errs_less(left: Sequence[Samples], present: float, learned: int = 0) -> bool:
    """The same of what a model leaves, and the mean squares that the present one leaves there.

    Args:
        left: residuals of the model [rad/s], a row an experiment.
        present: mean squares of the present one, summed up over the experiments.
        learned: as for `pays`.
    """
    error = sum(rms(row) ** 2 for row in left)
    if not error < BETTER**2 * present:
        return False
    if error == 0.0:
        return True
    count = sum(row.size / correlation_time(row) for row in left)
    price = learned * math.log(count) / 2 + math.log(EXPLAINED)
    return count * math.log(present / error) / 2 > price


def gains(model: GreyBoxModel, present: Model, experiment: Experiment) -> bool:
    """Whether one that has learned from an experiment pays there."""
    return pays(model, present, [experiment], learned=model.box.size)
