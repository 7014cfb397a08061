"""One machine as its page shows it: its last experiments, events, nodes; bounded in memory."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
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
from ldt_core.recording.node_status import READY, NodeStatus, node_statuses
from ldt_core.views.step_view import Row, StepView, belongs, drawn_number, statistic

# What bounds the memory: messages may come for ever, and a foreign one may be of any size.
MOST_STEPS = 200  # as many as a page of a run is made for; older ones leave
WHOLE_STEPS = 3  # of them with all samples, since predictions may still come
MOST_WHOLE = 20_000  # samples up to which more are left whole, 1 MB: to thin them takes longer
MOST_SAMPLES = 2000  # of a curve that a browser gets: 32 kB an experiment
LONGEST = 1_000_000  # samples of an experiment that is taken at all
MOST_EVENTS = 200  # that are listed
MOST_MODELS = 100  # versions that are known by what they learned from
MOST_LEARNED = 100  # experiments that are named of what a version learned from
MOST_CHARACTERS = 1000  # of a text
GREATEST = 10**15  # number or version: a browser counts exactly to 9e15

STREAMED = 20.0  # s of a stream of samples that are shown, as long as an experiment of the rotor
MOST_STREAMED = 4000  # samples of it that are held: 20 s at 200 Hz
DRAWN_STREAMED = 300  # samples of it that are drawn: a stroke each two pixels

MARKED = (Action.ADAPTED, Action.REFUSED, Action.STORED)

MOST_NODES = 30  # of one machine that are shown: a graph has fewer
MOST_STATUS_CHARACTERS = 400  # of what one says, since a foreign message may be of any size
SILENT_AFTER = 5.0  # s: a node tells of itself each second


@dataclass
class WatchedStep(StepView):
    """A step as it comes, message by message.

    Attributes:
        drawn: count of the fleet when its samples changed last, 0 when there are none.
    """

    changed: int = 0
    drawn: int = 0

    def row(self) -> Row:
        """Its figures and what its detector compared, in JSON types."""
        row = super().row()
        row |= {"drawn": self.drawn, "reason": shown_text(row["reason"])}
        if self.signal is None:
            return row | dict.fromkeys(("value", "warning", "drift"))
        compared = statistic([self.signal])
        return row | {
            "value": drawn_number(compared.values[0]),
            "warning": drawn_number(compared.warning[0]),
            "drift": drawn_number(compared.drift[0]),
        }


@dataclass(frozen=True)
class Told:
    """What a node said last, and when [s of the fleet's clock]."""

    status: NodeStatus
    at: float


class Nodes:
    """The nodes of one machine by role."""

    def __init__(self) -> None:
        self.told: dict[str, Told] = {}
        #: Name of the machine, as the nodes have it.
        self.machine = ""

    def take(self, message: Any, namespace: str, now: float) -> bool:
        """A message of `/diagnostics`; whether it told anything of this machine."""
        machines = {s.name.strip("/"): s.hardware_id for s in message.status}
        found = False
        for status in node_statuses(message, namespace):
            role = status.role
            if READY not in status.values or (
                role not in self.told and len(self.told) >= MOST_NODES
            ):
                continue
            if self._is_of_another_run(status, now):
                self.told.clear()
            self.machine = machines[status.name][:MOST_STATUS_CHARACTERS] or self.machine
            self.told[role] = Told(_cut(status), now)
            found = True
        return found

    def silent(self, now: float) -> list[str]:
        """Roles that have not been heard of for long, and were not at an end."""
        gone = [r for r, told in sorted(self.told.items()) if self._gone(told, now)]
        return [] if self.ended else gone

    def over(self, now: float) -> bool:
        """Whether there is nobody left of those that told something."""
        return bool(self.told) and all(self._gone(told, now) for told in self.told.values())

    @property
    def ended(self) -> bool:
        """Whether the source has said that it sends nothing more: all may end."""
        return any(told.status.ended for told in self.told.values())

    def rows(self, now: float, live: bool) -> Iterator[dict[str, Any]]:
        """Each node in JSON types: what it said, what it refused, whether it is silent."""
        for role, told in sorted(self.told.items()):
            refused = "; ".join(f"{n} × {kind}" for kind, n in told.status.rejected.items())
            gone = live and self._gone(told, now)
            silent, ended = gone and not self.ended, gone and self.ended
            yield {
                "role": role,
                "message": "ended" if ended else told.status.message,
                "warns": (told.status.warns and not ended) or silent,
                "silent": int(now - told.at) if silent else None,
                "rejected": refused,
                "why": told.status.last_rejection,
            }

    def _gone(self, told: Told, now: float) -> bool:
        return now - told.at > SILENT_AFTER

    def _is_of_another_run(self, status: NodeStatus, now: float) -> bool:
        """Whether those known are of a run before: that one is over, this is another process.

        The graph that follows may have other nodes, and would be in trouble for those it lacks.
        """
        known = self.told.get(status.role)
        if known is None or status.ended:
            return known is None and self.over(now)
        return known.status.process != status.process and (self.ended or self.over(now))


@dataclass
class WatchedMachine:
    """All that is known of a machine.

    Attributes:
        events: (count, time [s since the epoch] or None, experiment or None, kind, words).
        models: version → (count, kind, learned from).
        began: count of the fleet when its run began.
        fed_at: time of the last experiment [s of the fleet's clock].
    """

    namespace: str
    steps: dict[int, WatchedStep] = field(default_factory=dict)
    events: deque[tuple[int, float | None, int | None, str, str]] = field(
        default_factory=lambda: deque(maxlen=MOST_EVENTS)
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
    #: Samples as they are streamed: (time [s], speed [rad/s]); and the fleet's count at the last.
    stream: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=MOST_STREAMED))
    streamed: int = 0
    _last: tuple[int, float] | None = None
    #: Steps with all samples and how many, the oldest first; and the sum.
    _whole: deque[tuple[WatchedStep, int]] = field(default_factory=deque)
    _held: int = 0

    def take(
        self, topic: str, record: Any, count: int, now: float, moment: float | None = None
    ) -> None:
        """A record that came on a topic (last part of its name).

        Args:
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
                step = self._step(record.number, count)
                if topic == "prediction":
                    step.prediction = record
                else:
                    step.original = record
                self._drawn(step, count)
            case Signal():
                self.signal = record
                self._step(record.experiment, count).signal = record
            case Adaptation():
                self.adaptation = record
                self._step(record.experiment, count).adaptation = record
                if record.action in MARKED:
                    kind, words = str(record.action), record.reason
                    self._event(count, moment, record.experiment, kind, words)
            case ModelRecord():
                self._learned(record, count, moment)
            case DiagnosisRecord():
                self.diagnosis, self.diagnosis_changed = record, count
                self._event(count, moment, record.experiment, "diagnosis", record.sentence)

    def sample(self, moment: float, speed: float, count: int) -> None:
        """A streamed sample; one whose clock went back, or that is no number, begins anew.

        Args:
            moment: its stamp [s].
            speed: [rad/s].
            count: of the fleet.
        """
        if not (math.isfinite(moment) and math.isfinite(speed)):
            return
        if self.stream and moment <= self.stream[-1][0]:
            self.stream.clear()
        self.stream.append((moment, speed))
        self.streamed = count

    def streamed_now(self) -> list[tuple[float, float]]:
        """(Seconds before the last one, speed) of the last samples, thinned."""
        if not self.stream:
            return []
        last = self.stream[-1][0]
        shown = [(t - last, speed) for t, speed in self.stream if last - t <= STREAMED]
        step = -(-len(shown) // DRAWN_STREAMED)
        return [(round(t, 3), float(f"{speed:.5g}")) for t, speed in shown[::-1][::step][::-1]]

    def misread(self, sentence: str) -> None:
        """Count a message that could not be read."""
        self.unreadable += 1
        self.last_unreadable = shown_text(sentence)

    def _measured(self, record: Experiment, count: int, now: float, moment: float | None) -> None:
        if len(record) > LONGEST:
            where = f"experiment {record.number}"
            raise ExperimentError(where, f"at most {LONGEST} samples to show", len(record))
        key = (record.number, record.start)
        if key == self._last:
            return
        old = self.steps.get(record.number)
        if self._last is not None and record.number <= self._last[0]:
            self._begin_anew(record.number, count, moment)
        step = self._step(record.number, count)
        step.experiment, step.packed = record, None
        if old is not None and old is not step and old.prediction is not None:
            step.prediction = old.prediction if belongs(old.prediction, record) else None
        self._last, self.fed_at = key, now
        self._drawn(step, count)
        self._whole.append((step, len(record)))
        self._held += len(record)
        while len(self._whole) > WHOLE_STEPS and self._held > MOST_WHOLE:
            older, samples = self._whole.popleft()
            self._held -= samples
            if older.experiment is not None and self.steps.get(older.number) is older is not step:
                older.settle(MOST_SAMPLES)

    def _drawn(self, step: WatchedStep, count: int) -> None:
        if step.experiment is None:
            return
        step.drawn = count
        if step.original is not None and belongs(step.original, step.experiment):
            step.original_error = step.original.max_error(step.experiment)

    def _begin_anew(self, number: int, count: int, moment: float | None) -> None:
        """Numbers rise within a run: another one has begun."""
        self.steps.clear()
        self._whole.clear()
        self._held = 0
        self.models.clear()
        self.signal = self.adaptation = self.diagnosis = None
        self.began = self.diagnosis_changed = count
        words = f"a new run: its experiments count from {number}"
        self._event(count, moment, number, "begun", words)

    def _step(self, number: int, count: int) -> WatchedStep:
        _bounded(f"experiment {number}", number)
        step = self.steps.get(number)
        if step is None:
            step = self.steps[number] = WatchedStep(number)
            forget_oldest(self.steps, MOST_STEPS)
        step.changed = count
        return step

    def _learned(self, record: ModelRecord, count: int, moment: float | None) -> None:
        _bounded("model version", record.version)
        known = record.version in self.models
        learned = [n for n in record.trained_on if n <= GREATEST][-MOST_LEARNED:]
        self.models[record.version] = (count, shown_text(record.kind), learned)
        if len(self.models) > MOST_MODELS:
            del self.models[min(self.models)]
        if not known and record.version:
            words = f"version {record.version} of the {record.kind} model"
            self._event(count, moment, None, "model", words)

    def _event(
        self, count: int, moment: float | None, number: int | None, kind: str, words: str
    ) -> None:
        self.events.append((count, moment, number, kind, shown_text(words)))


def shown_text(words: str) -> str:
    """Cut to what is shown."""
    return words if len(words) <= MOST_CHARACTERS else words[: MOST_CHARACTERS - 1] + "…"


def _bounded(where: str, number: int) -> None:
    if number > GREATEST:
        raise ExperimentError(where, f"a number up to {GREATEST} to show", number)


def _cut(status: NodeStatus) -> NodeStatus:
    values = {
        k[:MOST_STATUS_CHARACTERS]: v[:MOST_STATUS_CHARACTERS]
        for k, v in list(status.values.items())[:MOST_NODES]
    }
    return replace(status, message=status.message[:MOST_STATUS_CHARACTERS], values=values)
