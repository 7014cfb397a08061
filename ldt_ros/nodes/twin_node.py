"""Stage 1: `experiment` and `model` in, `prediction` and `original_prediction` out."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Any

from ldt_core.base.bounded import forget_oldest
from ldt_core.base.errors import ExperimentError, LdtError, ModelError, RepeatedExperiment
from ldt_core.base.experiment import Adaptation, Experiment, ModelRecord
from ldt_core.base.sentences import counted
from ldt_core.models import build_model, restore_model
from ldt_core.models.base import Model
from ldt_core.recording.experiment_numbers import MOST_JUMP, ExperimentNumbers
from ldt_core.recording.message_subject import agree
from ldt_core.recording.node_status import REFUSED
from ldt_core.restart.checkpoint import Lookup
from ldt_core.restart.recorded_run import END
from ldt_core.twin.predictor import Predictor, try_out
from ldt_core.twin.stage import WINDOW, RecordedStep
from ldt_ros.nodes.interfaces import from_message, stamp_of, to_message
from ldt_ros.nodes.model_versions import ModelVersions
from ldt_ros.nodes.node import LdtNode, NodePart

#: Time between two looks for a time-out [s].
TICK = 0.05
#: Experiments that may wait for an adaptation; beyond, the oldest are dropped. What a source keeps
#: comes at once after it was cut off (100), and the present beside it.
QUEUE = 200
#: Stretches of numbers without a gap that are remembered.
STRETCHES = 1000


class Arrivals(NodePart):
    """The numbers of the experiments that have come, and when the last did.

    By a clock, not by the middleware's deadline: whoever asks for that is not matched by a machine
    that promises none, and hears nothing more of it once the publisher has gone.

    Args:
        deadline: longest time from one to the next [s]; 0 expects nothing.
        clock: of the time that passes [s].
    """

    def __init__(self, deadline: float, clock: Callable[[], float] = time.monotonic) -> None:
        self.deadline, self._clock = deadline, clock
        #: How often none came in time.
        self.overdue = 0
        self._numbers = ExperimentNumbers()
        self._since = clock()
        self._told = False

    def heard(self) -> None:
        """One has come, whatever becomes of it."""
        self._since, self._told = self._clock(), False

    def known(self, number: int) -> None:
        """One is not missing: it has come, or is recorded."""
        if len(self._numbers.spans) < STRETCHES:
            self._numbers.add(number)

    def newly_overdue(self) -> bool:
        """Whether one has been awaited for too long, and this has not been said yet."""
        late = 0 < self.deadline < self._clock() - self._since
        if not late or self._told:
            return False
        self._told = True
        self.overdue += 1
        return True

    @property
    def missing(self) -> int:
        """Numbers that were left out so far."""
        return sum(last - first + 1 for first, last in self._numbers.gaps)

    def health(self) -> dict[str, int]:
        """For `/diagnostics`."""
        return {"missing": self.missing, "overdue": self.overdue}

    def complaint(self) -> str:
        """What is to be said of it now; "" when all is well.

        What no source keeps any more does not come, and is no news: it is only counted.
        """
        found = []
        if self._told:
            waited = self._clock() - self._since
            found.append(f"no experiment for {waited:.0f} s, one is due every {self.deadline:g} s")
        gaps, spans = self._numbers.gaps, self._numbers.spans
        if gaps and gaps[-1][1] >= spans[-1][1] - WINDOW:
            first, last = gaps[-1]
            which = f"{first}" if first == last else f"{first} to {last}"
            found.append(f"{self.missing} experiments are missing, last {which}")
        return "; ".join(found)


class TwinNode(LdtNode):
    """Predicts each experiment after the adaptation of the one before.

    | received | what happens |
    |---|---|
    | `experiment` | predicted, once the adaptation of the last one and its model are there |
    | no such adaptation within `adaptation_timeout` | predicted all the same; logged, counted |
    | the same at the next | before, all but the 100 last waiting ones are dropped, counted |
    | `experiment`, one of the last again | left out, counted |
    | `experiment`, its number does not follow (`Numbering`) | rejected, `refused experiment` told |
    | `experiment`, impossible for the machine | rejected, `refused experiment` told |
    | more than 200 experiments waiting | the oldest is dropped and counted |
    | a number above the next | those between are counted as missing, told of for 100 more |
    | none for the `deadline`, if there is one | told of until one comes, counted |
    | `model` | kept until an adaptation names its version; the last twelve |
    | `model` that cannot predict | rejected |
    | `adaptation` of an earlier one | its model is taken when the time is out |
    | `adaptation` of one not predicted | ignored, unless this node was started again |
    | anything malformed | counted, logged once per kind |

    `refused experiment` is in `/diagnostics`: no adaptation of that number will come, which those
    who wait for it need to know. Started again in the middle of a run, the node predicts once more
    what is not recorded as adapted; the others leave out what they have had.
    """

    def __init__(self, **node_arguments: Any) -> None:
        super().__init__("twin", "machine", "model", "twin", **node_arguments)
        model = build_model(self.settings["model"], self.machine, self.settings)
        self.predictor = Predictor(self.machine, model)
        self.predictor.warm_up()
        self._models: ModelVersions[Model] = ModelVersions(model)
        self._waiting: deque[tuple[Experiment, float]] = deque()
        self._adapted: dict[int, tuple[Adaptation, float | None]] = {}  # with their stamps
        self._last_end = 0.0  # of the experiment predicted last [s since the epoch]
        self._arrivals = Arrivals(self.settings["deadline"])
        self.parts = [self._arrivals]
        for step in self.recording.steps(END):
            self._take_up(step)
        if self._adapted and self.settings["resume"]:
            self._find_model()
        self._predicted_at = 0.0
        self._refused = self._repeated = 0
        self._timeouts = 0
        self._unanswered = 0  # experiments in a row, of which no adaptation came in time
        self._dropped = 0
        self._prediction = self.topics.publishes("prediction")
        self._original = self.topics.publishes("original_prediction")
        self.topics.listens("model", self._on_model)
        self.topics.listens("adaptation", self._on_adaptation)
        self.topics.listens("experiment", self._on_experiment)
        self.create_timer(TICK, self._go_on, clock=self.steady)

    def health(self) -> dict[str, Any]:
        """Model in force, queue, time-outs."""
        return {
            "model_version": self.predictor.model.version,
            "experiment": self.predictor.last,
            "waiting": len(self._waiting),
            "dropped": self._dropped,
            REFUSED: self._refused,
            "repeated": self._repeated,
            "adaptation time-outs": self._timeouts,
            **super().health(),
        }

    def complaint(self) -> str:
        """What the parts say, and that nobody answers."""
        unanswered = ""
        if self._unanswered:
            timeout = f"{self.settings['adaptation_timeout']:g} s"
            which = counted(self._unanswered, "experiment")
            unanswered = f"no adaptation of {which} within {timeout}: look at the adaptor"
        return "; ".join(filter(None, [super().complaint(), unanswered]))

    def _on_model(self, message: Any) -> None:
        record = from_message("model", message)
        known = self._models.get(record.version)
        # An adaptor that begins anew counts its versions from 0 again.
        if known is None or known.record() != record:
            known = restore_model(record, self.machine, self.settings)
            self.predictor.try_out(known)
        self._models.put(record.version, known)
        self._go_on()

    def _on_adaptation(self, message: Any) -> None:
        adaptation = from_message("adaptation", message)
        last = self.predictor.last
        # What was adapted before this node was started again is ahead of what it predicts now.
        ahead = last is None or adaptation.experiment > last
        if not ahead or self.settings["resume"]:
            self._note(adaptation, stamp_of(message))
            self._go_on()

    def _note(self, adaptation: Adaptation, stamp: float | None) -> None:
        number = adaptation.experiment
        if self._adaptation_of_last() is None or number != self.predictor.last:
            self._adapted[number] = adaptation, stamp
            forget_oldest(self._adapted, WINDOW)

    def _adaptation_of_last(self) -> Adaptation | None:
        """That of the experiment predicted last, which an earlier one of its number is not."""
        found, stamp = self._adapted.get(self.predictor.last or 0, (None, None))
        return found if stamp is None or agree(stamp, self._last_end) else None

    def _refuse(self, experiment: Experiment, error: LdtError) -> None:
        if isinstance(error, RepeatedExperiment):
            self._repeated += 1
            return
        self.topics.reject("experiment", error)
        self._refused = experiment.number
        self.report.tell()

    def _on_experiment(self, message: Any) -> None:
        experiment = from_message("experiment", message)
        self._arrivals.heard()
        try:
            self.predictor.admit(experiment)
        except ExperimentError as error:
            if experiment.number - (self.predictor.numbering.last or 0) <= MOST_JUMP:
                self._arrivals.known(experiment.number)  # it has come, whatever is wrong with it
            self._refuse(experiment, error)
            return
        self._arrivals.known(experiment.number)
        self._waiting.append((experiment, time.monotonic()))
        if len(self._waiting) > QUEUE:
            _, since = self._waiting.popleft()
            # The next has had its turn for as long: a fast machine must not outrun the time-out.
            self._waiting[0] = self._waiting[0][0], since
            self._dropped += 1
        self._go_on()

    def _take_up(self, step: RecordedStep) -> None:
        """Take over what a recorded step says."""
        self._arrivals.known(step.number)
        self._begin_anew_at(step.number)
        self.predictor.recall(step)
        self._last_end = step.experiment.end
        if step.model is not None:
            self.predictor.model = self._restored(step.model, step.experiment)
            self._models.put(step.model.version, self.predictor.model)
        self._note(step.adaptation, None)

    def _restored(self, record: ModelRecord, experiment: Experiment) -> Model:
        """A recorded model; the present one in the place of one that nobody can use."""
        try:
            found = restore_model(record, self.machine, self.settings)
            try_out(found, experiment)
        except ModelError as error:
            self.get_logger().warning(f"{error}; the version before it stands in its place")
            return self.predictor.model.again(record.version)
        return found

    def _find_model(self) -> None:
        """The model in force came into it before the steps that were taken up, perhaps."""
        version = next(reversed(self._adapted.values()))[0].model_version
        if self._models.get(version) is None:
            try:
                bag = self.recording.run.bag(listed=True)
                assert bag is not None  # it has steps
                found = Lookup(bag, self.machine, self.settings, ()).model(version)
                self._models.put(version, found)
            except (LdtError, OSError):
                for step in self.recording.steps():
                    self._take_up(step)
        self.predictor.model = self._models.get(version) or self.predictor.model

    def _go_on(self) -> None:
        if self._arrivals.newly_overdue():
            self.get_logger().warning(self._arrivals.complaint())
            self.report.tell()
        if self._waiting:
            last = self.predictor.last or 0
            start = self.predictor.starts.get(last, 0.0)
            for step in self.recording.missed((last, start), self._waiting[0][0].number):
                self._take_up(step)
        while self._waiting and self._may_predict(self._waiting[0][1]):
            experiment, _ = self._waiting.popleft()
            self._predict(experiment)

    def _begin_anew_at(self, number: int) -> None:
        """Forget what was adapted to, where a counter began anew."""
        if number <= (self.predictor.last or 0):
            self._adapted.clear()

    def _predict(self, experiment: Experiment) -> None:
        self._begin_anew_at(experiment.number)
        try:
            prediction = self.predictor.answer(experiment)
        except LdtError as error:
            self._refuse(experiment, error)
            return
        self._last_end = experiment.end
        self._prediction.publish(to_message(prediction))
        self._predicted_at = time.monotonic()
        try:
            # Nobody waits for the yardstick, so it is made while the detector works.
            self._original.publish(to_message(self.predictor.predict_original(experiment)))
        except LdtError as error:
            self.topics.reject("experiment", error)

    def _may_predict(self, since: float) -> bool:
        """Whether it is the turn of the first that waits, which does so since then."""
        last = self.predictor.last
        if last is None:
            # The first that this node sees: nothing can have been learned from it before.
            untrained, resumed = self._models.first, self.settings["resume"]
            self.predictor.model = untrained if resumed else self._models.last
            return True
        adapted = self._adaptation_of_last()
        if adapted is not None:
            model = self._models.get(adapted.model_version)
            if model is not None:
                self.predictor.model = model
                self._unanswered = 0
                return True
        # A backlog is no reason to hurry: the time runs from when this one's turn came.
        turn = max(since, self._predicted_at)
        if time.monotonic() - turn < self.settings["adaptation_timeout"]:
            return False
        earlier = [n for n in self._adapted if n <= last]
        newest = self._adapted[max(earlier)][0].model_version if earlier else -1
        self.predictor.model = self._models.get(newest) or self.predictor.model
        self._timeouts += 1
        self._unanswered += 1
        # Who hung and was started again knows the last ones alone: each before takes a time-out.
        while self._unanswered > 1 and len(self._waiting) > WINDOW:
            self._waiting.popleft()
            self._dropped += 1
        self.get_logger().warning(
            f"no adaptation of experiment {last} within {self.settings['adaptation_timeout']:g} s: "
            f"experiment {self._waiting[0][0].number} is predicted by model "
            f"{self.predictor.model.version}"
        )
        return True
