"""An advice in sentences for the people at the machine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ldt_core.advice.bands import CaptureBand
from ldt_core.advice.experiment_design import DesignedExperiment
from ldt_core.advice.machine_estimate import MachineEstimate
from ldt_core.advice.margins import Margins
from ldt_core.base.sentences import listed, spoken
from ldt_core.physics.steady_state import has_foundation

NO_FOUNDATION = "No advice on voltages to avoid: the model has no foundation."
MM = 1e3  # in a m


def about_bands(
    belief: MachineEstimate,
    model: str,
    bands: Sequence[CaptureBand],
    margins: Margins,
    limit: float,
) -> str:
    """Which voltages to avoid, why, and how to come past; or why there is no such advice."""
    values = belief.values
    if not has_foundation(values):
        return NO_FOUNDATION
    if not values["e"]:
        who = f"the {model} model and {belief.source} know" if model else f"{belief.source} knows"
        return f"No advice on voltages to avoid: {who} no eccentricity."
    known = f"e = {values['e'] * MM:.3g} mm ({belief.source})"
    if not bands:
        first = margins.first_fold
        beyond = f" It can be from {first * MM:.3g} mm on." if first else ""
        return f"No voltage to avoid: with {known} the rotor is captured nowhere.{beyond}"
    shown = listed(f"{b.low:.3g} to {min(b.high, limit):.3g} V" for b in bands)
    speeds = listed(f"{b.held[1]:.3g}" for b in bands)
    words = (
        f"Do not hold {shown}: with {known} the rotor may be captured there at up to {speeds} "
        "rad/s. Step across, and come down to a faster speed from above."
    )
    stuck = [b for b in bands if b.high > limit]
    if stuck:
        words += (
            f" At the limit of {limit:.3g} V it does not come past {stuck[0].held[1]:.3g} rad/s "
            "for certain."
        )
    elif margins.no_way_through:
        words += f" It comes through up to e = {margins.no_way_through * MM:.3g} mm."
    return words


def about_left_out(belief: MachineEstimate) -> str:
    """What else acts and is not counted in."""
    if not belief.left_out:
        return ""
    return f"Not counted in: {listed(map(spoken, belief.left_out))}, which shifts these voltages."


def about_experiment(number: int, share: float, seconds: float) -> str:
    """Where one experiment was."""
    if not share:
        return ""
    words = f"Experiment {number} was in or near them for {share:.0%} of its time"
    return f"{words}, and captured for {seconds:.3g} s." if seconds else f"{words}."


def about_limit(left: float, limit: float) -> str:
    """What is left of the voltage."""
    return f"{left:.3g} V are left to the limit of {limit:.3g} V."


def about_next(design: DesignedExperiment | None, asked: str) -> str:
    """The next experiment."""
    if asked:
        return f"Next, as the diagnosis asks: {asked}."
    if design is None:
        return ""
    return (
        f"Most would be learned from {design.name}: {design.bits:.2g} bits, on "
        f"{design.sharpens} above all."
    )


def band_values(bands: Sequence[CaptureBand]) -> Mapping[str, float]:
    """Bands by dotted name, from 1."""
    found = {}
    for i, band in enumerate(bands, start=1):
        found[f"band.{i}.low"] = band.low
        found[f"band.{i}.high"] = band.high
        found[f"band.{i}.held_from"], found[f"band.{i}.held_to"] = band.held
        found[f"band.{i}.free_from"], found[f"band.{i}.free_to"] = band.free
    return found
