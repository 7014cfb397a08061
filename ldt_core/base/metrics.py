"""Figures of a run: the paper's MME, what was signalled and done; errors of free runs."""

from __future__ import annotations

import itertools
import math
import re
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np

from ldt_core.base.bounded import forget_oldest
from ldt_core.base.errors import LdtError, RepeatedExperiment, UnansweredExperiment
from ldt_core.base.experiment import (
    DOUBTFUL,
    FAILED,
    FAULTY,
    PAUSED,
    Action,
    Adaptation,
    AdviceRecord,
    DiagnosisRecord,
    Level,
    Samples,
    Signal,
    Step,
)
from ldt_core.base.model_state import STATES, ModelState, shown_state
from ldt_core.base.sentences import counted, number

#: Sentences about what makes a run fail: all experiments of a long one may.
MOST_FAILURES = 100
#: Causes of which is said what has become of them, the last ones.
CHANGES_TOLD = 4
#: Between a cause and what has become of it.
VERB = re.compile(" (?:has|is) ")
#: Begins what is not known.
WHAT = "what"
#: Says that an amount has changed.
GROWN = re.compile(r" has \w+ to ")
#: Says that a cause was taken to act.
NOT_ACTED = " has not acted"


class Summary:
    """Figures of a run, fed step by step, or record by record as a recording gives them.

    A quantity of which nothing is known yet is None. The mean over experiments of max_k |y_k - ŷ_k|
    is the paper's MME.
    """

    def __init__(self) -> None:
        self._sums = {"learning": 0.0, "original": 0.0}
        self._terms: Counter[str] = Counter()
        self._signals: Counter[Level] = Counter()
        self._states: Counter[str] = Counter()
        #: Of machine and model after the last experiment, and its number; None before any.
        self.last_state: tuple[int, ModelState] | None = None
        self._end = 0.0  # of that experiment [s since the epoch]
        self._actions: Counter[Action] = Counter()
        self._noted: set[str] = set()
        self.model_version = 0
        self.rejected = 0
        #: In the recording of a run: experiments that are in it, and those with an adaptation, by
        #: number and end [s], in their order.
        self.recorded: list[tuple[int, float]] = []
        self.answered: list[tuple[int, float]] = []
        #: What makes a run fail: experiments not answered or not recorded, a sentence each; the
        #: first `MOST_FAILURES` of them, and how many more there are.
        self.failures: list[str] = []
        self.further_failures = 0
        #: Experiments of a faulty sensor, from which nothing was learned.
        self.faulty = 0
        #: Experiments that came again, and were left out.
        self.repeated = 0
        # What the last new model is said to know; and of each cause since when, and what.
        self._newest = ""
        self._changes: dict[str, tuple[str, str]] = {}
        #: Verdicts of the diagnoses that were made, in their order.
        self.diagnoses: list[DiagnosisRecord] = []
        #: What people were advised last.
        self.advice: AdviceRecord | None = None
        #: What a person should know beside the figures, a sentence each.
        self.notes: list[str] = []

    def note(self, *sentences: str) -> None:
        """Add what a person should know."""
        self.notes += [s for s in sentences if s not in self.notes]

    def fail(self, *sentences: str) -> None:
        """Add what makes the run fail."""
        for new in (s for s in sentences if s not in self.failures):
            if len(self.failures) < MOST_FAILURES:
                self.failures.append(new)
            else:
                self.further_failures += 1

    def reject(self, error: LdtError) -> None:
        """Count an experiment that could not be used, or came again; the first says why.

        What is refused is not answered, and makes the run fail; what came again was answered.
        """
        if isinstance(error, UnansweredExperiment):
            self.fail(str(error))
            return
        if isinstance(error, RepeatedExperiment):
            self.repeated += 1
            return
        if not self.rejected:
            self.note(f"rejected {error}")
        self.rejected += 1
        self.fail(f"not answered: {error}")

    def add(self, step: Step) -> None:
        """Take in one turn of the loop."""
        self.add_signal(step.signal, step.experiment.end)
        self.add_original(step.original.max_error(step.experiment))
        self.add_adaptation(step.adaptation)
        if step.diagnosis is not None:
            self.diagnoses.append(step.diagnosis)
        if step.advice is not None:
            self.advice = step.advice

    def add_signal(self, signal: Signal, end: float = 0.0) -> None:
        """Take in the signal, and with it the learning twin's error, of one experiment.

        Args:
            end: of the experiment [s since the epoch].
        """
        self._signals[Level(signal.level)] += 1
        state = shown_state(signal)
        self._states[state.name] += 1
        # By time: a counter may have begun anew. Of one time, by number.
        if self.last_state is None or (end, signal.experiment) >= (self._end, self.last_state[0]):
            self.last_state, self._end = (signal.experiment, state), end
        self._add("learning", signal.max_error)

    def add_original(self, max_error: float) -> None:
        """Take in the maximum error of the original model in one experiment [rad/s]."""
        self._add("original", max_error)

    def add_adaptation(self, adaptation: Adaptation) -> None:
        """Take in what the adaptor did with one experiment."""
        self._actions[Action(adaptation.action)] += 1
        if adaptation.action is Action.ADAPTED:
            where = f"experiment {adaptation.number}"
            begin, told, _ = adaptation.reason.partition("; version")
            since, colon, changes = begin.partition(": ")
            known = bool(told and colon and since.startswith("since experiment"))
            self._newest = "" if known else f"The last new model, at {where}: {adaptation.reason}."
            if known:  # what was not known of an earlier version is over
                self._changes = {c: t for c, t in self._changes.items() if not c.startswith(WHAT)}
            for change in changes.split("; ") if known else ():
                self._add_change(since, change)
        if adaptation.details.get(PAUSED):
            self.note("learning was switched off for a while")
        if adaptation.details.get(DOUBTFUL) and DOUBTFUL not in self._noted:
            self._noted.add(DOUBTFUL)
            _, _, words = adaptation.reason.rpartition("; ")
            self.note(f"experiment {adaptation.number}, {words}; it was used all the same")
        self.faulty += bool(adaptation.details.get(FAULTY))
        for why in (FAILED, FAULTY):
            if adaptation.details.get(why) and why not in self._noted:
                self._noted.add(why)
                self.note(f"experiment {adaptation.number}: {adaptation.reason}")
        self.model_version = adaptation.model_version

    def _add_change(self, since: str, change: str) -> None:
        """Take in what is said of one cause; what was said of it before is over."""
        cause = VERB.split(change, 1)[0]
        was_since, was = self._changes.pop(cause, ("", ""))
        if change.endswith(NOT_ACTED):
            return
        grown = GROWN.match(was.removeprefix(cause))
        known_better = change.startswith(f"{cause} is ") and _first(since) >= _first(was_since)
        if grown and known_better:  # of the same change
            since, change = was_since, change.replace(" is ", grown[0], 1)
        self._changes[cause] = since, change
        forget_oldest(self._changes, CHANGES_TOLD)

    def _add(self, whose: str, error: float) -> None:
        self._sums[whose] += error
        self._terms[whose] += 1

    def _mean(self, whose: str) -> float | None:
        return self._sums[whose] / self._terms[whose] if self._terms[whose] else None

    @property
    def experiments(self) -> int:
        """Experiments that were judged."""
        return self._signals.total()

    @property
    def mme(self) -> float | None:
        """MME of the learning twin [rad/s]."""
        return self._mean("learning")

    @property
    def mme_original(self) -> float | None:
        """MME of the model that never learns [rad/s]."""
        return self._mean("original")

    @property
    def left(self) -> float | None:
        """Share of the original model's MME that is left."""
        mine, original = self.mme, self.mme_original
        return mine / original if mine is not None and original else None

    @property
    def outcome(self) -> str:
        """Whether learning helped, in a sentence; "" while nothing is known."""
        mine, original, left = self.mme, self.mme_original, self.left
        if mine is None or original is None or left is None:
            return ""
        share = _percent(left)
        errors = f"the error is {share} % of the original model's ({number(mine)} of "
        errors += f"{number(original)} rad/s)."
        if share != "100":
            return f"Learning {'helped' if left < 1 else 'made it worse'}: {errors}"
        if self.faulty:
            return (
                f"Nothing is learned from {counted(self.faulty, 'experiment')} of a faulty sensor."
            )
        if self.states["holds"] == self.experiments and not self.adaptations:
            return "The model already explains the machine: nothing to learn."
        tried = self.adaptations or self.refusals
        what = "Learning did not help" if tried else "Nothing was learned"
        return f"{what}: the error is that of the original model ({number(original)} rad/s)."

    @property
    def learned(self) -> str:
        """What has changed, as far as the new models know; "" where there was none."""
        groups = itertools.groupby(self._changes.values(), key=lambda told: told[0])
        told = (f"S{since[1:]}: {'; '.join(what for _, what in group)}." for since, group in groups)
        return " ".join(filter(None, [*told, self._newest]))

    @property
    def states(self) -> dict[str, int]:
        """Experiments in each state of machine and model, and how many nobody judged."""
        judged = {name: self._states[name] for name in STATES}
        return {**judged, "not_judged": self._states[""]}

    @property
    def positives(self) -> int:
        """Positive signals."""
        return self._signals[Level.POSITIVE]

    @property
    def warnings(self) -> int:
        """Warnings."""
        return self._signals[Level.WARNING]

    @property
    def negatives(self) -> int:
        """Negative signals."""
        return self._signals[Level.NEGATIVE]

    @property
    def adaptations(self) -> int:
        """New models that the twin went on with."""
        return self._actions[Action.ADAPTED]

    @property
    def refusals(self) -> int:
        """Positives without a new model."""
        return self._actions[Action.REFUSED]

    def as_dict(self) -> dict[str, Any]:
        """All figures and notes by name."""
        more = self.further_failures
        further = [f"{counted(more, 'more experiment')} not answered"] if more else []
        return {
            "experiments": self.experiments,
            "mme": self.mme,
            "mme_original": self.mme_original,
            "left": self.left,
            "outcome": self.outcome,
            "learned": self.learned,
            "states": self.states,
            "last_state": self.last_state[1].name if self.last_state else None,
            "positives": self.positives,
            "warnings": self.warnings,
            "negatives": self.negatives,
            "adaptations": self.adaptations,
            "refusals": self.refusals,
            "faulty": self.faulty,
            "model_version": self.model_version,
            "rejected": self.rejected,
            "repeated": self.repeated,
            "diagnoses": [
                {
                    "experiment": d.experiment,
                    "kind": d.kind,
                    "effects": list(d.effects),
                    "sentence": d.sentence,
                }
                for d in self.diagnoses
            ],
            "advice": self.advice
            and {"experiment": self.advice.experiment, "sentence": self.advice.sentence},
            "notes": [*self.notes, *self.failures, *further],
        }

    def rows(self) -> list[tuple[str, str]]:
        """(label, figure) for a table, in the order in which to show them."""
        seldom = {
            "alarms without a new model": self.refusals - self.faulty,
            "experiments of a faulty sensor": self.faulty,
            "warnings": self.warnings,
            "experiments rejected": self.rejected,
            "experiments repeated": self.repeated,
        }
        return [
            ("experiments", str(self.experiments)),
            ("mean maximum error: twin [rad/s]", _figure(self.mme)),
            ("mean maximum error: original model [rad/s]", _figure(self.mme_original)),
            ("error, in % of the original's", _percent(self.left)),
            *self._state_rows(),
            ("alarms", str(self.positives)),
            ("new models", str(self.adaptations)),
            *((label, str(count)) for label, count in seldom.items() if count),
        ]

    def _state_rows(self) -> Iterator[tuple[str, str]]:
        named = ((f"experiments: {s.brief}", s.name) for s in STATES.values())
        for label, name in (*named, ("experiments: not judged", "")):
            if self._states[name]:
                yield label, str(self._states[name])
        if self.last_state:
            yield "after the last experiment", self.last_state[1].words

    def cells(self) -> dict[str, str]:
        """Short label → figure, for a table of many machines, one a row."""
        return {
            "exp.": str(self.experiments),
            "MME twin": _figure(self.mme),
            "left %": _percent(self.left),
            "held": str(self._states["holds"]),
            "pos.": str(self.positives),
            "adapted": str(self.adaptations),
            "rejected": str(self.rejected),
            "state": self.last_state[1].name or "-" if self.last_state else "-",
        }


def _figure(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.0f}"


class FreeRunError:
    """Errors of free runs over several experiments.

    Attributes:
        experiments: how many.
    """

    def __init__(self) -> None:
        self.experiments = 0
        self._squares = 0.0
        self._samples = 0
        self._maxima = 0.0

    def add(self, residual: Samples) -> None:
        """Take in the residual of one experiment, (L,) [rad/s]."""
        self.experiments += 1
        self._squares += float(np.sum(residual**2))
        self._samples += residual.size
        self._maxima += float(np.abs(residual).max())

    @property
    def rmse(self) -> float:
        """Root mean square over all samples [rad/s]."""
        return math.sqrt(self._squares / self._samples)

    @property
    def mean_max_error(self) -> float:
        """Mean over experiments of the maximum error [rad/s]."""
        return self._maxima / self.experiments

    def as_dict(self) -> dict[str, float]:
        """All figures by name."""
        return {
            "experiments": self.experiments,
            "rmse": self.rmse,
            "mean_max_error": self.mean_max_error,
        }


def _first(since: str) -> int:
    """The number in "since experiment 7 or before"; 0 in what has none."""
    found = re.search(r"\d+", since)
    return int(found[0]) if found else 0
