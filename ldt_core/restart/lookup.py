"""What a checkpoint names and does not hold: read again from the recording, found by its place."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from ldt_core.base.errors import RecordingError
from ldt_core.base.experiment import Adaptation, DiagnosisRecord, Experiment, ModelRecord
from ldt_core.machine.machine_file import Machine
from ldt_core.models import restore_model
from ldt_core.models.base import Model
from ldt_core.recording.bag import Bag
from ldt_core.recording.step_search import ANCHOR, StepSearch
from ldt_core.twin.stage import WINDOW, RecordedStep

#: Experiments after which a diagnosis may still come, as many as wait for one.
DIAGNOSIS_DELAY = 1000
#: Experiments before the place of a number at which reading begins, tried in turn.
MARGINS = (0, 2 * WINDOW)


class Lookup:
    """Finds experiments, models and diagnoses of a run.

    Args:
        steps: the last ones up to the checkpoint's, in which most of it is.
    """

    def __init__(
        self, bag: Bag, machine: Machine, settings: Mapping[str, Any], steps: Iterable[RecordedStep]
    ) -> None:
        self._bag, self._machine, self._settings = bag, machine, settings
        #: The last recorded steps, the checkpoint's own the last one.
        self.steps = list(steps)
        self._experiments = {_key(s.experiment): s.experiment for s in self.steps}

    def experiment(self, number: Any, start: Any) -> Experiment:
        """The one with this number and start."""
        key = (_whole(number), float(start))
        if key not in self._experiments:
            found = self._near("experiment", key[0], lambda e: _key(e) == key, WINDOW)
            self._experiments[key] = found
        return self._experiments[key]

    def model(self, version: Any) -> Model:
        """The model of a version."""
        version = _whole(version)
        recorded = (s.model for s in reversed(self.steps))
        record = next((m for m in recorded if m is not None and m.version == version), None)
        if record is None:
            record = self._of_version(version)
        return restore_model(record, self._machine, self._settings)

    def diagnosis(self, number: Any) -> DiagnosisRecord:
        """The one made at an experiment."""
        number = _whole(number)
        for step in self.steps:
            if step.diagnosis is not None and step.diagnosis.experiment == number:
                return step.diagnosis
        found: DiagnosisRecord = self._near(
            "diagnosis", number, lambda d: d.experiment == number, DIAGNOSIS_DELAY
        )
        return found

    @functools.cached_property
    def _search(self) -> StepSearch:
        return StepSearch(self._bag)

    def _near(self, topic: str, number: int, wanted: Callable[[Any], bool], reach: int) -> Any:
        """A record about an experiment, of which several may have the number."""
        for margin in MARGINS:
            address = self._search.of_number(number - margin)
            for name, data in self._from(address, topic):
                if isinstance(data, Adaptation):
                    if data.experiment > number + reach:
                        break
                elif name == topic and wanted(data):
                    return data
        raise RecordingError(f"{self._bag.path}, {topic}", f"experiment {number}", "none")

    def _of_version(self, version: int) -> ModelRecord:
        for margin in MARGINS:
            address = self._search.of_version(version)
            if margin:
                first = self._search.next(address)
                address = self._search.of_number(first.number - margin) if first else 0
            for _, data in self._from(address, "model"):
                if isinstance(data, ModelRecord):
                    if data.version == version:
                        return data
                elif data.model_version > version:
                    break
        raise RecordingError(f"{self._bag.path}, model", f"version {version}", "none")

    def _from(self, address: int, topic: str) -> Iterable[tuple[str, Any]]:
        """Records of a topic, and the adaptations beside them, from an address on."""
        raws = self._bag.messages(topic, ANCHOR, begin=self._search.begin(address))
        for raw, record in self._bag.usable(raws):
            yield raw.topic.rpartition("/")[2], record


def _key(experiment: Experiment) -> tuple[int, float]:
    return experiment.number, experiment.start


def _whole(number: Any) -> int:
    if type(number) is not int or number < 0:
        raise ValueError(f"expected a whole number from 0, got {number!r:.40}")
    return number
