"""From measured runs to the trained acceleration with all that a prediction needs.

1. means over short blocks of the one-step targets, and from them the kernel (`sparse`);
2. noise of sensor and process, with the function that the cells alone give (`observer`);
3. one sparse solve on all samples, as innovations at the filtered states (`sparse`);
4. what free runs still miss where they have not learned from, as a disturbance (`speed_run`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import rms
from ldt_core.base.sentences import counted
from ldt_core.base.threads import one_thread
from ldt_core.estimation.motor_run import MotorRun
from ldt_core.models.gaussian_process.observer import (
    estimate_noise,
    filter_columns,
    filtered,
    kalman_gains,
    one_step,
)
from ldt_core.models.gaussian_process.sparse import (
    ROWS,
    Kernel,
    SparsePosterior,
    cells,
    choose_inducing,
    condition,
    condition_in_parts,
    fit_hyperparameters,
)
from ldt_core.models.gaussian_process.speed_run import FreeRun, compile_run, speed_variances

#: Blocks of the training data, at least: fewer determine neither the kernel nor the noise.
FEWEST_BLOCKS = 40
#: [time constants of the motor] Length of a block. The noise of a mean of n differences falls as
#: 1/n, since neighbours cancel, while the speed moves little within half a time constant.
BLOCK_LENGTH = 0.5
#: [noise deviations of its block means] Range of an input, at least, to be learned over: the span
#: of a thousand means of nothing but noise is 6.5.
LEAST_RANGE = 10.0
#: Noise of a sensor relative to the span of its speed, at least: below is rounding. It keeps the
#: solve defined on exact data.
LEAST_NOISE = 1e-6
#: [noise deviations] Shortest length scale over speed: finer detail is blurred by the sensor.
SHORTEST_LENGTH = 3.0
#: Candidates for inducing points, at most: blocks are thinned evenly to them, as they lie close.
MOST_CANDIDATES = 4000
#: Quantile of absolute differences off which the noise is read. High enough that a coarse encoder,
#: most of whose differences are 0, shows its steps; low enough that the few where the voltage
#: switches or a resonance is passed do not count.
NOISE_QUANTILE = 0.9
#: The same quantile of the size of a standard normal number.
NORMAL_QUANTILE = 1.6448536269514722
#: Parts of the data; the disturbance is measured in each where the function did not learn from it.
PARTS = 4
#: Stretches of every experiment that each part has, so that all parts see all of its course.
STRETCHES = 3
#: Halvings of an interval of logarithms: down to rounding.
BISECTIONS = 60


@dataclass(frozen=True, eq=False)
class LearnedAcceleration:
    """A trained acceleration.

    Args:
        posterior: the function [rad/s²].
        noise_std: of the speed sensor [rad/s].
        disturbance_std: of what the function leaves unexplained [rad/s²].
        memory: correlation time of that [s]; 0 for white.
        span: of the measured speeds [rad/s].
        rmse: free run over the training data [rad/s].
    """

    posterior: SparsePosterior
    noise_std: float
    disturbance_std: float
    memory: float
    span: float
    rmse: float


def learn(runs: Sequence[MotorRun], inputs: Sequence[str], most: int) -> LearnedAcceleration:
    """Train on these runs, from the prior.

    Args:
        runs: measured experiments, any sample periods.
        inputs: of the function, some of current, speed and voltage.
        most: inducing points at most.

    Raises:
        LdtError: too few samples, an input that hardly varies, or numbers that overflow.
    """
    with one_thread(), np.errstate(all="ignore"):  # judged at the end, by isfinite
        try:
            learned = _learn(runs, tuple(inputs), most)
        except (np.linalg.LinAlgError, ValueError) as error:
            raise LdtError(
                f"hybrid model: the training data give no Gaussian process ({error})"
            ) from error
    if not (np.isfinite(learned.posterior.weights).all() and np.isfinite(learned.rmse)):
        raise LdtError("hybrid model: the training data are too large to compute with")
    return learned


def _learn(runs: Sequence[MotorRun], inputs: tuple[str, ...], most: int) -> LearnedAcceleration:
    steps = [one_step(run) for run in runs]
    lengths = _block_lengths(runs)
    raw = [
        np.column_stack([{"current": current, "speed": r.speed, "voltage": r.voltage}[name]
                         for name in inputs])
        for r, (_, current) in zip(runs, steps, strict=True)
    ]  # fmt: skip
    x = np.concatenate([_means(a[:-1], n) for a, n in zip(raw, lengths, strict=True)])
    y = np.concatenate([_means(t, n) for (t, _), n in zip(steps, lengths, strict=True)])
    speeds = np.concatenate([run.speed for run in runs])
    span = float(np.ptp(speeds))
    noise_std = max(_sensor_noise(runs, [t for t, _ in steps]), LEAST_NOISE * span)
    _refuse_unexcited(x, inputs, noise_std / np.sqrt(min(lengths)))

    shortest = np.array(
        [SHORTEST_LENGTH * noise_std if name == "speed" else 0.0 for name in inputs]
    )
    kernel = fit_hyperparameters(x, y, shortest)
    inducing = choose_inducing(x[:: -(-len(x) // MOST_CANDIDATES)], kernel, most)
    rough = _from_cells(kernel, inducing, x, y)
    forces = [rough.mean(a) for a in raw]
    noise = estimate_noise(runs, forces)
    innovation_std = max(noise.std, LEAST_NOISE * span)

    parts = _parts(runs)

    def observations() -> Iterator[tuple[Array, Array, NDArray[np.int64]]]:
        for run, force, part in zip(runs, forces, parts, strict=True):
            _, states, _ = filtered(run, force, noise.ratio)
            known = {"current": states[:, 0], "speed": states[:, 1], "voltage": run.voltage}
            at = np.column_stack([known[name] for name in inputs])
            target, _, _ = filtered(run, np.zeros(len(run.speed)), noise.ratio)
            gains, scales = kalman_gains(run.ad, noise.ratio, len(run.speed))
            states = np.zeros((2, len(inducing)))
            for begin in range(0, len(target), ROWS):
                here = slice(begin, min(begin + ROWS, len(target)))
                after = slice(here.start + 1, here.stop + 1)
                about = kernel(at[here], inducing), gains[after], scales[after], states
                yield filter_columns(run, *about), target[here], part[after]

    found = condition_in_parts(kernel, inducing, observations(), innovation_std, PARTS)
    return _disturbance(runs, inputs, found, parts, noise_std, span, lengths, steps, raw)


def _parts(runs: Sequence[MotorRun]) -> list[NDArray[np.int64]]:
    """For each run (L,) the part of the data that a sample belongs to, in alternating stretches."""
    return [
        (np.arange(len(run.speed)) * PARTS * STRETCHES // len(run.speed) + index) % PARTS
        for index, run in enumerate(runs)
    ]


def _block_lengths(runs: Sequence[MotorRun]) -> list[int]:
    total = sum(len(run.speed) - 1 for run in runs)
    if total < FEWEST_BLOCKS:
        raise LdtError(
            f"hybrid model: expected at least {FEWEST_BLOCKS + 1} samples to learn from, got "
            f"{total + len(runs)} in {counted(len(runs), 'experiment')}"
        )
    most = total // FEWEST_BLOCKS
    result = []
    for run in runs:
        slowest = float(np.abs(np.linalg.eigvals(run.ad)).max())
        constant = -1.0 / np.log(slowest) if 0 < slowest < 1 else most / BLOCK_LENGTH
        longest = max(min(most, len(run.speed) - 1), 1)
        result.append(int(np.clip(round(BLOCK_LENGTH * constant), 1, longest)))
    return result


def _means(values: Array, length: int) -> Array:
    """Means over consecutive blocks of rows; a rest shorter than a block is left out."""
    count = len(values) // length
    return values[: count * length].reshape(count, length, *values.shape[1:]).mean(axis=1)


def _sensor_noise(runs: Sequence[MotorRun], lacking: Sequence[Array]) -> float:
    """Noise of the speed sensor [rad/s] from second differences of the one-step targets, which hold
    v_{k+1} - a v_k; a quantile sees neither the acceleration nor the jumps of the voltage.
    """
    scaled = []
    for run, targets in zip(runs, lacking, strict=True):
        gain = np.linalg.norm(np.convolve([1.0, -run.ad[1, 1]], [1.0, -2.0, 1.0]))
        scaled.append(np.diff(targets, 2) * run.gd[1] / gain)
    if not any(row.size for row in scaled):
        raise LdtError("hybrid model: expected experiments of 4 samples or more to learn from")
    return float(np.quantile(np.abs(np.concatenate(scaled)), NOISE_QUANTILE)) / NORMAL_QUANTILE


def _refuse_unexcited(x: Array, inputs: Sequence[str], noise: float) -> None:
    for column, name in zip(x.T, inputs, strict=True):
        span = float(np.ptp(column))
        least = LEAST_RANGE * noise if name == "speed" else 0.0
        if not span > max(least, 1e-9 * float(np.abs(column).max())):
            raise LdtError(
                f"hybrid model: the {name} stays within {span:.3g} {_UNITS[name]} in the training "
                f"data, so nothing can be learned over it (it would take more than {least:.3g})"
            )


_UNITS = {"current": "A", "speed": "rad/s", "voltage": "V"}


def _from_cells(kernel: Kernel, inducing: Array, x: Array, y: Array) -> SparsePosterior:
    """The function that the cells alone give: a first guess for the noise."""
    inputs, targets, variance, _ = cells(x, y)
    std = np.sqrt(np.maximum(variance, (1e-4 * kernel.signal_std) ** 2))
    rows = kernel(inputs, inducing) / std[:, None]
    return condition(kernel, inducing, [(rows, targets / std)], 1.0)


def _disturbance(
    runs: Sequence[MotorRun],
    inputs: Sequence[str],
    found: Sequence[SparsePosterior],
    parts: Sequence[NDArray[np.int64]],
    noise_std: float,
    span: float,
    lengths: Sequence[int],
    steps: Sequence[tuple[Array, Array]],
    raw: Sequence[Array],
) -> LearnedAcceleration:
    """What free runs miss beyond noise and the function's own spread.

    Its memory is that of the block means of the equation error. Its size gives the residuals over
    their predicted deviations unit mean square, in each part of the data for the function that was
    learned without that part.
    """
    posterior, *others = found
    above = below = 0.0
    for (lacking, _), at, n in zip(steps, raw, lengths, strict=True):
        rest = _means(lacking - posterior.mean(at[:-1]), n)
        above, below = above + float(rest[1:] @ rest[:-1]), below + float(rest @ rest)
    block = float(np.mean([n * run.period for n, run in zip(lengths, runs, strict=True)]))
    correlation = min(above / below, 0.99) if below > 0 else 0.0
    memory = -block / np.log(correlation) if correlation > 0.01 else 0.0
    errors = np.concatenate([r.speed - _run(compile_run(posterior, inputs), r)[0] for r in runs])
    squares, known, unit = [], [], []
    for index, other in enumerate(others):
        compiled = compile_run(other, inputs)
        for run, part in zip(runs, parts, strict=True):
            speed, slopes, deviation = _run(compiled, run)
            function, first, drift = speed_variances(
                run.ad, run.gd, slopes, deviation, persistence(memory, run.period)
            )
            own = part == index
            own[0] = False  # the run begins there
            squares.append((run.speed - speed)[own] ** 2)
            known.append((function + noise_std**2 * (1 + first))[own])
            unit.append(drift[own])
    r2, base, per = (np.concatenate(a) for a in (squares, known, unit))
    size = 0.0
    if np.mean(r2 / base) > 1:
        low, high = -60.0, float(np.log(r2.max() / per[per > 0].min()))
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            if np.mean(r2 / (base + np.exp(middle) * per)) > 1:
                low = middle
            else:
                high = middle
        size = float(np.exp((low + high) / 4))
    rmse = rms(errors)
    return LearnedAcceleration(posterior, noise_std, size, memory, span, rmse)


def _run(compiled: FreeRun, run: MotorRun) -> tuple[Array, Array, Array]:
    start = np.array([run.current, run.speed[0]])
    return compiled(run.ad, run.bd, run.gd, run.voltage, start)


def persistence(memory: float, period: float) -> float:
    """Autocorrelation over one sample of a process with this correlation time [s]."""
    return float(np.exp(-period / memory)) if memory > 0 else 0.0
