"""What the launching process hears of one machine's graph: its progress, and its end.

It listens to what is small, and gets what the nodes tell of themselves. The samples are in the
recording, and two cores have better to do than to decode them once more.
"""

from __future__ import annotations

import contextlib
import math
import re
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

from rclpy.node import Node

from ldt_core.base.bounded import forget_oldest
from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Adaptation, Signal
from ldt_core.recording.experiment_numbers import ExperimentNumbers
from ldt_core.recording.node_status import (
    LITTLE_ROOM,
    REFUSED,
    WRONG_RECORDING,
    WRONG_STREAM,
    NodeStatus,
)
from ldt_core.runs.fleet_members import SOURCES
from ldt_ros.nodes.interfaces import (
    LISTENER_DEPTH,
    from_message,
    listener_qos,
    message_type,
    stamp_of,
)

#: What changes in a warning that stays the same.
NUMBERS = re.compile(r"\d+")
#: Time without a failure after which a recording goes on for good [s]: a recorder tries again after
#: a minute at the latest, and a disk may have room for a message now and then.
WELL_AGAIN = 60.0
#: Signals and adaptations that wait for the other; what is older has lost it.
CAPACITY = 200
#: Beyond the twin's longest wait, time for the step that it then makes [s]: all cores may be busy.
WAITED = 10.0


class Monitor(Node):
    """Follows a machine's signals, adaptations and health."""

    def __init__(
        self,
        namespace: str,
        on_step: Callable[[Signal, Adaptation], None],
        longest_wait: float = math.inf,
        on_warning: Callable[[str, str], None] = lambda role, words: None,
        **node_arguments: Any,
    ) -> None:
        alone = {"start_parameter_services": False, **node_arguments}
        super().__init__("monitor", namespace=namespace, **alone)
        self.on_step, self.on_warning = on_step, on_warning
        #: What each node told of itself last, by role.
        self.health: dict[str, NodeStatus] = {}
        #: How often each has, since this node began.
        self.statements: Counter[str] = Counter()
        #: Of the twin for an adaptation [s].
        self.longest_wait = longest_wait
        self.last_experiment = 0
        self.last_step = 0
        self.last_signal = 0
        #: Experiments of which an adaptation came.
        self.answered = ExperimentNumbers()
        self.first_step_at: float | None = None
        self._last_step_at = time.monotonic()
        self._warned: set[str] = set()
        self._unwritten_at: float | None = None  # when its recording failed last
        self._signals: dict[int, Signal] = {}
        self._early: dict[int, Adaptation] = {}  # those that came before their signals
        self._adapted: dict[tuple[int, float | None], None] = {}  # the last ones, with stamps
        for topic, callback in (("signal", self._on_signal), ("adaptation", self._on_adaptation)):
            self.create_subscription(
                message_type(topic), topic, callback, listener_qos(topic, LISTENER_DEPTH)
            )

    @property
    def source_finished(self) -> bool:
        """Whether the source of the experiments has nothing more to send."""
        return any(told.finished for told in self._sources)

    @property
    def idle(self) -> bool:
        """Whether every experiment that was sent has gone all the way, or was refused."""
        for role in ("diagnoser", "advisor"):
            dealt = self._told(role, "experiment")
            if role in self.health and dealt != str(self.last_signal):
                return False
        if self.last_experiment in self._early:
            return False
        sources = self._sources
        ended = not sources or any(told.ended for told in sources)
        return self.last_experiment in (0, self.last_step) and ended

    @property
    def _sources(self) -> list[NodeStatus]:
        """What those that send experiments told of themselves last."""
        return [self.health[role] for role in SOURCES if role in self.health]

    @property
    def busy(self) -> bool:
        """Whether a node has told that it works on experiments that have not gone all the way.

        A twin that waits for an adaptation goes on without it after a while. If the next is not
        answered either, the others lack what it has, as after a flood, and it leaves out what they
        must lack. Where that does not help, the rest would take hours.
        """
        diagnosing = self._told("diagnoser", "diagnosing") == "true"
        advising = self._told("advisor", "advising") == "true"
        training = self._told("adaptor", "training") == "true"
        waiting = self._told("twin", "waiting") not in ("", "0")
        unanswered = time.monotonic() - self._last_step_at > 2 * self.longest_wait + WAITED
        return diagnosing or advising or training or (waiting and not unanswered)

    def _told(self, role: str, key: str) -> str:
        """What a node told last under a key, "" when it did not."""
        return self.health[role].values.get(key, "") if role in self.health else ""

    def hear(self, told: NodeStatus) -> None:
        """Take note of what a node of the machine tells of itself."""
        self.health[told.role] = told
        self.statements[told.role] += 1
        for key in (WRONG_STREAM, LITTLE_ROOM):
            if words := told.values.get(key):
                self._warn(told.role, words)
        for kind in told.rejected.keys() - self._warned:
            self._warned.add(kind)
            self.on_warning(told.role, f"rejected a message on {told.last_rejection}")
        if told.role == "recorder":
            self._follow_recording(told)
        if told.role in SOURCES:
            # Its counter may begin anew; a source that is started again has sent none at first.
            self.last_experiment = told.number("experiment") or self.last_experiment
        if told.values.get(REFUSED) == str(self.last_experiment):
            self.last_step = self.last_experiment

    def _warn(self, role: str, words: str) -> None:
        """Tell what is wrong, once."""
        lasting = NUMBERS.sub("", words)
        if lasting not in self._warned:
            self._warned.add(lasting)
            self.on_warning(role, words)

    def _follow_recording(self, told: NodeStatus) -> None:
        """Tell at once that nothing is recorded any more, and later that it goes on."""
        now = time.monotonic()
        if words := told.values.get(WRONG_RECORDING):
            if self._unwritten_at is None:
                self.on_warning(told.role, words)
            self._unwritten_at = now
        elif self._unwritten_at is not None and now - self._unwritten_at > WELL_AGAIN:
            self._unwritten_at = None
            self.on_warning(told.role, "the recording goes on, in a new file")

    def _on_signal(self, message: Any) -> None:
        with contextlib.suppress(LdtError):  # the nodes count it
            signal = from_message("signal", message)
            self.last_signal = signal.experiment
            adaptation = self._early.pop(signal.experiment, None)
            if adaptation is not None:
                self.on_step(signal, adaptation)
                return
            self._signals[signal.experiment] = signal
            forget_oldest(self._signals, CAPACITY)

    def _on_adaptation(self, message: Any) -> None:
        with contextlib.suppress(LdtError):
            adaptation = from_message("adaptation", message)
            self.answered.add(adaptation.experiment)
            about = adaptation.experiment, stamp_of(message)
            if about in self._adapted:
                return  # an adaptor that was started again says once more what it said
            self._adapted[about] = None
            forget_oldest(self._adapted, CAPACITY)
            self._last_step_at = time.monotonic()
            self.first_step_at = self.first_step_at or self._last_step_at
            self.last_step = adaptation.experiment
            signal = self._signals.pop(adaptation.experiment, None)
            if signal is not None:
                self.on_step(signal, adaptation)
                return
            self._early[adaptation.experiment] = adaptation
            forget_oldest(self._early, CAPACITY)
