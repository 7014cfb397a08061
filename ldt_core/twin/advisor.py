"""The advice of a running machine: when to give one, and what goes into it."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

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
from ldt_core.advice.machine_estimate import MachineEstimate, estimate_machine
from ldt_core.advice.margins import margins
from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import AdviceRecord, DiagnosisRecord, Experiment, ModelRecord, Scalar
from ldt_core.base.settings import resolve
from ldt_core.base.threads import one_thread
from ldt_core.machine.machine_file import Machine
from ldt_core.twin.stage import Archive, RecordedStep

RECENT = 6  # experiments that count for what has been learned already


class Advisor:
    """Advises people; nothing in the twin or the machine listens.

    At most one advice in `advice_every` experiments. It follows from the experiments, models and
    diagnoses that it is given, in their order, and from nothing else.

    Args:
        machine: as its file knows it.
        settings: parameters of the group advice; those that are missing have their defaults.

    Attributes:
        trouble: why the last advice came to nothing; empty when it came to something.

    Raises:
        OptionError: a parameter outside its range.
    """

    def __init__(self, machine: Machine, settings: Mapping[str, Any]) -> None:
        own = {n: v for n, v in settings.items() if n in resolve({}, "advice")}
        given = resolve(own, "advice")
        self.machine = machine
        self.every: int = given["advice_every"]
        self.trouble = ""
        self._recent: deque[Experiment] = deque(maxlen=RECENT)
        self._diagnosis: DiagnosisRecord | None = None
        self._last: int | None = None

    def informed(self, diagnosis: DiagnosisRecord) -> None:
        """Take in what a diagnosis has found."""
        self._diagnosis = diagnosis

    def step(self, experiment: Experiment, model: ModelRecord) -> AdviceRecord | None:
        """Take in one experiment and the model behind it; an advice, if one is due."""
        if not self._take(experiment):
            return None
        try:
            belief = estimate_machine(self.machine, model, self._diagnosis)
            with one_thread():
                return advise(self.machine, belief, list(self._recent), model, self._diagnosis)
        except (LdtError, np.linalg.LinAlgError, ArithmeticError) as error:
            self.trouble = str(error)
            return None

    def recall(self, step: RecordedStep) -> None:
        """Take over what a recorded step says, without advising anew."""
        if step.diagnosis is not None:
            self.informed(step.diagnosis)
        self._take(step.experiment)

    def state(self) -> dict[str, Any]:
        """Its state by the numbers of what is recorded; `return_to` takes it back."""
        return {
            "recent": [[e.number, e.start] for e in self._recent],
            "diagnosis": self._diagnosis.experiment if self._diagnosis else None,
            "last": self._last,
        }

    def return_to(self, state: Mapping[str, Any], archive: Archive) -> None:
        """Take back a state, before any step here.

        Raises:
            RecordingError: something that is not recorded; the advisor is then as it was.
            ValueError, TypeError, KeyError: no state; the same.
        """
        last, at = state["last"], state["diagnosis"]
        if not (last is None or type(last) is int) or len(state["recent"]) > RECENT:
            raise ValueError("last is no number, or there are more experiments than are kept")
        recent = [archive.experiment(number, start) for number, start in state["recent"]]
        # One that was being made when the state was taken is known by now.
        late = [s.diagnosis for s in archive.steps if s.diagnosis is not None]
        newer = late[-1] if late and (at is None or late[-1].experiment > at) else None
        diagnosis = newer or (None if at is None else archive.diagnosis(at))
        self._recent.clear()
        self._recent.extend(recent)
        self._diagnosis, self._last = diagnosis, last

    def _take(self, experiment: Experiment) -> bool:
        """Take in one experiment; whether an advice is due."""
        if self._recent and not self._recent[-1].same_period(experiment):
            self._recent.clear()
        self._recent.append(experiment)
        if self._last is not None and 0 <= experiment.number - self._last < self.every:
            return False
        self._last, self.trouble = experiment.number, ""
        return True


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
