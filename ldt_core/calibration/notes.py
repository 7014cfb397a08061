"""What a calibration says to a person, a sentence for each thing to know."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ldt_core.base.experiment import Experiment
from ldt_core.base.sentences import listed
from ldt_core.calibration.calibration import Calibration
from ldt_core.calibration.coordinates import SEARCH_FACTOR, Array, Coordinates
from ldt_core.calibration.identifiability import Identifiability

NOT_NAMED = "not freed"
AS_ASKED = "as asked"
OPTIONAL = "freed by name only"
VAGUE = "too uncertain"
GROUPED = "not told apart"
SILENT = "does not show"
SUGGEST_FREE = "free other parameters or check the machine file"
NOT_CONVERGED = (
    "The fit had not quite settled when it was stopped; the values may still move a little."
)
MOST_NOISE_RATIO = 5.0  # of a residual to its white part: beyond, it is not the sensor's noise
CONSTANT_RANGE = 0.02  # of the largest voltage: a smaller range excites nothing


def notes(calibration: Calibration, seen: Identifiability, white: float, same: float) -> list[str]:
    """Sentences on what is determined and what is not, and on the errors."""
    said = []
    values = calibration.nominal.parameters
    units = {p.name: p.unit for p in calibration.nominal.model.parameters}
    for name, exponents in seen.groups.items():
        moves = ", ".join(f"{n} {c:+.2g} %" for n, c in exponents.items())
        said.append(
            f"{listed([name, *exponents])} cannot all be told apart: {name} was kept at "
            f"{values[name]:.4g} {units[name]}; for each per cent it is larger in truth: {moves}."
        )
    if seen.products:
        said.append(f"What is determined: {', '.join(seen.products)}.")
    if seen.groups and not any(e.ci95 is None for e in calibration.estimates):
        said.append("The intervals hold if what was kept is right.")
    if seen.silent:
        said.append(
            f"{listed(seen.silent)} {'do' if len(seen.silent) > 1 else 'does'} not show in these "
            f"recordings and {'keep their values' if len(seen.silent) > 1 else 'keeps its value'}."
        )
    for name, reason in calibration.fixed.items():
        if reason == VAGUE:
            said.append(
                f"{name} was kept at {values[name]:.4g} {units[name]}: its 95 % interval would "
                "be wider than a factor of 1.6 either way."
            )
    left = calibration.noise["speed"]
    if left > MOST_NOISE_RATIO * white:
        said.append(
            f"What is left ({left:.3g} rad/s) is smooth, not noise (about {white:.2g} rad/s): the "
            "machine has something that the physics lacks, and the calibrated values imitate it as "
            "well as they can; the intervals do not cover that."
        )
    before, after = calibration.errors["fit"]
    if after.rmse > same * before.rmse:
        said.append("The file's values already fit: the free-run error hardly went down.")
    if "held_out" in calibration.errors:
        before, after = calibration.errors["held_out"]
        if after.rmse > before.rmse / same:
            said.append(
                f"Beware: on the experiments held out the free-run error went up, from "
                f"{before.rmse:.4g} to {after.rmse:.4g} rad/s."
            )
    return said


def bounds(coordinates: Coordinates, z: Array) -> list[str]:
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


def excitation(experiments: Sequence[Experiment]) -> list[str]:
    """A sentence when the voltage never changes."""
    level = _constant(experiments)
    if level is None:
        return []
    return [f"The voltage was {level:.4g} V throughout: record steps to determine more."]


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
