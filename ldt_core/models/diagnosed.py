"""The diagnosed model: the machine's physics plus the one effect that explains its changes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from ldt_core.base.errors import LdtError, OptionError
from ldt_core.base.experiment import DiagnosisRecord, Experiment, Prediction, Samples
from ldt_core.base.sentences import spoken
from ldt_core.effects.change_description import change_of
from ldt_core.estimation.effect.cause import Cause, UncertainStart
from ldt_core.estimation.effect.global_search import EffectSearch
from ldt_core.estimation.effect.learn_effect import EffectLearner, LearnedEffect, SigmaPoint
from ldt_core.estimation.effect.start_angle import FoundAngle, believe
from ldt_core.machine.machine_file import Machine
from ldt_core.models.base import Model
from ldt_core.models.physics import PhysicsModel
from ldt_core.physics.base import ANGLE

if TYPE_CHECKING:
    from ldt_core.physics.effect import Effect

AUTO = "auto"  # in place of an effect's name: the one that a diagnosis names
SPREAD_STEP = 1e-3  # s, longest integration step of the spread: worst relative error 1e-3
# Start angles that stand for any, a row each, with the signs of the other start states' deviations:
# every pair of states has all four combinations of signs equally often.
SIGNS = np.array(
    [[(-1.0) ** (i & j).bit_count() for j in range(8)] for i in range(8)], dtype=np.float64
)
LEAST_SAMPLES = 20  # of an experiment: a free run of fewer says nothing about a machine
NOISE_CONTRADICTED = 4.0  # deviations between a new noise and the old one: more than chance
LEAST_WEIGHT = 0.02  # probability of a hypothesis about the start angle, for its runs to be made


class DiagnosedModel(Model):
    """Free run of the whole physics with one effect, whose parameters are what is learned.

    `fit` finds them by free runs from the start of each experiment (`ldt_core.estimation.effect`).
    The physics stays as it is, so that one experiment is enough, and what was learned says what has
    happened to the machine. If something else has happened, the model cannot follow: then the
    adaptor's gate refuses it, or the residual stays. The effect is named beforehand, or by the
    diagnoses of the running machine (`informed`): until one names it there is none, and nothing is
    learned.

    - The noise is what the fit leaves; the deviation of every prediction contains it.
    - A machine whose first sample is within 4 deviations of the noise from 0 stood still. Its shaft
      angle is estimated, and the angles of all experiments learned from tell whether it is the same
      every time. If so, predictions start there; if not, they are the median over all angles.
    - A running machine starts at its first measured speed, its foundation as after a long run at
      that speed, at any angle.

    `parameters`: `machine`, the physics parameters, and `cause`: `effect` (null while there is
    none), its `parameters` and their `std`; once learned also `noise_std` [rad/s] and
    `noise_samples` (independent ones that it is known from, earlier versions included), `memory`
    (samples in which the residual forgets itself), `start` with `turn` (an angle that makes no
    difference, 0 where none does), `same_angle` (probability), `angle`, `angle_std` [rad] and
    `seen` ([experiment, angle, std] each), and `members`: [weight, start angle, value of each
    parameter], the best one first.

    Args (and those of `Model`):
        cause: name of the effect, file.py:NAME or the effect itself, or "auto" for what diagnoses
            name.

    Raises:
        OptionError: no such effect, or one that this machine cannot have.
        ModelError: parameters that cannot be this model's.
    """

    kind = "diagnosed"

    def __init__(
        self,
        machine: Machine,
        parameters: Mapping[str, Any] | None = None,
        version: int = 0,
        trained_on: Sequence[int] = (),
        *,
        cause: str | Effect = "unbalance",
    ) -> None:
        if cause != AUTO:
            _require(machine, cause)
        # Of the last experiment learned from: the gate asks again and again, with other blocks held
        # back and other experiments beside it.
        self._search: EffectSearch | None = None
        super().__init__(machine, parameters, version, trained_on, cause=cause)

    def untrained(self) -> dict[str, Any]:
        """The machine file's physics and an effect that changes nothing."""
        cause = self.options["cause"]
        return self._unlearned(None if cause == AUTO else _name(cause))

    def _unlearned(self, name: str | None) -> dict[str, Any]:
        neutral = self._own_effect(name).neutral if name else {}
        cause = {"effect": name, "parameters": neutral, "std": None, "noise_std": None}
        return {"machine": dict(self.machine.parameters), "cause": cause}

    def _own_effect(self, name: str) -> Effect:
        """As a change of what is known of the machine."""
        cause = self.options["cause"]
        if name == _name(cause) and not isinstance(cause, str):
            return cause
        return self.machine.effect(name)

    @property
    def asks_for_diagnosis(self) -> bool:
        """Whether diagnoses name the effect."""
        return bool(self.options["cause"] == AUTO)

    def informed(self, diagnosis: DiagnosisRecord) -> Self:
        """With the effect that was named, of which nothing has been learned yet."""
        name = diagnosis.cause
        if name in (None, self.parameters["cause"]["effect"]) or not self.asks_for_diagnosis:
            return self
        return type(self)(self.machine, self._unlearned(name), self.version, (), **self.options)

    def change(self, before: Model) -> str:
        """ "unbalance has grown to 6.1 mm"."""
        old = before.parameters["cause"] if isinstance(before, DiagnosedModel) else {}
        if self.effect is None:
            return f"{spoken(old['effect'])} has gone" if old.get("effect") else ""
        same = old.get("effect") == self.parameters["cause"]["effect"]
        return change_of(
            self.effect, old["parameters"] if same else self.effect.neutral, self.given
        )

    def build(self) -> None:
        """Check the parameters."""
        self.physics = PhysicsModel(self.machine, {"machine": self.parameters["machine"]})
        record = self.parameters["cause"]
        name = record["effect"]
        self.effect: Effect | None = None
        self.noise_std: float | None = None
        self.noise_samples = 0.0
        self.seen: list[FoundAngle] = []
        if name is None and self.asks_for_diagnosis and record["noise_std"] is None:
            return
        if name != _name(self.options["cause"]) and name not in self.machine.effect_names:
            raise ValueError(f"effect {name!r}, which is not known")  # a record names no files
        self.effect = self._own_effect(name)
        self.effect.require(self.machine.model)
        self.cause = Cause(self.machine, self.physics.values, self.effect)
        self.given = self._checked(self.effect, record["parameters"])
        if record["noise_std"] is not None:
            self._build_learned(self.effect, record)

    def _build_learned(self, effect: Effect, record: Mapping[str, Any]) -> None:
        self.noise_std = _number(record["noise_std"], 0.0)
        self.noise_samples = _number(record["noise_samples"], 0.0)
        start = record["start"]
        self.turn = _number(start["turn"], 0.0)
        self.same = _number(start["same_angle"], 0.0, 1.0)
        self.seen = [FoundAngle(int(n), _number(a), _number(s, 1e-9)) for n, a, s in start["seen"]]
        self.members = []
        for weight, angle, *values in record["members"]:
            if len(values) != len(self.cause.names):
                raise ValueError(f"a member with {len(values)} parameters")
            given = self._checked(effect, dict(zip(self.cause.names, values, strict=True)))
            z = self.cause.coordinates(given)
            self.members.append(SigmaPoint(_number(weight, 0.0, 1.0), z, _number(angle)))
        if not math.isclose(sum(m.weight for m in self.members), 1.0, rel_tol=1e-6):
            raise ValueError("members whose weights do not sum to 1")

    def _checked(self, effect: Effect, given: Mapping[str, Any]) -> dict[str, float]:
        if set(given) != set(self.cause.names):
            raise ValueError(f"parameters {sorted(given)} of {effect.name}")
        return effect.check({n: float(v) for n, v in given.items()})

    def predict(self, experiment: Experiment) -> Prediction:
        """Free run from the start state that is known or likeliest.

        `speed_std` is the deviation of the measured speed: the noise, and the spread of the free
        runs of all `members`. None while untrained.

        Raises:
            LdtError: the simulated state of the untrained model grows without bound.
        """
        about = (experiment.number, experiment.start, experiment.period, self.version)
        if self.noise_std is None:
            return Prediction(*about, self.physics.predict(experiment).speed)
        best = self.members[0]
        start = self.cause.start(experiment, self.noise_std, best.z, best.z)
        same = self.same if start.rest else 0.0
        runs, weights = self._runs(experiment, start, same)
        if same >= 0.5 or (start.rest and self.turn == 0):
            offset = self.cause.offset(best.angle)
            speed = self.cause.speed(experiment, best.z, offset, start.rest)
        else:
            speed = _median(runs, weights)
        variance = self.noise_std**2 + weights @ (runs - speed) ** 2
        return Prediction(*about, speed, np.sqrt(variance))

    def _runs(
        self, experiment: Experiment, start: UncertainStart, same: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Free runs of machines that may be the real one (n, L), and their weights (n,)."""
        chosen = []
        if start.rest and (self.turn == 0 or same > LEAST_WEIGHT):
            weight = 1.0 if self.turn == 0 else same
            chosen += [(weight * m.weight, m.z, self.cause.offset(m.angle)) for m in self.members]
        if not start.rest or (self.turn > 0 and 1 - same > LEAST_WEIGHT):
            for i, signs in enumerate(SIGNS):
                offset = signs[: start.spread.size] * start.spread
                offset[ANGLE] = self.turn * i / len(SIGNS)
                z = self.members[i % len(self.members)].z
                chosen.append(((1 - same) / len(SIGNS), z, offset))
        runs = [
            self.cause.speed(experiment, z, offset, start.rest, SPREAD_STEP)
            for _, z, offset in chosen
        ]
        weights = np.array([c[0] for c in chosen])
        return np.array(runs), weights / weights.sum()

    def fit(self, experiments: Sequence[Experiment]) -> Self:
        """Find the effect's parameters; the physics stays as it is.

        Of several experiments those count which the machine of the newest one can have made. Start
        angles that earlier versions found are kept, and weighed with the new ones.

        Raises:
            LdtError: no or too few samples, or experiments that say nothing about this effect.
        """
        return self._taught(experiments, None)

    def fit_without(self, experiments: Sequence[Experiment], held: Sequence[slice]) -> Self:
        """As `fit`, running through the blocks held back without looking at them."""
        return self._taught(experiments, held)

    def _taught(self, experiments: Sequence[Experiment], held: Sequence[slice] | None) -> Self:
        if not experiments:
            raise LdtError("diagnosed model: expected experiments to learn from, got none")
        if self.effect is None:
            raise LdtError("diagnosed model: no diagnosis has named a cause yet")
        for e in experiments:
            if len(e) < LEAST_SAMPLES:
                where = f"diagnosed model: experiment {e.number}"
                raise LdtError(f"{where}: expected {LEAST_SAMPLES} samples or more, got {len(e)}")
        newest = max(experiments, key=lambda e: (e.number, e.start))
        if self._search is None or self._search.experiment is not newest:
            angle = believe(self.seen, self.cause.turn).angle if self.seen else None
            here = self.cause.coordinates(self.given), angle or 0.0
            self._search = EffectSearch(self.cause, newest, [here])
        learned = EffectLearner(self._search, experiments, self.seen).learn(held)
        return self.successor(self._record(learned), learned.used)

    def _noise(self, learned: LearnedEffect) -> tuple[float, float]:
        """Noise and the independent samples that it is known from.

        A cause that changes does not change the sensor. So what earlier versions found counts as
        well, unless the residual contradicts it.
        """
        new = sum(len(e) for e in learned.used) / learned.memory
        old = self.noise_samples
        if not (self.noise_std and learned.noise and old):
            return learned.noise, new
        doubt = math.sqrt(0.5 / new + 0.5 / old)  # of the logarithm of the two deviations' ratio
        if abs(math.log(learned.noise / self.noise_std)) > NOISE_CONTRADICTED * doubt:
            return learned.noise, new
        square = (new * learned.noise**2 + old * self.noise_std**2) / (new + old)
        return math.sqrt(square), new + old

    def _record(self, learned: LearnedEffect) -> dict[str, Any]:
        cause = self.cause
        z = np.array([m.z for m in learned.members])
        weights = np.array([m.weight for m in learned.members])
        std = np.sqrt(weights @ (z - learned.z) ** 2) * cause.scale
        belief = believe(learned.angles, cause.turn) if cause.turn > 0 else learned.belief
        seen = [[s.number, s.angle, s.std] for s in learned.angles]
        start = {
            "turn": cause.turn,
            "same_angle": belief.same,
            "angle": learned.members[0].angle,
            "angle_std": belief.std,
            "seen": seen,
        }
        members = [
            [m.weight, m.angle, *(cause.given(m.z)[n] for n in cause.names)]
            for m in learned.members
        ]
        noise, samples = self._noise(learned)
        found = {
            "effect": self.parameters["cause"]["effect"],
            "parameters": cause.given(learned.z),
            "std": dict(zip(cause.names, std.tolist(), strict=True)),
            "noise_std": noise,
            "noise_samples": samples,
            "memory": learned.memory,
            "start": start,
            "members": members,
        }
        return {"machine": self.parameters["machine"], "cause": found}


def _name(cause: str | Effect) -> str:
    return cause if isinstance(cause, str) else cause.name


def _require(machine: Machine, cause: str | Effect) -> None:
    name, effect = _name(cause), machine.law(cause) if isinstance(cause, str) else cause
    try:
        effect.require(machine.model)
    except OptionError as error:
        known = {p.name for p in machine.model.parameters}
        able = [n for n in machine.effect_names if known.issuperset(machine.law(n).needs)]
        expected = "auto, to search for it, or an effect that machine "
        expected += f"{machine.name!r} can have: one of {', '.join(able)}"
        raise OptionError("cause", expected, f"{name!r}, which needs {error.expected}") from None


def _number(value: Any, low: float = -math.inf, high: float = math.inf) -> float:
    number = float(value)
    if not (math.isfinite(number) and low <= number <= high):
        raise ValueError(f"{value} where {low:g} to {high:g} is possible")
    return number


def _median(runs: Samples, weights: Samples) -> Samples:
    order = np.argsort(runs, axis=0)
    total = np.cumsum(weights[order], axis=0)
    place = np.argmax(total >= 0.5 * total[-1], axis=0)
    return np.take_along_axis(runs, np.take_along_axis(order, place[None], 0), 0)[0]
