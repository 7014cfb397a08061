"""Which experiment may come next, by its number.

| number | what happens |
|---|---|
| above the last one's, by at most `MOST_JUMP` | taken |
| one of the last ones, with the same start | a repetition, left out |
| any other: not above the last one's, or a greater jump | refused, and remembered |
| after such a one, counting on from it in number and time | the counter began anew: taken |

For the last, one refused before it is enough where both are later than all that was taken, and
`PATIENT` are needed where the clock went back too: it may be the past that comes again. A counter
that begins at 1 again costs one experiment, or three, and a number out of nowhere costs itself.
"""

from __future__ import annotations

from ldt_core.base.bounded import forget_oldest
from ldt_core.base.errors import ExperimentError, RepeatedExperiment
from ldt_core.base.experiment import Experiment
from ldt_core.recording.experiment_numbers import MOST_JUMP
from ldt_core.twin.stage import WINDOW

#: Experiments in a row that are refused before a counter and a clock that went back are believed.
PATIENT = 3


class Numbering:
    """Holds the rule above.

    Attributes:
        last: number of the experiment that was taken last; None before the first.
    """

    def __init__(self) -> None:
        self.last: int | None = None
        self._start = 0.0  # of the last one [s since the epoch]
        self._starts: dict[int, float] = {}
        self._doubted: list[tuple[int, float]] = []  # numbers and starts, in a row

    @property
    def starts(self) -> dict[int, float]:
        """Number and start [s since the epoch] of the last experiments that were taken."""
        return dict(self._starts)

    def admit(self, experiment: Experiment) -> None:
        """Take an experiment, or refuse it.

        Raises:
            ExperimentError: its number does not follow.
            RepeatedExperiment: it is one of the last ones again.
        """
        number = experiment.number
        where = f"experiment {number}"
        if self._starts.get(number) == experiment.start:
            raise RepeatedExperiment(where, f"a number above {self.last}", number)
        follows = self.last is None or 0 < number - self.last <= MOST_JUMP
        if not follows and not self._begins_anew(experiment):
            self._doubted = [*self._run_up_to(experiment), (number, experiment.start)]
            most = f", by {MOST_JUMP} at most" if number > (self.last or 0) else ""
            expected = f"a number above {self.last}{most}, or the next ones to count on from it"
            raise ExperimentError(where, expected, number)
        self.took(experiment)

    def took(self, experiment: Experiment) -> None:
        """Go on from an experiment, whatever its number."""
        self.last, self._start = experiment.number, experiment.start
        self._doubted = []
        self._starts.pop(experiment.number, None)
        self._starts[experiment.number] = experiment.start
        forget_oldest(self._starts, WINDOW)

    def recall(self, experiment: Experiment) -> None:
        """Take note of one that was taken before, in their order; one known already is no news."""
        if self._starts.get(experiment.number) != experiment.start:
            self.took(experiment)

    def _run_up_to(self, experiment: Experiment) -> list[tuple[int, float]]:
        """Number and start of those refused in a row before it, where it counts on from them."""
        if not self._doubted:
            return []
        number, start = self._doubted[-1]
        follows = 0 < experiment.number - number <= MOST_JUMP and experiment.start > start
        return self._doubted[-PATIENT:] if follows else []

    def _begins_anew(self, experiment: Experiment) -> bool:
        """Whether it counts on from enough that were refused before it."""
        before = self._run_up_to(experiment)
        return len(before) >= PATIENT or any(start > self._start for _, start in before)
