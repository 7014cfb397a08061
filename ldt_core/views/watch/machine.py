"""One machine as its page shows it: its last experiments, events, nodes; bounded in memory."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Any

from ldt_core.base.bounded import forget_oldest
from ldt_core.base.errors import ExperimentError
from ldt_core.base.experiment import (
    Action,
    Adaptation,
    DiagnosisRecord,
    Experiment,
    ModelRecord,
    Prediction,
    Signal,
)
from ldt_core.views.report.samples import Packed, pack
from ldt_core.views.report.statistic import statistic
from ldt_core.views.watch.nodes import Nodes

KEPT = 200  # experiments, as many as a page of a run is made for; older ones leave
WHOLE = 3  # of them with all samples, since predictions may still come; the others thinned
MOST = 2000  # samples of a curve that a browser gets, 32 kB an experiment
LONGEST = 1_000_000  # samples of an experiment that is taken at all
EVENTS = 200  # that are listed
MODELS = 100  # versions that are known by what they learned from
LEARNED = 100  # experiments that are named of what a version learned from
SHOWN = 1000  # characters of a text; a foreign message may be of any size
DIGITS = 6  # of figures that are drawn
GREATEST = 10**15  # of numbers and versions; a browser counts exactly to 9e15

Row = dict[str, Any]
MARKED = (Action.ADAPTED, Action.REFUSED, Action.STORED)


@dataclass
class Turn:
    """One experiment and what has come of it so far.

    Attributes:
        number: of the experiment.
        changed: count of the fleet when it changed last.
        drawn: count of the fleet when its samples changed last, 0 when there are none.
        packed: its samples for a browser, once no more is expected.
    """

    number: int
    changed: int = 0
    drawn: int = 0
    experiment: Experiment | None = None
    prediction: Prediction | None = None
    original: Prediction | None = None
    signal: Signal | None = None
    adaptation: Adaptation | None = None
    original_error: float | None = None
    packed: Packed | None = None

    def samples(self) -> Packed | None:
        """Thinned for a browser; None when nothing was measured."""
        if self.packed is not None or self.experiment is None:
            return self.packed
        prediction, original = (
            p if p is not None and belongs(p, self.experiment) else None
            for p in (self.prediction, self.original)
        )
        return pack(self.experiment, prediction, original, MOST)

    def settle(self) -> None:
        """Keep what a browser needs, and let the samples go."""
        self.packed = self.samples()
        self.experiment = self.prediction = self.original = None

    def row(self) -> Row:
        """Its figures, in JSON types."""
        signal, done = self.signal, self.adaptation
        row: Row = {
            "number": self.number,
            "drawn": self.drawn,
            "original": figure(self.original_error),
            "action": str(done.action) if done else "",
            "reason": text(done.reason) if done else "",
        }
        if signal is None:
            return row | dict.fromkeys(("error", "level", "version", "value", "warning", "drift"))
        compared = statistic([signal])
        return row | {
            "error": figure(signal.max_error),
            "level": int(signal.level),
            "version": signal.model_version,
            "value": figure(compared.values[0]),
            "warning": figure(compared.warning[0]),
            "drift": figure(compared.drift[0]),
        }


@dataclass
class WatchedMachine:
    """All that is known of a machine.

    Args:
        namespace: of its topics, "" for the root.

    Attributes:
        turns: by number, in the order in which they came.
        events: (count, time [s since the epoch] or None, experiment or None, kind, words).
        models: version → (count, kind, learned from).
        began: count of the fleet when its run began.
        fed_at: time of the last experiment [s of the fleet's clock].
    """

    namespace: str
    turns: dict[int, Turn] = field(default_factory=dict)
    events: deque[tuple[int, float | None, int | None, str, str]] = field(
        default_factory=lambda: deque(maxlen=EVENTS)
    )
    models: dict[int, tuple[int, str, list[int]]] = field(default_factory=dict)
    diagnosis: DiagnosisRecord | None = None
    diagnosis_changed: int = 0
    signal: Signal | None = None
    adaptation: Adaptation | None = None
    nodes: Nodes = field(default_factory=Nodes)
    name: str = ""
    unreadable: int = 0
    last_unreadable: str = ""
    began: int = 0
    fed_at: float | None = None
    _last: tuple[int, float] | None = None

    def take(
        self, topic: str, record: Any, count: int, now: float, moment: float | None = None
    ) -> None:
        """A record that came on a topic (last part of its name).

        Args:
            topic: "experiment", "prediction", …
            record: as the codec decodes it.
            count: of the fleet; larger than at any change before.
            now: of the fleet's clock [s].
            moment: of the world [s since the epoch], None when a recording is played.

        Raises:
            ExperimentError: numbers or lengths that no page could show.
        """
        match record:
            case Experiment():
                self._measured(record, count, now, moment)
            case Prediction():
                turn = self._turn(record.number, count)
                if topic == "prediction":
                    turn.prediction = record
                else:
                    turn.original = record
                self._drawn(turn, count)
            case Signal():
                self.signal = record
                self._turn(record.experiment, count).signal = record
            case Adaptation():
                self.adaptation = record
                self._turn(record.experiment, count).adaptation = record
                if record.action in MARKED:
                    kind, words = str(record.action), record.reason
                    self._event(count, moment, record.experiment, kind, words)
            case ModelRecord():
                self._learned(record, count, moment)
            case DiagnosisRecord():
                self.diagnosis, self.diagnosis_changed = record, count
                self._event(count, moment, record.experiment, "diagnosis", record.sentence)

    def misread(self, sentence: str) -> None:
        """Count a message that could not be read."""
        self.unreadable += 1
        self.last_unreadable = text(sentence)

    def _measured(self, record: Experiment, count: int, now: float, moment: float | None) -> None:
        if len(record) > LONGEST:
            where = f"experiment {record.number}"
            raise ExperimentError(where, f"at most {LONGEST} samples to show", len(record))
        key = (record.number, record.start)
        if key == self._last:
            return
        old = self.turns.get(record.number)
        if self._last is not None and record.number <= self._last[0]:
            self._begin_anew(record.number, count, moment)
        turn = self._turn(record.number, count)
        turn.experiment, turn.packed = record, None
        if old is not None and old is not turn and old.prediction is not None:
            turn.prediction = old.prediction if belongs(old.prediction, record) else None
        self._last, self.fed_at = key, now
        self._drawn(turn, count)
        for older in list(self.turns.values())[:-WHOLE]:
            if older.experiment is not None and older is not turn:
                older.settle()

    def _drawn(self, turn: Turn, count: int) -> None:
        if turn.experiment is None:
            return
        turn.drawn = count
        if turn.original is not None and belongs(turn.original, turn.experiment):
            turn.original_error = turn.original.max_error(turn.experiment)

    def _begin_anew(self, number: int, count: int, moment: float | None) -> None:
        """Numbers rise within a run: another one has begun."""
        self.turns.clear()
        self.models.clear()
        self.signal = self.adaptation = self.diagnosis = None
        self.began = self.diagnosis_changed = count
        words = f"a new run: its experiments count from {number}"
        self._event(count, moment, number, "begun", words)

    def _turn(self, number: int, count: int) -> Turn:
        _bounded(f"experiment {number}", number)
        turn = self.turns.get(number)
        if turn is None:
            turn = self.turns[number] = Turn(number)
            forget_oldest(self.turns, KEPT)
        turn.changed = count
        return turn

    def _learned(self, record: ModelRecord, count: int, moment: float | None) -> None:
        _bounded("model version", record.version)
        known = record.version in self.models
        learned = [n for n in record.trained_on if n <= GREATEST][-LEARNED:]
        self.models[record.version] = (count, text(record.kind), learned)
        if len(self.models) > MODELS:
            del self.models[min(self.models)]
        if not known and record.version:
            words = f"version {record.version} of the {record.kind} model"
            self._event(count, moment, None, "model", words)

    def _event(
        self, count: int, moment: float | None, number: int | None, kind: str, words: str
    ) -> None:
        self.events.append((count, moment, number, kind, text(words)))


def belongs(prediction: Prediction, experiment: Experiment) -> bool:
    """Whether it is a prediction of this experiment: a number may come again in another run."""
    return prediction.start == experiment.start and len(prediction) == len(experiment)


def text(words: str) -> str:
    """Cut to what is shown."""
    return words if len(words) <= SHOWN else words[: SHOWN - 1] + "…"


def figure(value: float | None) -> float | None:
    """Rounded to what is drawn; None where it is none."""
    if value is None or not math.isfinite(value):
        return None
    return float(f"{value:.{DIGITS}g}")


def _bounded(where: str, number: int) -> None:
    if number > GREATEST:
        raise ExperimentError(where, f"a number up to {GREATEST} to show", number)
