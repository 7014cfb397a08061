"""The linear model of the paper, ẋ = A x + B u, ŷ = C x + D u + offset, and its re-learning."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Self

import numpy as np

from ldt_core.errors import OptionError
from ldt_core.experiment import Experiment, Prediction
from ldt_core.identification import StateSpace, identify
from ldt_core.identification.estimate import MOST_ORDER
from ldt_core.machine import Machine
from ldt_core.models.base import Model


class LinearModel(Model):
    """Free run of a continuous-time state space; the voltage is held between samples, exactly.

    Untrained it is the machine file's physics, for a rotor the motor without its eccentricity
    (e = 0). `fit` identifies a new one from the experiments alone (`ldt_core.identification`):
    stable, with an offset, and free in its physical meaning.

    `parameters`: `A` (n × n) [1/s], `B` (n), `C` (n), `D`, `offset` [rad/s], `order`, `noise_std`
    (standard deviation of the residual of the fit [rad/s], null when untrained), `fit_percent`
    (MATLAB's, null when untrained), `held_out` (order → error on samples left out [rad/s], when the
    order was chosen), `states` (names of the states, where they are physical).

    Args:
        order: number of states of the identified model, 0 to choose it on held-out samples.

    Raises:
        OptionError: an order that is none.
        ModelError: parameters that cannot be this model's.
    """

    kind = "linear"

    def __init__(
        self,
        machine: Machine,
        parameters: Mapping[str, Any] | None = None,
        version: int = 0,
        trained_on: Sequence[int] = (),
        *,
        order: int = 0,
    ) -> None:
        if int(order) != order or not 0 <= order <= MOST_ORDER:
            raise OptionError("order", f"a whole number from 0 to {MOST_ORDER}", repr(order))
        super().__init__(machine, parameters, version, trained_on, order=int(order))

    def untrained(self) -> dict[str, Any]:
        """The machine file's physics, linear: the motor."""
        A, B, C, D = self.machine.model.state_space(self.machine.parameters)
        motor = StateSpace(A, np.ravel(B), np.ravel(C), np.ravel(D)[0])
        return {**_plain(motor), "states": ["current", "speed"]}

    def build(self) -> None:
        """Check the matrices; refuse an unstable model, which no `fit` makes."""
        p = self.parameters
        self.state_space = StateSpace(p["A"], p["B"], p["C"], p["D"], p["offset"])
        if self.state_space.poles.real.max() >= 0:
            raise ValueError(f"an unstable A with poles {self.state_space.poles}")
        if p["order"] != self.state_space.order:
            raise ValueError(f"order {p['order']} and {self.state_space.order} states in A")
        noise = p["noise_std"]
        self.noise_std = None if noise is None else float(noise)
        if self.noise_std is not None and self.noise_std < 0:
            raise ValueError(f"noise_std {noise}")
        self.states = list(p.get("states", ()))

    def predict(self, experiment: Experiment) -> Prediction:
        """Free run over the voltage from the steady state whose output is the first speed.

        One speed does not determine n states. Steady running does, is exact for an experiment that
        begins at rest or settled, and is what the physics assumes as well. A measured first current
        is used where the current is a state (untrained).

        `speed_std` is the deviation of the residuals of the fit, the same at every sample; None
        when untrained.
        """
        start = self.state_space.equilibrium(
            float(experiment.speed[0]), float(experiment.voltage[0])
        )
        if experiment.current is not None and "current" in self.states:
            start[self.states.index("current")] = experiment.current[0]
        speed = self.state_space.simulate(experiment.voltage, experiment.period, start)
        std = None if self.noise_std is None else np.full(speed.size, self.noise_std)
        return Prediction(
            experiment.number, experiment.start, experiment.period, self.version, speed, std
        )

    def shaped_like(self, other: Self) -> Self:
        """The same model, with the order that `other` has."""
        order = other.state_space.order
        return type(self)(self.machine, self.parameters, self.version, self.trained_on, order=order)

    def fit(self, experiments: Sequence[Experiment]) -> Self:
        """Identified again from these experiments alone, version + 1.

        Raises:
            ExperimentError: no experiments, or of different sample periods.
            LdtError: the experiments do not determine a model; the sentence says why.
        """
        found = identify(experiments, self.options["order"])
        learned = {
            "noise_std": found.noise_std,
            "fit_percent": found.fit_percent,
            "held_out": {str(n): error for n, error in found.held_out.items()},
        }
        return self.successor({**_plain(found), **learned}, experiments)


def _plain(model: StateSpace) -> dict[str, Any]:
    return {
        "A": model.A.tolist(),
        "B": model.B.tolist(),
        "C": model.C.tolist(),
        "D": model.D,
        "offset": model.offset,
        "order": model.order,
        "noise_std": None,
        "fit_percent": None,
    }
