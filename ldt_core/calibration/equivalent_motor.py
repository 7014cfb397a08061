"""Gain and time constants of a motor's response, by least squares in free run.

    tau_m tau_e speed'' + tau_m speed' + speed = G voltage + offset

Gain, offset and the start states are linear, and solved for at each trial of the time constants
(`estimation.variable_projection`).
"""

from __future__ import annotations

import cmath
import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment
from ldt_core.estimation.least_squares import trust_region
from ldt_core.estimation.linear import Identified, StateSpace, identify
from ldt_core.estimation.variable_projection import project_out

USUAL_TIME = 0.01  # sample periods: an electric time constant that few sensors show
LEAST_TIME = 1e-4  # sample periods: one that no sensor shows
AT_BOUND = 2.0  # times either: an electric time constant below is no other than that
MOST_TIME = 1e3  # longest experiments: a time constant beyond has run away
FIRST_TIMES = (0.3, 3.0)  # sample periods: electric time constants to begin a search with
LEAST_SINGULAR = 1e-8  # of the larger singular value: a start state below moves nothing
TIME_TOLERANCE = 1e-10  # relative, of the logarithms of the time constants
LOSS_TOLERANCE = 1e-12  # relative, of the sum of squares and of its gradient


@dataclass(frozen=True)
class MotorResponse:
    """A motor's response.

    Attributes:
        order: number of time constants that were fitted.
        gain: G [rad/s per V].
        tau_m: [s].
        tau_e: [s]; of order 1 what does not show, see `USUAL_TIME` and `LEAST_TIME`.
        offset: of the steady speed [rad/s]; 0 where the experiments show none.
        noise_std: standard deviation of what is left, start states estimated [rad/s].
        fit_percent: 100 (1 - |y - ŷ| / |y - ȳ|) over all samples.
    """

    order: int
    gain: float
    tau_m: float
    tau_e: float
    offset: float
    noise_std: float
    fit_percent: float

    @property
    def oscillates(self) -> bool:
        """Whether the response oscillates."""
        return self.order == 2 and 4 * self.tau_e > self.tau_m

    @property
    def slowest(self) -> float:
        """The time in which the slowest part fades to 1/e [s]."""
        root = cmath.sqrt(1 - 4 * self.tau_e / self.tau_m)
        return 2 * self.tau_e / (1 - root.real) if root.real < 1 else math.inf

    @property
    def time_constants(self) -> tuple[float, ...]:
        """(slow, fast) [s]; tau_m and tau_e where the response oscillates; (slow,) for order 1."""
        if self.order == 1:
            return (self.tau_m,)
        if self.oscillates:
            return (self.tau_m, self.tau_e)
        return (self.slowest, self.tau_m - self.slowest)


def fit_response(
    experiments: Sequence[Experiment], linear: Identified, order: int = 0, offset: bool = True
) -> MotorResponse:
    """The motor's response that is nearest to experiments of one sample period.

    Args:
        experiments: each with a start state of its own.
        linear: the model identified from them, to begin with.
        order: number of time constants, 1 or 2; 0 takes that of `linear`, 2 at most, or 2 where
            the free runs show the second one.
        offset: whether there may be one.

    Raises:
        LdtError: the experiments do not determine a model of that order.
    """
    search = _Search(list(experiments))
    wanted = order or min(linear.order, 2)
    correlation = max(linear.correlation_time, search.period)
    independent = search.samples * search.period / correlation
    seed = linear if linear.order == wanted else identify(experiments, wanted)
    starts = _starts(seed, search.period)
    found = min((search.fit(s, offset) for s in starts), key=lambda f: f.noise_std)
    if offset:
        without = search.fit(np.log([found.tau_m, found.tau_e][: found.order]), False)
        if not _shown(without, found, independent):
            found = without
    if order or (found.order == 2 and found.tau_e >= AT_BOUND * USUAL_TIME * search.period):
        return found
    one, two = found, found
    if found.order == 2:
        one = fit_response(experiments, linear, 1, offset)
    else:
        with contextlib.suppress(LdtError):  # experiments that determine no model of order 2
            two = fit_response(experiments, linear, 2, offset)
    if not _shown(one, two, independent):
        return one
    faster = two.tau_e < AT_BOUND * LEAST_TIME * search.period
    return replace(two, order=1, tau_e=LEAST_TIME * search.period) if faster else two


