"""What comparators share: the data of a case, effects fitted to it, and the form of their answers.

Effects are fitted in free run, alone and in sets, by the diagnosis' own bench and least squares:
every set to a few experiments first; those that do best there to all.
"""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.errors import reason_of
from ldt_core.base.experiment import Experiment
from ldt_core.base.settings import HOLDOUT
from ldt_core.diagnosis.candidate import Candidate
from ldt_core.diagnosis.channel_noise import channel_noise
from ldt_core.diagnosis.effect_fit import EffectFit, fit
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.holdout import closed, free_run, split_at_random
from ldt_core.diagnosis.responses import at_best_strength, best_alone, rank_pairs, simulate_all
from ldt_core.machine.machine_file import Machine
from ldt_core.physics.effect import Effect
from ldt_core.physics.machine_sizes import most_of

ROUGH_EXPERIMENTS = 4  # experiments to which every set is fitted, evenly spread
ROUGH_PRECISION = 1e-4  # of the sum of squares: fits to the few end there
FINISHED_SETS = 6  # sets of a kind that are fitted to all experiments


class EffectFits:
    """Fits of sets of effects to the same experiments.

    At first of every effect alone, from the two starts that promise most.

    Args:
        machine: as its file knows it.
        fitted: experiments.
        effects: the library.
    """

    def __init__(
        self, machine: Machine, fitted: Sequence[Experiment], effects: Sequence[Effect]
    ) -> None:
        voltage = max(float(np.abs(e.voltage).max()) for e in fitted) or 1.0
        most = most_of(machine.parameters, voltage)
        self.candidates = [Candidate(e, most) for e in effects]
        self.bench = FreeRunResiduals(machine, fitted)
        self.base = self.bench.of()
        places = {
            round(i) for i in np.linspace(0, len(fitted) - 1, min(ROUGH_EXPERIMENTS, len(fitted)))
        }
        self._few = self.bench.part(sorted(places))
        self.responses = simulate_all(self._few, self.candidates)
        self._known: dict[frozenset[str], EffectFit] = {}
        found = []
        for i, candidate in enumerate(self.candidates):
            starts = best_alone(self.responses, i)
            tried = [self._fit([candidate], [z]) for z in starts]
            found += sorted(tried, key=_loss)[:1]
        #: The best effects alone, fitted to all experiments, best first.
        self.alone = self.finished(found)

    def finished(self, rough: Sequence[EffectFit]) -> list[EffectFit]:
        """The best of some fits to a few experiments, fitted to all; best first."""
        chosen = {frozenset(f.names): f for f in reversed(sorted(rough, key=_loss)[:FINISHED_SETS])}
        for names, f in chosen.items():
            if names not in self._known:
                self._known[names] = fit(self.bench, f.members, f.z)
        return sorted((self._known[names] for names in chosen), key=_loss)

    def grown(self, base: EffectFit, count: int) -> list[EffectFit]:
        """The set with one effect more, for the effects that promise most beside it.

        Fitted to a few experiments.
        """
        d, left = self.responses, self._few.of(base.use)
        _, gain = at_best_strength(d.responses @ left, np.diag(d.gram))
        best: dict[int, int] = {}
        for k in np.argsort(-gain):
            owner = int(d.owner[k])
            if self.candidates[owner].name not in base.names:
                best.setdefault(owner, int(k))
        return [
            self._fit([*base.members, self.candidates[i]], [*base.z, d.z[k]])
            for i, k in list(best.items())[:count]
        ]

    def pairs(self, count: int) -> list[EffectFit]:
        """The pairs whose responses together promise most, fitted to a few experiments."""
        ranked = sorted(rank_pairs(self.responses).items(), key=lambda q: -q[1][0])[:count]
        c, z = self.candidates, self.responses.z
        return [self._fit([c[i], c[j]], [z[k], z[m]]) for (i, j), (_, k, m) in ranked]

    def _fit(self, members: Sequence[Candidate], start: Sequence[Array]) -> EffectFit:
        return fit(self._few, members, start, precision=ROUGH_PRECISION)


def _loss(f: EffectFit) -> float:
    return f.loss


Predict = Callable[[Experiment], Array]
Answered = TypeVar("Answered")


@dataclass(frozen=True)
class ComparatorAnswer:
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
        self.fitted, self.held = split_at_random(experiments, HOLDOUT, seed=0)
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
    def fits(self) -> EffectFits:
        """Every effect of the library fitted alone."""
        return self.shared("alone", lambda: EffectFits(self.machine, self.fitted, self.effects))

    def with_effects(self, use: Sequence[tuple[Effect, Mapping[str, float]]]) -> ComparatorAnswer:
        """The answer that these effects act."""
        parameters = {effect.name: dict(given) for effect, given in use}
        if not use:
            return ComparatorAnswer((), None, {})
        return ComparatorAnswer(
            tuple(parameters), lambda e: free_run(self.machine, e, use), parameters
        )


Comparator = Callable[[Data], ComparatorAnswer]


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
            yield who, None, None, time.process_time() - begin, reason_of(error)


def _content(data: Data, found: ComparatorAnswer) -> dict[str, Any]:
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


def _parameters(found: ComparatorAnswer, name: str) -> dict[str, dict[str, Any]]:
    given = found.parameters.get(name, {})
    return {p: {"value": v, "unit": "", "ci95": None} for p, v in given.items()}
