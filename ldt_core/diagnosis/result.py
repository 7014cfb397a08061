"""What a diagnosis says: the keys of `diagnosis.json`, and what its page draws."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.experiment import Experiment

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Amount:
    """A parameter of an effect, as it was found.

    Attributes:
        value: in `unit`.
        unit: SI.
        ci95: 95 % interval; None where the recording does not determine it.
    """

    value: float
    unit: str
    ci95: tuple[float, float] | None

    def as_dict(self) -> dict[str, Any]:
        """Keys of the contract."""
        return {"value": self.value, "unit": self.unit, "ci95": self.ci95 and list(self.ci95)}


@dataclass(frozen=True)
class Ranked:
    """A candidate and how it fared.

    Attributes:
        effect: its name.
        parameters: amounts; in the verdict's set for its members, else alone.
        held_out_rmse: free-run error on the held-out experiments with it alone [rad/s].
        closed_fraction: of the gap there, with it alone; None without a gap.
        shapley_share: its share of what the verdict's set closes; None outside that set.
        score: of the gap's power in the fitted experiments, the part that it explains alone.
        rejected_because: why it is not in the verdict; None for those that are.
    """

    effect: str
    parameters: Mapping[str, Amount]
    held_out_rmse: float | None
    closed_fraction: float | None
    shapley_share: float | None
    score: float | None
    rejected_because: str | None

    def as_dict(self) -> dict[str, Any]:
        """Keys of the contract."""
        return {
            "effect": self.effect,
            "parameters": {n: a.as_dict() for n, a in self.parameters.items()},
            "held_out_rmse": self.held_out_rmse,
            "closed_fraction": self.closed_fraction,
            "shapley_share": self.shapley_share,
            "score": self.score,
            "rejected_because": self.rejected_because,
        }


@dataclass(frozen=True)
class Place:
    """Where a part of the gap lies.

    Attributes:
        quantity: speed, voltage, acceleration, time, frequency, order or experiment.
        begin: lower end.
        end: upper end.
        unit: of both.
        share_of_gap: part of the gap's power inside.
        share_of_data: part of the samples inside.
        steady: whether it is where the named effect acts at a steady speed, by its law, and not
            where this recording shows it.
    """

    quantity: str
    begin: float
    end: float
    unit: str
    share_of_gap: float
    share_of_data: float
    steady: bool = False

    def as_dict(self) -> dict[str, Any]:
        """Keys of the contract."""
        return {
            "quantity": self.quantity,
            "from": self.begin,
            "to": self.end,
            "unit": self.unit,
            "share_of_gap": self.share_of_gap,
            "share_of_data": self.share_of_data,
            "steady": self.steady,
        }


@dataclass(frozen=True)
class Verdict:
    """The answer.

    Attributes:
        kind: none, effect, ambiguous or unknown.
        effects: all that act together (effect), or all names that are possible (ambiguous).
        acting: one list for each effect that acts: the names it may have, the best first.
        confidence: 0..1.
        sentence: for a person.
    """

    kind: str
    effects: Sequence[str]
    acting: Sequence[Sequence[str]]
    confidence: float
    sentence: str

    def as_dict(self) -> dict[str, Any]:
        """Keys of the contract, and `acting`."""
        return {
            "kind": self.kind,
            "effects": list(self.effects),
            "acting": [list(group) for group in self.acting],
            "confidence": self.confidence,
            "sentence": self.sentence,
        }


@dataclass(frozen=True)
class Errors:
    """Free-run errors on the held-out experiments.

    Attributes:
        rmse: root mean square [rad/s].
        mean_max_error: mean over the experiments of the largest error [rad/s].
    """

    rmse: float
    mean_max_error: float


@dataclass(frozen=True)
class Gap:
    """The gap on experiments that were held back.

    Attributes:
        noise_std: of the measured speed [rad/s].
        before: by the machine file.
        after: with the verdict's effects.
        closed_fraction: of the squared rmse beyond noise; None without a gap.
        closed_fraction_ci95: by bootstrap over the held-out experiments.
        regimes: closed fraction and errors by regime of the held-out experiments, worst first.
    """

    noise_std: float
    before: Errors
    after: Errors
    closed_fraction: float | None
    closed_fraction_ci95: tuple[float, float] | None
    regimes: Sequence[Mapping[str, Any]] = ()

    def as_dict(self) -> dict[str, Any]:
        """Keys of the contract, and `regimes`."""
        return {
            "noise_std": self.noise_std,
            "before": vars(self.before),
            "after": vars(self.after),
            "closed_fraction": self.closed_fraction,
            "closed_fraction_ci95": self.closed_fraction_ci95 and list(self.closed_fraction_ci95),
            "regimes": [dict(r) for r in self.regimes],
        }


@dataclass(frozen=True)
class Remainder:
    """What is left after the best set.

    Attributes:
        share_of_gap: part of the gap's power.
        structured: whether it is more than noise.
        depends_on: what it can be predicted from.
    """

    share_of_gap: float | None
    structured: bool
    depends_on: Sequence[str]

    def as_dict(self) -> dict[str, Any]:
        """Keys of the contract."""
        return {
            "share_of_gap": self.share_of_gap,
            "structured": self.structured,
            "depends_on": list(self.depends_on),
        }


@dataclass(frozen=True)
class NextExperiment:
    """The experiment that would settle what is open.

    Attributes:
        why: in words.
        voltage: (L,) [V], each held for one period.
        sample_period: [s].
        channels: to record.
    """

    why: str
    voltage: Sequence[float]
    sample_period: float
    channels: Sequence[str]

    def as_dict(self) -> dict[str, Any]:
        """Keys of the contract."""
        return {
            "why": self.why,
            "voltage": list(self.voltage),
            "sample_period": self.sample_period,
            "channels": list(self.channels),
        }


@dataclass(frozen=True, eq=False)
class Shown:
    """One experiment as the page draws it.

    Attributes:
        experiment: measured.
        held_out: whether it was held back.
        before: (L,) free run by the machine file [rad/s].
        after: (L,) free run with the verdict's effects [rad/s]; `before` where there are none.
        torque_before: (L,) torque on the shaft that would explain the error of `before` [N m].
        torque_after: (L,) the same for `after`.
        smooth_speed: (L,) measured speed without noise [rad/s].
        acceleration: (L,) its derivative [rad/s^2].
    """

    experiment: Experiment
    held_out: bool
    before: Array
    after: Array
    torque_before: Array
    torque_after: Array
    smooth_speed: Array
    acceleration: Array


@dataclass(frozen=True)
class Diagnosis:
    """All that a diagnosis found.

    Attributes:
        machine: its name.
        recordings: as they were given.
        experiments: numbers under `fit` and `held_out`.
        verdict: the answer.
        gap: how large it was and is.
        where: its places, the clearest first.
        candidates: all effects that were tried, best first.
        remainder: what is left.
        undetectable: effects that this recording could not have shown.
        ambiguities: groups of effects that this recording cannot tell apart.
        next_experiment: that would settle what is open.
        notes: for a person.
        effects: the verdict's effects as `ldt predict --with` adds them: name or file, parameters.
        shown: for the page.
    """

    machine: str
    recordings: Sequence[str]
    experiments: Mapping[str, Sequence[int]]
    verdict: Verdict
    gap: Gap
    where: Sequence[Place]
    candidates: Sequence[Ranked]
    remainder: Remainder
    undetectable: Sequence[str]
    ambiguities: Sequence[Sequence[str]]
    next_experiment: NextExperiment | None
    notes: Sequence[str] = ()
    effects: Sequence[Mapping[str, Any]] = ()
    shown: Sequence[Shown] = field(default=(), compare=False)

    def as_dict(self) -> dict[str, Any]:
        """The content of `diagnosis.json`: JSON values only, undefined quantities null."""
        return _clean(
            {
                "machine": self.machine,
                "recordings": list(self.recordings),
                "experiments": {k: list(v) for k, v in self.experiments.items()},
                "verdict": self.verdict.as_dict(),
                "gap": self.gap.as_dict(),
                "where": [p.as_dict() for p in self.where],
                "candidates": [c.as_dict() for c in self.candidates],
                "remainder": self.remainder.as_dict(),
                "undetectable": list(self.undetectable),
                "ambiguities": [list(group) for group in self.ambiguities],
                "next_experiment": self.next_experiment and self.next_experiment.as_dict(),
                "notes": list(self.notes),
                "effects": [dict(e) for e in self.effects],
            }
        )


def _clean(value: Any) -> Any:
    """The same in JSON types, with null for numbers that are not finite."""
    if isinstance(value, Mapping):
        return {str(k): _clean(v) for k, v in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_clean(v) for v in value]
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, np.integer):
        return int(value)
    return value
