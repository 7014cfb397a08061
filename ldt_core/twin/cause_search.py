"""The search for what explains an experiment: what of it is long goes on at later experiments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ldt_core.base.experiment import Experiment
from ldt_core.base.pausable import Pausable, finished, within
from ldt_core.base.sentences import listed
from ldt_core.base.threads import one_thread
from ldt_core.diagnosis.thresholds import THRESHOLDS
from ldt_core.models.base import Model
from ldt_core.models.grey_box import GreyBoxModel
from ldt_core.twin.candidates import Candidates
from ldt_core.twin.stage import Archive
from ldt_core.twin.version_errors import (
    explains,
    explains_all,
    far,
    gains,
    has_changed,
    rigid,
    rms_error,
    stands_for,
)

#: Integration steps of a search (`physics.base.Work`) at one experiment, of some 80 ns each on one
#: processor. A first search that finds two causes in 2000 samples takes 11 to 18 million; with some
#: room that is two seconds, and more an answer should not take. With 18 million, 13 % is left of
#: the stream `drag_e10`, seed 0, in place of 7 %.
STEPS = 24_000_000
#: The same of a search for causes, for whose end other models wait.
MOST_STEPS = 3 * STEPS
#: Of a question's attributes, those that are experiments.
LISTS = ("known", "recent", "told", "pool")


@dataclass(frozen=True, eq=False)
class Question:
    """What is to be explained, and all that the search begins with.

    Attributes:
        start: whose causes the search goes on from.
        versions: that were in force, the present one first.
        known: experiments that the present one has learned from.
        recent: those before the one to explain that may show the same machine.
        told: to explain together: the newest experiment, or the last ones of few samples.
        elsewhere: whether the present model fails only where it was never right.
        due: whether new causes may be searched for.
        pool: to learn from where no cause explains the experiment, the newest last.
    """

    start: Model
    versions: Sequence[Model]
    known: Sequence[Experiment]
    recent: Sequence[Experiment]
    told: Sequence[Experiment]
    elsewhere: bool
    due: bool
    pool: Sequence[Experiment]

    def state(self) -> dict[str, Any]:
        """By the numbers of what is recorded."""
        lists = {name: getattr(self, name) for name in LISTS}
        return {
            "start": self.start.version,
            "versions": [m.version for m in self.versions],
            **{name: [[e.number, e.start] for e in found] for name, found in lists.items()},
            "elsewhere": self.elsewhere,
        }

    @classmethod
    def of(cls, state: Mapping[str, Any], original: Model, archive: Archive) -> Question:
        """The question of a state; new causes were due."""

        def model(version: Any) -> Model:
            return original if version == original.version else archive.model(version)

        known, recent, told, pool = (
            [archive.experiment(number, start) for number, start in state[name]] for name in LISTS
        )
        versions = [model(v) for v in state["versions"]]
        about = told, bool(state["elsewhere"]), True, pool
        return cls(model(state["start"]), versions, known, recent, *about)


class CauseSearch:
    """Looks for causes that explain an experiment; where there are none, for what comes nearest.

    The causes known are re-estimated, then new ones are searched for. Only where that explains
    nothing do other models learn from the experiments, to compete at later ones: flexible ones at
    the next one, causes and what stands on them when they are found. How far it comes at an
    experiment is a number of integration steps, whatever the computer's speed.

    Args:
        candidates: makes the models.
        question: what to explain.
        over: whether it is known that no cause explains the experiment.
        granted: integration steps that it has been given so far.

    Attributes:
        cause: what explains the experiment, and its origin.
        idle: whether known causes explain the experiment, but hardly err less than the present
            model. Nothing would: what explains it leaves its noise.
        models: that have learned so far.
        ended: whether none is to come.
    """

    def __init__(
        self, candidates: Candidates, question: Question, over: bool = False, granted: int = 0
    ) -> None:
        self.question, self.granted = question, granted
        self._candidates, self._begun_over = candidates, over
        self.cause: tuple[GreyBoxModel, str] | None = None
        self.idle = False
        self.over = over
        self.models: list[Model] = []
        self.ended = False
        self._done, self._work = 0, self._works()

    def explain(self, steps: int) -> bool:
        """So many more, until it is known whether a cause explains it; whether that is known."""
        self.granted += steps
        self._go_on(until_known=True)
        return self.over

    def go_on(self, steps: int) -> bool:
        """So many more; whether it has ended."""
        self.granted += steps
        self._go_on(until_known=False)
        return self.ended

    def settled(self, model: Model) -> bool:
        """Whether causes that came into force meanwhile explain all that it is about."""
        caused = isinstance(model, GreyBoxModel)
        return caused and explains_all(model, self.question.pool)

    def _go_on(self, until_known: bool) -> None:
        with one_thread():
            while not self.ended and self._done < self.granted:
                if until_known and self.over:
                    return
                try:
                    self._done += next(self._work)
                except StopIteration:
                    self.ended = True
                    return

    def _works(self) -> Pausable[None]:
        asked = self.question
        if self.over:
            if len(asked.pool) == 1:  # it was made, and counted, before that was known
                finished(self._candidates.structures(asked.start, asked.pool))
        else:
            self.cause = yield from self._caused_in_time()
            self.over = True
            yield 0
            if self.cause is not None:
                self.models = [self.cause[0]]
                return
        yield from self._others()
        start, pool = self.question.start, self.question.pool
        causes = yield from self._candidates.structures(start, pool)
        self.models += [*causes, *self._candidates.flexible(start, pool, causes)]

    def _others(self) -> Pausable[None]:
        """Models that explain nothing, and may err less."""
        if not self.models:
            start, pool = self.question.start, self.question.pool  # not known at the beginning
            self.models = self._candidates.flexible(start, pool)
            self.models += yield from self._candidates.loosened(start, pool)

    def _caused_in_time(self) -> Pausable[tuple[GreyBoxModel, str] | None]:
        """As `_caused`; where it takes long, others compete meanwhile."""
        work, done = self._caused(), 0
        while done < MOST_STEPS:
            try:
                piece = next(work)
            except StopIteration as end:
                found: tuple[GreyBoxModel, str] | None = end.value
                return found
            done += piece
            yield piece
        yield from self._others()
        return (yield from work)

    def _caused(self) -> Pausable[tuple[GreyBoxModel, str] | None]:
        """A model of causes that explains the experiment, known or searched for, and its origin."""
        asked, told = self.question, self.question.told
        present = asked.versions[0]
        other = yield from self._candidates.told_apart(present, asked.known, told)
        if other is not None:
            return other
        best = yield from self._candidates.refitted(asked.versions, asked.known, told, asked.recent)
        nearest = best
        if best is not None and not explains_all(best, told):
            best = None
        if best is not None and not gains(best, present, told):
            self.idle = True
            return None
        alone = best
        if alone is None:
            best = (yield from self._moved(nearest)) or (yield from self._searched(told))
        elif pool := self._of_one_machine(alone):
            # Another cause may explain all.
            most = STEPS if rigid(alone) else STEPS // 2
            best = (yield from within(self._searched(pool), most)) or alone
        elif far(alone.box, alone.q):
            # Numbers that the file knows do not move so far by themselves: something moves them.
            best = (yield from self._near_file(alone)) or alone
        if best is None:
            return None
        return best, anew(best) if best is alone else "has a new cause"

    def _near_file(self, alone: GreyBoxModel) -> Pausable[GreyBoxModel | None]:
        """What explains the experiment with the machine's own parameters near the file's, if that
        is found in half of the time of one experiment.
        """
        until, found = self._done + STEPS // 2, (yield from self._moved(alone))
        if found is not None:
            return found
        search = self._searched(self.question.told, near_file=True)
        return (yield from within(search, until - self._done))

    def _moved(self, nearest: GreyBoxModel | None) -> Pausable[GreyBoxModel | None]:
        """The known causes with one number of the file that is another one, where that explains
        the experiment, and the nearest fit of the known causes moves such a number far.
        """
        asked = self.question
        if (
            not asked.due
            or nearest is None
            or not rigid(nearest)
            or not far(nearest.box, nearest.q)
        ):
            return None
        moved = self._candidates.moved(asked.start, nearest, asked.told)
        found = yield from within(moved, STEPS // 2)
        return found if found and gains(found, asked.versions[0], asked.told) else None

    def _of_one_machine(self, alone: GreyBoxModel) -> list[Experiment]:
        """The newest experiment, and the one before that a model fails most in which explains it
        alone, though the machine has hardly changed, or the excitation alone is another; else none.
        """
        asked, told = self.question, self.question.told
        if rigid(alone):
            about = asked.versions[0], told[-1]
            known = stands_for(*about, asked.known, asked.recent)
            other = asked.elsewhere and not far(alone.box, alone.q)
            if has_changed(*about, known) and not other:
                return []
        else:  # near a resonance, a little decides how much a model errs
            known = list(asked.known) if asked.elsewhere else []
        failed = [e for e in known if not explains(alone, e) and all(e is not t for t in told)]
        return [max(failed, key=lambda e: rms_error(alone, e)), *told] if failed else []

    def _searched(
        self, pool: Sequence[Experiment], near_file: bool = False
    ) -> Pausable[GreyBoxModel | None]:
        """What a search finds that explains all of these, unless searches have to wait.

        Args:
            near_file: leave out what moves the machine's own parameters far from the file's.
        """
        asked = self.question
        if not asked.due:
            return None
        found = yield from self._candidates.structures(asked.start, pool)
        near = (m for m in found if not (near_file and far(m.box, m.q)))
        explaining = (m for m in near if explains_all(m, pool))
        return next((m for m in explaining if gains(m, asked.versions[0], asked.told)), None)

    def state(self) -> dict[str, Any]:
        """For `of`."""
        return {**self.question.state(), "over": self._begun_over, "granted": self.granted}

    @classmethod
    def of(
        cls, state: Mapping[str, Any], candidates: Candidates, original: Model, archive: Archive
    ) -> CauseSearch:
        """The search of a state; what it had done it does again when it goes on."""
        question = Question.of(state, original, archive)
        granted = state["granted"]
        if type(granted) is not int or granted < 0:
            raise ValueError("granted is no count")
        return cls(candidates, question, bool(state["over"]), granted)


def anew(model: Model) -> str:
    """What a version does that has learned more with the same causes."""
    if not isinstance(model, GreyBoxModel):
        return "estimates its causes anew"
    name, by = model.box.farthest(model.q)
    moved = not model.effects or by > THRESHOLDS.prior_deviations
    what = ["its causes"] if model.effects else []
    what += ["the machine's own parameters"] if moved else []
    words = f"estimates {listed(what)} anew"
    return f"{words}, {name} by {by:.1f} tolerances from the file's" if moved and name else words


def granted(beside: CauseSearch | None) -> int:
    """Integration steps for a search at one experiment; beside one that goes on, each has half."""
    return STEPS if beside is None else STEPS // 2
