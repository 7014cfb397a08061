"""How many samples of recordings are held in memory, by what their files hold packed.

A chunk has a limit, and so has a message; a small file may have many of either.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Literal

from ldt_core.base.errors import RecordingError
from ldt_core.base.experiment import Experiment, Prediction, Samples
from ldt_core.recording.bag import Bag
from ldt_core.recording.mcap_records import MOST_RATIO

if TYPE_CHECKING:
    from ldt_core.machine.machine_file import Machine

FREE_BYTES = 200_000_000  # of samples out of files of any size: three of the longest experiments


class HeldSamples:
    """Reads what somebody keeps, of all recordings together up to a limit."""

    def __init__(self) -> None:
        self._packed: dict[Bag, int] = {}  # bytes of the files
        self._held = 0  # bytes of the samples in memory

    def of(self, bag: Bag, machine: Machine | None = None) -> Iterator[Experiment]:
        """Experiments of one more recording, as `Bag.experiments`.

        Raises:
            RecordingError: also where all together unpack to more samples than such files hold.
            ExperimentError: as there.
        """
        for read in bag.experiments(machine):
            self._hold(bag, read.voltage, read.speed, read.current)
            yield read

    def predictions(
        self, bag: Bag, name: Literal["prediction", "original_prediction"]
    ) -> Iterator[Prediction]:
        """Predictions of a topic, as `Bag.records`.

        Raises:
            RecordingError: as `of`.
        """
        for read in bag.records(name):
            self._hold(bag, read.speed, read.speed_std)
            yield read

    def _hold(self, bag: Bag, *channels: Samples | None) -> None:
        if bag not in self._packed:
            self._packed[bag] = sum(file.stat().st_size for file in bag.storage.files)
        packed = sum(self._packed.values())
        most = max(FREE_BYTES, MOST_RATIO * packed)
        self._held += sum(c.nbytes for c in channels if c is not None)
        if self._held > most:
            files = f"samples of at most {most} bytes in files of {packed}"
            raise RecordingError(bag.path, files, "more")
