"""A motor on a test bench with imperfect sensors, supply and load, and the default twin beside it.

    python -m tests.bench_faults [SEED...]

writes the table of the page `ldt docs streams`. The engine is that of `foreign_causes`; the machine
file is exact, but knows of no fault. The motor changes half-way.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

import ldt_core as ldt
from tests.foreign_causes import PERIOD, TRUE, integrated, motor
from tests.motors import motor_file
from tests.page_table import write_table

Array = np.ndarray
EXPERIMENTS, SAMPLES, NOISE = 32, 400, 0.1  # , , rad/s
LINES, FILTER, RIPPLE = 2000, 0.03, 0.01  # of an encoder; s; of a tachometer, of the speed
SPIKE, OFTEN, JITTER = 8.0, 0.005, 1e-3  # rad/s, of the samples, s
VOLTAGE_STEP, VOLTAGE_NOISE, SAG = 0.5, 0.1, 0.03  # V, V, of the supply
LOAD, MEMORY = 5e-4, 0.98  # N m of each sample, of which so much is left in the next one


class Recorded(NamedTuple):
    """(experiments, samples) voltage [V] and speed [rad/s]."""

    voltage: Array
    speed: Array


class Moved(NamedTuple):
    """What really happened: the same shapes, and the shaft's angle [rad]."""

    voltage: Array
    angle: Array
    speed: Array


def _white(random: Any, moved: Moved) -> Recorded:
    return Recorded(moved.voltage, moved.speed + NOISE * random.standard_normal(moved.speed.shape))


def _filtered(random: Any, moved: Moved) -> Recorded:
    speed, kept = moved.speed.copy(), np.exp(-PERIOD / FILTER)
    for i in range(1, speed.shape[1]):
        speed[:, i] = kept * speed[:, i - 1] + (1 - kept) * speed[:, i]
    return _white(random, moved._replace(speed=speed))


def _encoder(random: Any, moved: Moved) -> Recorded:
    step = 2 * np.pi / LINES
    count = np.floor(moved.angle / step + random.random((len(moved.angle), 1)))
    return Recorded(moved.voltage, np.diff(count, axis=1, prepend=count[:, :1]) * step / PERIOD)


def _tachometer(random: Any, moved: Moved) -> Recorded:
    return _white(
        random, moved._replace(speed=moved.speed * (1 + RIPPLE * np.sin(2 * moved.angle)))
    )


def _spikes(random: Any, moved: Moved) -> Recorded:
    hit = (random.random(moved.speed.shape) < OFTEN) * random.choice(
        [-SPIKE, SPIKE], moved.speed.shape
    )
    return _white(random, moved._replace(speed=moved.speed + hit))


def _jitter(random: Any, moved: Moved) -> Recorded:
    time = np.arange(moved.speed.shape[1]) * PERIOD
    rows = [np.interp(time + random.normal(0, JITTER, time.size), time, row) for row in moved.speed]
    return _white(random, moved._replace(speed=np.array(rows)))


def _voltage_steps(random: Any, moved: Moved) -> Recorded:
    shown = np.round(moved.voltage / VOLTAGE_STEP) * VOLTAGE_STEP
    return _white(random, moved._replace(voltage=shown))


def _voltage_noise(random: Any, moved: Moved) -> Recorded:
    noise = VOLTAGE_NOISE * random.standard_normal(moved.voltage.shape)
    return _white(random, moved._replace(voltage=moved.voltage + noise))


#: Name to (words, what is recorded of what happened).
FAULTS: Mapping[str, tuple[str, Callable[[Any, Moved], Recorded]]] = {
    "none": ("white noise of 0.1 rad/s, here and below", _white),
    "filter": ("the sensor has a digital filter of 30 ms", _filtered),
    "encoder": ("an encoder of 2000 lines, differentiated", _encoder),
    "tachometer": ("a ripple of 1 % of the speed, twice a turn", _tachometer),
    "spikes": ("0.5 % of the samples are 8 rad/s off", _spikes),
    "jitter": ("sample times are 1 ms off", _jitter),
    "voltage_steps": ("the voltage is recorded in steps of 0.5 V", _voltage_steps),
    "voltage_noise": ("the voltage is recorded with a noise of 0.1 V", _voltage_noise),
    "late": ("the drive gives each voltage one sample later", _white),
    "sags": ("the supply sags by up to 3 % in each experiment", _white),
    "load": ("a torque that wanders, and forgets in half a second", _white),
}


