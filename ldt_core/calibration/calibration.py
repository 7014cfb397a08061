"""What a calibration found: estimates, errors before and after, and sentences for a person."""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment, rms
from ldt_core.base.metrics import FreeRunError
from ldt_core.base.printable import printable
from ldt_core.base.sentences import listed, spoken
from ldt_core.calibration.coordinates import SEARCH_FACTOR, Coordinates
from ldt_core.calibration.identifiability import Identifiability
from ldt_core.machine.direction_check import swapped
from ldt_core.machine.machine_file import Machine
from ldt_core.machine.sensor_check import doubt, sound
from ldt_core.machine.stated_posterior import fitted_to
from ldt_core.models.physics import PhysicsModel

MOST_NAMED = 3  # effects in a sentence
DIGITS = 6  # significant ones of a calibrated value: more than any recording determines
WITHHELD = "withheld: the physics lacks something"
COUNTED_TWICE = (
    "The file was fitted to this recording before, whose noise counts twice now: intervals may be "
    "1.4 times too narrow. Start from the file before, or take another recording."
)
MOST_NOISE_RATIO = 5.0  # of a residual to its white part: beyond, it is not the sensor's noise
MOST_LEFT = 0.5  # of the speed (rms): a fit that leaves as much has not found the machine
LIMIT_MARGIN = 0.2  # of the largest recorded voltage, at either end: a limit must not be too tight
CONSTANT_RANGE = 0.02  # of the largest voltage: a smaller range excites nothing


class Reason(enum.StrEnum):
    """Why a parameter kept its value."""

    NOT_NAMED = "not freed"
    AS_ASKED = "as asked"
    OPTIONAL = "freed by name only"
    VAGUE = "too uncertain"
    GROUPED = "not told apart"
    SILENT = "does not show"
    EXACT = "stated without std"
    CHANGED = "an effect changes it"


@dataclass(frozen=True)
class ParameterEstimate:
    """A parameter that was free, in SI units.

    `nominal` is the machine file's value; `ci95` the 95 % interval, or None when the recordings do
    not determine the parameter or the physics lacks something; `std` that of the normal law with
    this interval, or else of what was known beforehand, about this value (`recentred`). A value of
    0 has none.
    """

    name: str
    unit: str
    nominal: float
    value: float
    ci95: tuple[float, float] | None
    std: float | None = None


@dataclass(frozen=True, eq=False)
class Posterior:
    """The normal law of the parameters' relative errors, those that were kept included.

    Attributes:
        parameters: names.
        root: (k, r) relative errors by r independent standard normal numbers.
    """

    parameters: tuple[str, ...]
    root: Array

    @property
    def deviations(self) -> dict[str, float]:
        """Relative standard deviation of each parameter."""
        return dict(zip(self.parameters, np.linalg.norm(self.root, axis=1).tolist(), strict=True))

    def widened(self, names: Sequence[str], errors: Array) -> Posterior:
        """The same with (n, p) relative errors of some parameters besides, a law's column each."""
        more = np.zeros((len(self.parameters), len(errors)))
        for j, name in enumerate(names):
            if name in self.parameters:
                more[self.parameters.index(name)] = errors[:, j]
        return replace(self, root=np.hstack([self.root, more]))

    def as_dict(self) -> dict[str, Any]:
        """A key of the machine file's `calibration`, in JSON types."""
        rows = [[rounded(float(v)) for v in row] for row in self.root]
        return {"parameters": list(self.parameters), "root": rows}


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
        lacking: effects that the physics lacks and that are plainly in what is left, the clearest
            first; None where what is left is smooth and follows none of them.
        posterior: what is known of all parameters together, wider by how far they imitate what is
            lacking; None where some are not determined, or what is lacking has no name.
        coloured: of a channel whose noise is stronger at low frequencies, deviations of white noise
            that is as rough, and of white noise that is as strong there.
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
    lacking: list[str] | None = field(default_factory=list)
    posterior: Posterior | None = None
    coloured: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    recordings: tuple[str, ...] = ()

    def with_recordings(self, recordings: Sequence[str]) -> Calibration:
        """The same, with the names of the files it was made from."""
        named = replace(self, recordings=tuple(recordings))
        before = self.nominal
        knows = before.deviations and before.calibration.get("lacking") == []
        if knows and fitted_to(before, recordings):
            named = replace(named, notes=(*self.notes, COUNTED_TWICE))
        return replace(named, machine=replace(self.machine, calibration=named.as_dict()))

    def as_dict(self) -> dict[str, Any]:
        """The machine file's key `calibration`, in JSON types."""
        before, after = self.errors["fit"]
        record: dict[str, Any] = {
            "recordings": [printable(name) for name in self.recordings],
            "free": {
                e.name: {
                    "value": e.value,
                    "ci95": None if e.ci95 is None else list(e.ci95),
                    "nominal": e.nominal,
                    "std": e.std,
                }
                for e in self.estimates
            },
            "fixed": list(self.fixed),
            "undetermined": [list(group) for group in self.undetermined],
            "intervals": self.intervals,
            "lacking": self.lacking,
            "noise": {channel: rounded(size) for channel, size in self.noise.items()},
            "experiments": self.experiments["fit"],
            "rmse_before": rounded(before.rmse),
            "rmse_after": rounded(after.rmse),
        }
        if self.coloured:
            record["coloured_noise"] = {
                channel: {"white": rounded(white), "slow": rounded(slow)}
                for channel, (white, slow) in self.coloured.items()
            }
        if "held_out" in self.errors:
            before, after = self.errors["held_out"]
            record["held_out"] = {
                "experiments": self.experiments["held_out"],
                "rmse_before": rounded(before.rmse),
                "rmse_after": rounded(after.rmse),
            }
        if self.posterior is not None:
            record["posterior"] = self.posterior.as_dict()
        record["notes"] = list(self.notes)
        return record


