"""Beside the loop: `experiment`, `adaptation`, `model` and `diagnosis` in, `advice` out."""

from __future__ import annotations

from collections import deque
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from ldt_core.experiment import Adaptation, Experiment, ModelRecord
from ldt_core.twin import build_advisor
from ldt_ros.convert import from_message, to_message
from ldt_ros.node import TwinNode
from ldt_ros.pairing import Pairing

NEWS = 0.2  # s, how soon the end of a run learns that nothing waits any more
KEPT_MODELS = 3  # a model may arrive before the adaptation that names it, or behind it
WAITING = 100  # experiments that may wait for their model, or for an advice under way


class AdvisorNode(TwinNode):
    """Advises people; no node listens to what it says.

    | received | what happens |
    |---|---|
    | `experiment`, `adaptation` | the two of one number are dealt with once the model is there |
    | `model` | kept until an adaptation names its version; the last three |
    | `diagnosis` | counts from then on |
    | more than 100 waiting | the oldest is left out and counted |
    | one without the other | dropped when 100 newer ones have come, and counted |
    | anything malformed | counted, logged once per kind |
    """

    def __init__(self, **node_arguments: Any) -> None:
        super().__init__("advisor", "machine", "advice", **node_arguments)
        self.advisor = build_advisor(self.machine, self.settings)
        self.worker = ThreadPoolExecutor(1, thread_name_prefix="advisor")
        self.pairs: Pairing[Experiment, Adaptation] = Pairing(self._on_pair)
        self._models: dict[int, ModelRecord] = {}
        self._waiting: deque[tuple[Experiment, Adaptation]] = deque()
        self._left_out = self._made = self._last = self._told_last = 0
        # One thread writes each, so that neither needs a lock.
        self._begun = self._ended = 0
        self._advice = self.publishes("advice")
        self.listens("model", self._on_model)
        self.listens("diagnosis", self._on_diagnosis)
        self.listens("adaptation", self._on_adaptation)
        self.listens("experiment", self._on_experiment)
        self.create_timer(NEWS, self._tell_progress, clock=self.steady)

    @property
    def busy(self) -> bool:
        """Whether the thread has something to do."""
        return self._begun > self._ended

    def health(self) -> dict[str, Any]:
        """Last experiment dealt with, whether it is at work, what was lost."""
        values = {
            "experiment": self._last,
            "advices": self._made,
            "advising": str(self.busy).lower(),
            "dropped": self._left_out,
            "unpaired": self.pairs.dropped,
        }
        trouble = self.advisor.trouble
        return {**values, "no advice": trouble} if trouble else values

    def close(self) -> None:
        """Begin nothing more; what is under way takes a second."""
        self.worker.shutdown(wait=True, cancel_futures=True)

    def _on_model(self, message: Any) -> None:
        record = from_message("model", message)
        self._models.pop(record.version, None)
        self._models[record.version] = record  # at the end: the last that came
        while len(self._models) > KEPT_MODELS:
            del self._models[next(iter(self._models))]
        self._go_on()

    def _on_diagnosis(self, message: Any) -> None:
        self.worker.submit(self.advisor.informed, from_message("diagnosis", message))

    def _on_experiment(self, message: Any) -> None:
        experiment = from_message("experiment", message)
        # What the twin refuses and tells of must not wait here for its corrected successor.
        if self.machine.may_have_made(experiment):
            self.pairs.left(experiment.number, experiment)

    def _on_adaptation(self, message: Any) -> None:
        adaptation = from_message("adaptation", message)
        self.pairs.right(adaptation.experiment, adaptation)

    def _on_pair(self, experiment: Experiment, adaptation: Adaptation) -> None:
        self._waiting.append((experiment, adaptation))
        if len(self._waiting) + self._begun - self._ended > WAITING:
            self._waiting.popleft()
            self._left_out += 1
        self._go_on()

    def _go_on(self) -> None:
        while self._waiting and self._waiting[0][1].model_version in self._models:
            experiment, adaptation = self._waiting.popleft()
            self._begun += 1
            model = self._models[adaptation.model_version]
            self.worker.submit(self._step_on_thread, experiment, model)

    def _step_on_thread(self, experiment: Experiment, model: ModelRecord) -> None:
        try:
            advice = self.advisor.step(experiment, model)
            if advice is not None:
                self._advice.publish(to_message(advice, experiment.end, self.machine.name))
                self._made += 1
        except Exception as error:  # would be lost in the thread's future
            self.failure = error
        finally:
            self._last = experiment.number
            self._ended += 1

    def _tell_progress(self) -> None:
        """The end of a run waits for the last experiment to be dealt with."""
        if self._last != self._told_last and not self.busy:
            self._told_last = self._last
            self.tell()
