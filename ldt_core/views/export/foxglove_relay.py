"""The topics of a graph or a recording for Foxglove and Lichtblick, over their WebSocket protocol.

It takes the place of a page's `Fleet`: a source of records feeds it. Samples of an experiment are
sent as messages of their own (`sample_messages`); of a recording as time goes on, of a running
graph when the experiment and its predictions have come. A machine that streams has its speed sent
on at once.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any

from ldt_core.base.errors import BadInput, LdtError
from ldt_core.base.experiment import Experiment, Prediction, Signal
from ldt_core.recording.codec import DECODERS, Record, encode
from ldt_core.recording.messages import schema, serialize, standard
from ldt_core.recording.node_status import HEALTH_TOPIC
from ldt_core.recording.status_messages import stamped_ns
from ldt_core.views.export.predicted_runs import PredictedRun
from ldt_core.views.export.sample_messages import (
    KIND,
    SampleMessage,
    sample_messages,
    speed_message,
)
from ldt_core.views.watch.fleet import Fleet

try:
    import foxglove
except ImportError as error:
    raise LdtError(
        "ldt serve needs the library foxglove-sdk, which is not installed: "
        "pip install 'ldt[foxglove]'"
    ) from error

BACKLOG = 16_384  # messages that wait for a slow client: four experiments of 2000 samples
#: Topics of samples that every machine has.
SAMPLED = ("joint_states", "voltage")
#: For the predictions of an experiment that has come [s]; one that a busy twin makes later is sent
#: as a message, and its curve is lacking.
PATIENCE = 5.0
MOST_WAITING = 16  # experiments of a machine; a twin that is busy is so far behind for a while
CLOSING = 1.0  # s that the end waits for connections that are still being opened
STEP = 0.05  # s between two sends of samples, faster than a screen shows


class FoxgloveRelay(Fleet):
    """Sends what it is fed to all clients.

    Args:
        live: whether records are of this day; of a recording they have its times.

    Raises:
        BadInput: the address cannot be bound to.
    """

    def __init__(self, live: bool, host: str, port: int, name: str) -> None:
        super().__init__(live)
        self._channels: dict[str, Any] = {}
        self._names: dict[str, str] = {}
        self._present: dict[str, PredictedRun] = {}
        self._streams: dict[str, Iterator[SampleMessage]] = {}
        self._next: dict[str, SampleMessage] = {}
        #: Of a running graph: machine → number → the experiment, and when it came.
        self._waiting: dict[str, dict[int, tuple[PredictedRun, float]]] = {}
        self._early: dict[str, deque[tuple[str, Prediction]]] = {}
        self._streaming: set[str] = set()  # machines whose speed comes sample by sample
        # It tells of each slip of a client, which is nobody's to read about here.
        foxglove.set_log_level("CRITICAL")
        self._context = foxglove.Context()
        try:
            self._server = foxglove.start_server(
                name=name,
                host=host,
                port=port,
                context=self._context,
                message_backlog_size=BACKLOG,
            )
        except Exception as error:
            raise BadInput(f"{host}:{port}", "a free address (--host, --port)", error) from None

    @property
    def port(self) -> int:
        """That it serves at."""
        return int(self._server.port)

    def stop(self) -> None:
        """End the server; whoever has connected and says nothing is not waited for."""
        end = threading.Thread(target=self._server.stop, daemon=True)
        end.start()
        end.join(CLOSING)

    def reset(self) -> None:
        """As `Fleet.reset`; clients forget what they were sent."""
        super().reset()
        self._streams.clear()
        self._next.clear()
        self._server.clear_session()

    def expect(self, namespace: str, name: str = "") -> None:
        """As `Fleet.expect`; clients are told of the machine's topics at once."""
        self._names[namespace] = name or self._names.get(namespace, "")
        super().expect(namespace, name)
        for topic, (kind, _) in DECODERS.items():
            self._channel(_absolute(namespace, topic), kind)
        for topic in SAMPLED:
            self._channel(_absolute(namespace, topic), KIND)

    def feed(self, namespace: str, topic: str, record: Any) -> None:
        """Send a record; as `Fleet.feed`, which counts."""
        super().feed(namespace, topic, record)
        if topic == HEALTH_TOPIC:
            self._send(HEALTH_TOPIC, "diagnostic_msgs/msg/DiagnosticArray", _health(record), None)
            return
        if not isinstance(record, Record):
            return
        moment = self._moment(namespace, record)
        message = encode(record, machine=self._names.get(namespace, ""), time=moment or 0.0)
        self._send(_absolute(namespace, topic), message.__msgtype__, serialize(message), moment)
        if self.live:
            self._wait(namespace, topic, record)
            return
        run = self._present.get(namespace)
        if isinstance(record, Experiment):
            self._flush(namespace)
            self._present[namespace] = PredictedRun(record)
            self._begin(namespace)
        elif run is not None and isinstance(record, Prediction) and run.fits(record):
            self._present[namespace] = run.beside(topic, record)
            self._begin(namespace)
        elif isinstance(record, Signal):
            self._flush(namespace)

    def _wait(self, namespace: str, topic: str, record: Record) -> None:
        """An experiment waits for its predictions; those before it are sent before it."""
        with self._lock:
            waiting = self._waiting.setdefault(namespace, {})
            early = self._early.setdefault(namespace, deque(maxlen=2 * MOST_WAITING))
            if isinstance(record, Experiment):
                waiting[record.number] = PredictedRun(record), self._clock()
                told = [(t, p) for t, p in early if p.number == record.number]
            elif isinstance(record, Prediction):
                told = [(topic, record)]
                if record.number not in waiting:  # no order is promised between topics
                    early.append((topic, record))
            else:
                told = []
            for name, prediction in told:
                run, came = waiting.get(prediction.number, (None, 0.0))
                if run is not None and run.fits(prediction):
                    waiting[prediction.number] = run.beside(name, prediction), came
            self._send_waiting(namespace)

    def _send_waiting(self, namespace: str) -> None:
        name, streamed = self._names.get(namespace, ""), namespace in self._streaming
        waiting = self._waiting[namespace]
        for number, (run, came) in list(waiting.items()):
            late = self._clock() - came > PATIENCE
            if not (run.predicted or late or len(waiting) > MOST_WAITING):
                return
            del waiting[number]
            for message in sample_messages(run, name, streamed):
                topic = _absolute(namespace, message.topic)
                self._send(topic, KIND, message.data, message.time_ns / 1e9)

    def sample(self, namespace: str, moment: float, speed: float) -> None:
        """Send a sample that a machine streams; as `Fleet.sample`, which counts."""
        super().sample(namespace, moment, speed)
        self._streaming.add(namespace)
        message = speed_message(self._names.get(namespace, ""), moment, speed)
        self._send(_absolute(namespace, message.topic), KIND, message.data, moment)

    def play(self, elapsed: Callable[[], float | None], stop: threading.Event) -> None:
        """Send samples as time goes on, until told to stop.

        Args:
            elapsed: recorded time since the present experiment began [s]; None where all that is
                there is to be sent at once.
        """
        while not stop.wait(STEP):
            with self._lock:
                for namespace in list(self._streams):
                    limit = elapsed()
                    begin = self._present[namespace].experiment.start
                    self._flush(namespace, None if limit is None else begin + limit)
                for namespace in self._waiting:
                    self._send_waiting(namespace)

    def _begin(self, namespace: str) -> None:
        """Samples from now on with what is known of them; those sent stay sent."""
        with self._lock:
            sent = self._next.get(namespace)
            begin = sent.time_ns if sent and namespace in self._streams else None
            stream = sample_messages(self._present[namespace], self._names.get(namespace, ""))
            self._streams[namespace] = stream
            ahead = (m for m in stream if begin is None or m.time_ns >= begin)
            self._streams[namespace] = ahead
            self._advance(namespace)

    def _advance(self, namespace: str) -> None:
        following = next(self._streams[namespace], None)
        if following is None:
            del self._streams[namespace]
            self._next.pop(namespace, None)
        else:
            self._next[namespace] = following

    def _flush(self, namespace: str, until: float | None = None) -> None:
        """Send the samples up to a recorded time [s], or all."""
        with self._lock:
            while namespace in self._streams:
                message = self._next[namespace]
                if until is not None and message.time_ns > until * 1e9:
                    return
                topic = _absolute(namespace, message.topic)
                self._send(topic, KIND, message.data, message.time_ns / 1e9)
                self._advance(namespace)

    def _moment(self, namespace: str, record: Any) -> float | None:
        """When a record was made: at the end of its experiment, which is the present one."""
        run = self._present.get(namespace)
        if isinstance(record, Experiment):
            return record.end
        return run.experiment.end if run else None

    def _send(self, topic: str, kind: str, data: bytes, moment: float | None) -> None:
        channel = self._channel(topic, kind)
        channel.log(data, log_time=None if moment is None else stamped_ns(moment))

    def _channel(self, topic: str, kind: str) -> Any:
        if topic not in self._channels:
            text = schema(kind)[0].encode()
            described = foxglove.Schema(name=kind, encoding="ros2msg", data=text)
            self._channels[topic] = foxglove.Channel(
                topic, schema=described, message_encoding="cdr", context=self._context
            )
        return self._channels[topic]


def _absolute(namespace: str, topic: str) -> str:
    """Its name, below the machine's namespace."""
    return f"/{namespace.strip('/')}/{topic}".replace("//", "/")


def _health(message: Any) -> bytes:
    """A message of `/diagnostics`, of ROS or of a recording, in CDR."""
    make = standard()
    stamp = message.header.stamp
    made = make.DiagnosticArray(
        header=make.Header(
            stamp=make.Time(sec=int(stamp.sec), nanosec=int(stamp.nanosec)),
            frame_id=str(message.header.frame_id),
        ),
        status=[
            make.DiagnosticStatus(
                level=s.level[0] if isinstance(s.level, bytes) else int(s.level),
                name=str(s.name),
                message=str(s.message),
                hardware_id=str(s.hardware_id),
                values=[make.KeyValue(key=str(v.key), value=str(v.value)) for v in s.values],
            )
            for s in message.status
        ],
    )
    return serialize(made)
