"""How far a model version is from an experiment."""

from __future__ import annotations

from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment, rms
from ldt_core.estimation.misfit import misfit, setting
from ldt_core.models.base import Model


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


def explains(model: Model, experiment: Experiment) -> bool:
    """Whether what it leaves is noise, or what it claims not to know."""
    try:
        prediction = model.predict(experiment)
    except LdtError:
        return False
    under = setting(experiment.voltage, experiment.speed)
    return misfit(prediction.residual(experiment), prediction.speed_std, under).explained
