"""What a diagnosis says: the keys of `diagnosis.json`, and what its page draws."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.bounded_file import read_bounded
from ldt_core.base.errors import BadInput, ExperimentError, OptionError, described, did_you_mean
from ldt_core.base.experiment import Experiment
from ldt_core.effects import EFFECTS, get_effect, known_effect
from ldt_core.machine.machine_file import Machine
from ldt_core.physics.effect import Effect

#: Field to its key in `diagnosis.json`, where they differ: `from` is a keyword of Python.
KEYS = {"begin": "from", "end": "to"}

MOST_BYTES = 50_000_000  # of a file that is read: no diagnosis comes near

#: What a next experiment may ask to be measured.
CHANNELS = ("voltage", "speed", "current")
KINDS = ("none", "effect", "ambiguous", "unknown")  # of a verdict


@dataclass(frozen=True)
class ParameterAmount:
    """A parameter of an effect, as it was found.

    Attributes:
        ci95: 95 % interval; None where the recording does not determine it.
    """

    value: float
    unit: str
    ci95: tuple[float, float] | None


@dataclass(frozen=True)
class RankedCandidate:
    """A candidate and how it fared.

    Attributes:
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
        effects: all that act together (effect), or all names that are possible (ambiguous).
        acting: one list for each effect that acts: the names it may have, the best first.
        confidence: share of such verdicts that was right among simulated cases; see `confidence`.
        grounds: what it was judged by.
    """

    kind: str
    effects: Sequence[str]
    acting: Sequence[Sequence[str]]
    confidence: float
    sentence: str
    grounds: Mapping[str, float] = field(default_factory=dict)


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
        closed_fraction: of the squared rmse beyond noise; None without a gap, or where it differs
            from experiment to experiment.
        closed_fraction_ci95: of as many further experiments of the same kind.
        regimes: closed fraction and errors by regime of the held-out experiments, worst first.
    """

    noise_std: float
    before: HeldOutErrors
    after: HeldOutErrors
    closed_fraction: float | None
    closed_fraction_ci95: tuple[float, float] | None
    regimes: Sequence[Mapping[str, Any]] = ()


@dataclass(frozen=True)
class Refit:
    """A nominal parameter that was fitted along.

    Attributes:
        parameter: of the machine file.
        factor: what it became, as a multiple of the file's value.
        ci95: of the factor; None where the recording does not determine it.
        prior_std: relative deviation that the file allows it; None where that is unknown.
        closed_fraction: of the gap, by all refitted parameters together and nothing else.
    """

    parameter: str
    factor: float
    ci95: tuple[float, float] | None
    prior_std: float | None
    closed_fraction: float | None


@dataclass(frozen=True)
class Remainder:
    """What is left after the best set."""

    share_of_gap: float | None
    structured: bool
    depends_on: Sequence[str]


@dataclass(frozen=True)
class NextExperiment:
    """The experiment that would settle what is open.

    Attributes:
        voltage: (L,) [V], each held for one period.
        sample_period: [s].
    """

    why: str
    voltage: Sequence[float]
    sample_period: float
    channels: Sequence[str]


