"""The conditions that a machine was in, as a Markov chain: which one may come next.

How many of the last conditions tell the next one is the order of the chain. It is the one by which
what has come was predicted best, each time from what was before (J. Rissanen, "A universal data
compression system", IEEE Transactions on Information Theory 29, 1983). So a machine that makes two
pieces of one kind and two of another is foreseen as one that makes them by turns is.
"""

from __future__ import annotations

import functools
import math
from collections import Counter, defaultdict, deque
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from ldt_core.base.experiment import Experiment
from ldt_core.models.base import Model
from ldt_core.twin.stage import Archive
from ldt_core.twin.version_errors import FAR, explains, largest_error

#: Experiments remembered: enough for a frequency to be known within a tenth.
REMEMBERED = 100
#: Experiments that a condition is taken to have lasted before any were counted: one that has been
#: left once is still more likely to last than not.
LASTED = 3.0
#: Last conditions that may tell the next one: blocks of up to so many are foreseen.
MOST_ORDER = 6
#: Of a condition that never followed, beside the counts of those that did (Krichevsky, Trofimov).
UNSEEN = 0.5
UNLEARNED = 0  # the condition that the model explains which has learned nothing


class ConditionChain:
    """Conditions of a machine, each by the model version that explains it.

    Attributes:
        path: the condition in each of the last experiments; None where no version explains it.
        shown: the newest experiment in each condition.
    """

    def __init__(self) -> None:
        self.path: deque[int | None] = deque(maxlen=REMEMBERED)
        self.shown: dict[int, Experiment] = {}
        # Of other conditions, the model and the experiment shown that it does not explain.
        self._apart: dict[int, tuple[Model, Experiment]] = {}

    def saw(self, condition: int | None, experiment: Experiment) -> None:
        """Take in one experiment."""
        self.path.append(condition)
        if condition is not None:
            self.shown[condition] = experiment
        self.shown = {c: e for c, e in self.shown.items() if c in self.path}

    def rename(self, old: int, new: int) -> None:
        """A version has come into force again under a new number."""
        self.path = deque((new if c == old else c for c in self.path), REMEMBERED)
        if old in self.shown:
            self.shown[new] = self.shown.pop(old)

    def merge(
        self, model: Model, here: int, experiment: Experiment, versions: Iterable[tuple[int, Model]]
    ) -> None:
        """Versions that explain each other's experiments are estimates of one condition.

        Args:
            model: explains this experiment.
            here: its condition.
            versions: others, each with its condition.
        """
        apart = {}
        for there, version in versions:
            shown = self.shown.get(there) if there not in (UNLEARNED, here) else None
            if shown and (self._apart.get(there) == (model, shown) or not explains(model, shown)):
                apart[there] = model, shown
            elif shown and explains(version, experiment):
                self.rename(there, here)
        self._apart = apart

    def following(self, condition: int) -> dict[int, float]:
        """Probability of each condition in the next experiment, from how often it followed.

        It stays `LASTED` times more often than counted. What followed and no version explained
        counts as staying, since no other one is known to be nearer. A condition that has been left
        is taken to stay less surely than counted, by one standard deviation (beta distribution):
        who follows a machine that goes back and forth should know that it pays. The benefit of the
        doubt is the original's.

        Args:
            condition: of the experiment behind those that were seen.
        """
        seen, order = _seen(tuple(self.path))
        last = [*self.path, condition]
        counts: dict[int, float] = {condition: LASTED}
        for came, count in _behind(seen, last, order).items():
            known = condition if came is None else came
            counts[known] = counts.get(known, 0.0) + count
        total = sum(counts.values())
        stays, left = counts[condition] / total, 1 - counts[condition] / total
        doubt = math.sqrt(stays * left / (total + 1)) if condition != UNLEARNED else 0.0
        surely = stays - doubt if left else 1.0
        rest = {c: n / total * (1 - surely) / left for c, n in counts.items() if c != condition}
        return {condition: surely, **rest}

    def ahead(
        self,
        present: Model,
        here: int,
        experiment: Experiment,
        versions: Iterable[tuple[int, Model]],
    ) -> Model | None:
        """The version that will clearly err less in the next experiment, though the present one
        explains this one; None where there is none. A machine may change in turns.

        Args:
            here: condition of the present version, which this experiment shows.
            versions: others, each with its condition.
        """
        after = self.following(here)
        others = [m for there, m in versions if there in after and there != here]
        if not others:
            return None
        stays, *expected = (self.expected_error(m, here, experiment) for m in (present, *others))
        least = min(expected)
        return others[expected.index(least)] if FAR * least < stays else None

    def expected_error(self, model: Model, condition: int, experiment: Experiment) -> float:
        """Largest error [rad/s] to be expected of a model in what follows a condition, which this
        experiment shows.
        """
        following = self.following(condition).items()
        shown = ((p, experiment if c == condition else self.shown[c]) for c, p in following)
        return sum(p * largest_error(model, e) for p, e in shown)

    def state(self) -> dict[str, Any]:
        """By the numbers of what is recorded; `return_to` takes it back."""
        shown = [[c, e.number, e.start] for c, e in self.shown.items()]
        return {"path": list(self.path), "shown": shown}

    def return_to(self, state: Mapping[str, Any], archive: Archive) -> None:
        """Take back a state."""
        path = [None if c is None else int(c) for c in state["path"]]
        shown = {int(c): archive.experiment(number, start) for c, number, start in state["shown"]}
        self.path, self.shown = deque(path, REMEMBERED), shown


#: The last conditions to how often which one came behind them.
_Seen = dict[tuple[int | None, ...], Counter[int | None]]


@functools.lru_cache(maxsize=1)  # asked of one path for each version and condition
def _seen(conditions: tuple[int | None, ...]) -> tuple[_Seen, int]:
    """What came behind up to `MOST_ORDER` conditions, and the order that predicted it best.

    A higher order costs a bit.
    """
    kinds = len({*conditions, None})
    seen: _Seen = defaultdict(Counter)
    bits = {order: float(order) for order in range(1, MOST_ORDER + 1)}
    for end in range(1, len(conditions)):
        before, came = conditions[max(end - MOST_ORDER, 0) : end], conditions[end]
        stayed = LASTED * (came in (before[-1], None))
        for order in bits:
            counts = _behind(seen, before, order)
            likely = counts[came] + UNSEEN + stayed
            bits[order] -= math.log2(likely / (counts.total() + UNSEEN * kinds + LASTED))
        for count in range(1, len(before) + 1):
            seen[tuple(before[-count:])][came] += 1
    return seen, min(bits, key=lambda order: bits[order])


def _behind(seen: _Seen, last: Sequence[int | None], order: int) -> Counter[int | None]:
    """What came behind the last conditions, `order` of them or as many as came before."""
    for count in range(min(order, len(last)), 0, -1):
        if found := seen.get(tuple(last[-count:])):
            return found
    return Counter()
