"""The remainder model: the physics found so far, and what it leaves, with memory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Self

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment, Prediction
from ldt_core.base.threads import one_thread
from ldt_core.estimation.motor_run import MotorRun
from ldt_core.estimation.remainder import LearnedRemainder, fit_remainder
from ldt_core.estimation.remainder_run import CurveNodes, RemainderShape, free_run
from ldt_core.models.base import Model
from ldt_core.models.grey_box import GreyBoxModel
from ldt_core.models.hybrid import HybridModel

#: Directions in which the weights are least known, along which a prediction is spread out.
DIRECTIONS = 10


class RemainderModel(Model):
    """Free run of the ideal motor, driven by an acceleration that is learned.

    Effects in the machine file, and those of a grey-box model that it stands `on`, add what they do
    to the free run of the motor alone; the acceleration is learned from what they leave. It depends
    on speed, current and what they were before, see `estimation.remainder_run`.

    `parameters`: `machine`, the physics parameters; `effects`, name → parameter → value, of those
    found to act beside the file's; `remainder`, None or a mapping of `speed` and `current` (first
    node, distance and count of each curve), `plays` [rad/s], `lags` [s], `span` [rad/s], `weights`
    and `directions` [rad/s²], and `noise_std` [rad/s].

    Args: those of `Model`.

    Raises:
        ModelError: parameters that cannot be this model's.
    """

    kind = "remainder"

    def untrained(self) -> dict[str, Any]:
        """The machine file's physics, and nothing beside."""
        return {"machine": dict(self.machine.parameters), "effects": {}, "remainder": None}

    def build(self) -> None:
        """Check the parameters."""
        physics = {name: self.parameters[name] for name in ("machine", "effects")}
        #: The motor, and what the effects do to it.
        self.base = HybridModel(self.machine, {**physics, "gaussian_process": None})
        record = self.parameters["remainder"]
        self.learned = None if record is None else _from_json(record)

    def predict(self, experiment: Experiment) -> Prediction:
        """Free run from the first measured speed (and current, where there is one).

        `speed_std` is the noise, and what the least known directions make of it; None untrained.
        A run that leaves the speeds that it was learned from by more than a quarter of their range
        is the physics' alone, as uncertain as the two are apart.

        Raises:
            LdtError: the simulated speed grows without bound.
        """
        about = (experiment.number, experiment.start, experiment.period, self.version)
        learned = self.learned
        if learned is None:
            return Prediction(*about, self.base.predict(experiment).speed)
        known = self.base.known_effects(experiment)
        guess = self._drive(experiment, known)

        def begun(more: float) -> MotorRun:
            return guess._replace(current=guess.current + more)

        def speed_from(more: float) -> Array:
            return free_run(learned.shape, learned.weights, begun(more))[0] + known

        run = begun(self.base.physics.told_current(experiment, speed_from))
        speed, _ = free_run(learned.shape, learned.weights, run)
        variance = np.full(speed.size, learned.noise_std**2)
        if not learned.shape.knows(speed):  # it has left all that it was learned from
            alone = self.base.predict(experiment).speed
            return Prediction(*about, alone, np.sqrt(variance + (speed + known - alone) ** 2))
        for direction in learned.directions:
            other, _ = free_run(learned.shape, learned.weights + direction, run)
            variance += (other - speed) ** 2
        return Prediction(*about, speed + known, np.sqrt(variance))

    def fit(self, experiments: Sequence[Experiment]) -> Self:
        """Learn the acceleration from these experiments; the physics stays as it is.

        Raises:
            LdtError: no or too few samples, a machine that stood still, or absurd values.
        """
        return self.fit_without(experiments, [slice(0, 0)] * len(experiments))

    def fit_without(self, experiments: Sequence[Experiment], held: Sequence[slice]) -> Self:
        """As `fit`, running through the blocks held back without looking at them."""
        if not experiments:
            raise LdtError("remainder model: expected experiments to learn from, got none")
        runs = [self._drive(e, self.base.known_effects(e)) for e in experiments]
        with one_thread():
            found = fit_remainder(runs, DIRECTIONS, held)
        return self.successor({**self.parameters, "remainder": _to_json(found)}, experiments)

    def on(self, found: GreyBoxModel) -> Self:
        """The same, untrained, on the physics that a grey-box model has found."""
        physics = {name: found.parameters[name] for name in ("machine", "effects")}
        return self.successor({**physics, "remainder": None}, ())

    def _drive(self, experiment: Experiment, known: Array) -> MotorRun:
        matrices = self.base.motor(experiment.period)
        speed = experiment.speed - known
        current = float(self.base.start(experiment)[0])
        return MotorRun(*matrices, experiment.period, experiment.voltage, speed, current)


def _to_json(found: LearnedRemainder) -> dict[str, Any]:
    shape = found.shape
    return {
        "speed": list(shape.speed),
        "current": list(shape.current),
        "plays": shape.plays.tolist(),
        "lags": shape.lags.tolist(),
        "span": shape.span,
        "weights": found.weights.tolist(),
        "directions": found.directions.tolist(),
        "noise_std": found.noise_std,
    }


def _from_json(record: Mapping[str, Any]) -> LearnedRemainder:
    axes = []
    for low, step, count in (record["speed"], record["current"]):
        if not (step > 0 and type(count) is int and count > 1):
            raise ValueError(f"{count} nodes at a distance of {step}")
        axes.append(CurveNodes(float(low), float(step), count))
    plays, lags = (np.array(record[n], dtype=np.float64) for n in ("plays", "lags"))
    sizes = [*plays, *lags, float(record["span"])]
    noise = float(record["noise_std"])
    if min(sizes) <= 0 or noise < 0:
        raise ValueError(f"widths, times and span {sizes}, noise_std {noise}")
    shape = RemainderShape(axes[0], axes[1], plays, lags, float(record["span"]))
    weights = np.array(record["weights"], dtype=np.float64)
    directions = np.array(record["directions"], dtype=np.float64).reshape(-1, shape.size)
    stated = [*axes[0], *axes[1], *sizes, noise, *weights, *directions.ravel()]
    if not np.isfinite(stated).all():  # JSON's null, too: compiled code looks nothing up by it
        raise ValueError("a number that is not finite")
    if weights.shape != (shape.size,):
        raise ValueError(f"{weights.size} weights of {shape.size}")
    return LearnedRemainder(shape, weights, directions, noise)
