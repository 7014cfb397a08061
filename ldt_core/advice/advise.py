"""An advice: bands, margins and the next experiment, from what is believed of the machine."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

import numpy as np

from ldt_core.advice.bands import (
    CaptureBand,
    Margins,
    captured_seconds,
    in_bands,
    margins,
    uncertain_bands,
    voltage_bands,
)
from ldt_core.advice.experiment_design import DesignedExperiment, least_covered, most_informative
from ldt_core.advice.machine_estimate import MachineEstimate
from ldt_core.base.experiment import AdviceRecord, DiagnosisRecord, Experiment, ModelRecord, Scalar
from ldt_core.base.sentences import listed, spoken
from ldt_core.machine.machine_file import Machine
from ldt_core.physics.steady_state import has_foundation

NO_FOUNDATION = "No advice on voltages to avoid: the model has no foundation."
MM = 1e3  # in a m


def advise(
    machine: Machine,
    belief: MachineEstimate,
    experiments: Sequence[Experiment] = (),
    model: ModelRecord | None = None,
    diagnosis: DiagnosisRecord | None = None,
) -> AdviceRecord:
    """Bands, margins, and the next experiment.

    Args:
        experiments: recent ones, the last one last; it is judged.

    Returns:
        A warning where the last experiment was in a band or near one.
    """
    values = belief.values
    limit = max(map(abs, machine.voltage_limits))
    bands = voltage_bands(values, limit)
    left = margins(values, limit)
    # What was made before the first that the model has learned from was another machine's.
    since = min(model.trained_on, default=0) if model else 0
    design = most_informative(machine, values, [e for e in experiments if e.number >= since])
    uncovered = least_covered(machine, experiments)
    asked = (diagnosis.values.get("next_experiment.why") or "") if diagnosis else ""
    told: dict[str, Scalar] = {
        "machine": machine.name,
        "source": belief.source,
        "left_out": ",".join(belief.left_out),
        "eccentricity": values.get("e"),
        "bands": len(bands),
        **band_values(bands),
        "margin.eccentricity_of_first_band": left.first_fold,
        "margin.eccentricity_of_no_way_through": left.no_way_through,
        "margin.voltage_limit": limit,
    }
    number, share, seconds, spare = 0, 0.0, 0.0, limit
    if experiments:
        last = experiments[-1]
        number = last.number
        share = float(np.mean(in_bands(last.voltage, uncertain_bands(values, limit))))
        seconds = captured_seconds(values, bands, last) if bands else 0.0
        spare = max(limit - float(np.abs(last.voltage).max()), 0.0)
        told |= {"experiment.share_in_or_near": share, "experiment.captured": seconds}
        told |= {"margin.voltage": spare}
    if uncovered is not None:
        told |= {"covered_least.from": uncovered[0], "covered_least.to": uncovered[1]}
    told["next.why"] = asked or None
    if design is not None:
        told |= {"next.name": design.name, "next.bits": design.bits, "next.on": design.sharpens}
        told |= {"next.levels": json.dumps(design.levels), "next.hold": design.hold}
    others = listed(map(spoken, belief.left_out)) if belief.left_out else ""
    sentences = (
        about_bands(belief, model.kind if model else "", bands, left, limit),
        f"Not counted in: {others}, which shifts these voltages." if bands and others else "",
        about_experiment(number, share, seconds),
        f"{spare:.3g} V are left to the limit of {limit:.3g} V." if experiments else "",
        about_next(design, str(asked)),
    )
    return AdviceRecord(
        number, model.version if model else 0, share > 0, " ".join(s for s in sentences if s), told
    )


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


def about_experiment(number: int, share: float, seconds: float) -> str:
    """Where one experiment was."""
    if not share:
        return ""
    words = f"Experiment {number} was in or near them for {share:.0%} of its time"
    return f"{words}, and captured for {seconds:.3g} s." if seconds else f"{words}."


def about_next(design: DesignedExperiment | None, asked: str) -> str:
    """The next experiment."""
    if asked:
        return f"Next, as the diagnosis asks: {asked}."
    if design is None:
        return ""
    return f"Most would be learned from {design.name}, about {design.sharpens} above all."


def band_values(bands: Sequence[CaptureBand]) -> Mapping[str, float]:
    """Bands by dotted name, from 1."""
    found = {}
    for i, band in enumerate(bands, start=1):
        found[f"band.{i}.low"] = band.low
        found[f"band.{i}.high"] = band.high
        found[f"band.{i}.held_from"], found[f"band.{i}.held_to"] = band.held
        found[f"band.{i}.free_from"], found[f"band.{i}.free_to"] = band.free
    return found
