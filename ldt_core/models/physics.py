"""The physics, never adapted: the baseline "original" of the paper, or with effects added."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self

from ldt_core.base.errors import LdtError, did_you_mean
from ldt_core.base.experiment import Experiment, Prediction
from ldt_core.estimation.start_at_rest import first_current
from ldt_core.models.base import Model


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
        """Free run from the first measured speed (and current, where there is one).

        Raises:
            LdtError: the simulated state grows without bound.
        """
        current = first_current(experiment)
        about, acting = (experiment.voltage, experiment.period), self.effects
        values = self.values
        for effect, given in acting:
            values = effect.change_parameters(self.physics, values, given)
        first = self.physics.behind_sensor(
            experiment.speed, experiment.period, acting, self.values
        )[0]
        initial = self.physics.initial_state(values, float(first), current)
        states = self.physics.simulate(self.values, *about, initial, acting)
        speed = self.physics.measure(states, experiment.period, acting, self.values)
        return Prediction(
            experiment.number, experiment.start, experiment.period, self.version, speed
        )

    def fit(self, experiments: Sequence[Experiment]) -> Self:
        """Refused with an LdtError: this model stays what the machine file says."""
        raise LdtError("the model 'physics' does not learn: it is the machine file's equations")
