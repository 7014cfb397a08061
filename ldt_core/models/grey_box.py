"""The grey-box model: the machine's physics with the effects and parameters that explain it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Self

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment, Prediction, rms
from ldt_core.base.pausable import Pausable, finished
from ldt_core.estimation.amount_interval import intervals_of
from ldt_core.estimation.effect.start_angle import FoundAngle, believe, together
from ldt_core.estimation.fitted_structure import FittedStructure
from ldt_core.estimation.grey_box import ANGLES, COARSE_STEP, Case, GreyBox, Prior
from ldt_core.estimation.misfit import misfit, noise_in, setting
from ldt_core.estimation.running_start import running_start
from ldt_core.estimation.structure_screening import Present
from ldt_core.estimation.structure_search import StructureSearch
from ldt_core.models.base import Model
from ldt_core.models.causes import SURE, Causes, Doubts, intervals_in
from ldt_core.physics.base import CURRENT

#: Directions in which the parameters are least known, along which a prediction is spread out.
DIRECTIONS = 3
#: Samples that a free run needs to tell anything about a machine.
LEAST_SAMPLES = 20
#: Samples of one experiment that a search works on: bounds its time. Of 3000, a search took twice
#: what it is granted at an experiment (`cause_search.STEPS`), of 2000 half, and found the same.
MOST_SAMPLES = 2_000
#: Probability of one and the same start angle from which on it is used, and its rounding error:
#: one angle alone leaves it even.
EVEN, ROUNDED = 0.5, 1e-9
#: Structures that explain an experiment alike: posterior odds below 20 (Kass, Raftery, "Bayes
#: factors", Journal of the American Statistical Association 90, 1995, "strong").
ALIKE = 2 * math.log(20.0)
#: Noise [rad/s] as a part of the speed's root mean square, at least: the simulation's own error.
NOISE_FLOOR = 1e-4
#: Times the precision of the file's tolerances, where they are not trusted: ten deviations are one.
LOOSE = 1e-2
#: Precision, in tolerances, beyond which a stiff run's differences are no machine's: a millionth.
MOST_TOLD = 1e12


class GreyBoxModel(Model):
    """Free run of the machine's physics, with effects, and with its parameters within tolerance.

    The untrained model is the machine file's physics. `fit` re-estimates the parameters of the
    effects that act, and with them the machine's own, under a prior that begins with the file's
    values and tolerances and shrinks with every version. `FittedStructure`s of a search become
    models by `adopt`.

    `parameters`: `machine`, the physics parameters; `effects`, name → parameter → value; `alike`,
    names of effects that explain the same as well; `intervals`, effect → parameter → 95 % interval
    [low, high], null where nothing determines it; `noise_std` [rad/s], null while untrained;
    `start` with `turn` [rad], and `seen`, the start angles found (number, angle, std [rad] each);
    `prior` with `mean` (k) and `precision` (k, k) of the machine's coordinates (`GreyBox`);
    `before`, the same before it learned; and `directions`, rows of coordinates by one standard
    deviation each.

    Args:
        machine: the machine as it is known beforehand.
        parameters: all that makes the model, in JSON types; None for the untrained model.
        version: 0 when untrained.
        trained_on: numbers of the experiments it learned from.

    Raises:
        ModelError: parameters that cannot be this model's.
    """

    kind = "grey_box"

    def untrained(self) -> dict[str, Any]:
        """The machine file's physics."""
        names = GreyBox(self.machine, (), self.machine.tolerances).uncertain
        prior = _plain(Prior.of_file(self.machine, names))
        return {
            "machine": dict(self.machine.parameters),
            "effects": {},
            "alike": [],
            "noise_std": None,
            "prior": prior,
            "before": prior,
            "directions": [],
            "start": {"turn": 0.0, "seen": []},
        }

    def build(self) -> None:
        """Check the parameters."""
        given = self.parameters["effects"]
        unknown = [n for n in given if n not in self.machine.effect_names]
        if unknown:
            raise ValueError(f"effect {unknown[0]!r}, which is not known")
        self.effects = tuple(
            self.machine.effect(n).in_detail(values) for n, values in given.items()
        )
        for effect in self.effects:
            effect.require(self.machine.model)
        self.given = {e.name: e.check(given[e.name]) for e in self.effects}
        self.box = GreyBox(self.machine, self.effects, self.machine.tolerances)
        k = len(self.box.uncertain)
        self.prior = _prior(self.parameters["prior"], k)
        #: None in a recording that does not tell it.
        begun = self.parameters.get("before")
        self.before = None if begun is None else _prior(begun, k)
        known = self.machine.parameters
        ratios = [self.parameters["machine"][n] / known[n] for n in self.box.uncertain]
        own = np.array([math.log(r) for r in ratios]) / self.box.tolerance
        self.q = self.box.coordinates(self.given, own)
        self.directions = [np.array(d, dtype=np.float64) for d in self.parameters["directions"]]
        if any(d.shape != self.q.shape for d in self.directions):
            raise ValueError("directions of another number of coordinates")
        start = self.parameters["start"]
        self.turn = float(start["turn"])
        self.seen = [FoundAngle(int(n), float(a), max(float(s), 1e-9)) for n, a, s in start["seen"]]
        #: Whether the machine starts at the same angle every time, and at which.
        self.angle = believe(self.seen, self.turn) if self.turn > 0 else None
        noise = self.parameters["noise_std"]
        self.noise_std = None if noise is None else float(noise)
        of_file = tuple(effect.name for effect, _ in self.machine.effects)
        told = intervals_in(self.parameters.get("intervals", {}))  # older recordings have none
        alike = tuple(self.parameters["alike"])
        #: What acts, as far as this version knows.
        self.causes = Causes(self.effects, self.given, told, alike, of_file)
        self._last: tuple[Experiment, Prediction] | None = None

    @property
    def present(self) -> Present:
        """Where a search for further effects begins.

        What was learned of the machine's own parameters is true if the effects of this version are
        all that act. A search doubts that, and begins with what the machine file says of them.
        """
        return Present(self.effects, self.given, Prior.of_file(self.machine, self.box.uncertain))

    def predict(self, experiment: Experiment) -> Prediction:
        """Free run; `speed_std` is the noise and what the least known directions make of it.

        Raises:
            LdtError: the simulated speed grows without bound.
        """
        # One experiment is asked about several times in a row: how far off, whether explained.
        last = self._last
        if last is None or last[0] is not experiment or last[1].model_version != self.version:
            last = experiment, self._prediction(experiment)
            self._last = last
        return last[1]

    def _prediction(self, experiment: Experiment) -> Prediction:
        about = (experiment.number, experiment.start, experiment.period, self.version)
        noise = self.noise_std or 0.0
        rest = self.box.at_rest(experiment, noise) if noise else False
        start = np.zeros(CURRENT + 1)
        variance = np.full(len(experiment), noise**2)
        if not rest:
            start = running_start(self.box, self.q, experiment, self.turn)
        elif self.angle is not None and self.angle.same < EVEN - ROUNDED:
            starts = [np.array([self.turn * k / ANGLES, 0.0, 0.0]) for k in range(ANGLES)]
            cases = [Case(self.q, experiment, rest, start) for start in starts]
            runs = self.box.speeds(cases, step=COARSE_STEP)
            speed = np.median(runs, axis=0)
            variance += np.mean((np.array(runs) - speed) ** 2, axis=0)
            return Prediction(*about, speed, np.sqrt(variance))
        elif self.angle is not None:
            start[0] = self.angle.angle or 0.0
        speed = self.box.speed(self.q, experiment, rest, start)
        if self.noise_std is None:
            return Prediction(*about, speed)
        low, high = self.box.low, self.box.high
        moved = [np.clip(self.q + direction, low, high) for direction in self.directions]
        near = [Case(q, experiment, rest, start) for q in moved]
        for other in self.box.speeds(near, step=COARSE_STEP):
            variance += (other - speed) ** 2
        return Prediction(*about, speed, np.sqrt(variance))

    def fit(self, experiments: Sequence[Experiment], sized: bool = True) -> Self:
        """The same effects and the machine's parameters, re-estimated; unneeded effects leave.

        Args:
            experiments: to learn from.
            sized: whether a model that does not explain them is wanted too.

        Raises:
            LdtError: no or too few samples.
        """
        return finished(self.fitting(experiments, sized))

    def fitting(self, experiments: Sequence[Experiment], sized: bool = True) -> Pausable[Self]:
        """`fit`, in pieces."""
        search = self.search_on(experiments)
        found = yield from self._fitted(search, self.prior, sized)
        return (yield from self._again(search, found, experiments))

    def updated(self, experiments: Sequence[Experiment]) -> Pausable[Self | None]:
        """This model with more experiments of a machine that has not changed; None where it has.

        What was known before the version learned is the prior, so that nothing counts twice; all
        the experiments have to be explained by one machine.

        Args:
            experiments: those that this version has learned from, and more.

        Raises:
            LdtError: no or too few samples.
        """
        if self.before is None:
            return None
        search = self.search_on(experiments)
        found = yield from search.refined(Present(self.effects, self.given, self.before), self.q)
        if not found.explains:
            return None
        return (yield from self._again(search, found, experiments))

    def _again(
        self, search: StructureSearch, found: FittedStructure, experiments: Sequence[Experiment]
    ) -> Pausable[Self]:
        """The next version with the same causes; those not told apart stay so until they are."""
        found = yield from search.pruned(found, self.given)
        last = self.effects[-1:] == found.box.effects[-1:] and found.explains
        rivals = [self.machine.effect(n) for n in self.parameters["alike"] if last]
        alike = yield from search.still_alike(found.present, rivals, ALIKE)
        for rival in rivals:  # told apart only where a whole fit says so: a shaft may be captured
            laws = (*found.box.effects[:-1], rival)
            if rival.name not in alike:
                other = yield from search.fitted(found.present, laws, sized=False)
                if other.explains and other.score < found.score + ALIKE:
                    alike.append(rival.name)
        return self.adopt(found, experiments, alike)

    def loosened(self, experiments: Sequence[Experiment]) -> Pausable[Self]:
        """The same effects, and the machine's parameters as if hardly anything were known of them.

        What no law explains, they may imitate.

        Raises:
            LdtError: no or too few samples.
        """
        search = self.search_on(experiments)
        file = self.present.prior
        present = replace(self.present, prior=Prior(file.mean, LOOSE * file.precision))
        return self.adopt((yield from search.fitted(present, self.effects)), experiments)

    def _fitted(
        self, search: StructureSearch, known: Prior, sized: bool
    ) -> Pausable[FittedStructure]:
        near = self.q if self.version > 0 else None
        present = Present(self.effects, self.given, known)
        found = yield from search.fitted(present, self.effects, near, sized)
        if self.version > 0 and found.surprises:
            anew = yield from search.fitted(self.present, self.effects, sized=sized)
            found = min(found, anew, key=lambda s: s.surprise)
        return found

    def search_on(self, experiments: Sequence[Experiment], workers: int = 1) -> StructureSearch:
        """A search for what explains these experiments.

        Raises:
            LdtError: no or too few samples.
        """
        if not experiments or max(len(e) for e in experiments) < LEAST_SAMPLES:
            expected = f"an experiment of {LEAST_SAMPLES} samples or more"
            raise LdtError(f"grey-box model: expected {expected} to learn from, got none")
        noise = max(self.noise_of(e) for e in experiments)
        told = [self._stretch(e, noise) for e in experiments]
        return StructureSearch(self.machine, self.machine.tolerances, told, noise, workers)

    def _stretch(self, experiment: Experiment, noise: float) -> Experiment:
        """The first part of a long experiment that this model does not explain."""
        if len(experiment) <= MOST_SAMPLES:
            return experiment
        residual = experiment.speed - self.predict(experiment).speed
        under = setting(experiment.voltage, experiment.speed)
        for begin in range(0, len(experiment) - MOST_SAMPLES + 1, MOST_SAMPLES // 2):
            end = begin + MOST_SAMPLES
            part = experiment.part(begin, end)
            if begin > 0 and self.box.at_rest(part, noise):
                continue  # it passes through 0, perhaps fast
            if not misfit(residual[begin:end], None, under.part(slice(begin, end))).explained:
                return part
        return experiment.part(0, MOST_SAMPLES)

    def with_other_causes(
        self, experiments: Sequence[Experiment], workers: int = 1
    ) -> Pausable[list[Self]]:
        """The best that a search finds beside and in place of the present effects, or none."""
        try:
            search = self.search_on(experiments, workers)
            ranked = yield from search.search(self.present, self.machine.possible_effects())
            if not ranked:
                return []
            near = (s.names[-1] for s in ranked[1:] if s.score - ranked[0].score < ALIKE)
            rivals = [n for n in dict.fromkeys(near) if n not in ranked[0].names]
            return [self.adopt(ranked[0], experiments, rivals)]
        except (LdtError, np.linalg.LinAlgError, ArithmeticError):
            return []

    def with_alike_causes(self, experiments: Sequence[Experiment]) -> Pausable[list[Self]]:
        """What was not told apart from the last effect, in its place, and this model's own causes,
        fitted to these experiments; the best first, these where the odds are not strong.

        Raises:
            LdtError: no or too few samples.
        """
        search, found = self.search_on(experiments), []
        for last in (self.effects[-1], *map(self.machine.effect, self.parameters["alike"])):
            laws = (*self.effects[:-1], last)
            found.append((yield from search.fitted(self.present, laws, sized=False)))
        own = found[0]
        ranked = sorted(found, key=lambda s: s.score - (ALIKE if s is own else 0.0))

        def alike(best: FittedStructure) -> list[str]:
            others = (s for s in ranked if s is not best and s.explains)
            return [s.names[-1] for s in others if s.score - best.score < ALIKE]

        return [self.adopt(f, experiments, alike(f)) for f in ranked]

    def noise_of(self, experiment: Experiment) -> float:
        """Standard deviation of the noise [rad/s] that the residual's roughness shows."""
        floor = NOISE_FLOOR * rms(experiment.speed)
        residual = experiment.speed - self.predict(experiment).speed
        under = setting(experiment.voltage, experiment.speed)
        return max(noise_in(residual, under), floor, 1e-12)

    def adopt(
        self,
        found: FittedStructure,
        experiments: Sequence[Experiment],
        alike: Sequence[str] = (),
    ) -> Self:
        """The next version, with a fitted structure.

        Args:
            found: effects and parameters.
            experiments: that it was fitted to.
            alike: names of effects that explain these as well in the place of the last one.
        """
        box, fit = found.box, found.fit
        machine, use = box.values(fit.q)
        rest = np.concatenate(fit.residuals)
        noise = max(fit.noise, 1e-12)
        # Residuals that the noise does not explain tell less than white noise would.
        excess = max(1.0, float(np.mean(rest**2)) / noise**2)
        k = len(box.uncertain)
        told = fit.information.copy()
        told[:k, :k] -= found.prior.precision
        absurd = np.diag(told) > MOST_TOLD
        told[absurd], told[:, absurd] = 0.0, 0.0
        information = told / excess
        information[:k, :k] += found.prior.precision
        information[np.diag_indices(box.size)] += 1e-9
        inner, cross = information[:k, :k], information[:k, k:]
        precision = inner - cross @ np.linalg.solve(information[k:, k:], cross.T)
        values, vectors = np.linalg.eigh(np.linalg.inv(information))
        widest = [vectors[:, i] * math.sqrt(max(values[i], 0.0)) for i in range(box.size)]
        angles = together(self.seen, found.fit.angles, fit.turn) if fit.turn > 0 else self.seen
        start = {
            "turn": fit.turn or self.turn,
            "seen": [[a.number, a.angle, a.std] for a in angles],
        }
        record = {
            "machine": machine,
            "start": start,
            "intervals": intervals_of(found, told),
            "effects": {e.name: given for e, given in use},
            "alike": list(alike),
            "noise_std": noise,
            "prior": _plain(Prior(fit.q[:k], _symmetric(precision))),
            "before": _plain(found.prior),
            "directions": [np.clip(d, -1.0, 1.0).tolist() for d in widest[-DIRECTIONS:]],
        }
        return self.successor(record, experiments)

    def change(self, before: Model, doubts: Doubts = SURE, lasting: bool = False) -> str:
        """ "unbalance has grown to 6.100 ± 0.020 mm"; see `Causes.change`."""
        old = before.causes if isinstance(before, GreyBoxModel) else Causes()
        return self.causes.change(old, doubts, lasting)


def _plain(prior: Prior) -> dict[str, Any]:
    return {"mean": prior.mean.tolist(), "precision": prior.precision.tolist()}


def _prior(plain: Mapping[str, Any], count: int) -> Prior:
    mean, precision = (np.array(plain[n], dtype=np.float64) for n in ("mean", "precision"))
    precision = precision.reshape(0, 0) if precision.size == 0 else precision  # JSON's empty list
    if mean.shape != (count,) or precision.shape != (count, count):
        raise ValueError(f"a prior of {mean.size} parameters where the machine has {count}")
    if count and float(np.linalg.eigvalsh(precision).min()) <= 0:
        raise ValueError("a prior that is no distribution")
    return Prior(mean, precision)


def _symmetric(matrix: Array) -> Array:
    return np.asarray((matrix + matrix.T) / 2, dtype=np.float64)
