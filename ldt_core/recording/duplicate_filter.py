"""Which messages a recording has already: a node that was started again says some once more."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Self

from ldt_core.base.bounded import forget_oldest
from ldt_core.recording.experiment_numbers import ExperimentNumbers, number_of
from ldt_core.recording.messages import content
from ldt_core.recording.storage import Storage

MAX_MESSAGES = 2000  # remembered; several times what a topic keeps for late joiners
MAX_MODELS = 100  # models of before that may come again, ten times what their topic keeps


class DuplicateFilter:
    """The last messages, and the experiments of those recorded before.

    Args:
        before: topic → experiments of which there is a message in a recording that goes on.
        known: (topic, message type, CDR bytes) of further messages in it.
    """

    def __init__(
        self,
        before: Mapping[str, ExperimentNumbers] | None = None,
        known: Iterable[tuple[str, str, bytes]] = (),
    ) -> None:
        self._before = dict(before or {})
        self._last: dict[bytes, None] = {}
        for message in known:
            self._take(*message)

    @classmethod
    def of(cls, path: Path, numbers: Mapping[str, ExperimentNumbers]) -> Self:
        """Of a recording that goes on.

        Args:
            path: its folder.
            numbers: topic → experiments that are recorded, which may change from now on.
        """
        storage = Storage(path)
        # A model has no experiment's number.
        topics = [t for t in storage.topics if t.rpartition("/")[2] == "model"]
        models = storage.last(topics, MAX_MODELS)
        before = {topic: held.copy() for topic, held in numbers.items()}
        return cls(before, ((raw.topic, raw.kind, raw.data) for raw in models))

    def seen(self, topic: str, kind: str, data: bytes) -> bool:
        """Whether this message has come before; it has from now on.

        Args:
            topic: absolute.
            kind: message type.
            data: CDR bytes.
        """
        if before := self._before.get(topic):
            number = number_of(topic, kind, data)
            if number is not None and number in before:
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
