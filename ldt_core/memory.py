"""The twin's memory between experiments: the warning set S_w.

All else that the paper keeps in its memory block (voltages, measurements, predictions) is in the
recording.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ldt_core.errors import LdtError, OptionError
from ldt_core.experiment import Experiment
from ldt_core.settings import resolve

CHANNELS = ("voltage", "speed", "current")


class Memory:
    """The warning set S_w: experiments with a warning, kept until the model has learned from them.

    Bounded, so that a detector that warns for ever costs neither memory nor training time without
    end: above the limit the oldest leave, and are counted. It is a set: an experiment that comes
    again (same number, same start) takes the place of the first.

    Args:
        limit: most experiments kept.

    Raises:
        OptionError: a limit outside the range of `memory_limit` in `parameters.yaml`.

    Attributes:
        dropped: how many experiments have left because of the limit, since the beginning.
    """

    def __init__(self, limit: int = 50) -> None:
        self.limit: int = resolve({"memory_limit": limit}, "adaptor")["memory_limit"]
        self.dropped = 0
        self._kept: dict[tuple[int, float], Experiment] = {}

    @property
    def experiments(self) -> tuple[Experiment, ...]:
        """S_w, in the order in which they came."""
        return tuple(self._kept.values())

    def __len__(self) -> int:
        return len(self._kept)

    def store(self, experiment: Experiment) -> None:
        """S_w ← S_w ∪ S_m."""
        key = (experiment.number, experiment.start)
        self._kept.pop(key, None)
        self._kept[key] = experiment
        while len(self._kept) > self.limit:
            del self._kept[next(iter(self._kept))]
            self.dropped += 1

    def union(self, experiment: Experiment) -> list[Experiment]:
        """S_w ∪ S_m, the experiment last; S_w itself stays."""
        key = (experiment.number, experiment.start)
        return [e for other, e in self._kept.items() if other != key] + [experiment]

    def clear(self) -> None:
        """S_w ← ∅."""
        self._kept.clear()

    def state(self) -> dict[str, Any]:
        """S_w in JSON types; `restore` takes it back, every sample to the last bit."""
        return {
            "dropped": self.dropped,
            "experiments": [_plain(e) for e in self._kept.values()],
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state saved earlier; experiments above this memory's limit leave.

        Raises:
            OptionError: the state is not a memory's; the memory is then as it was before.
        """
        try:
            experiments = [_experiment(record) for record in state["experiments"]]
            dropped = state["dropped"]
        except (KeyError, TypeError, ValueError, OverflowError, LdtError) as error:
            got = str(error) if isinstance(error, LdtError) else f"{type(error).__name__}: {error}"
            raise OptionError("state of the memory", "experiments and dropped", got) from error
        if type(dropped) is not int or dropped < 0:
            raise OptionError(
                "state of the memory, dropped", "a whole number from 0", repr(dropped)
            )
        self.clear()
        self.dropped = dropped
        for experiment in experiments:
            self.store(experiment)


def _plain(experiment: Experiment) -> dict[str, Any]:
    channels = {name: getattr(experiment, name) for name in CHANNELS}
    return {
        "number": experiment.number,
        "start": experiment.start,
        "period": experiment.period,
        **{name: None if row is None else row.tolist() for name, row in channels.items()},
    }


def _experiment(record: Mapping[str, Any]) -> Experiment:
    channels = (record[name] for name in CHANNELS)
    return Experiment(record["number"], record["start"], record["period"], *channels)
