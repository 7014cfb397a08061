"""The hybrid model against scikit-learn: training, and the free run of one experiment."""

from __future__ import annotations

import time

import numpy as np
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
from threadpoolctl import threadpool_limits

from ldt_core.base.experiment import Experiment
from ldt_core.estimation.motor_run import MotorRun
from ldt_core.machine.machine_file import Machine, load_machine
from ldt_core.models.gaussian_process.observer import one_step
from ldt_core.models.hybrid import HybridModel
from tests.benchmarks.row import Row, best_of

EXPERIMENTS = 10  # of 2000 samples
EXACT = 2000  # points that scikit-learn's exact regression takes
ECCENTRICITY = 0.006  # m
NOISE = 0.1  # rad/s
HELD_OUT = 20  # experiments: with five the two errors differ by chance


def measured(machine: Machine, number: int) -> Experiment:
    """An experiment of the worn rotor, random voltage, from rest at a random angle."""
    rng = np.random.default_rng([1, number])
    voltage = np.repeat(rng.uniform(6, 16, 20), 100)
    start = machine.model.initial_state(machine.parameters, 0.0)
    start[0] = rng.uniform(0, 2 * np.pi)
    states = machine.model.simulate(machine.parameters, voltage, 0.01, start)
    speed = states[:, 1] + NOISE * rng.standard_normal(2000)
    return Experiment(number, 0.0, 0.01, voltage, speed)


def as_run(model: HybridModel, e: Experiment) -> MotorRun:
    """The experiment with the discrete motor behind it."""
    return MotorRun(*model.motor(e.period), e.period, e.voltage, e.speed, float(model.start(e)[0]))


def looped(model: HybridModel, e: Experiment, regressor, deviation: bool = False) -> np.ndarray:
    """The free run as it is written without us: one call of predict for each sample."""
    run = as_run(model, e)
    i, w = run.current, float(run.speed[0])
    speed = np.empty(len(e))
    for k in range(len(e)):
        speed[k] = w
        force = regressor.predict([[w]], return_std=deviation)
        (f,) = force[0] if deviation else force
        i, w = run.ad @ (i, w) + run.bd * run.voltage[k] + run.gd * f
    return speed


class Tabled:
    """A regressor's mean on a fine grid: only its error counts here, and a loop takes a minute."""

    def __init__(self, regressor, low: float, high: float) -> None:
        self.grid = np.linspace(low, high, 5000)
        self.values = regressor.predict(self.grid[:, None])

    def predict(self, x, return_std: bool = False) -> np.ndarray:
        """Mean at one input."""
        return np.interp(x[0], self.grid, self.values)


def rmse(predicted: list[np.ndarray], held_out: list[Experiment]) -> float:
    """Of the free runs [rad/s]."""
    pairs = zip(predicted, held_out, strict=True)
    return float(np.sqrt(np.mean([(p - e.speed) ** 2 for p, e in pairs])))


def run() -> list[Row]:
    """Training on 20,000 samples; a free run of 2000."""
    machine = load_machine("rotor")
    worn = machine.with_parameters(e=ECCENTRICITY)
    data = [measured(worn, n) for n in range(1, EXPERIMENTS + 1)]
    held_out = [measured(worn, n) for n in range(101, 101 + HELD_OUT)]
    untrained = HybridModel(machine)
    model = untrained.fit(data)
    with threadpool_limits(1):  # on both sides
        return [_training(untrained, data, held_out), *_free_run(model, held_out[0])]


def _training(untrained: HybridModel, data, held_out) -> Row:
    ours = best_of(3, lambda: untrained.fit(data))
    model = untrained.fit(data)
    runs = [as_run(untrained, e) for e in data]
    speed = np.concatenate([r.speed[:-1] for r in runs])
    lacking = np.concatenate([one_step(r)[0] for r in runs])
    some = np.linspace(0, len(speed) - 1, EXACT).astype(int)
    # The bounds and the start that a careful user gives; the default ones were seen to get stuck.
    prior = ConstantKernel(25.0, (1e-2, 1e4)) * RBF(5.0, (0.3, 100.0)) + WhiteKernel(
        200.0, (1e-2, 1e4)
    )
    begin = time.perf_counter()
    exact = GaussianProcessRegressor(prior).fit(speed[some, None], lacking[some])
    peer = time.perf_counter() - begin
    tabled = Tabled(exact, float(speed.min()) - 10, float(speed.max()) + 10)
    errors = [
        rmse([model.predict(e).speed for e in held_out], held_out),
        rmse([looped(model, e, tabled) for e in held_out], held_out),
        rmse([untrained.predict(e).speed for e in held_out], held_out),
    ]
    return Row(
        "training of the hybrid model, hyper-parameters included",
        ours,
        "scikit-learn, exact Gaussian process",
        peer,
        "20x",
        f"{len(speed) + len(data)} samples, peer {EXACT}; free-run RMSE on held-out data "
        f"{errors[0]:.3f} rad/s, peer {errors[1]:.3f} (physics alone {errors[2]:.3f})",
    )


def _free_run(model: HybridModel, e: Experiment) -> list[Row]:
    """Against the same function in scikit-learn with as few points: its best case."""
    posterior = model.learned.posterior
    kernel = posterior.kernel
    prior = ConstantKernel(kernel.signal_std**2) * RBF(kernel.length_scales[0])
    same = GaussianProcessRegressor(prior, alpha=1e-10 * kernel.signal_std**2, optimizer=None)
    same.fit(posterior.inducing, posterior.mean(posterior.inducing))
    ours = best_of(20, lambda: model.predict(e))
    rows = []
    for deviation in (False, True):
        begin = time.perf_counter()
        speed = looped(model, e, same, deviation)
        peer = time.perf_counter() - begin
        off = float(np.abs(speed - model.predict(e).speed).max())
        what = "mean and standard deviation" if deviation else "mean"
        rows.append(
            Row(
                f"hybrid free run of {len(e)} samples, with standard deviation",
                ours,
                f"loop over scikit-learn's predict ({what})",
                peer,
                "1000x",
                f"{len(posterior.inducing)} inducing points in both; "
                f"speeds differ by {off:.1e} rad/s",
            )
        )
    return rows
