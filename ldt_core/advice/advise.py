"""An advice: bands, margins and the next experiment, from what is believed of the machine."""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np

from ldt_core.advice.advice_sentences import (
    about_bands,
    about_experiment,
    about_left_out,
    about_limit,
    about_next,
    band_values,
)
from ldt_core.advice.bands import captured_seconds, in_bands, uncertain_bands, voltage_bands
from ldt_core.advice.experiment_design import least_covered, most_informative
from ldt_core.advice.machine_estimate import MachineEstimate
from ldt_core.advice.margins import margins
from ldt_core.base.experiment import AdviceRecord, DiagnosisRecord, Experiment, ModelRecord, Scalar
from ldt_core.machine.machine_file import Machine


def advise(
    machine: Machine,
    belief: MachineEstimate,
    experiments: Sequence[Experiment] = (),
    model: ModelRecord | None = None,
    diagnosis: DiagnosisRecord | None = None,
) -> AdviceRecord:
    """Bands, margins, and the next experiment.

    Args:
        machine: its limits.
        belief: its parameters as they are taken to be.
        experiments: recent ones, the last one last; it is judged.
        model: in force.
        diagnosis: the last one.

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
    sentences = (
        about_bands(belief, model.kind if model else "", bands, left, limit),
        about_left_out(belief) if bands else "",
        about_experiment(number, share, seconds),
        about_limit(spare, limit) if experiments else "",
        about_next(design, str(asked)),
    )
    return AdviceRecord(
        number,
        model.version if model else 0,
        share > 0,
        " ".join(s for s in sentences if s),
        told,
    )
