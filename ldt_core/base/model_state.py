"""What a signal says about machine and model, in the words and colours that people see."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from ldt_core.base.experiment import Level, Signal
from ldt_core.base.sentences import number

#: Residual over the noise from which no signal is taken at its word that the model holds: no error
#: above ten times the noise may look well, whoever wrote the recording.
DOUBTED = 10.0


@dataclass(frozen=True)
class ModelState:
    """A state of machine and model.

    Args:
        name: as signals have it; "" where nobody has judged.
        words: for people.
        tone: a colour of the pages: good, found (neutral), bad, vague (amber) or open (grey).
        known: a clause on what is known of the experiment.
    """

    name: str
    words: str
    tone: str
    known: str

    @property
    def brief(self) -> str:
        """The words without what explains them, for tables and keys."""
        return self.words.partition(":")[0]


NOT_JUDGED = ModelState("", "not judged", "open", "whether the model explains it is not judged")
#: By name, in the order in which they are listed.
STATES = {
    state.name: state
    for state in (
        ModelState("holds", "model holds", "good", "the model explains it"),
        ModelState("learning", "learning", "found", "too little is known to say what explains it"),
        ModelState("new_range", "new range", "found", "the excitation is new, nothing else"),
        ModelState("changed", "machine changed", "bad", "the model does not explain it any more"),
        ModelState(
            "inadequate",
            "model inadequate: the best known, not good",
            "vague",
            "the best model known does not explain it",
        ),
    )
}


def shown_state(signal: Signal) -> ModelState:
    """What people are told of a signal; never that a model holds whose error is not noise.

    >>> from ldt_core.base.experiment import Level
    >>> shown_state(Signal(1, Level.NEGATIVE, "mine", 0, 2.0, {}, "holds", 1.1)).words
    'model holds'
    >>> shown_state(Signal(1, Level.NEGATIVE, "mine", 0, 2.0, {}, "holds", 12.0)).words
    'not judged'
    """
    if signal.state == "holds" and not 0 <= (signal.adequacy or 0.0) < DOUBTED:
        return NOT_JUDGED
    return STATES.get(signal.state, NOT_JUDGED)


def headline_state(signal: Signal) -> ModelState:
    """What stands above a page: an alarm is told where no state says whether the model holds.

    >>> from ldt_core.base.experiment import Level
    >>> headline_state(Signal(1, Level.POSITIVE, "mine", 0, 2.0)).words
    'alarm: model not judged'
    """
    state = shown_state(signal)
    if state is NOT_JUDGED and signal.level == Level.POSITIVE:
        return replace(state, words="alarm: model not judged", tone="bad")
    if state is NOT_JUDGED and signal.level == Level.WARNING:
        return replace(state, words="warning: model not judged", tone="vague")
    return state


def times_noise(adequacy: float | None) -> str:
    """The residual in words; "" while it is unknown.

    >>> times_noise(1.234), times_noise(None)
    ('1.2 times the noise', '')
    """
    if adequacy is None or not math.isfinite(adequacy):
        return ""
    return f"{number(adequacy, 2)} times the noise"
