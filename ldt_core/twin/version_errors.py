"""How far a model version is from an experiment."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment, Prediction, Samples, rms
from ldt_core.diagnosis.thresholds import THRESHOLDS
from ldt_core.estimation.grey_box import GreyBox
from ldt_core.estimation.misfit import EXPLAINED, misfit, setting
from ldt_core.estimation.noise import correlation_time
from ldt_core.models.base import Model
from ldt_core.models.grey_box import GreyBoxModel
from ldt_core.physics.base import CURRENT
from ldt_core.twin.training_data import VALID_ERROR_RATIO

#: A model comes into force on data that it has not learned from if its error is less than this part
#: of the present one's: chance makes the errors of equally good models differ by less.
BETTER = 0.95
#: Ratio of errors that the experiments of one machine do not have. With 1.5 or 3 in its place, what
#: is left of eight streams whose laws the library lacks is the same, in one a tenth more.
FAR = 2.0


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


def squared_error(model: Model, judged: Sequence[Experiment]) -> float:
    """Mean squares of its errors, summed up over the experiments [(rad/s)^2]."""
    return sum(rms_error(model, e) ** 2 for e in judged)


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
    errors = [squared_error(m, judged) for m in (model, present)]
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


def explains_all(model: Model, experiments: Sequence[Experiment]) -> bool:
    """Whether it explains each of these."""
    return all(explains(model, e) for e in experiments)


def gains(model: GreyBoxModel, present: Model, learned: Sequence[Experiment]) -> bool:
    """Whether one that has learned from experiments pays there."""
    return pays(model, present, learned, learned=model.box.size)


def fails_before(
    model: Model,
    present: Model,
    experiment: Experiment,
    learned: Sequence[Experiment],
    recent: Sequence[Experiment],
) -> bool:
    """Whether a model that explains the newest experiment fails in those before, though the machine
    has hardly changed: it follows what the laws lack, or noise.

    The machine has changed where the present model errs far more than in all that it stands for.
    Where it has changed less than that, its model errs in those before as the present one does now.
    Not so one with a foundation: near a resonance, a little decides whether it catches the shaft.

    Args:
        present: the model in force.
        experiment: the newest.
        learned: those that the present one has learned from; where they are not known, it stands
            for what it explains.
        recent: those before the newest.
    """
    if not rigid(present):
        return False
    known = stands_for(present, experiment, learned, recent)
    if has_changed(present, experiment, known):
        return False
    now = rms_error(present, experiment)
    return any(rms_error(model, e) > FAR * now for e in known)


def rigid(model: Model) -> bool:
    """Whether its machine has no foundation."""
    return len(model.machine.model.states) == CURRENT + 1


def stands_for(
    present: Model,
    experiment: Experiment,
    learned: Sequence[Experiment],
    recent: Sequence[Experiment],
) -> list[Experiment]:
    """The experiments before the newest that the present model stands for; see `fails_before`."""
    known = [e for e in learned if e.same_period(experiment)]
    if not known:
        return [e for e in recent if explains(present, e)]
    since = max(e.start for e in known)
    return known + [e for e in recent if e.start > since]


def has_changed(present: Model, experiment: Experiment, known: Sequence[Experiment]) -> bool:
    """Whether the present model errs far more than in all that it stands for."""
    now = rms_error(present, experiment)
    return all(now > FAR * rms_error(present, e) for e in known)


def unexplained(
    present: Model, original: Model, recent: Sequence[Experiment], experiment: Experiment
) -> list[Experiment]:
    """The newest experiments that neither the present model nor the original explains, as far as
    the present one errs as much in them: behind a change that nobody explains it errs more.
    """
    pool = [experiment]
    least = rms_error(present, experiment) / VALID_ERROR_RATIO
    for e in reversed(recent):
        if explains(present, e) or explains(original, e) or rms_error(present, e) < least:
            break
        pool.insert(0, e)
    return pool


def far(box: GreyBox, q: Array) -> set[str]:
    """The machine's own parameters that are farther from the file's than by chance."""
    return box.far(q, THRESHOLDS.prior_deviations)
