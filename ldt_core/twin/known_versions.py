"""The versions of a machine's model: what each stands for, and which will err least."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ldt_core.base.experiment import Experiment, Signal
from ldt_core.models.base import Model
from ldt_core.models.grey_box import GreyBoxModel
from ldt_core.twin.adaptor import Adaptor
from ldt_core.twin.condition_chain import UNLEARNED, ConditionChain
from ldt_core.twin.memory import Memory
from ldt_core.twin.original_watch import COMPARED, WORSE, OriginalWatch
from ldt_core.twin.search_backoff import SearchBackoff
from ldt_core.twin.stage import RecordedStep
from ldt_core.twin.version_errors import (
    BETTER,
    FAR,
    alike,
    explaining,
    explains,
    explains_all,
    fails_before,
    fit_of,
    has_changed,
    largest_error,
    pays,
    same,
    stands_for,
)

#: In the details of an adaptation: the version that would be in force, did the original not take
#: its place.
FOLLOWED = "followed"
#: Probability from which on a condition is taken to last: the errors of one machine differ by up to
#: `FAR`, and what two of them say of two versions by its square.
LASTS = FAR**2 / (1 + FAR**2)
#: Experiments in a row that the original does not explain, after which its condition is taken to
#: have gone for good: of two conditions at random, one in eight of such rows is of one alone.
LEFT_FOR_GOOD = 3


class KnownVersions(Adaptor):
    """Knows which version explains an experiment, and foresees which will err least in the next.

    Args:
        model: to begin with, the original.
        memory: S_w and the recent experiments.
        how: as for `Adaptor`.
    """

    def __init__(self, model: Model, memory: Memory, **how: Any) -> None:
        super().__init__(model, memory, **how)
        self.original = model
        self.watch = OriginalWatch()
        #: What would be in force, did the original not take its place.
        self.followed = model
        # The same for the next experiment, as far as it is foreseen in this one.
        self._pick = model
        #: What the machine was like, and how that follows upon each other.
        self.chain = ConditionChain()
        #: The version that explains the present experiment.
        self._explaining: Model | None = None
        #: Experiments that the present version has learned from, as far as they are known.
        self.learned_from: list[Experiment] = []
        self.backoff = SearchBackoff()
        # Whether the version adopted last was in force before.
        self._again = False

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
        self._explaining = self.model if fits else explaining(self.earlier, experiment, error)
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
            self.chain.merge(model, here, experiment, self._versions())
        self.chain.saw(here, experiment)

    def _versions(self) -> list[tuple[int, Model]]:
        """Each earlier one with the condition that it stands for."""
        return [(self._condition(m), m) for m in self.earlier]

    def _watched(self, experiment: Experiment, signal: Signal) -> None:
        """Compare what learns with the original, in force or not."""
        own = signal.max_error
        if not alike(self.followed, self.model):
            own = largest_error(self.followed, experiment)
        self.watch.saw(own, largest_error(self.original, experiment))

    def _leads(self, model: Model, experiment: Experiment) -> bool:
        """Whether something new may come into force: where the original has taken the place of what
        learned, it has to err less than that over the last experiments, too. Once the machine has
        left the original's condition for good, over those since, and plainly.
        """
        if not self.watch.withdrawn or not alike(self.model, self.original):
            return True
        last = [*self._recent(experiment)[1 - COMPARED :], experiment]
        right = (k for k, e in enumerate(last) if explains(self.original, e))
        left = 1 + max(right, default=-1)
        gone = left > 0 and len(last) - left >= LEFT_FOR_GOOD
        last = last[left:] if gone else last
        errors = [sum(largest_error(m, e) for e in last) for m in (model, self.original)]
        return errors[0] * (WORSE if gone else 1.0) < errors[1]

    def _follow(self) -> bool:
        """Note what would be in force; whether that is another version than the one that is."""
        known = any(m is self._pick for m in self.earlier)
        other = known and alike(self.model, self.original) and not alike(self._pick, self.model)
        self.followed = self._pick if other else self.model
        return other

    def _returns(self, version: Model, experiment: Experiment) -> Model | None:
        """What is foreseen where another version explains the experiment; None where none does."""
        if version is self.model or self._fails_before(version, experiment):
            return None
        return self._foreseen(version, experiment)

    def _foreseen(self, version: Model, experiment: Experiment) -> Model:
        """Which will err least in the next one: this version, which explains it, any other of a
        condition that may follow, or the original, of which people know how it errs.

        One experiment shows how a version errs in a condition, and may hardly excite the machine.
        Where the condition very likely lasts, that is no reason against this version.
        """
        here = self._condition(version)
        after = self.chain.following(here)
        others = [m for there, m in self._versions() if there in after]
        rivals = [self.original, version, self.model, *others]
        best = version
        if after[here] <= LASTS:
            expected = [self.chain.expected_error(m, here, experiment) for m in rivals]
            least = rivals[int(np.argmin(expected))]
            if version is self.model:
                best = least if FAR * min(expected) < expected[1] else version
            else:
                best = least if min(expected) < BETTER * expected[0] else self.original
        self._pick = best
        out = self.watch.trails and not alike(self.followed, self.model)
        return self.original if out else best

    def _version(self, number: float) -> Model:
        return {m.version: m for m in (self.model, *self.earlier)}[int(number)]

    def _fails_before(self, model: Model, experiment: Experiment) -> bool:
        about = experiment, self.learned_from, self._recent(experiment)
        return fails_before(model, self.model, *about)

    def _changed_from(
        self, before: Model, recent: Sequence[Experiment], experiment: Experiment
    ) -> tuple[Model, Experiment, bool]:
        """What the present version is compared with, the first experiment that it is known to be
        of, and whether nothing says that the machine has changed there.

        It has not changed now where the version explains what the one before stands for, too; then
        it has changed behind the last one that it does not explain, but an earlier version does.
        """
        known = list(recent)  # the machine file's own model stands for all
        if before.version:
            known = stands_for(before, experiment, self.learned_from, recent)
            known = [e for e in known if e in self.learned_from or explains(before, e)]
            hardly = self.learned_from and not has_changed(before, experiment, known)
            if hardly and not pays(before, self.model, known):
                known = self.learned_from  # what lies between tells less than what taught it
        last = self._causes_of(self.earlier)
        if (before.version and not known) or not explains_all(self.model, known):
            return last, experiment, False
        first = min([*known, experiment], key=lambda e: e.start)
        for e in reversed([e for e in recent if e.start < first.start]):
            if not explains(self.model, e):
                older = self.earlier[:-1]
                while older and not explains(older[-1], e):
                    older.pop()
                if not older:
                    break
                return self._causes_of(older), first, False
            first = e
        return last, first, True

    def _causes_of(self, versions: Sequence[Model]) -> Model:
        """The newest of these versions that says what acts."""
        grey = (m for m in reversed(versions) if isinstance(m, GreyBoxModel))
        return next(grey, self.original)
