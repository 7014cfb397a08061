"""Records of machines as a page is fed them."""

from __future__ import annotations

from typing import Any

import numpy as np

from ldt_core.base.experiment import (
    Action,
    Adaptation,
    DiagnosisRecord,
    Experiment,
    Level,
    ModelRecord,
    Prediction,
    Signal,
)
from ldt_core.recording.messages import standard
from ldt_core.views.watch.fleet import Fleet

PERIOD, LENGTH, START = 0.01, 60, 1.7e9
HOSTILE = "</script><img src=x onerror=alert(1)>\"' {{ 7*7 }} <!-- \u2028"


def measured(number: int, start: float | None = None, length: int = LENGTH) -> Experiment:
    """Experiment of this number."""
    when = START + number * length * PERIOD if start is None else start
    speed = 30 + np.random.default_rng(number).normal(0, 0.1, length)
    return Experiment(number, when, PERIOD, np.full(length, 9.0), speed)


def predicted(experiment: Experiment, error: float, version: int = 0) -> Prediction:
    """Off by the error at one sample."""
    speed = experiment.speed.copy()
    speed[len(speed) // 2] -= error
    std = np.full(len(speed), 0.2)
    shared = (experiment.number, experiment.start, experiment.period)
    return Prediction(*shared, version, speed, std)


def feed(
    fleet: Fleet,
    namespace: str,
    number: int,
    error: float = 1.0,
    level: Level = Level.NEGATIVE,
    words: str = "",
    state: str = "",
    adequacy: float | None = None,
    **times: Any,
) -> None:
    """A whole turn of the loop."""
    experiment = measured(number, **times)
    fleet.feed(namespace, "experiment", experiment)
    fleet.feed(namespace, "prediction", predicted(experiment, error))
    fleet.feed(namespace, "original_prediction", predicted(experiment, 2 * error))
    limits = {"warning_limit": 3.0, "drift_limit": 6.0}
    detector = f"threshold{words}"
    signal = Signal(number, level, detector, 0, error, limits, state, adequacy)
    fleet.feed(namespace, "signal", signal)
    action = Action.ADAPTED if level is Level.POSITIVE else Action.KEPT
    if action is Action.ADAPTED:
        fleet.feed(namespace, "model", ModelRecord(number, f"kind{words}", (number,), {}))
        verdict = {"verdict.kind": "effect"}
        sentence = f"It is unbalance{words}."
        record = DiagnosisRecord(number, 0, sentence, ("unbalance",), verdict)
        fleet.feed(namespace, "diagnosis", record)
    version = number if action is Action.ADAPTED else 0
    fleet.feed(namespace, "adaptation", Adaptation(number, action, version, f"since{words}"))


def health(name: str, machine: str = "rig", message: str = "running", **values: str) -> Any:
    """A message of `/diagnostics` with the status of one node."""
    make = standard()
    told = {"ready": "true", "finished": "false", **values}
    pairs = [make.KeyValue(key=k.replace("_", " "), value=v) for k, v in told.items()]
    warns = message != "running"
    status = make.DiagnosticStatus(
        level=make.level(int(warns)), name=name, message=message, hardware_id=machine, values=pairs
    )
    stamp = make.Time(sec=1, nanosec=0)
    return make.DiagnosticArray(header=make.Header(stamp=stamp, frame_id=""), status=[status])
