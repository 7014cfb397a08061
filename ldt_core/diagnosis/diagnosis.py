"""What a diagnosis says: the keys of `diagnosis.json`, and what its page draws."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.experiment import Experiment

Array = NDArray[np.float64]

#: Field to its key in `diagnosis.json`, where they differ: `from` is a keyword of Python.
KEYS = {"begin": "from", "end": "to"}


@dataclass(frozen=True)
class ParameterAmount:
    """A parameter of an effect, as it was found.

    Attributes:
        value: in `unit`.
        unit: SI.
        ci95: 95 % interval; None where the recording does not determine it.
    """

    value: float
    unit: str
    ci95: tuple[float, float] | None


@dataclass(frozen=True)
class RankedCandidate:
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
    parameters: Mapping[str, ParameterAmount]
    held_out_rmse: float | None
    closed_fraction: float | None
    shapley_share: float | None
    score: float | None
    rejected_because: str | None


@dataclass(frozen=True)
class GapLocation:
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


@dataclass(frozen=True)
class HeldOutErrors:
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
    before: HeldOutErrors
    after: HeldOutErrors
    closed_fraction: float | None
    closed_fraction_ci95: tuple[float, float] | None
    regimes: Sequence[Mapping[str, Any]] = ()


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


@dataclass(frozen=True, eq=False)
class DrawnExperiment:
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
    where: Sequence[GapLocation]
    candidates: Sequence[RankedCandidate]
    remainder: Remainder
    undetectable: Sequence[str]
    ambiguities: Sequence[Sequence[str]]
    next_experiment: NextExperiment | None
    notes: Sequence[str] = ()
    effects: Sequence[Mapping[str, Any]] = ()
    shown: Sequence[DrawnExperiment] = field(default=(), compare=False)

    def as_dict(self) -> dict[str, Any]:
        """The content of `diagnosis.json`: JSON values only, undefined quantities null."""
        content = _json(replace(self, shown=()))
        del content["shown"]
        return content


def _json(value: Any) -> Any:
    """The same in JSON types: records by their fields, null for numbers that are not finite."""
    if is_dataclass(value):
        named = {f.name: getattr(value, f.name) for f in fields(value)}
        return {KEYS.get(name, name): _json(v) for name, v in named.items()}
    if isinstance(value, Mapping):
        return {str(k): _json(v) for k, v in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_json(v) for v in value]
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, np.integer):
        return int(value)
    return value
