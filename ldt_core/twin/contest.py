"""The contest: whatever explains the machine comes into force, whichever kind of model it is."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from ldt_core.base.experiment import FAILED, Action, Adaptation, Experiment, Level, Signal
from ldt_core.base.pausable import finished
from ldt_core.base.sentences import counted
from ldt_core.base.threads import one_thread
from ldt_core.models.base import Model
from ldt_core.models.grey_box import GreyBoxModel
from ldt_core.twin.adaptor import PASSED_OVER, ROLLED_BACK
from ldt_core.twin.candidates import POOL, Candidates
from ldt_core.twin.cause_doubts import doubts
from ldt_core.twin.cause_search import CauseSearch, Question, anew, granted
from ldt_core.twin.condition_chain import ConditionChain
from ldt_core.twin.known_versions import FOLLOWED, KnownVersions
from ldt_core.twin.memory import Memory
from ldt_core.twin.original_watch import OriginalWatch
from ldt_core.twin.stage import Archive, RecordedStep
from ldt_core.twin.training_data import newest_enough, too_short
from ldt_core.twin.version_errors import (
    alike,
    explains,
    explains_all,
    has_changed,
    pays,
    rigid,
    rms_error,
    same,
    squared_error,
    stands_for,
    unexplained,
)

#: In the details of an adaptation: what is searched for, or learns, competes later.
SEARCHING = "searching"
#: That a search has ended, and what came of it has competed.
SEARCHED = "searched"
#: Values of `SEARCHING`: no cause explains the experiment, or that is not known yet.
OVER, UNDER_WAY = 1.0, 2.0
#: States of a model that fails where it was never right.
ELSEWHERE = ("inadequate", "new_range")
#: In the details of an adaptation: the original has come into force again.
ORIGINAL = "original_again"


class ContestAdaptor(KnownVersions):
    """Lets every earlier version, causes old and new, and a flexible model compete at a positive.

    Where the present model claims not to know enough, it learns more of the same machine. It is
    replaced only where that pays. At any other positive, in this order, until one explains it:

    1. an earlier version, the original included: a machine that goes back and forth gets its
       version back at once, without training;
    2. the causes known so far, re-estimated with the machine's parameters, under their priors;
    3. one more effect of the library, or another one, that explains the experiment to the noise;
    4. the flexible model, if it does better in the halves that it has not learned from;
    5. what comes nearest of all these. They compete when they have learned, at an experiment from
       which none of them has: those that no search holds up at the next one (`cause_search`).

    None comes into force that fails in what the present model stands for (`fails_before`). Where a
    known version explains an experiment, that one comes into force which will err least in what may
    follow. Over ten experiments the largest errors of what learns may sum to 1.1 times the
    original's; beyond, the original comes into force again, until what would be in force has caught
    up, or something new has learned that errs less over the last ones (`_leads`).

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
        # Whether the present model claims not to know enough, and fails where it was never right.
        self._learning = self._elsewhere = False
        #: What competes when it has ended.
        self.search: CauseSearch | None = None
        # Integration steps that are left in this experiment for a search of its own.
        self._steps = granted(None)

    def _dealt(self, experiment: Experiment, signal: Signal) -> tuple[Adaptation, Model]:
        self._watched(experiment, signal)
        if self._passed_over(experiment):
            return super()._dealt(experiment, signal)
        search, self.search = self.search, None  # of one that fails nothing is left
        self._steps, learned = granted(search), None
        if search is not None and not search.settled(self.model):
            ended = search.go_on(self._steps)
            learned = search if signal.level is not Level.NEGATIVE else None
            self.search = None if ended and learned else search
        self._explain(experiment)
        self._learning = signal.state == "learning"
        self._elsewhere = signal.state in ELSEWHERE
        before, recent, self._pick = self.model, self.memory.recent, self.followed
        won = self._contested(learned, experiment, signal)
        told, model = won or super()._dealt(experiment, signal)
        self._took(before, [*recent, experiment], signal)
        self._saw(experiment)
        if search is not None and self.search is not search:
            told = replace(told, details={**told.details, SEARCHED: 1.0})
        if self._follow():
            told = replace(told, details={**told.details, FOLLOWED: self.followed.version})
        return told, model

    def _contested(
        self, search: CauseSearch | None, experiment: Experiment, signal: Signal
    ) -> tuple[Adaptation, Model] | None:
        """What comes into force without learning from this experiment."""
        found, details = self._trained(search, experiment, signal), {}
        sure = True  # of what has changed
        long = self.watch.worse and not alike(self.model, self.original)
        new = signal.level is Level.NEGATIVE and signal.state == "new_range"
        beaten = new and self.watch.worse_now
        if found is None and beaten:
            about = self.model, self.learned_from, [experiment]
            with one_thread():
                found = finished(self.candidates.told_apart(*about))
        if found is not None and not self._leads(found[0], experiment):
            found = None
        if found is None and (long or beaten):
            where = self.watch.why if long else "errs less in this new range"
            found, details[ORIGINAL] = (self.original, f"is the original again, which {where}"), 1.0
            self._pick = self.model if long else self.original
            if long and self._explaining:  # what learns goes on, judged meanwhile
                self._returns(self._explaining, experiment)
            sure = False
            self.watch.withdraw(self.model.version)
        known = self._explaining
        holds = signal.state == "holds" and known is self.model
        if found is None and known and (holds or signal.level is Level.WARNING):
            judge = self._foreseen if holds else self._returns
            ahead = judge(known, experiment)
            if ahead is not None and not alike(ahead, self.model):
                sure = ahead is known
                why = "" if sure else ", which errs least over what may follow"
                found = ahead, f"is version {ahead.version} again{why}"
        if found is None:
            return None
        (model, origin), before = found, self.model
        self._adopt(model.again(before.version + 1))
        if signal.level is Level.WARNING:
            self.memory.store(experiment)
        elif signal.level is Level.POSITIVE:
            self.memory.clear()
        self.memory.remember(experiment)
        details["warning_set"] = len(self.memory)
        reason = self._reason(before, experiment, origin, sure)
        told = Adaptation(experiment.number, Action.ADAPTED, self.model.version, reason, details)
        return self._warned(told, experiment), self.model

    def _learn(self, experiment: Experiment) -> tuple[Action, str, dict[str, float]]:
        self.memory.clear()
        before, version = self.model, self._explaining
        stays, present = f"version {before.version} stays", rms_error(before, experiment)
        if self._learning:
            about = self.learned_from, self._recent(experiment), experiment
            more, why = self.candidates.learned_more(before, *about)
            if more is not None:
                return self._learned_by(more, anew(more), experiment, {})
            if version is before and why:
                return Action.REFUSED, f"{why}; {stays}", {}
        if version is not None and (told := self._known_again(version, experiment)):
            return told
        asked = self._question(experiment)
        if too_short(asked.told) and len(asked.told) < self.memory.history:
            why = f"{counted(sum(map(len, asked.told)), 'sample')} that nobody explains are too few"
            return Action.REFUSED, f"{why} to learn from yet; {stays}", {}
        search = CauseSearch(self.candidates, asked)
        over = search.explain(self._steps)
        said = "no known cause explains it" if over else "no cause that explains it is found yet"
        if search.cause is not None:
            if not self._leads(search.cause[0], experiment):
                said = "a cause explains it, but the original errs less over the last experiments"
                return Action.REFUSED, f"{said}; {stays}", {}
            if not self._fails_before(search.cause[0], experiment):
                return self._learned_by(*search.cause, experiment, {})
            said = "the cause that explains it fails in the experiments before"
        if search.idle:
            why = "what its causes explain does not pay for another version"
            return Action.REFUSED, f"{why}; {stays}", {}
        details: dict[str, float] = {}
        judged = self.unexplained(experiment)  # in one alone a version errs less by luck
        waits = f"searches wait for {self.backoff.wait} more experiments"
        then = "the search for one goes on" if self.search or not over else waits
        if self.backoff.due and self.search is None:
            self._keep(search, judged, over)
            details = {SEARCHING: OVER if over else UNDER_WAY}
            then = "other models compete when they have learned" if over else then
            self.backoff.failed(present)
        beaten = (before, self.original)
        pool = newest_enough(judged, POOL)
        flexible = self.candidates.at_once(self._grey(), beaten, pool)
        may = flexible is not None and self._leads(flexible, experiment)
        if flexible is not None and may and not self._fails_before(flexible, experiment):
            origin = f"does better in what was held back from it, {said}"
            return self._learned_by(flexible, origin, experiment, details)
        known = [m for m in self.earlier if m.version not in self.watch.withdrawn]
        nearest = min((self.original, *known), key=lambda m: squared_error(m, judged))
        if pays(nearest, before, judged) and self._returns(nearest, experiment) is nearest:
            self._adopt(nearest.again(before.version + 1))
            origin = f"is version {nearest.version} again, which errs least"
            return Action.ADAPTED, self._reason(before, experiment, origin, False), details
        return Action.REFUSED, f"{said}, {then}; {stays}", details

    def _known_again(
        self, version: Model, experiment: Experiment
    ) -> tuple[Action, str, dict[str, float]] | None:
        """What comes of a version that explains the experiment; None where none is to return."""
        before, next_one = self.model, self._returns(version, experiment)
        if next_one is None:
            return None
        with one_thread():
            tied = finished(self.candidates.told_apart(before, self.learned_from, [experiment]))
        # A machine that has one cause all along is likelier than one that changes to and fro.
        one = tied or self._one_machine(experiment)
        if one is not None and not self._fails_before(one[0], experiment):
            return self._learned_by(*one, experiment, {})
        origin = f"is version {next_one.version} again"
        if next_one is not version:
            often = f"version {version.version} explains it, but the machine changes so often"
            often = f"{often} that version {next_one.version} will err less"
            if alike(next_one, before):
                return Action.REFUSED, often, {}
            origin = f"{origin}: {often}"
        self._adopt(next_one.again(before.version + 1))
        return Action.ADAPTED, self._reason(before, experiment, origin), {}

    def _one_machine(self, experiment: Experiment) -> tuple[Model, str] | None:
        """A cause that explains what the present version does not, and all that this stands for,
        where the machine has hardly changed; and its origin.
        """
        recent = self._recent(experiment)
        known = stands_for(self.model, experiment, self.learned_from, recent)
        due = self.backoff.due and self.search is None
        if not due or not rigid(self.model) or has_changed(self.model, experiment, known):
            return None
        search = CauseSearch(self.candidates, self._question(experiment))
        search.explain(self._steps)
        return search.cause if search.cause and explains_all(search.cause[0], known) else None

    def _keep(self, search: CauseSearch, judged: Sequence[Experiment], over: bool) -> None:
        """Go on with a search at later experiments."""
        search.question = replace(search.question, pool=newest_enough(judged, POOL))
        self.search = CauseSearch(self.candidates, search.question, True) if over else search

    def _learned_by(
        self, model: Model, origin: str, experiment: Experiment, details: dict[str, float]
    ) -> tuple[Action, str, dict[str, float]]:
        """A model that has learned comes into force."""
        before = self.model
        reached, present = rms_error(model, experiment), rms_error(before, experiment)
        details = {"candidate_rmse": reached, "present_rmse": present, **details}
        self._adopt(model.again(before.version + 1))
        return Action.ADAPTED, self._reason(before, experiment, origin), details

    def _question(self, experiment: Experiment) -> Question:
        """What explains this experiment. It is asked beside a search that goes on, too: of an
        experiment in which a resonance has captured the shaft, that may take long.
        """
        versions = (self.model, *reversed(self.earlier))
        told = [experiment]
        if too_short(told):
            lasting = (self.model, self.original)
            recent = self._recent(experiment)
            failed = (e for e in recent if not any(explains(m, e) for m in lasting))
            told = newest_enough([*failed, experiment])
        about = self._recent(experiment), told, self._elsewhere, self.backoff.due
        return Question(self._grey(), versions, self.learned_from, *about, pool=())

    def _reason(self, before: Model, experiment: Experiment, origin: str, sure: bool = True) -> str:
        """In words; of a version that explains nothing it is not known what has changed."""
        words = f"version {self.model.version} {origin}"
        if not sure or not explains(self.model, experiment):
            return words
        recent = [e for e in self._recent(experiment) if not same(e, experiment)]
        last, first, lasting = self._changed_from(before, recent, experiment)
        since = f"{first.number} or before, unlike the machine file" if lasting else first.number
        known = stands_for(before, experiment, self.learned_from, recent)
        hardly = last is before and not lasting and not has_changed(before, experiment, known)
        learned = [e for e in recent if e.number in self.model.trained_on]
        told = newest_enough([*learned, experiment])
        change = self._change(last, told, lasting, hardly)
        return f"since experiment {since}: {change}; {words}" if change else words

    def _change(
        self, before: Model, told: Sequence[Experiment], lasting: bool, hardly: bool
    ) -> str:
        """What has changed, as far as that is known."""
        if not isinstance(self.model, GreyBoxModel):
            return self.model.change(before)
        about = doubts(self.model, before, self.earlier, told, hardly, lasting)
        return self.model.change(before, about, lasting)

    def unexplained(self, experiment: Experiment) -> list[Experiment]:
        """The newest experiments that nobody explains."""
        return unexplained(self.model, self.original, self._recent(experiment), experiment)

    def _trained(
        self, search: CauseSearch | None, experiment: Experiment, signal: Signal
    ) -> tuple[Model, str] | None:
        """What learned from the experiments before, if it does better on this one."""
        if search is None:
            return None
        pool = search.question.pool
        # Nobody explains them, no candidate has learned from them. One alone is fitted by luck.
        judged = [e for e in self.unexplained(experiment) if all(e is not p for p in pool)]
        learned = [m for m in search.models if not self._fails_before(m, experiment)]
        best = min(learned, key=lambda m: squared_error(m, judged), default=None)
        if best is None or not all(pays(best, m, judged) for m in (self.model, self.original)):
            return None
        origin = f"learned from experiment {pool[-1].number} and does best in this one"
        if signal.level is Level.POSITIVE and not isinstance(best, GreyBoxModel):
            # A cause tells more than a flexible model.
            found = CauseSearch(self.candidates, self._question(experiment))
            found.explain(self._steps)
            if found.cause is not None and not self._fails_before(found.cause[0], experiment):
                return found.cause
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
            self.search = None
            super().recall(step)
            return
        self._watched(step.experiment, step.signal)
        told = step.adaptation.details
        passed_over = any(told.get(why) for why in PASSED_OVER)
        if not passed_over:
            self._recall_search(step)
            self._explain(step.experiment, step)
        if told.get(SEARCHING):
            self.backoff.failed(rms_error(self.model, step.experiment))
        before, recent = self.model, self.memory.recent
        super().recall(step)
        if ROLLED_BACK in told:
            self.chain, self.learned_from, self.search = ConditionChain(), [], None
        elif not passed_over:
            self._took(before, [*recent, step.experiment], step.signal)
            self._saw(step.experiment)
        if told.get(ORIGINAL):
            self.watch.withdraw(before.version)
        if not passed_over or ROLLED_BACK in told:
            self.followed = self.model
            with contextlib.suppress(KeyError):  # one that came in a gap of the recording
                self.followed = self._version(told.get(FOLLOWED, self.model.version))

    def _recall_search(self, step: RecordedStep) -> None:
        """What a search was granted, that it has ended, or that another one began."""
        told, experiment = step.adaptation.details, step.experiment
        steps = granted(self.search)
        if self.search is not None:
            self.search.granted += steps
        if told.get(SEARCHED):
            self.search = None
        if begun := told.get(SEARCHING):
            self._elsewhere = step.signal.state in ELSEWHERE
            asked, over = replace(self._question(experiment), due=True), begun == OVER
            search = CauseSearch(self.candidates, asked, granted=steps)
            self._keep(search, self.unexplained(experiment), over)

    def state(self) -> dict[str, Any]:
        """Its state by the numbers of what is recorded; `return_to` takes it back."""
        search = None if self.search is None else self.search.state()
        learned = [[e.number, e.start] for e in self.learned_from]
        own: dict[str, Any] = {"watch": self.watch.state(), "search": search}
        own |= {"learned_from": learned, "followed": self.followed.version}
        own |= {"chain": self.chain.state(), "backoff": self.backoff.state()}
        return {**super().state(), **own}

    def return_to(self, state: Mapping[str, Any], archive: Archive) -> None:
        """Take back a state, before any step here."""
        learned = [archive.experiment(number, start) for number, start in state["learned_from"]]
        chain, asked = ConditionChain(), state["search"]
        chain.return_to(state["chain"], archive)
        search = asked and CauseSearch.of(asked, self.candidates, self.original, archive)
        super().return_to(state, archive)
        self.watch, self.search, self.chain = OriginalWatch.of(state["watch"]), search, chain
        self.learned_from, self.followed = learned, self._version(state["followed"])
        self.backoff.return_to(state["backoff"])
