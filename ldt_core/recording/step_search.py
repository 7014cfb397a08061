"""Where in a recording an experiment is, however long the recording, without reading the rest.

Steps are recorded in the order of their numbers, but for what is in the queues of topics at one
time. So the place of one is found as a word is in a dictionary: open it somewhere, look at the
number there, and go on in the half in which it must be. No index is needed, which a file that is
being written does not have.
"""

from __future__ import annotations

import bisect
import contextlib
import itertools
from collections.abc import Callable, Iterator
from typing import IO, NamedTuple

from mcap.opcode import Opcode
from mcap.records import Message

from ldt_core.base.errors import BadInput, RecordingError
from ldt_core.base.experiment import Adaptation
from ldt_core.recording.bag import Bag
from ldt_core.recording.mcap_reader import TolerantMcapReader
from ldt_core.recording.mcap_records import (
    DAMAGE_ERRORS,
    HEAD,
    INDEX,
    ByteStream,
    agrees,
    opened,
    reason,
)
from ldt_core.recording.storage import RawMessage, is_mcap

SEARCH_BYTES = 1 << 16  # within which places are not told apart: an experiment or a few
ANCHOR = "adaptation"  # topic that is looked at: one a step, small, and it names the model


class FoundStep(NamedTuple):
    """A step that was found somewhere.

    Args:
        address: of the chunk that it is in.
        number: of its experiment.
        version: of the model in force after it.
    """

    address: int
    number: int
    version: int


class StepSearch:
    """Finds steps in a recording by bytes; an address counts those of all files in a row.

    Args:
        bag: the recording; of MCAP files that are not compressed as a whole.

    Raises:
        RecordingError: it has no adaptations.
    """

    def __init__(self, bag: Bag) -> None:
        self._bag = bag
        self._topic = bag.topic(ANCHOR) or ""
        if not self._topic:
            raise RecordingError(bag.path, "adaptations", "none")
        sizes = (file.stat().st_size for file in bag.storage.files)
        self._bases = list(itertools.accumulate(sizes, initial=0))
        #: Behind the last byte.
        self.end = self._bases[-1]
        self._seen: dict[int, FoundStep | None] = {}
        self._files: dict[int, tuple[TolerantMcapReader, set[int]]] = {}

    def begin(self, address: int) -> tuple[int, int]:
        """File and byte of an address, for `Storage.messages`."""
        index = max(min(bisect.bisect_right(self._bases, address), len(self._bases) - 1) - 1, 0)
        return index, address - self._bases[index]

    def of_number(self, number: int) -> int:
        """An address before the adaptation of this experiment and of all later ones."""
        return self._before(number, lambda anchor: anchor.number)

    def of_version(self, version: int) -> int:
        """An address before the adaptation that brought this model version into force."""
        return self._before(version, lambda anchor: anchor.version)

    def next(self, address: int) -> FoundStep | None:
        """The first adaptation in the chunks that begin at an address or later.

        Raises:
            RecordingError: damage on the way there.
        """
        if address not in self._seen:
            self._seen[address] = next(self.all_from(address), None)
        return self._seen[address]

    def all_from(self, address: int) -> Iterator[FoundStep]:
        """The adaptations in the chunks that begin at an address or later; raises as `next`."""
        index, at = self.begin(address)
        while index < len(self._bases) - 1:
            try:
                yield from self._in_file(index, at)
            except DAMAGE_ERRORS as error:
                file = self._bag.storage.files[index]
                raise RecordingError(file, "a file without damage", reason(error)) from None
            index, at = index + 1, 0

    def _before(self, wanted: int, key: Callable[[FoundStep], int]) -> int:
        low, high = 0, self.end
        below = [k.address for k in self._seen.values() if k is not None and key(k) < wanted]
        low = max(below, default=low)
        above = [a for a, k in self._seen.items() if a > low and (k is None or key(k) >= wanted)]
        high = min(above, default=high)
        while high - low > SEARCH_BYTES:
            middle = (low + high) // 2
            found = self.next(middle)
            if found is not None and key(found) < wanted:
                low = max(found.address, middle)
            else:
                high = middle
        return low

    def _in_file(self, index: int, at: int) -> Iterator[FoundStep]:
        file = self._bag.storage.files[index]
        if index not in self._files:
            if not is_mcap(file):
                raise ValueError("no MCAP file that can be read from the middle")
            mcap = self._bag.storage.mcap(file)
            channels = mcap.first_channels()
            self._files[index] = mcap, {n for n, d in channels.items() if d[0].topic == self._topic}
        mcap, wanted = self._files[index]
        size = self._bases[index + 1] - self._bases[index]
        with mcap.path.open("rb") as plain:
            for place, body in _chunks_with(wanted, plain, at, size):
                for record in opened(body):
                    if isinstance(record, Message) and record.channel_id in wanted:
                        with contextlib.suppress(BadInput):  # sent by somebody, used by nobody
                            yield self._anchor(self._bases[index] + place, record)

    def _anchor(self, address: int, message: Message) -> FoundStep:
        kind = self._bag.topics[self._topic]
        raw = RawMessage(self._topic, kind, message.log_time, message.data)
        record = self._bag.decoded(raw, 1)
        assert isinstance(record, Adaptation)
        return FoundStep(address, record.experiment, record.model_version)


def _chunks_with(
    channels: set[int], plain: IO[bytes], at: int, size: int
) -> Iterator[tuple[int, bytes]]:
    """(place, content) of the chunks from a byte on that hold a message of these channels.

    The others are passed over by what the file says behind each chunk.
    """
    place = ByteStream(plain, size).find_chunk(at)
    chunk: tuple[int, int] | None = None
    while place is not None and place + HEAD.size <= size:
        plain.seek(place)
        opcode, length = HEAD.unpack(plain.read(HEAD.size))
        behind = place + HEAD.size + length
        if behind > size:
            return  # it is being written
        if opcode == Opcode.CHUNK:
            chunk = place, length
        elif opcode != Opcode.MESSAGE_INDEX:
            return
        elif chunk is not None and INDEX.unpack(plain.read(INDEX.size))[0] in channels:
            plain.seek(chunk[0] + HEAD.size)
            body = plain.read(chunk[1])
            if not agrees(body, len(body)):
                raise ValueError(f"no chunk at byte {chunk[0]}")
            yield chunk[0], body
            chunk = None
        place = behind
