"""What comparators have in common: the data of a case, and the form of their answers."""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment
from ldt_core.diagnosis.free_run_residuals import channel_noise
from ldt_core.diagnosis.holdout import HOLDOUT, closed, free_run, split
from ldt_core.lab.challenge.comparators.fits import Fits
from ldt_core.machine.machine_file import Machine
from ldt_core.physics.effect import Effect

Array = NDArray[np.float64]
Predict = Callable[[Experiment], Array]
Answered = TypeVar("Answered")


@dataclass(frozen=True)
class Found:
    """A comparator's answer.

    Attributes:
        names: effects that act; none at all is the answer "none".
        predict: experiment to (L,) predicted speed; None where nothing is added.
        parameters: effect to parameter to value, where there are any.
        named: whether this comparator names effects at all.
    """

    names: Sequence[str]
    predict: Predict | None
    parameters: Mapping[str, Mapping[str, float]]
    named: bool = True

    @property
    def kind(self) -> str:
        """Of its verdict."""
        return "unnamed" if not self.named else "effect" if self.names else "none"


class Data:
    """What a comparator may use of a case.

    Args:
        machine: as its file knows it.
        experiments: shown.
        effects: the library.
    """

    def __init__(
        self, machine: Machine, experiments: Sequence[Experiment], effects: Sequence[Effect]
    ) -> None:
        self.machine = machine
        #: The same experiments to fit and to hold back as the diagnosis takes.
        self.fitted, self.held = split(experiments, HOLDOUT, seed=0)
        self.effects = list(effects)
        #: Deviation of the white noise on the measured speed [rad/s].
        self.noise = channel_noise(self.fitted)[0]
        self._shared: dict[str, tuple[Any, float]] = {}
        self._used: set[str] = set()

    def shared(self, name: str, make: Callable[[], Any]) -> Any:
        """What several comparators use, made once; its time counts for each of them."""
        if name not in self._shared:
            begin = time.process_time()
            made = make()
            self._shared[name] = made, time.process_time() - begin
        self._used.add(name)
        return self._shared[name][0]

    def timed(self, work: Callable[[], Answered]) -> tuple[Answered, float]:
        """What the work gives and its processor time [s], all that it shares included."""
        self._used, there = set(), set(self._shared)
        begin = time.process_time()
        done = work()
        seconds = time.process_time() - begin
        return done, seconds + sum(self._shared[n][1] for n in self._used if n in there)

    @property
    def fits(self) -> Fits:
        """Every effect of the library fitted alone."""
        return self.shared("alone", lambda: Fits(self.machine, self.fitted, self.effects))

    def with_effects(self, use: Sequence[tuple[Effect, Mapping[str, float]]]) -> Found:
        """The answer that these effects act."""
        parameters = {effect.name: dict(given) for effect, given in use}
        if not use:
            return Found((), None, {})
        return Found(tuple(parameters), lambda e: free_run(self.machine, e, use), parameters)


Comparator = Callable[[Data], Found]


def compare(
    wanted: Mapping[str, Comparator],
    machine: Machine,
    experiments: Sequence[Experiment],
    effects: Sequence[Effect],
) -> Iterator[tuple[str, dict[str, Any] | None, Predict | None, float, str]]:
    """Each comparator's name, answer, prediction, processor time [s] and failure."""
    data = Data(machine, experiments, effects)
    for who, comparator in wanted.items():
        begin = time.process_time()
        try:
            found, seconds = data.timed(functools.partial(comparator, data))
            yield who, _content(data, found), found.predict, seconds, ""
        except Exception as error:  # a failure is an answer, as it is of the diagnosis
            text = str(error) if isinstance(error, LdtError) else f"{type(error).__name__}: {error}"
            yield who, None, None, time.process_time() - begin, text


def _content(data: Data, found: Found) -> dict[str, Any]:
    """The keys of a `diagnosis.json` that a score reads."""
    part = None
    if found.predict is not None:
        before = [free_run(data.machine, e) for e in data.held]
        part, _ = closed(data.held, before, [found.predict(e) for e in data.held], data.noise)
        part = part if part is not None and math.isfinite(part) else None
    return {
        "verdict": {
            "kind": found.kind,
            "effects": list(found.names),
            "acting": [[name] for name in found.names],
        },
        "gap": {"noise_std": data.noise, "closed_fraction": part},
        "where": [],
        "candidates": [
            {"effect": name, "parameters": _parameters(found, name)} for name in found.names
        ],
    }


def _parameters(found: Found, name: str) -> dict[str, dict[str, Any]]:
    given = found.parameters.get(name, {})
    return {p: {"value": v, "unit": "", "ci95": None} for p, v in given.items()}
