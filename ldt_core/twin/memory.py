"""The twin's memory between experiments: the warning set S_w, and the last experiments.

All else that the paper keeps in its memory block (voltages, measurements, predictions) is in the
recording.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ldt_core.base.bounded import forget_oldest
from ldt_core.base.experiment import Experiment
from ldt_core.base.settings import resolve
from ldt_core.twin.stage import Archive

#: By number and start.
Experiments = dict[tuple[int, float], Experiment]


class Memory:
    """The warning set S_w: experiments with a warning, kept until the model has learned from them.

    And the last experiments whatever their signal was, for an adaptor that learns from all that is
    still valid. Both are bounded, so that a detector that warns for ever costs neither memory nor
    training time without end: above its limit the oldest leave, and those of S_w are counted. Both
    are sets: an experiment that comes again (same number, same start) takes the place of the first.

    Raises:
        OptionError: a limit outside the range of `memory_limit` or `history` in `parameters.yaml`.

    Attributes:
        dropped: how many experiments have left S_w because of the limit, since the beginning.
    """

    def __init__(self, limit: int = 50, history: int = 8) -> None:
        given = resolve({"memory_limit": limit, "history": history}, "adaptor")
        self.limit: int = given["memory_limit"]
        self.history: int = given["history"]
        self.dropped = 0
        self._kept: Experiments = {}
        self._recent: Experiments = {}

    @property
    def experiments(self) -> tuple[Experiment, ...]:
        """S_w, in the order in which they came."""
        return tuple(self._kept.values())

    @property
    def recent(self) -> tuple[Experiment, ...]:
        """The last experiments, in the order in which they came."""
        return tuple(self._recent.values())

    def __len__(self) -> int:
        return len(self._kept)

    def store(self, experiment: Experiment) -> None:
        """S_w ← S_w ∪ S_m."""
        self.dropped += _put(self._kept, experiment, self.limit)

    def remember(self, experiment: Experiment) -> None:
        """The last experiment."""
        _put(self._recent, experiment, self.history)

    def union(self, experiment: Experiment) -> list[Experiment]:
        """S_w ∪ S_m, the experiment last; S_w itself stays."""
        key = _key(experiment)
        return [e for other, e in self._kept.items() if other != key] + [experiment]

    def clear(self) -> None:
        """S_w ← ∅."""
        self._kept.clear()

    def forget(self) -> None:
        """Everything."""
        self._kept.clear()
        self._recent.clear()

    def state(self) -> dict[str, Any]:
        """Which experiments are kept, by number and start; `return_to` takes it back."""
        return {
            "dropped": self.dropped,
            "kept": [list(key) for key in self._kept],
            "recent": [list(key) for key in self._recent],
        }

    def return_to(self, state: Mapping[str, Any], archive: Archive) -> None:
        """Keep what a state names."""
        if len(state["kept"]) > self.limit or len(state["recent"]) > self.history:
            raise ValueError("more experiments than are kept")
        kept, recent = (
            {(number, start): archive.experiment(number, start) for number, start in state[name]}
            for name in ("kept", "recent")
        )
        dropped = state["dropped"]
        if type(dropped) is not int or dropped < 0:
            raise ValueError("dropped is no count")
        self._kept, self._recent, self.dropped = kept, recent, dropped


def _key(experiment: Experiment) -> tuple[int, float]:
    return experiment.number, experiment.start


def _put(kept: Experiments, experiment: Experiment, limit: int) -> int:
    """Keep an experiment as the last; how many of the oldest have left for it."""
    kept.pop(_key(experiment), None)
    kept[_key(experiment)] = experiment
    return forget_oldest(kept, limit)
