"""Experiments in, continuous-time model out: what MATLAB's ssest does with its simulation focus."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.errors import ExperimentError, LdtError, OptionError
from ldt_core.base.experiment import Experiment
from ldt_core.base.threads import one_thread
from ldt_core.estimation.linear import schwarz
from ldt_core.estimation.linear.alternatives import alternatives, residual_deviation
from ldt_core.estimation.linear.order_search import best_of_orders
from ldt_core.estimation.linear.output_error import Linear, OutputError
from ldt_core.estimation.linear.state_space import (
    StartRule,
    StateSpace,
    misses,
    principal_deviations,
    settled,
    usual,
)
from ldt_core.estimation.noise import common_correlation_time
from ldt_core.machine.experiment_limits import refuse_period

#: Highest order that can be asked for; `order` in parameters.yaml.
MOST_ORDER = 10
#: Orders tried where it is to be chosen. A motor has 2 states; a soft shaft or foundation adds 2.
TRIED_ORDERS = range(1, 5)
#: Samples per unknown, at least: fewer make a fit that says little of the next experiment.
SAMPLES_PER_UNKNOWN = 4
#: Range of a constant voltage or speed relative to its size, at most: rounding.
CONSTANT_RANGE = 1e-9
#: Size of a voltage or speed, at most, and one over it at least: quotients and squares of it can be
#: computed.
LARGEST = 1e30
#: Relative effect of the input, at least: below is rounding (a random voltage has 1e-3 to 1).
LEAST_EXCITATION = 1e-7
#: F statistic below which the voltage explains no more than chance: 1e-4 of all noise passes 10 at
#: order 1, far less at higher orders.
LEAST_F = 10.0
#: Samples on which poles and order are first sought; the chosen model is then fitted to all.
ROUGH_SAMPLES = 6_000


@dataclass(frozen=True, eq=False)
class Identified(StateSpace):
    """A model with what its identification knows of it.

    Args:
        starts: (experiments, n) estimated state at the first sample of each experiment.
        start: in which state a new run starts.
        others: (model, start, weight) of other models that the data allow, see `alternatives`.
        period: sample period of the data [s].
        noise_std: standard deviation of the free run's residual [rad/s], the unknowns deducted.
        correlation_time: of that residual [s], one sample period if it is white.
        fit_percent: 100 (1 − |y − ŷ| / |y − ȳ|) over all samples, as MATLAB's `compare`.
        held_out: order → root mean square error on samples left out [rad/s]; empty when the order
            was given.
    """

    starts: Array = field(default_factory=lambda: np.zeros((0, 0)))
    start: StartRule | None = None
    others: list[tuple[StateSpace, StartRule, float]] = field(default_factory=list)
    period: float = float("nan")
    noise_std: float = float("nan")
    correlation_time: float = float("nan")
    fit_percent: float = float("nan")
    held_out: dict[int, float] = field(default_factory=dict)


def identify(
    experiments: Sequence[Experiment],
    order: int | None = None,
    *,
    offset: bool = True,
) -> Identified:
    """The linear model whose free run from the voltage is nearest to the measured speed.

    Continuous time; stable by construction; the start state of each experiment is estimated, and
    the output's offset. State 1 is the speed without the offset: C = [1, 0, …]. The result is the
    same to the last bit for the same experiments on the same machine.

    Args:
        experiments: one or more, of one sample period; lengths may differ.
        order: number of states; None or 0 chooses from 1 to 4 on held-out samples, or takes
            1 where no experiment is long enough for that.
        offset: whether the speed may have an offset, that of a constant load or sensor bias.

    Raises:
        OptionError: an order that is none.
        ExperimentError: no experiments, or of different sample periods.
        LdtError: the experiments do not determine a model; the sentence says why.
    """
    if order is not None and (int(order) != order or not 0 <= order <= MOST_ORDER):
        raise OptionError("order", f"a whole number from 0 to {MOST_ORDER}", repr(order))
    orders = range(1, int(order) + 1) if order else TRIED_ORDERS
    experiments = list(experiments)
    least = orders[-1] if order else orders[0]
    unknowns = _unknowns(least, len(experiments), offset)
    refuse_undetermined(experiments, unknowns, f"a linear model of order {least}")
    scale = _Scale(experiments, offset)
    inputs = [(e.voltage - scale.voltage_mean) / scale.voltage for e in experiments]
    outputs = [(e.speed - scale.speed_mean) / scale.speed for e in experiments]
    sigma = schwarz.slowest(max(len(e) for e in experiments))
    search = rough = OutputError(inputs, outputs, sigma, offset=offset)
    few = _spread(search.lengths)
    if len(few) < len(experiments):
        rough = OutputError(
            [inputs[i] for i in few], [outputs[i] for i in few], sigma, offset=offset
        )
    with one_thread():
        try:
            orders = _possible(orders, rough, experiments)
        except LdtError:  # these few may say nothing where all together do
            if rough is search:
                raise
            rough, orders = search, _possible(orders, search, experiments)
        theta, held_out = best_of_orders(rough, orders, choosing=not order)
        if not order or rough is not search:
            theta, _ = search.minimise(theta)
        _refuse_chance(experiments, search, theta)
        return _model(search, theta, scale, experiments, held_out)


def _spread(lengths: list[int]) -> list[int]:
    """Indices of experiments, evenly spread, that hold about `ROUGH_SAMPLES` samples."""
    count = max(1, min(len(lengths), round(ROUGH_SAMPLES / np.mean(lengths))))
    return sorted({int(i) for i in np.linspace(0, len(lengths) - 1, count).round()})


class _Scale:
    """Centre and size of input and output: a fit in units of its own data is free of units."""

    def __init__(self, experiments: list[Experiment], offset: bool) -> None:
        voltage = np.concatenate([e.voltage for e in experiments])
        speed = np.concatenate([e.speed for e in experiments])
        self.voltage_mean, self.voltage = float(voltage.mean()), float(voltage.std())
        self.speed_mean, self.speed = float(speed.mean()), float(speed.std())
        if not offset:  # zero is where the machine's is
            self.voltage_mean = self.speed_mean = 0.0


def refuse_undetermined(experiments: Sequence[Experiment], unknowns: int, what: str) -> None:
    """Refuse experiments that cannot determine a model, before anything is computed from them.

    Args:
        experiments: measured.
        unknowns: of the model and of all start states.
        what: the model, for the sentence.

    Raises:
        ExperimentError: none, of different sample periods, or too large or small to compute with.
        LdtError: too few samples, or a signal that does not vary.
    """
    if not experiments:
        raise ExperimentError("identification", "at least one experiment", "none")
    first = experiments[0]
    refuse_period(first)
    for e in experiments[1:]:
        if not e.same_period(first):
            raise ExperimentError(
                f"experiment {e.number}, sample period",
                f"{first.period:g} s as in experiment {first.number} (one model, one period)",
                f"{e.period:g} s",
            )
    samples = sum(len(e) for e in experiments)
    if samples < SAMPLES_PER_UNKNOWN * unknowns:
        raise LdtError(
            f"{_named(experiments)} cannot determine {what}: {samples} samples for {unknowns} "
            f"unknowns, {SAMPLES_PER_UNKNOWN * unknowns} are needed"
        )
    for name, unit in (("voltage", "V"), ("speed", "rad/s")):
        values = np.concatenate([getattr(e, name) for e in experiments])
        size = float(np.abs(values).max())
        if size > 0 and not 1 / LARGEST < size < LARGEST:
            expected = f"sizes from {1 / LARGEST:g} to {LARGEST:g} {unit}"
            raise ExperimentError(f"{_named(experiments)}, {name}", expected, f"{size:g} {unit}")
        if float(np.ptp(values)) <= CONSTANT_RANGE * size:
            raise LdtError(
                f"{_named(experiments)} cannot determine {what}: "
                f"the {name} is {values[0] + 0.0:g} {unit} throughout"
            )


def _unknowns(order: int, experiments: int, offset: bool) -> int:
    """Poles, c, perhaps an offset, and a start state for each experiment."""
    return 2 * order + offset + order * experiments


def _possible(orders: range, search: OutputError, experiments: list[Experiment]) -> range:
    """The orders that the samples suffice for and the voltage excites, else an LdtError."""
    asked, most = orders[-1] if orders is not TRIED_ORDERS else orders[0], 0
    for n in orders:
        unknowns = _unknowns(n, len(search.lengths), search.offset)
        if search.count < SAMPLES_PER_UNKNOWN * unknowns or search.excitation(n) < LEAST_EXCITATION:
            break
        most = n
    if most < asked:
        raise LdtError(
            f"{_named(experiments)} cannot determine a linear model of order {asked}: "
            "the voltage varies too little or too simply"
        )
    return range(1, most + 1)


def _named(experiments: Sequence[Experiment]) -> str:
    if len(experiments) == 1:
        return f"experiment {experiments[0].number}"
    return f"{len(experiments)} experiments ({experiments[0].number} to {experiments[-1].number})"


def _refuse_chance(experiments: list[Experiment], search: OutputError, theta: Array) -> None:
    """An F test of the model against one in which the voltage does nothing."""
    with_input, without = search.loss(theta), search.without_input(theta)
    n = theta.size
    rest = search.count - _unknowns(n, len(search.lengths), search.offset)
    gained, left = (without - with_input) / n, with_input / rest
    if gained < LEAST_F * left:
        raise LdtError(
            f"{_named(experiments)} cannot determine a linear model: "
            "the voltage explains no more of the speed than chance would"
        )


def _model(
    search: OutputError,
    theta: Array,
    scale: _Scale,
    experiments: list[Experiment],
    held_out: dict[int, float],
) -> Identified:
    period, linear = experiments[0].period, search.solve(theta)
    residual = search.y - search.outputs(theta, linear)
    squares = float(residual @ residual)
    time = common_correlation_time(np.split(residual, search.begins[1:-1]))
    unknowns = _unknowns(theta.size, len(search.lengths), search.offset)
    deviation = residual_deviation(squares, search.count, unknowns, time)
    around = float(((search.y - search.y.mean()) ** 2).sum())
    model, starts = _physical(search, theta, linear, scale, period)
    few = _spread(search.lengths)
    seen = [experiments[i] for i in few]
    rules = [usual(model, starts[few], seen), settled(model)]
    start = min((r for r in rules if r), key=lambda r: misses(model, r, seen))
    others = []
    for a in alternatives(search, theta, linear, deviation * np.sqrt(time)):
        other, begins = _physical(search, a.theta, a.linear, scale, period)
        rule = settled(other) if start is rules[1] else usual(other, begins[few], seen)
        if rule is not None:
            others.append((other, rule, a.weight))
    noise_std = scale.speed * deviation
    moved = [start.per_speed * noise_std, *principal_deviations(start.spread)]
    others += [(model, replace(start, state=start.state + m), 1.0) for m in moved]
    return Identified(
        **vars(model),
        starts=starts,
        start=start,
        others=others,
        period=period,
        noise_std=noise_std,
        correlation_time=time * period,
        fit_percent=100 * (1 - float(np.sqrt(squares / around))),
        held_out={n: scale.speed * error for n, error in held_out.items()},
    )


def _physical(
    search: OutputError, theta: Array, linear: Linear, scale: _Scale, period: float
) -> tuple[StateSpace, Array]:
    """Model and start states in SI units, in the dual (observer) form: state 1 is the output."""
    A, b = schwarz.matrices(theta, search.sigma)
    # the dual system has the same output: cᵀ exp(A t) b = bᵀ exp(Aᵀ t) c, and v is its start state
    gain = b[0] * scale.speed
    A = A.T / period
    B = linear.c * gain / scale.voltage / period
    C = np.eye(theta.size)[0]
    # the fit saw voltage − mean: the steady state of the mean goes from the offset to the states
    steady = -np.linalg.solve(A, B) * scale.voltage_mean
    offset = linear.offset * scale.speed + scale.speed_mean
    offset -= float(C @ steady)
    return StateSpace(A, B, C, offset=offset), linear.v * gain + steady
