"""The linear model of the paper, ẋ = A x + B u, ŷ = C x + D u + offset, and its re-learning."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Self

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.errors import MachineFileError, OptionError
from ldt_core.base.experiment import Experiment, Prediction
from ldt_core.estimation.free_run_start import first_current, told_current
from ldt_core.estimation.linear import StateSpace, identify
from ldt_core.estimation.linear.alternatives import squared_distances
from ldt_core.estimation.linear.identification import MOST_ORDER
from ldt_core.estimation.linear.state_space import StartRule, discretise
from ldt_core.machine.machine_file import Machine
from ldt_core.models.base import Model


class LinearModel(Model):
    """Free run of a continuous-time state space; the voltage is held between samples, exactly.

    Untrained it is the machine file's physics, for a rotor the motor without its eccentricity
    (e = 0). `fit` identifies a new one from the experiments alone (`ldt_core.estimation.linear`):
    stable, with an offset, and free in its physical meaning.

    `parameters`: `A` (n × n) [1/s], `B` (n), `C` (n), `D`, `offset` [rad/s], `order`, `noise_std`
    (of the residual of the fit [rad/s], null when untrained), `fit_percent` (MATLAB's, likewise),
    `held_out` (order → error on samples left out [rad/s], when the order was chosen), `states`
    (names of the states, where they are physical), `start` (`state` and `per_speed`, see
    `estimation.linear.state_space`) and `others`, models that the data allow as well, for the
    deviation (`A`, `B`, `offset`, their `state` and `per_speed`, `weight`).

    Args (and those of `Model`):
        order: number of states of the identified model, 0 to choose it on held-out samples.
        offset: whether it may have an offset. The paper's has none, and so a steady speed of 0 at
            0 V; one that is to stand for friction or load needs it.

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
        offset: bool = True,
    ) -> None:
        if int(order) != order or not 0 <= order <= MOST_ORDER:
            raise OptionError("order", f"a whole number from 0 to {MOST_ORDER}", repr(order))
        options = {"order": int(order), "offset": bool(offset)}
        super().__init__(machine, parameters, version, trained_on, **options)

    def untrained(self) -> dict[str, Any]:
        """The machine file's physics, linear: the motor."""
        A, B, C, D = self.machine.model.state_space(self.machine.parameters)
        motor = StateSpace(A, np.ravel(B), np.ravel(C), np.ravel(D)[0])
        if motor.poles.real.max() >= 0:  # of no machine, but beyond floating point
            expected = "a motor whose slowest rate floating point tells from 0 beside the fastest"
            got = f"rates {-np.sort(motor.poles.real)[::-1]} 1/s (its inductance or friction?)"
            raise MachineFileError(f"{self.machine.name}, parameters", expected, got)
        return {**_plain(motor), "states": ["current", "speed"]}

    def build(self) -> None:
        """Check the matrices; refuse an unstable model, which no `fit` makes."""
        p = self.parameters
        self.state_space = StateSpace(p["A"], p["B"], p["C"], p["D"], p["offset"])
        if self.state_space.poles.real.max() >= 0:
            raise ValueError(f"an unstable A with poles {self.state_space.poles}")
        if p["order"] != self.state_space.order:
            raise ValueError(f"order {p['order']} and {self.state_space.order} states in A")
        self.states = list(p.get("states", ()))
        self.learned = None if p["noise_std"] is None else _Learned(self.state_space, p)

    def predict(self, experiment: Experiment) -> Prediction:
        """Free run over the voltage from the first speed.

        Untrained it starts in the steady state that has this speed, and from the first current,
        measured or told by the speed, where that is more than noise; trained by a rule learned too
        (`estimation.linear.state_space`). `speed_std` is None when untrained, else what residuals,
        parameters and start may be off.
        """
        first, period = float(experiment.speed[0]), experiment.period
        if self.learned is not None:
            speed, std = self.learned.run(experiment)
        else:
            std = None
            start = self.state_space.equilibrium(first, float(experiment.voltage[0]))
            speed = self._begun(experiment, start)
        about = (experiment.number, experiment.start, period, self.version)
        return Prediction(*about, speed, std)

    def _begun(self, experiment: Experiment, start: Array) -> Array:
        """(L,) speed [rad/s] of the machine file's model, by its first current."""
        about, current = (experiment.voltage, experiment.period), first_current(experiment)
        if "current" not in self.states:
            return self.state_space.simulate(*about, start)
        place = self.states.index("current")
        if current is not None:
            start[place] = current

        def run(more: float) -> Array:
            begun = start.copy()
            begun[place] += more
            return self.state_space.simulate(*about, begun)

        motor = self.machine.model.folded(self.machine.parameters)
        return run(told_current(run, motor, experiment))

    def shaped_like(self, other: Self) -> Self:
        """The same model, with the order that `other` has."""
        options = {**self.options, "order": other.state_space.order}
        return type(self)(self.machine, self.parameters, self.version, self.trained_on, **options)

    def fit(self, experiments: Sequence[Experiment]) -> Self:
        """Identified again from these experiments alone, version + 1.

        Raises:
            ExperimentError: no experiments, or of different sample periods.
            LdtError: the experiments do not determine a model; the sentence says why.
        """
        found = identify(experiments, self.options["order"], offset=self.options["offset"])
        others = [
            {"A": m.A.tolist(), "B": m.B.tolist(), "offset": m.offset, "weight": w, **_rule(start)}
            for m, start, w in found.others
        ]
        start = found.start
        assert start is not None  # of what was identified it is known
        learned = {
            "noise_std": found.noise_std,
            "fit_percent": found.fit_percent,
            "held_out": {str(n): error for n, error in found.held_out.items()},
            "start": _rule(start),
            "others": others,
        }
        return self.successor({**_plain(found), **learned}, experiments)


