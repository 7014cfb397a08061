"""Beside the loop: when a running machine gives rise to an advice."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any

from ldt_core.advice.advise import advise
from ldt_core.advice.machine_estimate import estimate_machine
from ldt_core.base.errors import reason_of
from ldt_core.base.experiment import AdviceRecord, DiagnosisRecord, Experiment, ModelRecord
from ldt_core.base.settings import resolve
from ldt_core.base.threads import one_thread
from ldt_core.machine.machine_file import Machine
from ldt_core.twin.stage import Archive, RecordedStep

#: Experiments that count for what has been learned already.
RECENT_EXPERIMENTS = 6


class Advisor:
    """Advises people; nothing in the twin or the machine listens.

    At most one advice in `advice_every` experiments. It follows from the experiments, models and
    diagnoses that it is given, in their order, and from nothing else.


    Raises:
        OptionError: a parameter outside its range.
    """

    def __init__(self, machine: Machine, settings: Mapping[str, Any]) -> None:
        own = {n: v for n, v in settings.items() if n in resolve({}, "advice")}
        given = resolve(own, "advice")
        self.machine = machine
        self.every: int = given["advice_every"]
        self.trouble = ""
        self._recent: deque[Experiment] = deque(maxlen=RECENT_EXPERIMENTS)
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
        except Exception as error:
            self.trouble = reason_of(error)
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
        """Take back a state, before any step here."""
        last, at = state["last"], state["diagnosis"]
        if not (last is None or type(last) is int) or len(state["recent"]) > RECENT_EXPERIMENTS:
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
