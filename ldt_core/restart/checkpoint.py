"""What a stage has come to know, kept beside the recording for a faster restart.

The recording stays the truth. A checkpoint holds numbers, and names the experiments, models and
diagnoses that are read from the recording again. It counts only if it is whole, under the run's
key, and the recording has that very step complete; else the recording alone decides.
"""

from __future__ import annotations

import functools
import hashlib
import json
import math
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from ldt_core.base import result_files
from ldt_core.base.code_version import code_version
from ldt_core.base.digest import json_digest
from ldt_core.base.errors import RecordingError
from ldt_core.base.experiment import Adaptation, DiagnosisRecord, Experiment, ModelRecord
from ldt_core.machine.machine_file import Machine
from ldt_core.models import restore_model
from ldt_core.models.base import Model
from ldt_core.recording.bag import Bag
from ldt_core.recording.message_subject import agree
from ldt_core.recording.step_search import ANCHOR, StepSearch
from ldt_core.twin.stage import WINDOW, RecordedStep

FORMAT = "ldt-checkpoint-2"
#: Enough that no two experiments of all that there are share it.
FINGERPRINT_DIGITS = 16
#: Files of a stage, which are written in turn: what is recorded may end before the newest.
SLOTS = 2
#: Largest file [bytes]; a detector that has seen much takes 10 kB.
MOST_BYTES = 4_000_000
#: Largest whole number, as JSON's readers agree on.
LARGEST_NUMBER = 2**53

#: Experiments after which a diagnosis may still come, as many as wait for one.
DIAGNOSIS_DELAY = 1000
#: Experiments before the place of a number at which reading begins, tried in turn.
MARGINS = (0, 2 * WINDOW)


class Checkpoint(NamedTuple):
    """What a file says.

    Args:
        experiment: number of the last experiment that the stage has dealt with.
        start: when that began [s since the epoch].
        speed: fingerprint of what was measured in it: simulated runs may begin at the same time.
    """

    experiment: int
    start: float
    speed: str
    state: dict[str, Any]


def fingerprint(experiment: Experiment) -> str:
    """Of the measured speed."""
    return hashlib.sha256(experiment.speed.tobytes()).hexdigest()[:FINGERPRINT_DIGITS]


class CheckpointFiles:
    """The files of one stage."""

    def __init__(
        self, folder: str | Path, stage: str, key: Any, log: Callable[[str], None]
    ) -> None:
        self.folder, self._log = Path(folder), log
        #: All that there may be.
        self.paths = [self.folder / f"{stage}.{slot}.checkpoint" for slot in range(SLOTS)]
        self._key, self._version = json_digest(key), json_digest(code_version())
        self._slot = 0

    def read(self) -> list[Checkpoint]:
        """Those that are whole and of this run, the newest first; what is not is logged.

        Of another version there is nothing to log: whoever goes on with such a run is told.
        """
        found = []
        for slot, file in enumerate(self.paths):
            try:
                parsed = self._parsed(file)
                if parsed is not None:
                    found.append((parsed, slot))
            except FileNotFoundError:
                continue
            except (OSError, ValueError, TypeError, KeyError, RecursionError) as error:
                self._log(f"{file} is ignored, the recording decides: {error}")
        # Of a counter that began anew the newest has not the highest number.
        found.sort(key=lambda pair: (pair[0].start, pair[0].experiment), reverse=True)
        if found:  # the next one takes the older one's place
            self._slot = (found[0][1] + 1) % SLOTS
        return [checkpoint for checkpoint, _ in found]

    def write(self, checkpoint: Checkpoint) -> None:
        """Whole or not at all, and on the medium; where there is no recording yet, nothing.

        Raises:
            OSError: it cannot be written.
            TypeError, ValueError: a state that is not in JSON types, or too large.
        """
        if not self.folder.is_dir():
            return
        content = {"format": FORMAT, "key": self._key, "version": self._version}
        content |= checkpoint._asdict()
        text = json.dumps({**content, "digest": json_digest(content)}, allow_nan=False)
        if len(text) > MOST_BYTES:
            raise ValueError(f"expected at most {MOST_BYTES} bytes, got {len(text)}")
        result_files.write(self.paths[self._slot], text, sync=True)
        self._slot = (self._slot + 1) % SLOTS

    def _parsed(self, file: Path) -> Checkpoint | None:
        """None where another version wrote it."""
        with file.open("rb") as stream:
            data = stream.read(MOST_BYTES + 1)
        if len(data) > MOST_BYTES:
            raise ValueError(f"expected at most {MOST_BYTES} bytes")
        content = json.loads(data)
        if not isinstance(content, dict) or content.pop("digest", None) != json_digest(content):
            raise ValueError("it is damaged")
        if content.get("format") != FORMAT:
            raise ValueError("it is of another version")
        if content.get("version") != self._version:
            return None
        if content.get("key") != self._key:
            raise ValueError("it is of another run")
        number, start, speed, state = (content[name] for name in Checkpoint._fields)
        if type(number) is not int or not 0 < number < LARGEST_NUMBER:
            raise ValueError("its experiment is no number")
        if type(start) is not float or not math.isfinite(start) or not isinstance(state, dict):
            raise ValueError("its start or its state is none")
        return Checkpoint(number, start, speed, state)


class Lookup:
    """Finds experiments, models and diagnoses of a run."""

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

    def sent(self, number: int, time: float | None) -> Experiment:
        """The one of this number that begins or ends then [s since the epoch], None for any.

        Raises:
            RecordingError: it is not there.
        """

        def wanted(one: Experiment) -> bool:
            said = time is None or agree(one.start, time) or agree(one.end, time)
            return one.number == number and said

        if self._bag.topic(ANCHOR) is not None:
            found: Experiment = self._near("experiment", number, wanted, WINDOW)
            return found
        for one in self._bag.records("experiment"):  # no step is complete yet
            if wanted(one):
                return one
        raise RecordingError(f"{self._bag.path}, experiment", f"experiment {number}", "none")

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
