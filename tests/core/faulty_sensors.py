"""Experiments of the short rotor, and what faulty sensors make of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ldt_core.base.experiment import Experiment
from ldt_core.base.settings import resolve
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import Machine, load_machine

SHORT = replace(load_machine("rotor"), duration=4.0)
WORN = ("unbalance:e=0.004",)


def made(
    count: int, seed: int = 3, effects: Sequence[str] = WORN, machine: Machine = SHORT, **given
) -> list[Experiment]:
    """Experiments as they were; the machine does not change."""
    plan = {"experiments": count, "seed": seed, "start_time": 1e9, "degradation": "none"}
    plant = Plant.from_settings(machine, resolve({**plan, "effect": list(effects), **given}))
    return [plant.experiment(number) for number in range(1, count + 1)]


def shown(experiment: Experiment, speed) -> Experiment:
    """The experiment with another speed."""
    return replace(experiment, speed=speed)


def _random(experiment):
    return np.random.default_rng([77, experiment.number])


def sticks(e):
    """At what it showed after a third of the time."""
    at = len(e) // 3
    return shown(e, np.where(np.arange(len(e)) < at, e.speed, e.speed[at]))


def stuck(e):
    return shown(e, np.full(len(e), 31.4))


def dead(e):
    return shown(e, np.zeros(len(e)))


def saturates(e):
    return shown(e, np.minimum(e.speed, 25.0))


def steps(e):
    return shown(e, e.speed + np.where(np.arange(len(e)) < len(e) // 2, 0.0, 20.0))


def spikes(e):
    random, speed = _random(e), e.speed.copy()
    speed[random.choice(len(e), 10, replace=False)] += random.choice([-60.0, 60.0], 10)
    return shown(e, speed)


def drops_out(e):
    """One sample in twenty is lost, and shown as 0."""
    return shown(e, np.where(_random(e).random(len(e)) < 0.05, 0.0, e.speed))


def every_other(e):
    return shown(e, np.where(np.arange(len(e)) % 2, e.speed, 0.0))


def garbage(e):
    return shown(e, _random(e).uniform(-200.0, 200.0, len(e)))


#: What breaks a measurement → what is said of it.
FAULTS = {
    sticks: "sensor that sticks",
    stuck: "sensor that sticks",
    dead: "sensor that is dead, or a blocked rotor",
    saturates: "saturates",
    steps: "within one sample",
    spikes: "within one sample",
    drops_out: "drops out",
    every_other: "drops out",
    garbage: "faulty sensor",
}


def broken(experiments, fault, first, last):
    """The experiments, those from first to last as a faulty sensor shows them."""
    return [fault(e) if first <= e.number <= last else e for e in experiments]