def rounded(value: float) -> float:
    """The number that is written, reported and simulated with."""
    return float(f"{value:.{DIGITS}g}")


def padded_range(low: float, high: float) -> tuple[float, float]:
    """The recorded range and 0 V, widened by a part of its largest size, to the digit of that."""
    low, high = min(low, 0.0), max(high, 0.0)
    wider = LIMIT_MARGIN * max(-low, high)
    digit = 10.0 ** math.floor(math.log10(wider))
    return (
        rounded(math.floor((low - wider) / digit) * digit),
        rounded(math.ceil((high + wider) / digit) * digit),
    )


def limits_note(machine: Machine) -> str:
    """What is said of the limits of a file for which nobody gave any."""
    low, high = machine.voltage_limits
    return (
        f"The file permits {low:g} to {high:g} V: the recorded range and a fifth more. Give the "
        "machine's own limits with --limits before you follow advice."
    )


def free_run_error(machine: Machine, experiments: Sequence[Experiment]) -> FreeRunError:
    """Error of the machine's free runs from the first measured samples."""
    model, error = PhysicsModel(machine), FreeRunError()
    for experiment in experiments:
        error.add(model.predict(experiment).residual(experiment))
    return error


def notes(calibration: Calibration, seen: Identifiability, white: float, same: float) -> list[str]:
    """Sentences on what is determined and what is not, and on the errors."""
    said = []
    values = calibration.nominal.parameters
    units = {p.name: p.unit for p in calibration.nominal.model.parameters}
    for name, exponents in seen.groups.items():
        moves = listed(f"{n} changes by {c:+.2g} %" for n, c in exponents.items())
        said.append(
            f"The recordings cannot separate {listed([name, *exponents])}. {name} was kept at "
            f"{values[name]:.4g} {units[name]}; if it is 1 % larger in truth, {moves}."
        )
    if seen.products:
        said.append(f"They do determine {listed(seen.products)}.")
    if seen.groups and not any(e.ci95 is None for e in calibration.estimates):
        said.append("The intervals hold if what was kept is right within its tolerance.")
    for name in seen.silent:
        kept = "it was kept" if name in calibration.fixed else "the fitted value means nothing"
        said.append(f"{name} does not show in these recordings: {kept}.")
    for name, reason in calibration.fixed.items():
        if reason == Reason.VAGUE:
            said.append(
                f"{name} was kept at {values[name]:.4g} {units[name]}: its 95 % interval would "
                "be wider than a factor of 1.6 either way."
            )
    left = calibration.noise["speed"]
    if left > MOST_NOISE_RATIO * white:
        said.append(
            f"What is left ({left:.3g} rad/s) is smooth, not noise (about {white:.2g} rad/s). "
            "The machine has something that the physics lacks; the calibrated values imitate it."
        )
    if calibration.lacking:
        shown = calibration.lacking[:MOST_NAMED]
        more = " or another" if len(calibration.lacking) > MOST_NAMED else ""
        has = [spoken(n) for n in shown if n in calibration.machine.acting]
        beside = (
            f". The machine file has {listed(has)}, but in another amount or by another law."
            if has
            else ", which the machine file lacks."
        )
        said.append(
            f"What is left looks like {listed([spoken(n) for n in shown], 'or')}{more}{beside}"
        )
    if calibration.lacking != []:
        said.append(
            "So no interval is given. `ldt diagnose` looks for the cause; `ldt calibrate --with` "
            "adds it to the file."
        )
    for part, (before, after) in calibration.errors.items():
        where = {"fit": "fitted", "held_out": "held out"}[part]
        if after.rmse > before.rmse / same:
            said.append(
                f"Beware: on the experiments {where} the free-run error went up, from "
                f"{before.rmse:.4g} to {after.rmse:.4g} rad/s."
            )
        elif part == "fit" and after.rmse > same * before.rmse:
            said.append("The file's values already fit: the free-run error hardly went down.")
    return said


