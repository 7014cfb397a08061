"""The conditions that a machine was in, as a Markov chain: which one may come next.

How many of the last conditions tell the next one is the order of the chain. It is the one by which
what has come was predicted best, each time from what was before (J. Rissanen, "A universal data
compression system", IEEE Transactions on Information Theory 29, 1983). So a machine that makes two
pieces of one kind and two of another is foreseen as one that makes them by turns is. Where it makes
them at random, nothing tells the next one: order 0.
"""

from __future__ import annotations

import functools
import math
from collections import Counter, defaultdict, deque
from collections.abc import Iterable, Mapping, Sequence
from typing import Any
from weakref import WeakKeyDictionary

from ldt_core.base.experiment import Experiment
from ldt_core.models.base import Model
from ldt_core.twin.stage import Archive
from ldt_core.twin.version_errors import explains, largest_error

#: Experiments remembered: enough for a frequency to be known within a tenth.
REMEMBERED = 100
#: Experiments that a condition is taken to have lasted before any were counted: one that has been
#: left once is still more likely to last than not.
LASTED = 3.0
#: Last conditions that may tell the next one: blocks of up to so many are foreseen.
MOST_ORDER = 6
#: Bits by which order 0 has to predict better than order 1. From 1 to 4, what is left of the error
#: over 24 kinds of sequences of conditions is the same within 4 %, and least at 3 and 4.
RANDOM = 4.0
#: Of a condition that never followed, beside the counts of those that did (Krichevsky, Trofimov).
UNSEEN = 0.5
UNLEARNED = 0  # the condition that the model explains which has learned nothing


class ConditionChain:
    """Conditions of a machine, each by the model version that explains it.

    Attributes:
        path: the condition in each of the last experiments; None where no version explains it.
        shown: the newest experiment in each condition, and of those that no version explains.
    """

    def __init__(self) -> None:
        self.path: deque[int | None] = deque(maxlen=REMEMBERED)
        self.shown: dict[int | None, Experiment] = {}
        # Of other conditions, the model and the experiment shown that it does not explain.
        self._apart: dict[int, tuple[Model, Experiment]] = {}
        # For as long as somebody else holds the experiment, whose samples may be many.
        self._errors: WeakKeyDictionary[Experiment, WeakKeyDictionary[Model, float]] = (
            WeakKeyDictionary()
        )

    def saw(self, condition: int | None, experiment: Experiment) -> None:
        """Take in one experiment."""
        self.path.append(condition)
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

    def following(self, condition: int) -> dict[int | None, float]:
        """Probability of each condition in the next experiment, from how often it followed.

        It stays `LASTED` times more often than counted. A condition that has been left is taken to
        stay less surely than counted, by one standard deviation (beta distribution): who follows a
        machine that goes back and forth should know that it pays. The benefit of the doubt is the
        original's.

        Args:
            condition: of the experiment behind those that were seen.
        """
        last = (*self.path, condition)
        seen, order = _seen(last)
        return _next(_behind(seen, last, order), condition, order)

    def expected_error(self, model: Model, condition: int, experiment: Experiment) -> float:
        """Largest error [rad/s] to be expected of a model in what follows a condition, which this
        experiment shows.
        """
        following = self.following(condition).items()
        shown = ((p, experiment if c == condition else self.shown[c]) for c, p in following)
        return sum(p * self._error(model, e) for p, e in shown)

    def _error(self, model: Model, experiment: Experiment) -> float:
        """Largest error, found once: of ten versions in as many conditions, it is asked again."""
        known = self._errors.setdefault(experiment, WeakKeyDictionary())
        if model not in known:
            known[model] = largest_error(model, experiment)
        return known[model]

    def state(self) -> dict[str, Any]:
        """By the numbers of what is recorded; `return_to` takes it back."""
        shown = [[c, e.number, e.start] for c, e in self.shown.items()]
        return {"path": list(self.path), "shown": shown}

    def return_to(self, state: Mapping[str, Any], archive: Archive) -> None:
        """Take back a state."""
        path = [None if c is None else int(c) for c in state["path"]]
        shown = {
            None if c is None else int(c): archive.experiment(number, start)
            for c, number, start in state["shown"]
        }
        self.path, self.shown = deque(path, REMEMBERED), shown


#: The last conditions to how often which one came behind them.
_Seen = dict[tuple[int | None, ...], Counter[int | None]]


@functools.lru_cache(maxsize=1)  # asked of one path for each version
def _seen(conditions: tuple[int | None, ...]) -> tuple[_Seen, int]:
    """What came behind up to `MOST_ORDER` conditions, and the order that predicted it best.

    A higher order costs a bit.
    """
    kinds = len({*conditions, None})
    seen: _Seen = defaultdict(Counter)
    seen[()][conditions[0]] += 1
    bits = {0: RANDOM, **{order: order - 1.0 for order in range(1, MOST_ORDER + 1)}}
    for end in range(1, len(conditions)):
        before, came = conditions[max(end - MOST_ORDER, 0) : end], conditions[end]
        for order in bits:
            counts, lasted = _behind(seen, before, order), LASTED if order else 0.0
            likely = counts[came] + UNSEEN + (lasted if came == before[-1] else 0.0)
            bits[order] -= math.log2(likely / (counts.total() + UNSEEN * kinds + lasted))
        for count in range(len(before) + 1):
            seen[before[len(before) - count :]][came] += 1
    return seen, min(bits, key=lambda order: bits[order])


def _behind(seen: _Seen, last: Sequence[int | None], order: int) -> Counter[int | None]:
    """What came behind the last conditions, `order` of them or as many as came before."""
    for count in range(min(order, len(last)), min(order, 1) - 1, -1):
        if found := seen.get(tuple(last[len(last) - count :])):
            return found
    return Counter()


def _next(came: Counter[int | None], here: int, order: int) -> dict[int | None, float]:
    """Probability of each condition behind this one, of what came behind it so far."""
    counts: dict[int | None, float] = {here: LASTED if order else 0.0}
    for condition, count in came.items():
        counts[condition] = counts.get(condition, 0.0) + count
    total = sum(counts.values())
    stays, left = counts.pop(here) / total, sum(counts.values()) / total
    doubted = order and here != UNLEARNED
    surely = stays - (math.sqrt(stays * left / (total + 1)) if doubted else 0.0)
    return {here: surely, **{c: n / total * (1 - surely) / left for c, n in counts.items()}}
