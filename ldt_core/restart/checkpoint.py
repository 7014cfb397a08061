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
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from ldt_core.base import result_files

FORMAT = "ldt-checkpoint-1"
#: Files of a stage, which are written in turn: what is recorded may end before the newest.
SLOTS = 2
#: Largest file [bytes]; a detector that has seen much takes 10 kB.
MOST_BYTES = 4_000_000
#: Largest whole number, as JSON's readers agree on.
LARGEST_NUMBER = 2**53


class Checkpoint(NamedTuple):
    """What a file says.

    Args:
        experiment: number of the last experiment that the stage has dealt with.
        start: when that began [s since the epoch].
    """

    experiment: int
    start: float
    state: dict[str, Any]


class CheckpointFiles:
    """The files of one stage.

    Args:
        folder: of the recording; nothing is written while there is none.
        stage: role of its node.
        key: in JSON types, of what the state follows from beside the recording.
    """

    def __init__(
        self, folder: str | Path, stage: str, key: Any, log: Callable[[str], None]
    ) -> None:
        self.folder, self._log = Path(folder), log
        #: All that there may be.
        self.paths = [self.folder / f"{stage}.{slot}.checkpoint" for slot in range(SLOTS)]
        self._key = digest(key)
        self._slot = 0

    def read(self) -> list[Checkpoint]:
        """Those that are whole and of this run, the newest first; what is not is logged."""
        found = []
        for slot, file in enumerate(self.paths):
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

    def write(self, checkpoint: Checkpoint) -> None:
        """Whole or not at all, and on the medium; where there is no recording yet, nothing.

        Raises:
            OSError: it cannot be written.
            TypeError, ValueError: a state that is not in JSON types, or too large.
        """
        if not self.folder.is_dir():
            return
        content = {"format": FORMAT, "key": self._key, **checkpoint._asdict()}
        text = json.dumps({**content, "digest": digest(content)}, allow_nan=False)
        if len(text) > MOST_BYTES:
            raise ValueError(f"expected at most {MOST_BYTES} bytes, got {len(text)}")
        result_files.write(self.paths[self._slot], text, sync=True)
        self._slot = (self._slot + 1) % SLOTS

    def _parsed(self, file: Path) -> Checkpoint:
        with file.open("rb") as stream:
            data = stream.read(MOST_BYTES + 1)
        if len(data) > MOST_BYTES:
            raise ValueError(f"expected at most {MOST_BYTES} bytes")
        content = json.loads(data)
        if not isinstance(content, dict) or content.pop("digest", None) != digest(content):
            raise ValueError("it is damaged")
        if content.get("format") != FORMAT or content.get("key") != self._key:
            raise ValueError("it is of another run, or of another version")
        number, start, state = (content[name] for name in Checkpoint._fields)
        if type(number) is not int or not 0 < number < LARGEST_NUMBER:
            raise ValueError("its experiment is no number")
        if type(start) is not float or not math.isfinite(start) or not isinstance(state, dict):
            raise ValueError("its start or its state is none")
        return Checkpoint(number, start, state)


def digest(content: Any) -> str:
    """SHA-256 of a content in JSON types."""
    text = json.dumps(content, sort_keys=True, allow_nan=False, default=str)
    return hashlib.sha256(text.encode()).hexdigest()