def _shown(simpler: MotorResponse, larger: MotorResponse, independent: float) -> bool:
    """Whether one unknown more is worth it: Schwarz's criterion, of independent samples."""
    gained = 2 * independent * math.log(simpler.noise_std / larger.noise_std)
    return gained >= math.log(independent)


def _starts(model: StateSpace, period: float) -> list[Array]:
    """Logarithms of time constants to begin with; first those of the model."""
    polynomial = np.poly(model.poles).real  # s^2 + p1 s + p0, or s + p0
    if model.order == 1:
        return [np.log([1 / polynomial[1]])]
    tau_m = polynomial[1] / polynomial[2]
    fast = [1 / polynomial[1], *(share * period for share in FIRST_TIMES)]
    return [np.log([tau_m, tau_e]) for tau_e in fast]


class _Search:
    """Experiments, and how well time constants explain them."""

    def __init__(self, experiments: list[Experiment]) -> None:
        self.experiments, self.period = experiments, experiments[0].period
        self.samples = sum(len(e) for e in experiments)
        self.longest = max(e.duration for e in experiments)
        speeds = np.concatenate([e.speed for e in experiments])
        self.spread = float(np.linalg.norm(speeds - speeds.mean()))

    def fit(self, start: Array, offset: bool) -> MotorResponse:
        """The nearest minimum."""
        low, high = math.log(LEAST_TIME * self.period), math.log(MOST_TIME * self.longest)
        found = trust_region(
            lambda logs: self._residual(logs, offset)[0],
            np.clip(start, low, high),
            low,
            high,
            xtol=TIME_TOLERANCE,
            ftol=LOSS_TOLERANCE,
            gtol=LOSS_TOLERANCE,
        ).z
        residual, weights = self._residual(found, offset)
        size, unknowns = float(np.linalg.norm(residual)), found.size + weights.size
        unknowns += found.size * len(self.experiments)
        tau_m, tau_e = self._times(found)
        return MotorResponse(
            order=found.size,
            gain=float(weights[0]),
            tau_m=tau_m,
            tau_e=tau_e,
            offset=float(weights[1]) if offset else 0.0,
            noise_std=size / math.sqrt(max(self.samples - unknowns, 1)),
            fit_percent=100 * (1 - size / self.spread),
        )

    def _times(self, logs: Array) -> tuple[float, float]:
        """tau_m and tau_e [s] of one or both logarithms."""
        taus = [*np.exp(logs).tolist(), USUAL_TIME * self.period]
        return taus[0], taus[1]

    def _residual(self, logs: Array, offset: bool) -> tuple[Array, Array]:
        """(all samples,) what is left of the speed, and gain and perhaps offset."""
        model = _unit(*self._times(logs))
        bases: dict[int, Array] = {}
        columns, speeds = [], []
        for e in self.experiments:
            length = len(e)
            if length not in bases:
                bases[length] = _free(model, length, self.period)
            forced = model.simulate(e.voltage, self.period, np.zeros(model.order))
            stacked = np.column_stack([forced, *([np.ones(length)] if offset else []), e.speed])
            stacked = project_out(stacked, bases[length])
            columns.append(stacked[:, :-1])
            speeds.append(stacked[:, -1])
        matrix, target = np.vstack(columns), np.concatenate(speeds)
        weights = np.linalg.lstsq(matrix, target, rcond=None)[0]
        return np.asarray(target - matrix @ weights), np.asarray(weights, dtype=np.float64)


def _unit(tau_m: float, tau_e: float) -> StateSpace:
    """The response of gain 1; states speed, and the current in units of volts."""
    a = np.array([[0.0, 1 / tau_m], [-1 / tau_e, -1 / tau_e]])
    return StateSpace(a, np.array([0.0, 1 / tau_e]), np.array([1.0, 0.0]))


def _free(model: StateSpace, length: int, period: float) -> Array:
    """(length, k) orthonormal basis of what start states can add to the speed."""
    still = np.zeros(length)
    runs = [model.simulate(still, period, start) for start in np.eye(model.order)]
    left, sizes, _ = np.linalg.svd(np.column_stack(runs), full_matrices=False)
    return left[:, sizes > LEAST_SINGULAR * sizes[0]]
