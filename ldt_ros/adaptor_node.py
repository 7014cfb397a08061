"""Stage 3: `experiment` and `signal` in, `model` and `adaptation` out, `diagnosis` where asked."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

from ldt_core.errors import LdtError
from ldt_core.experiment import Experiment, Level, Signal
from ldt_core.models import build_model
from ldt_core.twin import build_adaptor
from ldt_ros.convert import from_message, to_message
from ldt_ros.node import TwinNode
from ldt_ros.pairing import Pairing


class AdaptorNode(TwinNode):
    """Keeps, stores, or learns from each experiment as its signal says.

    Training runs on a thread of its own, so that health is told meanwhile; experiments that come
    then wait for it in order. So does the diagnosis, for a model that learns by what it names; then
    this node publishes it, and the graph has no diagnoser. It may take 40 s, within which the twin
    waits unless its `adaptation_timeout` is shorter.

    | received | what happens |
    |---|---|
    | `experiment`, `signal` | the two of one number go through the adaptor |
    | one without the other | dropped when 100 newer ones have come, and counted |
    | a number that waits already | dropped and counted: the first one counts |
    | anything malformed | counted, logged once per kind |
    """

    def __init__(self, **node_arguments: Any) -> None:
        groups = ("machine", "model", "adaptor", "diagnosis")
        super().__init__("adaptor", *groups, **node_arguments)
        model = build_model(self.settings["model"], self.machine, self.settings)
        self.adaptor = build_adaptor(model, self.settings)
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="adaptor")
        # One thread writes each, so that neither needs a lock.
        self._begun = 0
        self._ended = 0
        self._pairs: Pairing[Experiment, Signal] = Pairing(self._on_pair)
        self._model = self.publishes("model")
        self._adaptation = self.publishes("adaptation")
        self._diagnosis = self.publishes("diagnosis") if model.asks_for_diagnosis else None
        self._model.publish(to_message(model.record()))
        self.listens("experiment", self._on_experiment)
        self.listens("signal", self._on_signal)

    def health(self) -> dict[str, Any]:
        """Model in force, size of S_w, whether it is training."""
        diagnoser = self.adaptor.diagnoser
        trouble = diagnoser.trouble if diagnoser else ""
        values = {
            "model_version": self.adaptor.model.version,
            "warning_set": len(self.adaptor.memory),
            "training": str(self._begun > self._ended).lower(),
            "unpaired": self._pairs.dropped,
        }
        return {**values, "no diagnosis": trouble} if trouble else values

    def close(self) -> None:
        """Let a training finish, and say what became of it while somebody may listen."""
        if self.adaptor.diagnoser is not None:
            self.adaptor.diagnoser.cancel()  # it may take longer than anybody waits
        self._worker.shutdown(wait=True)

    def _on_experiment(self, message: Any) -> None:
        experiment = from_message("experiment", message)
        # What the twin refuses and tells of must not wait here for its corrected successor.
        if self.machine.may_have_made(experiment):
            self._pairs.left(experiment.number, experiment)

    def _on_signal(self, message: Any) -> None:
        signal = from_message("signal", message)
        self._pairs.right(signal.experiment, signal)

    def _on_pair(self, experiment: Experiment, signal: Signal) -> None:
        if signal.level is Level.POSITIVE or self._begun > self._ended:
            self._begun += 1
            self._worker.submit(self._step_on_thread, experiment, signal)
        else:
            self._step(experiment, signal)

    def _step_on_thread(self, experiment: Experiment, signal: Signal) -> None:
        try:
            self._step(experiment, signal)
        except LdtError as error:
            self.reject("signal", error)
        except Exception as error:  # would be lost in the thread's future
            self.failure = error
        finally:
            self._ended += 1

    def _step(self, experiment: Experiment, signal: Signal) -> None:
        before = self.adaptor.model.version
        adaptation, model = self.adaptor.step(experiment, signal)
        diagnosis = self.adaptor.diagnosis
        if self._diagnosis is not None and diagnosis is not None:
            self._diagnosis.publish(to_message(diagnosis, experiment.end, self.machine.name))
        if model.version != before:
            self._model.publish(to_message(model.record()))
        self._adaptation.publish(to_message(adaptation, experiment.end, self.machine.name))