class _Learned:
    """A model with its start and the others that the data allow, ready to run."""

    def __init__(self, model: StateSpace, parameters: Mapping[str, Any]) -> None:
        """Raises ValueError, KeyError or TypeError on parameters that are none."""
        self.model, self.noise_std = model, float(parameters["noise_std"])
        if not np.array_equal(model.C, np.eye(1, model.order)[0]) or model.D:
            raise ValueError("a learned model whose first state is not the speed")
        mine, others = parameters["start"], parameters["others"]
        self.models = [model]
        self.models += [StateSpace(o["A"], o["B"], model.C, 0.0, o["offset"]) for o in others]
        self.weights = np.array([0.0, *(o["weight"] for o in others)], dtype=np.float64)
        rules = [(r["state"], r["per_speed"]) for r in (mine, *others)]
        self.state, self.per_speed = np.array(rules, dtype=np.float64).transpose(1, 0, 2).copy()
        if any(m.order != model.order for m in self.models) or (self.state.shape[1] != model.order):
            raise ValueError(f"models or starts of another order than {model.order}")
        numbers = (self.weights, self.state, self.per_speed, self.noise_std)
        if not all(np.isfinite(n).all() for n in numbers):
            raise ValueError("a start, weight or noise_std that is not finite")
        if self.noise_std < 0 or self.weights.min() < 0:
            raise ValueError(f"noise_std {self.noise_std} or a weight below 0")
        self.offsets = np.array([m.offset for m in self.models])

    def run(self, experiment: Experiment) -> tuple[Array, Array]:
        """Speed (L,) [rad/s] and its deviation."""
        starts = self.state + self.per_speed * experiment.speed[0]
        voltage, period = np.ascontiguousarray(experiment.voltage), experiment.period
        speed = self.model.simulate(voltage, period, starts[0])
        discrete = [discretise(m.A, m.B, period) for m in self.models]
        steps, drives = (np.stack(arrays) for arrays in zip(*discrete, strict=True))
        distances = squared_distances(steps, drives, self.offsets, starts, self.weights, voltage)
        return speed, np.sqrt(self.noise_std**2 + distances)


def _rule(start: StartRule) -> dict[str, Any]:
    return {"state": start.state.tolist(), "per_speed": start.per_speed.tolist()}


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
