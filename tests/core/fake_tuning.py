"""A machine whose speed is a level and noise, and a model that learns the level: a known answer."""

from __future__ import annotations

import numpy as np

from ldt_core.base.experiment import Experiment, Prediction
from ldt_core.models.base import Model

NOISE = 0.1  # rad/s
SAMPLES = 100
#: Numbers of the experiments in which the level rises by 1 rad/s.
STEPS = (21, 31, 41, 51)


class Level(Model):
    """Predicts the mean speed of the last experiment learned from."""

    kind = "level"
    adaptive = True

    def untrained(self):
        return {"level": 0.0}

    def build(self):
        self.level = float(self.parameters["level"])

    def predict(self, experiment):
        speed = np.full(len(experiment), self.level)
        return Prediction(
            experiment.number, experiment.start, experiment.period, self.version, speed
        )

    def fit(self, experiments):
        level = float(np.mean(experiments[-1].speed))
        return self.successor({"level": level}, experiments)


def recording(steps=STEPS, count=60, seed=0, size=1.0) -> list[Experiment]:
    """Experiments whose level has risen by `size` at each of the steps."""
    rng = np.random.default_rng(seed)
    found = []
    for number in range(1, count + 1):
        level = size * sum(number >= s for s in steps)
        speed = level + NOISE * rng.standard_normal(SAMPLES)
        found.append(Experiment(number, 10.0 * number, 0.01, np.full(SAMPLES, 5.0), speed))
    return found