def _dry(part: Array, y: Array) -> Array:
    return -0.02 * part * np.tanh(y[1] / 0.2)


#: Name to (words, how far it has gone in each experiment, its torque).
CHANGES: Mapping[str, tuple[str, Callable[[Array], Array], Callable[[Array, Array], Array]]] = {
    "dry": ("dry friction begins", lambda i: 1.0 * (i > 0), _dry),
    "fan": ("a fan", lambda i: 1.0 * (i > 0), lambda part, y: -2e-6 * part * y[1] * np.abs(y[1])),
    "gravity": ("gravity", lambda i: 1.0 * (i > 0), lambda part, y: -0.03 * part * np.sin(y[0])),
    "wear": ("friction grows in each experiment", lambda i: 0.1 * np.maximum(i, 0), _dry),
    "again": ("friction comes and goes", lambda i: 1.0 * (i // 4 % 2), _dry),
    "cubic": (
        "a drag that no law has",
        lambda i: 1.0 * (i > 0),
        lambda p, y: -2e-8 * p * y[1] ** 3,
    ),
}


def motor_on_a_bench() -> ldt.Machine:
    """Its file."""
    return motor_file(TRUE, SAMPLES, PERIOD)


def experiments(fault: str, change: str, seed: int) -> list[ldt.Experiment]:
    """What the twin sees."""
    random = np.random.default_rng(seed)
    time = np.arange(SAMPLES) / SAMPLES
    kinds = [
        lambda: np.repeat(random.uniform(-12, 12, 10), SAMPLES // 10),
        lambda: np.repeat(random.uniform(2, 12, 10), SAMPLES // 10),
        lambda: random.uniform(6, 12) * np.sin(2 * np.pi * time * random.uniform(2, 6)),
    ]
    u = np.array([kinds[random.integers(3)]() for _ in range(EXPERIMENTS)])
    applied = u.copy()
    if fault == "late":
        applied = np.concatenate([0 * u[:, :1], u[:, :-1]], axis=1)
    if fault == "sags":
        applied *= random.uniform(1 - SAG, 1, (EXPERIMENTS, 1))
    wander = np.zeros(u.shape)
    if fault == "load":
        for i in range(1, SAMPLES):
            wander[:, i] = MEMORY * wander[:, i - 1] + LOAD * random.standard_normal(EXPERIMENTS)
    _, gone, torque = CHANGES[change]
    part = gone(np.arange(1, EXPERIMENTS + 1) - EXPERIMENTS // 2)

    def rate(t: float, y: Array, v: Array) -> Array:
        beside = wander[:, min(int(t / PERIOD + 1e-9), SAMPLES - 1)]
        return motor(y, v, torque(part, y) + beside)

    angle, speed, _ = integrated(rate, 0, applied)
    shown = FAULTS[fault][1](random, Moved(u, angle, speed))
    rows = zip(*shown, strict=True)
    return [ldt.Experiment(k + 1, 10.0 * k, PERIOD, *row) for k, row in enumerate(rows)]


def after_the_change(fault: str, change: str, seed: int) -> tuple[float, float]:
    """Mean largest errors of the default twin and of the original, from the second one on."""
    run = ldt.run(experiments(fault, change, seed), motor_on_a_bench())
    late = run.steps[EXPERIMENTS // 2 + 1 :]
    twin = np.mean([s.signal.max_error for s in late])
    return float(twin), float(np.mean([s.original.max_error(s.experiment) for s in late]))


def table(seeds: list[int]) -> str:
    """Markdown: what is left of the original's error, in percent, over all seeds."""
    lines = ["| | " + " | ".join(words for words, *_ in CHANGES.values()) + " |"]
    lines.append("|---" * (len(CHANGES) + 1) + "|")
    for fault, (words, _) in FAULTS.items():
        row = []
        for change in CHANGES:
            twin, original = np.sum([after_the_change(fault, change, s) for s in seeds], axis=0)
            row.append(f"{100 * twin / original:.0f} %")
            print(fault, change, row[-1], flush=True)
        lines.append(f"| {words} | " + " | ".join(row) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    write_table("streams", table([int(s) for s in sys.argv[1:]] or [1]), "bench")
