"""Experiments and what a twin made of them as a table of pandas, one row an experiment."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment, Step
from ldt_core.twin.stage import RecordedStep

if TYPE_CHECKING:
    import pandas


def described_experiment(experiment: Experiment) -> dict[str, Any]:
    """Its number, start [s since the epoch], duration [s], sample period [s] and samples."""
    return {
        "experiment": experiment.number,
        "start": experiment.start,
        "duration": experiment.duration,
        "sample_period": experiment.period,
        "samples": len(experiment),
    }


def described_step(step: Step | RecordedStep) -> dict[str, Any]:
    """What the twin said and did at an experiment; errors [rad/s]."""
    original, diagnosis = step.original, step.diagnosis
    return {
        **described_experiment(step.experiment),
        "detector": step.signal.detector,
        "model_version": step.signal.model_version,
        "max_error": step.signal.max_error,
        "max_error_original": original and original.max_error(step.experiment),
        "signal": step.signal.level.word,
        "adaptation": str(step.adaptation.action),
        "reason": step.adaptation.reason,
        "diagnosis": diagnosis and diagnosis.sentence,
    }


def frame(rows: Iterable[dict[str, Any]]) -> pandas.DataFrame:
    """The rows as a table.

    Raises:
        LdtError: pandas is not installed.
    """
    try:
        import pandas
    except ImportError as error:
        raise LdtError(
            "a DataFrame needs pandas, which is not installed: pip install pandas"
        ) from error
    return pandas.DataFrame(list(rows))
