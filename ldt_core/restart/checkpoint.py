"""What a stage has come to know, kept beside the recording, so that a restart need not read it all.

The recording stays the truth. A checkpoint says what the recorded steps up to one of them make of a
stage: numbers, and which experiments, models and diagnoses it keeps, which are read from the
recording again. It counts only if it is whole, under the run's key, and the recording has that very
step complete; else the recording alone decides, and what comes out is the same.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import msgs_config
from ldt_core.base import result_files
from ldt_core.base.errors import LdtError, RecordingError
from ldt_core.base.experiment import Experiment
from ldt_core.machine.machine_file import Machine
from ldt_core.restart.lookup import Lookup
from ldt_core.restart.recorded_steps import opened, past_of
from ldt_core.restart.run_key import key_text
from ldt_core.twin.adaptor import ROLLED_BACK
from ldt_core.twin.recorded import WINDOW, Archive, RecordedStep

FORMAT = "ldt-checkpoint-1"
#: Files of a stage, which are written in turn: what is recorded may end before the newest.
SLOTS = 2
MOST_BYTES = 4_000_000  # of a file; a detector that has seen much takes 10 kB
DEEPEST = 2**53  # largest whole number, as JSON's readers agree on
#: Groups of parameters from which a stage's state follows, beside machine and versions.
GROUPS = {
    "detector": ("detector",),
    "adaptor": ("model", "adaptor", "diagnosis"),
    "diagnoser": ("diagnosis",),
    "advisor": ("model", "advice"),
}

Log = Callable[[str], None]
State = dict[str, Any]


class Checkpoint(NamedTuple):
    """What a file says.

    Args:
        experiment: number of the last experiment that the stage has dealt with.
        start: when that began [s since the epoch].
        state: as the stage gave it.
    """

    experiment: int
    start: float
    state: State


class Checkpoints:
    """The files of one stage.

    Args:
        folder: of the recording; nothing is kept while there is none.
        namespace: of the machine.
        machine: as the twin knows it.
        stage: one of `GROUPS`.
        settings: parameters of its groups at least; `checkpoint_every` says how often.
        log: told once what is ignored or cannot be kept.
    """

    def __init__(
        self,
        folder: str | Path,
        namespace: str,
        machine: Machine,
        stage: str,
        settings: Mapping[str, Any],
        log: Log = lambda sentence: None,
    ) -> None:
        self.folder, self.namespace, self.machine = Path(folder), namespace, machine
        self.stage, self.settings, self._log = stage, settings, log
        own = {n: settings[n] for n in msgs_config.parameters(*GROUPS[stage]) if n in settings}
        key = [key_text(machine), namespace.strip("/"), stage, own]
        self._key = _digest(key)
        self._every: int = settings.get("checkpoint_every", 0) if str(folder) else 0
        self._steps = 0
        self._slot = 0

    def files(self) -> list[Path]:
        """All that there may be."""
        return [self.folder / f"{self.stage}.{slot}.checkpoint" for slot in range(SLOTS)]

    def passed(self, experiment: Experiment, state: Callable[[], State | None]) -> None:
        """The stage has dealt with an experiment, for good; keep its state if it is time.

        Args:
            experiment: the last one.
            state: gives the stage's state, None where it cannot say it.
        """
        self._steps += 1
        if not self._every or self._steps < self._every:
            return
        self._steps = 0
        found = state()
        if found is None:
            self._every = 0
            return
        try:
            self._write(Checkpoint(experiment.number, experiment.start, found))
        except (OSError, TypeError, ValueError) as error:
            self._every = 0
            self._log(f"no checkpoints of the {self.stage} are kept: {error}")

    def read(self) -> list[Checkpoint]:
        """Those that are whole and of this run, the newest first; what is not is logged."""
        found = []
        for slot, file in enumerate(self.files()):
            try:
                found.append((self._parsed(file), slot))
            except FileNotFoundError:
                continue
            except (OSError, ValueError, TypeError, KeyError, RecursionError) as error:
                self._log(f"{file} is ignored, the recording decides: {error}")
        found.sort(key=lambda pair: pair[0].experiment, reverse=True)
        if found:  # the next one takes the older one's place
            self._slot = (found[0][1] + 1) % SLOTS
        return [checkpoint for checkpoint, _ in found]

    def returned(
        self, path: str | Path, return_to: Callable[[Mapping[str, Any], Archive], None]
    ) -> int:
        """Go back to the newest checkpoint that counts.

        Args:
            path: folder of the recording.
            return_to: makes the stage what a state says; where it raises, the stage is as it was.

        Returns:
            Number of the step after which the stage is now, 0 where it has to recall all of them.
        """
        for checkpoint in self.read() if self._every else ():
            try:
                return_to(checkpoint.state, self._lookup(path, checkpoint))
            except (LdtError, OSError, ValueError, TypeError, KeyError, AttributeError) as error:
                where = f"the checkpoint of the {self.stage} at {checkpoint.experiment}"
                self._log(f"{where} is ignored, the recording decides: {error}")
            else:
                return checkpoint.experiment
        return 0

    def _lookup(self, path: str | Path, checkpoint: Checkpoint) -> Lookup:
        """What leads to that step, which has to be in the recording and the very same."""
        before: deque[RecordedStep] = deque(maxlen=WINDOW)
        for step in past_of(path, self.namespace, self.machine, checkpoint.experiment):
            before.append(step)
            if step.experiment.number >= checkpoint.experiment:
                break
        bag = opened(path, self.namespace, listed=True)
        last = before[-1] if before else None
        if last is None or bag is None or last.experiment.number != checkpoint.experiment:
            raise RecordingError(path, f"step {checkpoint.experiment}, complete", "none")
        if last.experiment.start != checkpoint.start or ROLLED_BACK in last.adaptation.details:
            raise RecordingError(path, f"the same step {checkpoint.experiment}", "another")
        return Lookup(bag, self.machine, self.settings, before)

    def _write(self, checkpoint: Checkpoint) -> None:
        """Whole or not at all, and on the medium; where there is no recording yet, nothing."""
        if not self.folder.is_dir():
            return
        content = {"format": FORMAT, "key": self._key, **checkpoint._asdict()}
        text = json.dumps({**content, "digest": _digest(content)}, allow_nan=False)
        if len(text) > MOST_BYTES:
            raise ValueError(f"expected at most {MOST_BYTES} bytes, got {len(text)}")
        result_files.write(self.files()[self._slot], text, sync=True)
        self._slot = (self._slot + 1) % SLOTS

    def _parsed(self, file: Path) -> Checkpoint:
        with file.open("rb") as stream:
            data = stream.read(MOST_BYTES + 1)
        if len(data) > MOST_BYTES:
            raise ValueError(f"expected at most {MOST_BYTES} bytes")
        content = json.loads(data)
        if not isinstance(content, dict) or content.pop("digest", None) != _digest(content):
            raise ValueError("it is damaged")
        if content.get("format") != FORMAT or content.get("key") != self._key:
            raise ValueError("it is of another run, or of another version")
        number, start, state = (content[name] for name in Checkpoint._fields)
        if type(number) is not int or not 0 < number < DEEPEST:
            raise ValueError("its experiment is no number")
        if type(start) is not float or not math.isfinite(start) or not isinstance(state, dict):
            raise ValueError("its start or its state is none")
        return Checkpoint(number, start, state)


def _digest(content: Any) -> str:
    """SHA-256 of a content in JSON types."""
    text = json.dumps(content, sort_keys=True, allow_nan=False, default=str)
    return hashlib.sha256(text.encode()).hexdigest()
