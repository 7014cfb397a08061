"""The contest: whatever explains the machine comes into force, whichever kind of model it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ldt_core.base.experiment import FAILED, Action, Adaptation, Experiment, Level, Signal, rms
from ldt_core.models.base import Model
from ldt_core.models.grey_box import GreyBoxModel
from ldt_core.twin.adaptor import PASSED_OVER, ROLLED_BACK, Adaptor
from ldt_core.twin.candidates import POOL, UNLEARNABLE, Candidates
from ldt_core.twin.condition_chain import UNLEARNED, ConditionChain
from ldt_core.twin.memory import Memory
from ldt_core.twin.original_watch import OriginalWatch
from ldt_core.twin.search_backoff import SearchBackoff
from ldt_core.twin.stage import Archive, RecordedStep
from ldt_core.twin.training_data import VALID_ERROR_RATIO
from ldt_core.twin.version_errors import (
    BETTER,
    alike,
    explains,
    fit_of,
    gains,
    largest_error,
    pays,
    rms_error,
    same,
)

#: In the details of an adaptation: what learns from it competes at the next experiment.
SEARCHING = "searching"
#: In the details of an adaptation: the original has come into force again.
ORIGINAL = "original_again"


class ContestAdaptor(Adaptor):
    """Lets every earlier version, causes old and new, and a flexible model compete at a positive.

    Where the present model claims not to know enough, it learns more of the same machine. It is
    replaced only where that pays. At any other positive, in this order, until one explains it:

    1. an earlier version, the original included: a machine that goes back and forth gets its
       version back at once, without training;
    2. the causes known so far, re-estimated with the machine's parameters, under their priors;
    3. one more effect of the library, or another one, that explains the experiment to the noise;
    4. the flexible model, if it does better in the halves that it has not learned from;
    5. what comes nearest of all these. They compete at the next experiment, from which none of them
       has learned.

    Over ten experiments the twin's largest errors may sum to 1.1 times the original's; beyond, the
    original comes into force again.

    Args:
        model: to begin with, of kind grey_box.
        memory: S_w and the recent experiments.
        settings: of the models that compete (`parameters.yaml`).
        how: as for `Adaptor`.
    """

    def __init__(
        self, model: Model, memory: Memory, settings: Mapping[str, Any], **how: Any
    ) -> None:
        super().__init__(model, memory, **how)
        self.candidates = Candidates(settings)
        self.original = model
        self.watch = OriginalWatch()
        #: What the machine was like, and how that follows upon each other.
        self.chain = ConditionChain()
        #: The version that explains the present experiment.
        self._explaining: Model | None = None
        # Whether the present model claims not to know enough, and fails where it was never right.
        self._learning = self._elsewhere = False
        #: Experiments that the present version has learned from, as far as they are known.
        self.learned_from: list[Experiment] = []
        #: Experiments to learn from, by what competes at the next one.
        self.pending: list[Experiment] = []
        self.backoff = SearchBackoff()
        # Whether the version adopted last was in force before.
        self._again = False
        # Of other conditions, the model and the experiment shown that it does not explain.
        self._apart: dict[int, tuple[Model, Experiment]] = {}

    def _dealt(self, experiment: Experiment, signal: Signal) -> tuple[Adaptation, Model]:
        self.watch.saw(signal.max_error, largest_error(self.original, experiment))
        pool, self.pending = self.pending, []
        if self._passed_over(experiment):
            return super()._dealt(experiment, signal)
        self._explain(experiment)
        self._learning = signal.state == "learning"
        self._elsewhere = signal.state in ("inadequate", "new_range")
        before, recent = self.model, self.memory.recent
        done = self._contested(pool, experiment, signal) or super()._dealt(experiment, signal)
        self._took(before, [*recent, experiment], signal)
        self._saw(experiment)
        return done

    def _contested(
        self, pool: Sequence[Experiment], experiment: Experiment, signal: Signal
    ) -> tuple[Adaptation, Model] | None:
        """What comes into force without learning from this experiment."""
        found, details = self._trained(pool, experiment, signal), {}
        long = self.watch.worse and not alike(self.model, self.original)
        seen = signal.level is not Level.NEGATIVE or signal.state != "new_range"
        if found is None and (long or (not seen and self.watch.worse_now)):
            where = "erred less over ten experiments" if long else "errs less in this new range"
            found, details[ORIGINAL] = (self.original, f"is the original again, which {where}"), 1.0
            self.watch = OriginalWatch()
        known = self._explaining if signal.level is Level.WARNING else None
        other = known is not None and known is not self.model
        if found is None and known and other and self._foreseen(known, experiment) is known:
            found = known, f"is version {known.version} again"
        if found is None:
            return None
        model, origin = found
        before = self.model
        self._adopt(model.again(before.version + 1))
        if signal.level is Level.WARNING:
            self.memory.store(experiment)
        elif signal.level is Level.POSITIVE:
            self.memory.clear()
        self.memory.remember(experiment)
        details["warning_set"] = len(self.memory)
        version, reason = self.model.version, self._reason(before, experiment, origin)
        told = Adaptation(experiment.number, Action.ADAPTED, version, reason, details)
        return self._warned(told, experiment), self.model

    def _adopt(self, model: Model) -> None:
        there = [m for m in (*self.earlier[1:], self.model) if alike(m, model)]
        self._again = bool(there) or alike(model, self.original)
        super()._adopt(model)
        self.earlier = [m for i, m in enumerate(self.earlier) if i == 0 or m not in there]
        for m in there:
            if m is not self.original:
                self.chain.rename(m.version, model.version)

    def _condition(self, model: Model) -> int:
        """The condition that a version stands for: its number, of what is the original again 0."""
        return UNLEARNED if alike(model, self.original) else model.version

    def _explain(self, experiment: Experiment, step: RecordedStep | None = None) -> None:
        """Find the version that explains the experiment, the present one before all others."""
        said = None if step is None else step.prediction
        fits, error = fit_of(self.model, experiment, said)
        self._explaining = self.model if fits else self._known(experiment)
        self.backoff.saw(isinstance(self._explaining, GreyBoxModel), error)

    def _took(self, before: Model, recent: Sequence[Experiment], signal: Signal) -> None:
        """Note what a new version has learned from; of one in force again it is not known.

        One that has learned more of the same condition is another version of it.
        """
        if self.model is before:
            return
        known = {e.number: e for e in (*self.learned_from, *recent)}  # the newest of a number
        numbers = () if self._again else self.model.trained_on
        learned = [known[n] for n in numbers if n in known]
        more = signal.state == "learning" and not self._again and before is not self.original
        if more or any(same(e, k) for e in learned for k in self.learned_from):
            self.chain.rename(before.version, self.model.version)
        self.learned_from = learned

    def _saw(self, experiment: Experiment) -> None:
        model = self._explaining
        learned = any(same(experiment, e) for e in self.learned_from)
        if alike(model, self.model) if model else learned and explains(self.model, experiment):
            model = self.model
        here = None if model is None else self._condition(model)
        if model is not None and here:
            self._merge(model, here, experiment)
        self.chain.saw(here, experiment)

    def _merge(self, model: Model, here: int, experiment: Experiment) -> None:
        """Two versions that explain each other's experiments are estimates of one condition."""
        apart = {}
        for version in self.earlier:
            there = self._condition(version)
            shown = self.chain.shown.get(there) if there not in (UNLEARNED, here) else None
            if shown and (self._apart.get(there) == (model, shown) or not explains(model, shown)):
                apart[there] = model, shown
            elif shown and explains(version, experiment):
                self.chain.rename(there, here)
        self._apart = apart

    def _foreseen(self, version: Model, experiment: Experiment) -> Model:
        """Which will err least in the next one: this version, which explains it, the present one or
        the original, of which people know how it errs.
        """
        here = self._condition(version)
        rivals = list({id(m): m for m in (self.original, version, self.model)}.values())
        expected = [self.chain.expected_error(m, here, experiment) for m in rivals]
        best = int(np.argmin(expected))
        return rivals[best] if expected[best] < BETTER * expected[0] else self.original

    def _learn(self, experiment: Experiment) -> tuple[Action, str, dict[str, float]]:
        self.memory.clear()
        before = self.model
        present = rms(before.predict(experiment).residual(experiment))
        version = self._explaining
        if self._learning:
            more, why = self._learned_more(experiment)
            if more is not None:
                return self._learned_by(more, "estimates its causes anew", experiment, {})
            if version is before and why:
                return Action.REFUSED, f"{why}; version {before.version} stays", {}
        if version is not None and version is not before:
            next_one = self._foreseen(version, experiment)
            origin = f"is version {next_one.version} again"
            if next_one is not version:
                said = f"version {version.version} explains it, but the machine changes so often"
                origin = f"{said} that version {next_one.version} will err less"
                if alike(next_one, before):
                    return Action.REFUSED, origin, {}
            self._adopt(next_one.again(before.version + 1))
            return Action.ADAPTED, self._reason(before, experiment, origin), {}
        if cause := self._caused(experiment):
            return self._learned_by(*cause, experiment, {})
        details: dict[str, float] = {}
        then = f"searches wait for {self.backoff.wait} more experiments"
        if self.backoff.due:
            self.pending, details = self.unexplained(experiment)[-POOL:], {SEARCHING: 1.0}
            then = "other models compete at the next experiment"
            self.backoff.failed(present)
        judged = self.unexplained(experiment)  # in one alone a version errs less by luck
        beaten = (before, self.original)
        flexible = self.candidates.at_once(self._grey(), beaten, judged[-POOL:])
        if flexible is not None:
            origin = "does better in what was held back from it, no known cause explains it"
            return self._learned_by(flexible, origin, experiment, details)
        rivals = (self.original, *self.earlier)
        nearest = min(rivals, key=lambda m: sum(rms_error(m, e) ** 2 for e in judged))
        if pays(nearest, before, judged) and self._foreseen(nearest, experiment) is nearest:
            self._adopt(nearest.again(before.version + 1))
            origin = f"is version {nearest.version} again, which errs least"
            return Action.ADAPTED, self._reason(before, experiment, origin), details
        stays = f"version {before.version} stays"
        return Action.REFUSED, f"no known cause explains it, {then}; {stays}", details

    def _learned_by(
        self, model: Model, origin: str, experiment: Experiment, details: dict[str, float]
    ) -> tuple[Action, str, dict[str, float]]:
        """A model that has learned comes into force."""
        before = self.model
        reached, present = rms_error(model, experiment), rms_error(before, experiment)
        details = {"candidate_rmse": reached, "present_rmse": present, **details}
        self._adopt(model.again(before.version + 1))
        return Action.ADAPTED, self._reason(before, experiment, origin), details

    def _caused(self, experiment: Experiment) -> tuple[GreyBoxModel, str] | None:
        """A model of causes that explains the experiment, known or searched for, and its origin."""
        before, recent, known = self.model, self._recent(experiment), self.learned_from
        versions = (before, *reversed(self.earlier))
        best = self.candidates.refitted(versions, known, experiment, recent)
        if best is not None and not (
            explains(best, experiment) and gains(best, before, experiment)
        ):
            best = None
        alone, pool = best, [*known[-POOL + 1 :], experiment]
        if alone is not None and self._elsewhere and not all(explains(alone, e) for e in pool):
            # Of one machine, as the excitation alone is another: another cause may explain all.
            best = self._searched(pool) or alone
        elif best is None:
            best = self._searched([experiment])
        if best is None:
            return None
        return best, "estimates its causes anew" if best is alone else "has a new cause"

    def _searched(self, pool: Sequence[Experiment]) -> GreyBoxModel | None:
        """What a search finds that explains all of these, unless searches have to wait."""
        if not self.backoff.due:
            return None
        found = self.candidates.structures(self._grey(), pool)
        explaining = (m for m in found if all(explains(m, e) for e in pool))
        return next((m for m in explaining if gains(m, self.model, pool[-1])), None)

    def _learned_more(self, experiment: Experiment) -> tuple[Model | None, str]:
        """The present model with more learned of the same machine, if that pays, or why not; no
        reason where the machine is not the same.
        """
        before, known, recent = self.model, self.learned_from, self._recent(experiment)
        new = [e for e in recent if not any(same(e, k) for k in known) and explains(before, e)]
        pool = [*new[-POOL + 1 :], experiment]
        # What a flexible model has learned from fits, by luck too: the other ones judge it.
        flexible = not isinstance(before, GreyBoxModel)
        try:
            more = self.candidates.more(before, known, [experiment] if flexible else pool)
            if more is None:
                return None, ""
            own = more if isinstance(more, GreyBoxModel) else None
            if not (gains(own, before, experiment) if own else pays(more, before, new)):
                return None, "learning more of the same machine does not pay"
            return self.candidates.more(before, known, pool) if flexible else more, ""
        except UNLEARNABLE as error:
            return None, str(error)

    def _reason(self, before: Model, experiment: Experiment, origin: str) -> str:
        words = f"version {self.model.version} {origin}"
        change = self.model.change(before)
        return f"since experiment {experiment.number}: {change}; {words}" if change else words

    def _known(self, experiment: Experiment) -> Model | None:
        """The earlier version that explains the experiment best, if better than the present."""
        best, least = None, rms_error(self.model, experiment)
        for version in self.earlier:
            error = rms_error(version, experiment)
            if error < least and explains(version, experiment):
                best, least = version, error
        return best

    def unexplained(self, experiment: Experiment) -> list[Experiment]:
        """The newest experiments that neither the present model nor the original explains, as far
        as the present one errs as much in them: behind a change that nobody explains it errs more.
        """
        pool = [experiment]
        least = rms_error(self.model, experiment) / VALID_ERROR_RATIO
        for e in reversed(self._recent(experiment)):
            known = explains(self.model, e) or explains(self.original, e)
            if known or rms_error(self.model, e) < least:
                break
            pool.insert(0, e)
        return pool

    def _trained(
        self, pool: Sequence[Experiment], experiment: Experiment, signal: Signal
    ) -> tuple[Model, str] | None:
        """What learned from the experiments before, if it does better on this one."""
        if not pool or signal.level is Level.NEGATIVE:
            return None
        # Nobody explains them, no candidate has learned from them. One alone is fitted by luck.
        judged = [e for e in self.unexplained(experiment) if all(e is not p for p in pool)]

        def squared(model: Model) -> float:
            return sum(rms_error(model, e) ** 2 for e in judged)

        best = min(self.candidates.learned(self._grey(), pool), key=squared, default=None)
        if best is None or not all(pays(best, m, judged) for m in (self.model, self.original)):
            return None
        origin = f"learned from experiment {pool[-1].number} and does best in this one"
        if signal.level is Level.POSITIVE and not isinstance(best, GreyBoxModel):
            # A cause tells more than a flexible model.
            return self._caused(experiment) or (best, origin)
        return best, origin

    def _grey(self) -> Model:
        """The newest model of which causes explained an experiment: a search goes on from them.

        Causes that merely err less than others are in its way.
        """
        for model in (self.model, *reversed(self.earlier)):
            if isinstance(model, GreyBoxModel) and self._condition(model) in self.chain.shown:
                return model
        return self.original

    def recall(self, step: RecordedStep) -> None:
        """Take over what a recorded step says."""
        if step.adaptation.details.get(FAILED):
            self.pending = []
            super().recall(step)
            return
        self.watch.saw(step.signal.max_error, largest_error(self.original, step.experiment))
        told = step.adaptation.details
        pool = self.unexplained(step.experiment)[-POOL:] if told.get(SEARCHING) else []
        passed_over = any(told.get(why) for why in PASSED_OVER)
        if not passed_over:
            self._explain(step.experiment, step)
        if pool:
            self.backoff.failed(rms_error(self.model, step.experiment))
        before, recent = self.model, self.memory.recent
        super().recall(step)
        if ROLLED_BACK in told:
            self.chain, self.learned_from = ConditionChain(), []
        elif not passed_over:
            self._took(before, [*recent, step.experiment], step.signal)
            self._saw(step.experiment)
        if told.get(ORIGINAL):
            self.watch = OriginalWatch()
        self.pending = pool

    def state(self) -> dict[str, Any]:
        """Its state by the numbers of what is recorded; `return_to` takes it back."""
        pending = [[e.number, e.start] for e in self.pending]
        learned = [[e.number, e.start] for e in self.learned_from]
        own = {"errors": list(self.watch.errors), "pending": pending, "learned_from": learned}
        chain, backoff = self.chain.state(), self.backoff.state()
        return {**super().state(), **own, "chain": chain, "backoff": backoff}

    def return_to(self, state: Mapping[str, Any], archive: Archive) -> None:
        """Take back a state, before any step here."""
        errors = [(float(twin), float(original)) for twin, original in state["errors"]]
        pending = [archive.experiment(number, start) for number, start in state["pending"]]
        learned = [archive.experiment(number, start) for number, start in state["learned_from"]]
        chain = ConditionChain()
        chain.return_to(state["chain"], archive)
        super().return_to(state, archive)
        self.watch, self.pending, self.chain = OriginalWatch(errors), pending, chain
        self.learned_from = learned
        self.backoff.return_to(state["backoff"])
