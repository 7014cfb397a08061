"""What a calibration found: estimates, what the data do not determine, errors before and after."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from ldt_core.base.experiment import Experiment
from ldt_core.base.metrics import FreeRunError
from ldt_core.machine.machine_file import Machine
from ldt_core.models.physics import PhysicsModel

DIGITS = 6  # significant ones of a calibrated value: more than any recording determines


@dataclass(frozen=True)
class ParameterEstimate:
    """A parameter that was free.

    Attributes:
        name: of the parameter.
        unit: SI.
        nominal: the machine file's value.
        value: calibrated.
        ci95: 95 % interval, or None when the recordings do not determine the parameter.
    """

    name: str
    unit: str
    nominal: float
    value: float
    ci95: tuple[float, float] | None


@dataclass(frozen=True)
class Calibration:
    """A calibrated machine and how far to trust it.

    Attributes:
        nominal: the machine before.
        machine: the machine after; its `calibration` is `as_dict()`.
        estimates: the free parameters.
        fixed: parameters that kept their values, with the reason.
        undetermined: groups of parameters that the recordings cannot tell apart.
        noise: standard deviation of what is left with the start states estimated, by channel.
        intervals: how they were made, in words.
        errors: "fit" and, when experiments were held out, "held_out" → (before, after), free runs
            from the first measured sample as `ldt predict` makes them [rad/s].
        experiments: numbers of the experiments by the same keys.
        notes: sentences for a person: what is determined, what to beware of.
        recordings: the files.
    """

    nominal: Machine
    machine: Machine
    estimates: tuple[ParameterEstimate, ...]
    fixed: dict[str, str]
    undetermined: list[list[str]]
    noise: dict[str, float]
    intervals: str
    errors: dict[str, tuple[FreeRunError, FreeRunError]]
    experiments: dict[str, list[int]]
    notes: tuple[str, ...]
    recordings: tuple[str, ...] = ()

    def with_recordings(self, recordings: Sequence[str]) -> Calibration:
        """The same, with the names of the files it was made from."""
        named = replace(self, recordings=tuple(recordings))
        return replace(named, machine=replace(self.machine, calibration=named.as_dict()))

    def as_dict(self) -> dict[str, Any]:
        """The machine file's key `calibration`, in JSON types."""
        before, after = self.errors["fit"]
        record: dict[str, Any] = {
            "recordings": list(self.recordings),
            "free": {
                e.name: {
                    "value": e.value,
                    "ci95": None if e.ci95 is None else list(e.ci95),
                    "nominal": e.nominal,
                }
                for e in self.estimates
            },
            "fixed": list(self.fixed),
            "undetermined": [list(group) for group in self.undetermined],
            "intervals": self.intervals,
            "noise": {channel: rounded(size) for channel, size in self.noise.items()},
            "experiments": self.experiments["fit"],
            "rmse_before": rounded(before.rmse),
            "rmse_after": rounded(after.rmse),
        }
        if "held_out" in self.errors:
            before, after = self.errors["held_out"]
            record["held_out"] = {
                "experiments": self.experiments["held_out"],
                "rmse_before": rounded(before.rmse),
                "rmse_after": rounded(after.rmse),
            }
        record["notes"] = list(self.notes)
        return record


def rounded(value: float) -> float:
    """The number that is written, reported and simulated with."""
    return float(f"{value:.{DIGITS}g}")


def free_run_error(machine: Machine, experiments: Sequence[Experiment]) -> FreeRunError:
    """Error of the machine's free runs from the first measured samples."""
    model, error = PhysicsModel(machine), FreeRunError()
    for experiment in experiments:
        error.add(model.predict(experiment).residual(experiment))
    return error
