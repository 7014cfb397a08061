"""Which messages a recording has already: a node that was started again says some once more."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from collections.abc import Set as AbstractSet
from pathlib import Path
from typing import Self

from ldt_core.base.bounded import forget_oldest
from ldt_core.recording.message_subject import Subject, said_of
from ldt_core.recording.messages import content
from ldt_core.recording.storage import RawMessage, Storage

MAX_MESSAGES = 2000  # remembered; several times what a topic keeps for late joiners
MAX_RARE = 100  # messages of rare topics that may come again, ten times what a topic keeps of them
RARE = ("model", "diagnosis", "advice")
ENOUGH = 300  # of a topic at the end of a recording: three times what a topic keeps
FIRST_TAIL, LONGEST_TAIL = 2**20, 2**28  # bytes of that end


class DuplicateFilter:
    """The last messages, and what the last ones of a recording that goes on are about.

    A number alone tells no repetition: a counter that began anew comes by it again, at another
    time.

    Args:
        before: topic → experiments, with a time (`said_of`), of which a message is recorded.
        known: (topic, message type, CDR bytes) of further messages in it.
    """

    def __init__(
        self,
        before: Mapping[str, AbstractSet[Subject]] | None = None,
        known: Iterable[tuple[str, str, bytes]] = (),
    ) -> None:
        self._before = dict(before or {})
        self._last: dict[bytes, None] = {}
        for message in known:
            self._take(*message)

    @classmethod
    def of(cls, path: Path) -> Self:
        """Of a recording that goes on: its folder."""
        storage = Storage(path)
        rare = [t for t in storage.topics if t.rpartition("/")[2] in RARE]
        last = storage.last(rare, MAX_RARE)
        before = _tail(storage, [t for t in storage.topics if t not in rare])
        before |= _subjects(last)
        models = ((r.topic, r.kind, r.data) for r in last if r.topic.endswith("model"))
        return cls(before, models)

    def seen(self, topic: str, kind: str, data: bytes) -> bool:
        """Whether this message has come before; it has from now on.

        Args:
            topic: absolute.
            kind: message type.
            data: CDR bytes.
        """
        before = self._before.get(topic)
        if before and said_of(topic, kind, data) in before:
            return True
        return not self._take(topic, kind, data)

    def _take(self, topic: str, kind: str, data: bytes) -> bool:
        key = topic.encode()[-64:]
        digest = hashlib.blake2b(content(kind, data), digest_size=16, key=key).digest()
        if digest in self._last:
            return False
        self._last[digest] = None
        forget_oldest(self._last, MAX_MESSAGES)
        return True


def _tail(storage: Storage, topics: list[str]) -> dict[str, set[Subject]]:
    """What the last messages of topics are about."""
    back = FIRST_TAIL
    while True:
        begin = storage.before_end(back)
        found = _subjects(storage.messages(topics, begin))
        enough = any(len(about) >= ENOUGH for about in found.values())
        if enough or begin == (0, 0) or back >= LONGEST_TAIL:
            return found
        back *= 4


def _subjects(raws: Iterable[RawMessage]) -> dict[str, set[Subject]]:
    """Topic → what its messages are about."""
    found: dict[str, set[Subject]] = {}
    for raw in raws:
        about = said_of(raw.topic, raw.kind, raw.data)
        if about is not None:
            found.setdefault(raw.topic, set()).add(about)
    return found
