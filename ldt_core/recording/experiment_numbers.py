"""Which experiments a recording holds, in memory that does not grow with their count."""

from __future__ import annotations

import bisect
import json
import re
import sys
from collections.abc import Iterable, Iterator
from typing import Any, Self

from ldt_core.base.errors import OptionError
from ldt_core.base.sentences import Span

#: Experiments that may be missing at once: eleven days of one a second. Beyond, numbers jump.
MOST_JUMP = 1_000_000
STRETCH = re.compile(r"([0-9]{1,18})(?:(-)([0-9]{1,18})?)?")  # numbers as a user names them


class ExperimentNumbers:
    """Whole numbers, kept as stretches without a gap.

    >>> held = ExperimentNumbers()
    >>> for number in (1, 2, 3, 7, 5, 6):
    ...     held.add(number)
    >>> held.spans, 4 in held, 6 in held
    ([(1, 3), (5, 7)], False, True)
    """

    def __init__(self, spans: Iterable[Span] = ()) -> None:
        self._first: list[int] = []
        self._last: list[int] = []
        for first, last in sorted(spans):
            self._put(first, last)

    @property
    def spans(self) -> list[Span]:
        """The stretches in rising order."""
        return list(zip(self._first, self._last, strict=True))

    @property
    def gaps(self) -> list[Span]:
        """The stretches between them in which numbers are missing; a jump is none."""
        held = zip(self._last, self._first[1:], strict=False)
        return [(b + 1, a - 1) for b, a in held if a - b <= MOST_JUMP]

    @property
    def jumps(self) -> list[Span]:
        """The numbers before and after each jump."""
        held = zip(self._last, self._first[1:], strict=False)
        return [(before, after) for before, after in held if after - before > MOST_JUMP]

    def add(self, number: int) -> None:
        """Take in one; one that is there already changes nothing."""
        if self._last and number == self._last[-1] + 1:  # as nearly all come
            self._last[-1] = number
        elif number not in self:
            self._put(number, number)

    def __contains__(self, number: int) -> bool:
        at = bisect.bisect_right(self._first, number) - 1
        return at >= 0 and number <= self._last[at]

    def __bool__(self) -> bool:
        return bool(self._first)

    def __len__(self) -> int:
        return sum(last - first + 1 for first, last in self.spans)

    def __iter__(self) -> Iterator[int]:
        for first, last in self.spans:
            yield from range(first, last + 1)

    def copy(self) -> Self:
        """The same numbers, to go on with."""
        return type(self)(self.spans)

    def take(self, others: ExperimentNumbers) -> None:
        """Take in those of another."""
        for first, last in others.spans:
            self._put(first, last)

    def _put(self, first: int, last: int) -> None:
        """A stretch that holds at least one number that is not there; it joins its neighbours."""
        low = bisect.bisect_left(self._last, first - 1)
        high = bisect.bisect_right(self._first, last + 1)
        if low < high:
            first, last = min(first, self._first[low]), max(last, self._last[high - 1])
        self._first[low:high], self._last[low:high] = [first], [last]


def parse_selection(text: str) -> ExperimentNumbers:
    """The numbers that a user names; a stretch may have no end.

    Raises:
        OptionError: no such text.

    >>> parse_selection("3-5, 8").spans, 10**9 in parse_selection("21-")
    ([(3, 5), (8, 8)], True)
    """
    chosen = ExperimentNumbers()
    for part in text.split(","):
        found = STRETCH.fullmatch(part.strip())
        first, dash, last = found.groups() if found else ("", "", "")
        stretch = int(first or 0), int(last or (sys.maxsize if dash else first or 0))
        if not 0 < stretch[0] <= stretch[1]:
            expected = "numbers of experiments, such as 1-20,25 or 21-"
            raise OptionError("--only", expected, repr(text))
        chosen.take(ExperimentNumbers([stretch]))
    return chosen


def numbers_text(numbers: dict[str, ExperimentNumbers], files: int) -> str:
    """What `parse_numbers` reads.

    Args:
        numbers: topic → experiments.
        files: how many of the recording's files, from the first on, hold them.
    """
    spans = {topic: held.spans for topic, held in numbers.items()}
    return json.dumps({"files": files, "numbers": spans}) if files else ""


def parse_numbers(text: Any) -> tuple[dict[str, ExperimentNumbers], int]:
    """(topic → experiments, how many files hold them); nothing of 0 files from any other text."""
    try:
        data = json.loads(text)
        files, numbers = data["files"], data["numbers"]
        if type(files) is not int or files < 0:
            return {}, 0
        found = {}
        for topic, spans in numbers.items():
            if not all(type(n) is int for span in spans for n in span):
                return {}, 0
            if not all(first <= last for first, last in spans):
                return {}, 0
            found[topic] = ExperimentNumbers((first, last) for first, last in spans)
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return {}, 0
    return found, files
