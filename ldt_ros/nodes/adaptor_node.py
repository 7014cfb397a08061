"""Stage 3: `experiment` and `signal` in, `model` and `adaptation` out, `diagnosis` where asked."""

from __future__ import annotations

from functools import partial
from typing import Any

from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn

from ldt_core.base.experiment import Experiment, Level, Signal
from ldt_core.base.printable import one_line
from ldt_core.base.threads import one_thread, started_thread
from ldt_core.models import build_model
from ldt_core.restart.learning_switch import LearningSwitch
from ldt_core.twin.loop import build_adaptor
from ldt_ros.nodes.interfaces import to_message
from ldt_ros.nodes.node import LdtNode
from ldt_ros.nodes.pairing import ExperimentPairs
from ldt_ros.nodes.stage_worker import StageWorker

#: Time between two lines of the log that tell of a new model [s]: a journal is kept for months.
LOGGED_EVERY = 60.0

SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


class AdaptorNode(LdtNode, LifecycleNodeMixin):
    """Keeps, stores, or learns from each experiment as its signal says.

    A managed node, which is active from its start on. While it is inactive it learns nothing: each
    experiment is answered so that the loop goes on, with the model in force, and is kept out of all
    that is learned from later. It stays inactive over crashes and `--resume`. For an operator who
    works at the machine, of which nothing is to be learned.

    | asked for | what happens |
    |---|---|
    | `deactivate` | nothing is learned from the next experiment on; a training under way ends |
    | `activate` | it learns again |
    | `shutdown` | as `deactivate`, and for good: it learns again when it is started anew |
    | `cleanup`, or what the present state does not have | refused |

    A model that learns by what a diagnosis names asks for one; then this node publishes it, and the
    graph has no diagnoser. The diagnosis has a thread of its own, and takes part at a stated later
    experiment. Only if it is not ready by then the twin waits, unless its `adaptation_timeout` is
    shorter. What the node does with what it receives is said at `ExperimentPairs` and
    `StageWorker`.
    """

    def __init__(self, **node_arguments: Any) -> None:
        groups = ("machine", "model", "adaptor", "diagnosis")
        super().__init__("adaptor", *groups, **node_arguments)
        model = build_model(self.settings["model"], self.machine, self.settings)
        self.adaptor = build_adaptor(model, self.settings)
        self._switch = LearningSwitch(self.settings["resume"] or self.settings["bag"])
        LifecycleNodeMixin.__init__(self)
        self._survive_refusals()
        self.trigger_configure()
        self.adaptor.paused = self._switch.is_off
        if not self.adaptor.paused:
            self.trigger_activate()
        self._model = self.topics.publishes("model")
        self._adaptation = self.topics.publishes("adaptation")
        self._diagnosis = None
        if self.adaptor.diagnoser is not None:
            self._diagnosis = self.topics.publishes("diagnosis")
            self._limited = one_thread()  # for good: two threads would lift each other's limit
            self._beside = started_thread("diagnosis")
            self.adaptor.diagnoser.executor = self._beside
        self.worker = StageWorker(self, self.adaptor, "signal")
        self.pairs = ExperimentPairs(self, "signal", self._pair)
        self.parts = [self.worker, self.pairs]
        self.worker.go_to_the_end(self.pairs.met)
        self.pairs.listen()
        for why in self.adaptor.unusable.values():
            self.get_logger().warning(f"{why}; the version before it stands in its place")
        self._model.publish(to_message(self.adaptor.model.record()))

    def health(self) -> dict[str, Any]:
        """Model in force, size of S_w, whether it is training."""
        diagnoser = self.adaptor.diagnoser
        trouble = diagnoser.trouble if diagnoser else ""
        values = {
            "model_version": self.adaptor.model.version,
            "warning_set": len(self.adaptor.memory),
            "training": self.worker.busy,
            "learning": "off" if self.adaptor.paused else "on",
            **super().health(),
        }
        return {**values, "no diagnosis": trouble} if trouble else values

    def close(self) -> None:
        """Let a training finish, and say what became of it while somebody may listen."""
        if self.adaptor.diagnoser is not None:
            self.adaptor.diagnoser.cancel()  # it may take longer than anybody waits
            self._beside.shutdown(wait=False)
        self.worker.thread.shutdown(wait=True)

    def destroy_node(self) -> None:
        """End what the base class leaves to the garbage collector, and with it the log's publisher.

        Collected later, it would take that of the node that then has its name.
        """
        super().destroy_node()
        self._state_machine.destroy_when_not_in_use()

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Learn from the next experiment on."""
        return self._learn(True)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Learn nothing from the next experiment on."""
        return self._learn(False)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Refuse: what has been learned stays."""
        return FAILURE

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Learn nothing any more; the loop needs the answers all the same."""
        self.adaptor.paused = True
        return SUCCESS

    def _learn(self, wanted: bool) -> TransitionCallbackReturn:
        if self.adaptor.paused == wanted:
            kept = self._switch.turn(off=not wanted)
            what = f"learning is switched {'on' if wanted else 'off'}"
            self.get_logger().info(what if kept else f"{what}, until this node is started again")
        self.adaptor.paused = not wanted
        return SUCCESS

    def _survive_refusals(self) -> None:
        """Say no to what the present state does not have; the library would end the node."""
        service = next(s for s in self.services if s.srv_name.endswith("/change_state"))
        change = service.callback

        def guarded(request: Any, response: Any) -> Any:
            try:
                return change(request, response)
            except Exception as error:
                self.get_logger().warning(f"change_state: {one_line(str(error))}")
                response.success = False
                return response

        service.callback = guarded

    def _pair(self, experiment: Experiment, beside: Signal) -> None:
        work = partial(self._adapt, experiment, beside)
        diagnoser = self.adaptor.diagnoser
        waits = diagnoser is not None and diagnoser.asked is not None
        self.worker.deal(experiment, work, waits or beside.level is Level.POSITIVE)

    def _adapt(self, experiment: Experiment, signal: Signal) -> None:
        """Keep, store or learn, and say so."""
        before = self.adaptor.model.version
        adaptation, model = self.adaptor.step(experiment, signal)
        diagnosis = self.adaptor.diagnosis
        if self._diagnosis is not None and diagnosis is not None:
            self._diagnosis.publish(to_message(diagnosis, experiment.end, self.machine.name))
        if model.version != before:
            self._model.publish(to_message(model.record()))
            words = one_line(f"experiment {experiment.number}: {adaptation.reason}")
            self.get_logger().info(words, throttle_duration_sec=LOGGED_EVERY)
        self._adaptation.publish(to_message(adaptation, experiment.end, self.machine.name))