@dataclass(frozen=True, eq=False)
class DrawnExperiment:
    """One experiment as the page draws it.

    Attributes:
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
        experiments: numbers under `fit` and `held_out`.
        effects: the verdict's effects as `ldt predict --with` adds them: name or file, parameters.
        alternatives: sets, or other amounts, that are as good as the verdict's, which the recording
            cannot tell from it, in the form of `effects`.
        seen: voltage and speed to the least and the largest that was recorded.
        machine_file: as it was given, or the name with `.yaml` of a machine that ships with LDT.
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
    alternatives: Sequence[Sequence[Mapping[str, Any]]] = ()
    seen: Mapping[str, Sequence[float]] = field(default_factory=dict)
    shown: Sequence[DrawnExperiment] = field(default=(), compare=False)
    refit: Sequence[Refit] = ()
    machine_file: str = ""

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


def read_effects(
    file: str | Path, machine: Machine | None = None, own: Sequence[Effect] = ()
) -> list[tuple[Effect, dict[str, float]]]:
    """The effects with their parameters from a `diagnosis.json`, by its key `effects`.

    A diagnosis names no file to run: an effect of the user's own comes from the machine file or is
    given beside it.

    Args:
        machine: that is to have them; None takes any.
        own: effects that are neither in the library nor among the machine's own.

    Raises:
        BadInput: the file cannot be read, is no diagnosis, or one of another machine.
        OptionError: an unknown effect, or a parameter outside its bounds.
    """
    found = read_diagnosis(file, machine)
    known = [*own, *(machine.own_laws if machine else ())]
    return used_effects(str(file), acting_entries(str(file), found), known)


def used_effects(
    file: str, listed: Any, own: Sequence[Effect] = ()
) -> list[tuple[Effect, dict[str, float]]]:
    """Effects with their parameters, of a list like the key `effects`; errors as above."""
    with refused(file):
        entries = [
            (str(e["effect"]), {str(n): _amount(v) for n, v in e["parameters"].items()})
            for e in listed
        ]
    given = {e.name: e for e in own}
    acting: list[tuple[Effect, dict[str, float]]] = []
    for name, parameters in entries:
        known = [*EFFECTS.names(), *given]
        if name not in known:
            raise BadInput(f"{file}, effect", known_effect(name, given), repr(name))
        effect = given.get(name) or get_effect(name)
        if name in [e.name for e, _ in acting]:
            raise BadInput(f"{file}, effect {name}", "one entry an effect", "two")
        if not parameters:
            expected = f"a value for {' or '.join(p.name for p in effect.parameters)}"
            raise BadInput(f"{file}, effect {name}", expected, "none")
        try:
            acting.append(effect.used(parameters))
        except OptionError as error:
            raise OptionError(f"{file}, {error.where}", error.expected, error.got) from None
    return acting


def read_next(file: str | Path, machine: Machine) -> tuple[Machine, Array, bool]:
    """The next experiment that a `diagnosis.json` asks for.

    Returns:
        The machine with that experiment's length and sample period, (L,) voltage [V], and whether
        the current is to be measured.

    Raises:
        BadInput: the file cannot be read, is of another machine, or asks for no experiment, or
            for a channel that no recording has.
        ExperimentError: a voltage outside the machine's limits.
    """
    asked = read_diagnosis(file, machine).get("next_experiment")
    if asked is None:
        raise BadInput(file, "a next_experiment", "none: nothing is open, or nothing settles it")
    try:
        volts = np.array(asked["voltage"], dtype=np.float64)
        period, channels = float(asked["sample_period"]), [str(c) for c in asked["channels"]]
        blank = Experiment(1, 0.0, period, volts, np.zeros(volts.size))
    except (KeyError, TypeError, ValueError, OverflowError, ExperimentError) as error:
        got = f"something else ({error})"
        raise BadInput(
            f"{file}, next_experiment", "voltage, sample_period, channels", got
        ) from error
    for name in channels:
        if name not in CHANNELS:
            where = f"{file}, next_experiment, channels"
            raise BadInput(where, did_you_mean(name, CHANNELS), described(name))
    machine.check(blank)
    timed = replace(machine, duration=volts.size * period, sample_period=period)
    return timed, volts, "current" in channels


def read_diagnosis(file: str | Path, machine: Machine | None = None) -> Mapping[str, Any]:
    """The keys of a `diagnosis.json`; arguments and errors as of `read_effects`."""
    try:
        found = json.loads(read_bounded(file, MOST_BYTES))
    except (OSError, ValueError, RecursionError) as error:
        got = getattr(error, "strerror", None) or "no JSON"
        raise BadInput(file, "a readable diagnosis.json, as ldt diagnose writes it", got) from error
    if not isinstance(found, Mapping) or not isinstance(found.get("verdict"), Mapping):
        raise BadInput(file, "a diagnosis with the key verdict", "something else")
    kind = found["verdict"].get("kind")
    if kind is not None and kind not in KINDS:
        raise BadInput(f"{file}, verdict, kind", f"one of {', '.join(KINDS)}", described(kind))
    of = found.get("machine")
    if machine is not None and of not in (None, machine.name):
        told = f"a diagnosis of the machine {machine.name!r}"
        again = "if it is the same machine, give its file the same name"
        raise BadInput(file, told, f"one of {described(of)} ({again})")
    return found


def acting_entries(where: str, found: Mapping[str, Any]) -> Any:
    """Each acting effect, unchecked; from the candidates if there is no `effects`."""
    if found.get("effects") is not None:
        return found["effects"]
    with refused(where):
        names = list(found["verdict"]["effects"])
        if found["verdict"]["kind"] not in ("effect", "ambiguous"):
            names = []
        if found["verdict"]["kind"] == "ambiguous":
            names = names[:1]
        ranked = {c["effect"]: c["parameters"] for c in found.get("candidates", [])}
        return [
            {"effect": n, "parameters": {p: a["value"] for p, a in ranked[n].items()}}
            for n in names
        ]


@contextmanager
def refused(where: str) -> Iterator[None]:
    """Turn what reading content of another kind raises into one sentence."""
    try:
        yield
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        expected = "a list of {effect: name, parameters: {name: number}}"
        got = f"no {error}" if isinstance(error, KeyError) else f"something else ({error})"
        raise BadInput(where, expected, got) from error


def _amount(value: Any) -> float:
    if isinstance(value, bool):
        raise TypeError(f"{value} is no number")
    return float(value)
