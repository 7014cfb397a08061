"""The hybrid model of the paper: the ideal motor's physics plus a Gaussian process."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import Any, Self

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError, OptionError, did_you_mean
from ldt_core.base.experiment import Experiment, Prediction
from ldt_core.base.threads import one_thread
from ldt_core.estimation.free_run_start import first_current
from ldt_core.estimation.motor_run import MotorRun
from ldt_core.machine.machine_file import Machine
from ldt_core.models.base import Model
from ldt_core.models.gaussian_process.learn import LearnedAcceleration, learn, persistence
from ldt_core.models.gaussian_process.sparse import Kernel, SparsePosterior
from ldt_core.models.gaussian_process.speed_run import INPUTS, compile_run, speed_variances
from ldt_core.models.grey_box import GreyBoxModel
from ldt_core.models.physics import PhysicsModel
from ldt_core.physics.base import CURRENT
from ldt_core.physics.zero_order_hold import zero_order_hold


class HybridModel(Model):
    """y_{k+1} = y_k + f_p(u_k, y_k) + f_d(y_k) in closed loop (paper, "Hybrid model").

    f_p is the ideal machine: the motor with its inertia and viscous friction,
    `Physics.state_space`, exact for held voltage, of a rotor the motor all the same. Its current is
    carried along, since without it the speed is off by up to 0.46 rad/s:

        [i; w]_{k+1} = Ad [i; w]_k + Bd u_k + Gd f_d(w_k)

    Effects in the machine file, and those of a grey-box model that it stands `on`, add what they do
    to the free run of f_p alone; f_d is learned from what they leave, at speeds without them.

    f_d is a Gaussian process, zero until trained and zero far from what it was trained on. It is
    kept as an acceleration [rad/s²] that is held over a sample like the voltage, so that another
    sample period is predicted too. The training is better than a regression on one-step
    differences, which sensor noise biases: see `gaussian_process.observer`. The physics carries the
    current under the measured speeds from the first measured current (or the one that holds the
    first speed); were later ones used, f_d would not learn what is wrong with the armature.

    `parameters`: `machine`, the physics parameters; `effects`, name → parameter → value, of those
    found to act beside the file's (left out: none); `gaussian_process`, None or a mapping of
    `inputs`, `signal_std` [rad/s²], `length_scales` (unit of each input), `inducing` (m, d),
    `weights` (m,), `explained` (lower triangle by rows), `noise_std` [rad/s], `disturbance_std`
    [rad/s²], `memory` [s], `span` and `rmse` [rad/s]: see `gaussian_process`.

    Args (and those of `Model`):
        gp_inputs: of f_d in `fit`: speed (as in the paper), voltage, current.
        inducing: inducing points at most.

    Raises:
        OptionError: other inputs, or none.
        ModelError: parameters that cannot be this model's.
    """

    kind = "hybrid"

    def __init__(
        self,
        machine: Machine,
        parameters: Mapping[str, Any] | None = None,
        version: int = 0,
        trained_on: Sequence[int] = (),
        *,
        gp_inputs: Sequence[str] = ("speed",),
        inducing: int = 200,
    ) -> None:
        for name in gp_inputs:
            if name not in INPUTS:
                raise OptionError("gp_inputs", did_you_mean(str(name), INPUTS), repr(name))
        if not gp_inputs or len(set(gp_inputs)) != len(gp_inputs):
            raise OptionError("gp_inputs", "one or more different inputs", list(gp_inputs))
        if inducing < 1:
            raise OptionError("inducing", "1 or more", inducing)
        options = {"gp_inputs": tuple(gp_inputs), "inducing": inducing}
        super().__init__(machine, parameters, version, trained_on, **options)

    def untrained(self) -> dict[str, Any]:
        """The machine file's physics, and no Gaussian process."""
        return {"machine": dict(self.machine.parameters), "gaussian_process": None}

    def build(self) -> None:
        """Compile the free run from the parameters, checking them."""
        found = self.parameters.get("effects", {})
        effects = [self.machine.effect(name).used(given) for name, given in found.items()]
        for effect, _ in effects:
            effect.require(self.machine.model)
        machine = {"machine": self.parameters["machine"]}
        self.physics = PhysicsModel(self.machine, machine, effects=effects)
        self._more_than_motor = bool(self.machine.acting or effects)
        record = self.parameters["gaussian_process"]
        self.learned = None if record is None else _from_json(record)
        posterior = self.learned.posterior if self.learned else None
        with one_thread():  # the same bits whatever else the process computes with
            self.run = compile_run(posterior, record["inputs"] if record else ("speed",))

    def predict(self, experiment: Experiment) -> Prediction:
        """Free run from the first measured speed (and current, where there is one).

        `speed_std` is the deviation of the measured speed, at most the span of the speeds trained
        on (`gaussian_process.speed_run`). None while untrained.

        Raises:
            ExperimentError: the voltage is so large that the free run overflows.
        """
        ad, bd, gd = self.motor(experiment.period)
        start = self.start(experiment)
        beside = self.known_effects(experiment) if self._more_than_motor else 0.0

        def run(more: float) -> tuple[Array, Array, Array]:
            return self.run(ad, bd, gd, experiment.voltage, start + np.array([more, 0.0]))

        more = self.physics.told_current(experiment, lambda more: run(more)[0] + beside)
        speed, slopes, deviation = run(more)
        std = None
        if self.learned is not None:
            known = self.learned
            rho = persistence(known.memory, experiment.period)
            function, first, drift = speed_variances(ad, gd, slopes, deviation, rho)
            variance = function + known.noise_std**2 * (1 + first)
            variance += known.disturbance_std**2 * drift
            std = np.sqrt(np.minimum(variance, known.span**2))
        about = (experiment.number, experiment.start, experiment.period, self.version)
        return Prediction(*about, speed + beside, std)

    def fit(self, experiments: Sequence[Experiment]) -> Self:
        """Train f_d on these experiments, from the prior; the physics stays as it is.

        Raises:
            LdtError: no or too few samples, an input that hardly varies, or absurd values.
        """
        if not experiments:
            raise LdtError("hybrid model: expected experiments to learn from, got none")
        runs = []
        for e in experiments:
            current = float(self.start(e)[0])
            speed = e.speed.copy()  # for read-only speeds all would be compiled again
            if self._more_than_motor:
                speed -= self.known_effects(e)
            runs.append(MotorRun(*self.motor(e.period), e.period, e.voltage, speed, current))
        inputs, most = self.options["gp_inputs"], self.options["inducing"]
        learned = learn(runs, inputs, most)
        record = {"inputs": list(inputs), **_to_json(learned)}
        return self.successor({**self.parameters, "gaussian_process": record}, experiments)

    def on(self, found: GreyBoxModel) -> Self:
        """The same, untrained, on the physics that a grey-box model has found."""
        physics = {name: found.parameters[name] for name in ("machine", "effects")}
        return self.successor({**physics, "gaussian_process": None}, ())

    def motor(self, period: float) -> tuple[Array, Array, Array]:
        """The ideal motor over one sample period [s]: Ad (2, 2), Bd (2,), Gd (2,)."""
        a, b, _, _ = self.physics.physics.state_space(self.physics.values)
        return _discretise(tuple(a.ravel()), tuple(b.ravel()), period)

    def known_effects(self, experiment: Experiment) -> Array:
        """(L,) what the effects that act do to the speed of the ideal motor [rad/s].

        Raises:
            LdtError: the simulated state grows without bound.
        """
        about = *self.motor(experiment.period), experiment.voltage, self.start(experiment)
        ideal, _, _ = compile_run(None, ("speed",))(*about)
        return np.asarray(self.physics.free_run(experiment) - ideal)

    def start(self, experiment: Experiment) -> Array:
        """(2,) current and speed at the first sample."""
        current = first_current(experiment)
        speed = float(experiment.speed[0])
        state = self.physics.physics.initial_state(self.physics.values, speed, current)
        return np.array([state[CURRENT], speed])


