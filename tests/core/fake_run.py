"""A recorded run of made-up experiments, for tests of what is shown of one."""

from __future__ import annotations

from pathlib import Path

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
from ldt_core.recording.writer import BagWriter

START = 1.7e9
PERIOD = 0.01


def fake_run(
    path: Path,
    numbers=range(1, 7),
    length: int = 60,
    words: str = "",
    deviation: bool = True,
    unpredicted=(),
    machine: str = "rig",
    state: str = "",
    adequacy: float | None = None,
) -> Path:
    """Write a run in which the error of experiment n is 1 + (7 n mod 11) rad/s, at its middle.

    Args:
        path: folder of the recording.
        numbers: of the experiments.
        length: samples of each.
        words: put into every text that a recording can hold.
        deviation: whether the model tells how sure it is.
        unpredicted: numbers that are recorded, but not predicted.
        machine: its name.
        state: of machine and model in every signal.
        adequacy: error over the noise in every signal.
    """
    with BagWriter(path, machine + words) as bag:
        bag.write("model", ModelRecord(0, f"kind{words}", (), {"machine": {f"J{words}": 0.02}}), 0)
        for number in numbers:
            random = np.random.default_rng(number)
            start = START + number * length * PERIOD
            voltage = random.uniform(6, 16, length)
            speed = 30 + random.normal(0, 0.1, length)
            one = Experiment(number, start, PERIOD, voltage, speed)
            bag.write("experiment", one, one.end)
            if number in unpredicted:
                continue
            error = 1.0 + 7 * number % 11
            predicted = speed.copy()
            predicted[length // 2] -= error
            std = np.full(length, 0.1) if deviation else None
            shared = (number, start, PERIOD)
            bag.write("prediction", Prediction(*shared, number % 3, predicted, std), one.end)
            bag.write("original_prediction", Prediction(*shared, 0, speed + 12), one.end)
            positive = number % 3 == 0
            level = Level.POSITIVE if positive else Level.NEGATIVE
            limits = {"warning_limit": 3.0, "drift_limit": 6.0, f"more{words}": 1.0}
            judged = (state, adequacy)
            signal = Signal(number, level, f"own{words}", number % 3, error, limits, *judged)
            bag.write("signal", signal, one.end)
            if positive:
                record = ModelRecord(number, f"kind{words}", (number,), {})
                bag.write("model", record, one.end)
                values = {"verdict.kind": "effect", "verdict.sentence": f"it is{words}"}
                verdict = DiagnosisRecord(number, 0, f"it is{words}", ("unbalance",), values)
                bag.write("diagnosis", verdict, one.end)
            action = Action.ADAPTED if positive else Action.KEPT
            bag.write("adaptation", Adaptation(number, action, number, f"since{words}"), one.end)
    return path