def bound_notes(coordinates: Coordinates, z: Array) -> list[str]:
    """A sentence for each parameter that ended on a bound at z (p,), and what that means."""
    said = []
    for c in coordinates.on_bound(z):
        at = c.value(float(z[coordinates.names.index(c.name)]))
        if at == c.nominal:
            said.append(f"{c.name} stayed at {at:.4g} {c.parameter.unit}, as in the file.")
            continue
        physical = at in (c.parameter.low, c.parameter.high)
        edge = (
            "what physics allows"
            if physical
            else f"the search, {SEARCH_FACTOR:g} times off the file"
        )
        said.append(
            f"{c.name} ended at {at:.4g} {c.parameter.unit}, the edge of {edge}: another parameter "
            "is off, or the machine has something that the physics lacks."
        )
    return said


def refuse_absurd(
    coordinates: Coordinates, z: Array, after: FreeRunError, experiments: Sequence[Experiment]
) -> None:
    """Refuse a fit that leaves more than noise, and is no calibration of this machine.

    Raises:
        LdtError: it leaves half of the speed and no less than a constant in each experiment would,
            or a parameter that cannot be 0 has run to the upper edge of the search. At the lower
            edge it may just not matter, and one that may be 0 may stand in for what the physics
            lacks.
    """
    speed = np.concatenate([e.speed for e in experiments])
    apart = np.concatenate([e.speed - e.speed.mean() for e in experiments])
    size, constant = rms(speed), rms(apart)
    high = math.log(SEARCH_FACTOR)
    ends = zip(coordinates.free, z, strict=True)
    away = [c.name for c, v in ends if c.parameter.open_low and v == high]
    if after.rmse < max(constant, MOST_LEFT * size) and not away:
        return
    found = (
        f"{listed(away)} ran to {SEARCH_FACTOR:g} times the file's value"
        if away
        else f"the fit leaves {after.rmse:.4g} rad/s of {size:.4g}"
    )
    raise LdtError(
        f"calibration failed: {found}, so that this is no calibration of the machine; check the "
        "signs and units of voltage and speed, and the machine file"
    )


def doubtful(error: LdtError, machine: Machine, experiments: Sequence[Experiment]) -> LdtError:
    """A failed fit, with the experiment that speaks for a recording in another unit, if one does.

    Args:
        machine: as its file knows it.
    """
    told = ((e.number, doubt(machine, e)) for e in experiments)
    found = next((f"experiment {number}: {words}" for number, words in told if words), "")
    if error.exit_code != LdtError.exit_code:
        return error
    if question := swapped(experiments):
        return LdtError(f"{error}; {question}")
    if not found:
        return error
    again = "if it is the unit, import again with it (ldt import --speed NAME:rpm)"
    return LdtError(f"{error}; {found}; {again}")


def recording_notes(machine: Machine, experiments: Sequence[Experiment]) -> list[str]:
    """Sentences where the sensor failed, columns may be swapped, or the voltage never changes."""
    level, (_, failed) = _constant(experiments), sound(machine, experiments)
    told = [f"Do not trust these values: {failed}."] if failed else []
    if question := swapped(experiments):
        told.append(f"Do not trust these values: {question}")
    if level is not None:
        told.append(f"The voltage was {level:.4g} V throughout: record steps to determine more.")
    return told


def nothing_determined(experiments: Sequence[Experiment]) -> str:
    """Why nothing can be fitted."""
    level = _constant(experiments)
    why = (
        f"the voltage was {level:.4g} V throughout"
        if level is not None
        else "the free parameters hardly move the speed, or not apart from each other"
    )
    return (
        f"nothing to calibrate: these recordings determine none of the free parameters ({why}); "
        "record steps of the voltage, or name others with --free"
    )


def _constant(experiments: Sequence[Experiment]) -> float | None:
    volts = np.concatenate([e.voltage for e in experiments])
    return float(volts.mean()) if np.ptp(volts) <= CONSTANT_RANGE * np.abs(volts).max() else None
