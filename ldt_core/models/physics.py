"""The physics, never adapted: the baseline "original" of the paper, or with effects added."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, Self

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError, did_you_mean
from ldt_core.base.experiment import Experiment, Prediction
from ldt_core.estimation.free_run_start import first_current, told_current
from ldt_core.models.base import Model
from ldt_core.physics.base import CURRENT


class PhysicsModel(Model):
    """Free run of the machine file's equations, and of effects if any are given.

    `parameters` is `{"machine": {name: value}}`, the physics parameters in SI units.

    Args:
        effects: (effect, all its values) that act, as an option of `Model`.
    """

    kind = "physics"
    adaptive = False

    def untrained(self) -> dict[str, Any]:
        """The machine file's parameters."""
        return {"machine": dict(self.machine.parameters)}

    def build(self) -> None:
        """Check the parameters against the physics."""
        self.physics = self.machine.model
        acting = self.options.get("effects", ())
        self.effects = [(effect.in_detail(given), given) for effect, given in acting]
        self.values = {n: float(v) for n, v in self.parameters["machine"].items()}
        known = {p.name: p for p in self.physics.parameters}
        for name in self.values:
            if name not in known:
                raise ValueError(f"parameter {name!r} is not {did_you_mean(name, known)}")
        for name, parameter in known.items():
            if not parameter.accepts(self.values[name]):
                raise ValueError(f"{name} = {self.values[name]:g} is not {parameter.range}")

    def predict(self, experiment: Experiment) -> Prediction:
        """Free run from the first measured speed and current; where nobody measured a current that
        flowed, from the one that the speed tells.

        Raises:
            LdtError: the simulated state grows without bound.
        """
        about = experiment.number, experiment.start, experiment.period, self.version
        return Prediction(*about, self.free_run(experiment, self.told_current(experiment)))

    def free_run(self, experiment: Experiment, beside: float = 0.0) -> Array:
        """(L,) speed from the first current that is guessed [rad/s], or so much beside it [A]."""
        period, acting = experiment.period, self.effects
        first = self.physics.behind_sensor(experiment.speed, period, acting, self.values)[0]
        current = first_current(experiment)
        changed = self.physics.changed(self.values, acting)
        state = self.physics.initial_state(changed, float(first), current)
        state[CURRENT] += beside
        states = self.physics.simulate(self.values, experiment.voltage, period, state, acting)
        return self.physics.measure(states, period, acting, self.values)

    def told_current(
        self, experiment: Experiment, run: Callable[[float], Array] | None = None
    ) -> float:
        """See `free_run_start.told_current`: of this machine's motor; None takes `free_run`."""
        own = functools.partial(self.free_run, experiment)
        motor = self.physics.folded(self.physics.changed(self.values, self.effects))
        return told_current(run or own, motor, experiment)

    def fit(self, experiments: Sequence[Experiment]) -> Self:
        """Refused with an LdtError: this model stays what the machine file says."""
        raise LdtError("the model 'physics' does not learn: it is the machine file's equations")