@functools.lru_cache(maxsize=64)
def _discretise(
    a: tuple[float, ...], b: tuple[float, ...], period: float
) -> tuple[Array, Array, Array]:
    """Exact for what is held over a sample: Ad (2, 2), Bd (2,) of the voltage, Gd (2,) of f_d."""
    inputs = np.column_stack([b, (0.0, 1.0)])
    ad, held = zero_order_hold(np.reshape(a, (2, 2)), inputs, period)
    return ad, np.ascontiguousarray(held[:, 0]), np.ascontiguousarray(held[:, 1])


_SCALARS = ("noise_std", "disturbance_std", "memory", "span", "rmse")


def _to_json(learned: LearnedAcceleration) -> dict[str, Any]:
    posterior = learned.posterior
    return {
        "signal_std": posterior.kernel.signal_std,
        "length_scales": list(posterior.kernel.length_scales),
        "inducing": posterior.inducing.tolist(),
        "weights": posterior.weights.tolist(),
        "explained": [row[: i + 1].tolist() for i, row in enumerate(posterior.explained)],
        **{name: getattr(learned, name) for name in _SCALARS},
    }


def _from_json(record: Mapping[str, Any]) -> LearnedAcceleration:
    kernel = Kernel(record["signal_std"], tuple(record["length_scales"]))
    inputs = record["inputs"]
    inducing, weights = (np.array(record[n], dtype=np.float64) for n in ("inducing", "weights"))
    rows = record["explained"]
    if not set(inputs) <= set(INPUTS) or len(inputs) != len(kernel.length_scales):
        raise ValueError(f"inputs {inputs} with {len(kernel.length_scales)} length scales")
    if inducing.shape != (len(weights), len(inputs)) or not 0 < len(rows) <= len(weights):
        shapes = f"{inducing.shape}, {weights.shape} and {len(rows)} rows"
        raise ValueError(f"inducing inputs, weights and explained covariance of {shapes}")
    explained = np.zeros((len(rows), len(rows)))
    for i, row in enumerate(rows):
        if len(row) != i + 1:
            raise ValueError(f"{len(row)} numbers in row {i + 1} of the explained covariance")
        explained[i, : i + 1] = explained[: i + 1, i] = row
    numbers = {name: float(record[name]) for name in _SCALARS}
    if min(numbers.values()) < 0 or numbers["noise_std"] == 0:
        raise ValueError(f"{numbers}, of which none may be below 0, nor noise_std 0")
    return LearnedAcceleration(SparsePosterior(kernel, inducing, weights, explained), **numbers)
