"""What may come into force: models that learn from the experiments that nothing explains yet."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment, Samples, rms
from ldt_core.base.pausable import Pausable, finished
from ldt_core.base.threads import cores, one_thread
from ldt_core.estimation.fitted_structure import FittedStructure
from ldt_core.machine.machine_file import Machine
from ldt_core.models import build_model
from ldt_core.models.base import Model
from ldt_core.models.grey_box import ALIKE, GreyBoxModel
from ldt_core.models.hybrid import HybridModel
from ldt_core.models.remainder import RemainderModel
from ldt_core.physics.effect import Effect
from ldt_core.twin.version_errors import (
    errs_less,
    explains,
    explains_all,
    far,
    gains,
    pays,
    same,
    squared_error,
)

#: Experiments learned from at most, the newest included.
POOL = 3
#: The same, with those that the version in force has learned from.
MOST = 2 * POOL
#: The models that compete where no cause explains the machine: one with a memory, and one of the
#: speed alone, which needs less data. A linear one is no rival: without physics it errs without
#: bound where the excitation is new.
FLEXIBLE, SMOOTH = "remainder", "hybrid"
#: Parts of an experiment, each of which is held back once from a model that learns from the others.
PARTS = 2
#: Effects that look like another motor constant: of the supply and of the sensor.
CONSTANT, GAINS = "K_t", ("input_gain", "sensor_gain")
#: What learning can fail by.
UNLEARNABLE = (LdtError, np.linalg.LinAlgError, ArithmeticError)


class Candidates:
    """Makes new models of earlier ones, by re-estimation, a search for causes, or flexibly.

    What takes long is done in pieces, on one thread of linear algebra by whoever goes on with it.

    Args:
        settings: of the models that compete (`parameters.yaml`).
    """

    def __init__(self, settings: Mapping[str, Any]) -> None:
        self._settings = settings
        # The last search: version that it began with and experiments, and what it found.
        self._searched: tuple[tuple[int, tuple[int, ...]], list[GreyBoxModel]] | None = None

    def more(
        self, model: Model, known: Sequence[Experiment], experiments: Sequence[Experiment]
    ) -> Model | None:
        """A model that has learned more of a machine that has not changed; None where it has.

        Args:
            model: in force.
            known: that it has learned from; none where they are not known any more.
            experiments: that it has not learned from, the newest last.

        Raises:
            LdtError, LinAlgError, ArithmeticError: it cannot learn.
        """
        with one_thread():
            pool = [*known, *experiments][-MOST:]
            if known and isinstance(model, GreyBoxModel):
                return finished(model.updated(pool))
            return model.fit(pool)

    def learned_more(
        self,
        before: Model,
        known: Sequence[Experiment],
        recent: Sequence[Experiment],
        experiment: Experiment,
    ) -> tuple[Model | None, str]:
        """The present model with more learned of the same machine, if that pays, or why not; no
        reason where the machine is not the same.

        Args:
            before: the present model.
            known: experiments that it has learned from.
            recent: those before the newest.
            experiment: the newest.
        """
        new = [e for e in recent if not any(same(e, k) for k in known) and explains(before, e)]
        pool = [*new[-POOL + 1 :], experiment]
        # What a flexible model has learned from fits, by luck too: the other ones judge it.
        flexible = not isinstance(before, GreyBoxModel)
        try:
            more = self.more(before, known, [experiment] if flexible else pool)
            if more is None:
                return None, ""
            own = more if isinstance(more, GreyBoxModel) else None
            if not (gains(own, before, [experiment]) if own else pays(more, before, new)):
                return None, "learning more of the same machine does not pay"
            return self.more(before, known, pool) if flexible else more, ""
        except UNLEARNABLE as error:
            return None, str(error)

    def refitted(
        self,
        versions: Sequence[Model],
        known: Sequence[Experiment],
        told: Sequence[Experiment],
        recent: Sequence[Experiment],
    ) -> Pausable[GreyBoxModel | None]:
        """The best of the causes of these versions, re-estimated from the newest experiments.

        Args:
            versions: the present one first.
            known: that the present one has learned from.
            told: to explain.
            recent: those before the last one that may show the same machine.
        """
        tried: dict[frozenset[Effect], GreyBoxModel] = {}
        for model in versions:
            if isinstance(model, GreyBoxModel):
                tried.setdefault(frozenset(model.effects), model)
        found: list[GreyBoxModel] = []
        for model in list(tried.values())[:POOL]:
            with suppress(*UNLEARNABLE):
                fitted = yield from model.fitting(told, sized=False)
                if explains_all(fitted, told):
                    own = known if model is versions[0] else ()
                    fitted = yield from self._with_more(model, fitted, own, [*recent, told[-1]])
                found.append(fitted)
                if explains_all(fitted, told):
                    break
        return min(found, key=lambda m: squared_error(m, told), default=None)

    def told_apart(
        self, model: Model, known: Sequence[Experiment], told: Sequence[Experiment]
    ) -> Pausable[tuple[GreyBoxModel, str] | None]:
        """A cause that was not told apart from this model's, and its origin, if it explains what
        this one does not and all that this one has learned from: the tie was decided wrongly. None
        where this one's own causes, re-estimated from all that, explain it as well.

        Args:
            known: that the model has learned from.
            told: that it does not explain.
        """
        if not (isinstance(model, GreyBoxModel) and model.parameters["alike"] and known):
            return None
        pool = [*known[-POOL:], *told]
        with suppress(*UNLEARNABLE):
            for rival in (yield from model.with_alike_causes(pool)):
                if explains_all(rival, pool):
                    if rival.given.keys() == model.given.keys():
                        return None
                    return rival, "has a cause that was not told apart before, and explains both"
        return None

    def _with_more(
        self,
        model: GreyBoxModel,
        fitted: GreyBoxModel,
        known: Sequence[Experiment],
        recent: Sequence[Experiment],
    ) -> Pausable[GreyBoxModel]:
        """What was fitted to the last experiments, with the others that it explains."""
        valid = [e for e in recent if explains(fitted, e)]
        if known and explains_all(fitted, known):
            new = [e for e in valid if not any(same(e, k) for k in known)]
            if found := (yield from model.updated([*known, *new[-POOL:]][-MOST:])):
                return found
        more = (yield from fitted.updated(valid[-POOL:])) if len(valid) > 1 else None
        return more or fitted

    def structures(self, start: Model, pool: Sequence[Experiment]) -> Pausable[list[GreyBoxModel]]:
        """The best of what a search finds; found once, where it is asked for twice.

        Args:
            start: whose causes the search goes on from.
            pool: to explain.
        """
        if not isinstance(start, GreyBoxModel):
            return []
        asked = (start.version, tuple(id(e) for e in pool))
        if self._searched is None or self._searched[0] != asked:
            self._searched = asked, (yield from start.with_other_causes(pool, cores()))
        return self._searched[1]

    def moved(
        self, start: Model, alone: GreyBoxModel, told: Sequence[Experiment]
    ) -> Pausable[GreyBoxModel | None]:
        """The known causes, and one number of the machine file that is another one, where that
        explains experiments with all others near the file's.

        Args:
            start: whose causes are known.
            alone: explains them with numbers far from the file's, of which one may be it.
            told: to explain.
        """
        if not isinstance(start, GreyBoxModel):
            return None
        moved = far(start.box, alone.q)
        found: list[FittedStructure] = []
        with suppress(*UNLEARNABLE):
            search = start.search_on(told)
            for effect in numbers_of_file(start.machine):
                seen_in = start.box.changed_by(effect)
                seen_in |= {CONSTANT} if effect.name in GAINS else set()
                if effect.name not in start.given and not moved.isdisjoint(seen_in):
                    found.append((yield from search.beside(start.present, effect)))
        price = math.log(sum(map(len, told)))
        near = [s for s in found if s.explains and not far(s.box, s.fit.q)]
        scored = [(s.score_beside(start.given, price), s) for s in near]
        if not scored:
            return None
        (least, best), *others = sorted(scored, key=lambda pair: pair[0])
        alike = [other.names[-1] for score, other in others if score < least + ALIKE]
        return start.adopt(best, told, alike)

    def loosened(self, start: Model, pool: Sequence[Experiment]) -> Pausable[list[GreyBoxModel]]:
        """The known causes, with the machine's parameters beyond their tolerances."""
        found = []
        if isinstance(start, GreyBoxModel):
            with suppress(*UNLEARNABLE):
                found.append((yield from start.loosened(pool)))
        return found

    def flexible(
        self, start: Model, pool: Sequence[Experiment], causes: Sequence[GreyBoxModel] | None = None
    ) -> list[Model]:
        """Flexible models that have learned from these experiments.

        Args:
            start: of the machine.
            pool: to learn from.
            causes: that they stand on; None for the machine file's physics alone.
        """
        smooth = build_model(SMOOTH, start.machine, self._settings)
        assert isinstance(smooth, HybridModel)
        learners: list[Model] = []
        for kind in (self._remainder(start), smooth):
            learners += [kind] if causes is None else map(kind.on, causes)
        found: list[Model] = []
        for learner in learners:
            with suppress(*UNLEARNABLE):
                found.append(learner.fit(pool))
        return found

    def at_once(
        self, start: Model, rivals: Sequence[Model], pool: Sequence[Experiment]
    ) -> Model | None:
        """The flexible model, where it does better than all of these in what was held back from it.

        Args:
            start: whose causes it may stand on.
            rivals: the present model first.
            pool: to learn from.
        """
        causes = [start] if isinstance(start, GreyBoxModel) and start.given else []
        present = [m for m in rivals[:1] if isinstance(m, RemainderModel)]
        tried: list[RemainderModel] = []  # a fit begins anew, and depends on the physics alone
        plain = self._remainder(start)
        for learner in [*present, plain, *map(plain.on, causes)]:
            if not any(learner.base.parameters == other.base.parameters for other in tried):
                tried.append(learner)
        least, best = float("inf"), None
        for physics in tried:
            with one_thread(), suppress(*UNLEARNABLE):
                left, known = _held_back(physics, rivals, pool)
                error = sum(rms(row) ** 2 for row in left)
                if error < least and all(errs_less(left, other) for other in known):
                    least, best = error, physics.fit(pool)
        return best

    def _remainder(self, start: Model) -> RemainderModel:
        """Untrained, on the machine file's physics."""
        found = build_model(FLEXIBLE, start.machine, self._settings)
        assert isinstance(found, RemainderModel)
        return found


def numbers_of_file(machine: Machine) -> list[Effect]:
    """The effects that say of one number of the machine file that it is another one, or look so.

    Not a drag, which has laws of its own: only a search tells which.
    """
    library = [e for e in machine.possible_effects() if len(e.parameters) == 1]
    return [e for e in library if e.name in GAINS or (e.on_parameters and e.family != "drag")]


def _held_back(
    learner: Model, rivals: Sequence[Model], pool: Sequence[Experiment]
) -> tuple[list[Samples], list[float]]:
    """What a learner leaves in the parts of experiments that it has not learned from, and the mean
    squares of the rivals there, summed up.
    """
    left, known = [], [0.0] * len(rivals)
    predicted = [[m.predict(e).residual(e) for e in pool] for m in rivals]
    for part in range(PARTS):
        held = [slice(len(e) * part // PARTS, len(e) * (part + 1) // PARTS) for e in pool]
        trained = learner.fit_without(pool, held)
        for i, (e, block) in enumerate(zip(pool, held, strict=True)):
            left.append(trained.predict(e).residual(e)[block])
            for j, rows in enumerate(predicted):
                known[j] += rms(rows[i][block]) ** 2
    return left, known
