"""What a motor's known physics leaves: an acceleration of its state, with and without memory.

    [i; w]_{k+1} = Ad [i; w]_k + Bd u_k + Gd f_k

f is a sum of a curve over the speed, a curve over the current, and two families that can stand for
any memory of the speed: plays, which follow the speed as a loose joint does and do not forget
(Krasnosel'skii, Pokrovskii, "Systems with hysteresis", 1989: sums of plays of all widths are the
hysteresis of Prandtl and Ishlinskii), and lags, which follow it and forget at all rates.

They are fitted to free runs, by Gauss-Newton steps from where the measured speed leads: with it in
the place of the predicted one the fit is linear, and has no other minimum. By its prior a curve is
a random walk from node to node, hence as uncertain beyond what was seen as it is far away; the
weights of a family are independent. The sizes of these priors are those under which the data are
likeliest (MacKay, "Bayesian interpolation", Neural Computation 4, 1992), so that what the data do
not ask for vanishes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.compiled import njit
from ldt_core.base.errors import LdtError
from ldt_core.estimation.motor_run import MotorRun
from ldt_core.estimation.noise import correlation_time

#: Nodes of a curve in the range seen, and of those as a part, beyond it on either side.
NODES = {"speed": 64, "current": 32}
BEYOND = 0.25
#: Half widths of the plays: in thirds of octaves down from half the range of speeds seen. One that
#: lies between two, taken as a mix of both, is off by a quarter of their distance at most, 6 % of
#: its width; of whole octaves it were 18 %. The narrowest is as wide as two nodes of the curve.
PLAYS, PLAYS_AN_OCTAVE = 16, 3
#: Time constants of the lags, in equal ratios from so many samples to a part of an experiment.
LAGS, FASTEST, SLOWEST = 5, 10, 0.25
#: Rows of a fit at most: longer experiments are averaged over as many neighbours as that takes.
ROWS = 4000
#: Steps, at least and at most, and halvings of one that does not help.
FEWEST_STEPS, STEPS, DAMPINGS = 8, 40, 12
#: Steps that are made before the residual is taken for what no remainder explains.
ROUGH_STEPS = 3
#: What a step has to raise the logarithm of the posterior by, a row, to be worth another one.
CONVERGED = 1e-3
#: Precision of a prior [s^4/rad^2]: of one of which nothing is known, and the limits.
FIRST, LEAST, MOST = 1e-6, 1e-9, 1e9


class CurveNodes(NamedTuple):
    """Nodes of a curve: the first, their distance, and their number."""

    low: float
    step: float
    nodes: int


@dataclass(frozen=True)
class RemainderShape:
    """What an acceleration is made of.

    Args:
        speed: nodes of the curve over the speed [rad/s].
        current: those over the current [A].
        plays: (p,) half widths [rad/s].
        lags: (q,) time constants [s].
        span: of the speeds seen, by which what a lag misses is measured [rad/s].
    """

    speed: CurveNodes
    current: CurveNodes
    plays: Array
    lags: Array
    span: float

    @property
    def size(self) -> int:
        """Number of weights."""
        return self.speed.nodes + self.current.nodes + self.plays.size + self.lags.size

    @classmethod
    def of(cls, runs: Sequence[MotorRun]) -> RemainderShape:
        """What fits the ranges of these experiments.

        Raises:
            LdtError: the machine stood still.
        """
        speeds = np.concatenate([r.speed for r in runs])
        span = float(np.ptp(speeds))
        if not span > 0:
            raise LdtError("remainder model: the speed never changes in what it is to learn from")
        longest = max(r.speed.size * r.period for r in runs)
        slowest = max(SLOWEST * longest, 2 * FASTEST * runs[0].period)
        return cls(
            _axis(speeds, NODES["speed"]),
            _axis(np.concatenate([_current(r) for r in runs]), NODES["current"]),
            span / 2 * np.exp2(-np.arange(PLAYS, dtype=np.float64) / PLAYS_AN_OCTAVE),
            np.geomspace(FASTEST * runs[0].period, slowest, LAGS),
            span,
        )

    def priors(self) -> list[tuple[slice, Array]]:
        """Which weights each prior is about, and the matrix that its precision multiplies."""
        found: list[tuple[slice, Array]] = []
        begin = 0
        for count in (self.speed.nodes, self.current.nodes):
            part = slice(begin, begin + count)
            found += [(part, _walk(count)), (part, np.eye(count) / count)]
            begin += count
        for count in (self.plays.size, self.lags.size):
            found.append((slice(begin, begin + count), np.eye(count)))
            begin += count
        return found


@dataclass(frozen=True)
class LearnedRemainder:
    """A fitted acceleration.

    Args:
        shape: what it is made of.
        weights: (n,) [rad/s^2].
        directions: (d, n) in which the weights are least known, by one deviation each [rad/s^2].
        noise_std: what its free runs leave [rad/s].
    """

    shape: RemainderShape
    weights: Array
    directions: Array
    noise_std: float


def _axis(values: Array, count: int) -> CurveNodes:
    low, high = float(values.min()), float(values.max())
    step = max(high - low, 1e-9) / (count - 1)
    beyond = math.ceil(BEYOND * count)
    return CurveNodes(low - beyond * step, step, count + 2 * beyond)


def _walk(count: int) -> Array:
    change = np.diff(np.eye(count), axis=0)
    return np.asarray(change.T @ change)


def free_run(
    shape: RemainderShape, weights: Array, run: MotorRun, thin: int = 0, led: bool = False
) -> tuple[Array, Array]:
    """Speed (L,) under an acceleration, and its derivatives by the weights.

    Args:
        thin: samples over which each row of the derivatives (L / thin, n) is a mean; 0 for none.
        led: whether the acceleration is that of the measured speed, not of the predicted one.
    """
    lead = run.speed if led else np.empty(0)
    return _run(
        *(run.ad, run.bd, run.gd, run.voltage, run.current, run.speed[0]),
        *(shape.speed, shape.current, shape.plays, 1 - np.exp(-run.period / shape.lags)),
        *(shape.span, weights, thin, lead),
    )


@njit()
def _current(run):  # pragma: no cover - compiled
    """(L,) current that the motor draws at the measured speed [A]."""
    found = np.empty(len(run.speed))
    i = run.current
    for k in range(len(found)):
        found[k] = i
        i = run.ad[0, 0] * i + run.ad[0, 1] * run.speed[k] + run.bd[0] * run.voltage[k]
    return found


@njit()
def _run(
    ad, bd, gd, voltage, i, w, speeds, currents, plays, rates, span, weights, thin, lead
):  # pragma: no cover - compiled
    """See `free_run`; `rates` (q,) is what a lag catches up in a sample."""
    samples, n, p, q = len(voltage), len(weights), len(plays), len(rates)
    rows = -(-samples // thin) if thin else 0
    first_play = speeds.nodes + currents.nodes
    speed, slopes = np.empty(samples), np.zeros((rows, n))
    loose, late, free = np.full(p, w), np.full(q, w), len(lead) == 0
    at_w, at_i = w, i
    di, dw, df = np.zeros(n), np.zeros(n), np.zeros(n)
    dloose, dlate = np.zeros((p, n)), np.zeros((q, n))
    for k in range(samples):
        speed[k] = w
        if thin:
            row, part = k // thin, 1.0 / min(thin, samples - k // thin * thin)
            for m in range(n):
                slopes[row, m] += part * dw[m]
                df[m] = 0.0
        force, by_w, by_i = 0.0, 0.0, 0.0
        if free:
            at_w, at_i = w, i
        else:
            at_w = lead[k]
        for axis, begin, x in ((speeds, 0, at_w), (currents, speeds.nodes, at_i)):
            at = min(max((x - axis.low) / axis.step, 0.0), axis.nodes - 1.0)
            c = min(int(at), axis.nodes - 2)
            t = at - c
            a, b = weights[begin + c], weights[begin + c + 1]
            force += (1 - t) * a + t * b
            df[begin + c], df[begin + c + 1] = 1 - t, t
            slope = (b - a) / axis.step if 0.0 < at < axis.nodes - 1.0 else 0.0
            if begin == 0:
                by_w += slope
            else:
                by_i += slope
        for j in range(p):
            weight, width = weights[first_play + j], plays[j]
            touches = abs(at_w - loose[j]) > width
            if touches:
                loose[j] = at_w - width if at_w > loose[j] else at_w + width
            ahead = (at_w - loose[j]) / width
            force += weight * ahead
            df[first_play + j] += ahead
            if thin and free and touches:  # as far ahead whatever the speed, which it follows
                for m in range(n):
                    dloose[j, m] = dw[m]
            elif thin and free:
                by_w += weight / width
                for m in range(n):
                    df[m] -= weight / width * dloose[j, m]
        for j in range(q):
            weight = weights[first_play + p + j]
            late[j] += rates[j] * (at_w - late[j])
            ahead = min(max((at_w - late[j]) / span, -1.0), 1.0)
            force += weight * ahead
            df[first_play + p + j] += ahead
            if thin and free:
                moving = weight / span if abs(ahead) < 1.0 else 0.0
                by_w += moving
                for m in range(n):
                    dlate[j, m] += rates[j] * (dw[m] - dlate[j, m])
                    df[m] -= moving * dlate[j, m]
        if thin:
            for m in range(n):
                dforce = df[m] + (by_w * dw[m] + by_i * di[m] if free else 0.0)
                ahead_i = ad[0, 0] * di[m] + ad[0, 1] * dw[m] + gd[0] * dforce
                dw[m] = ad[1, 0] * di[m] + ad[1, 1] * dw[m] + gd[1] * dforce
                di[m] = ahead_i
        if not free:
            at_i = ad[0, 0] * at_i + ad[0, 1] * at_w + bd[0] * voltage[k]
        i, w = (
            ad[0, 0] * i + ad[0, 1] * w + bd[0] * voltage[k] + gd[0] * force,
            ad[1, 0] * i + ad[1, 1] * w + bd[1] * voltage[k] + gd[1] * force,
        )
    return speed, slopes


class _Data:
    """Free runs over experiments, as the rows that a fit sees."""

    def __init__(self, runs: Sequence[MotorRun], held: Sequence[slice]) -> None:
        self.runs = runs
        self.thin = max(1, math.ceil(sum(r.speed.size for r in runs) / ROWS))
        kept = [np.ones(r.speed.size) for r in runs]
        for row, block in zip(kept, held, strict=True):
            row[block] = 0.0
        self.kept = np.concatenate([self._means(row) == 1.0 for row in kept])
        self.measured = np.concatenate([self._means(r.speed) for r in runs])

    def _means(self, row: Array) -> Array:
        edges = np.arange(0, row.size, self.thin)
        return np.asarray(np.add.reduceat(row, edges) / np.diff(np.append(edges, row.size)))

    def residual(self, shape: RemainderShape, weights: Array, led: bool) -> Array:
        """(rows,) measured minus predicted."""
        speeds = [self._means(free_run(shape, weights, r, 0, led)[0]) for r in self.runs]
        return np.asarray((self.measured - np.concatenate(speeds))[self.kept])

    def slopes(self, shape: RemainderShape, weights: Array, led: bool) -> Array:
        """(rows, n) derivatives of the prediction."""
        found = [free_run(shape, weights, r, self.thin, led)[1] for r in self.runs]
        return np.asarray(np.concatenate(found)[self.kept])


def fit_remainder(
    runs: Sequence[MotorRun], directions: int, held: Sequence[slice] = ()
) -> LearnedRemainder:
    """The acceleration under which free runs are nearest to these experiments.

    Args:
        runs: to learn from.
        directions: how many of the least known ones to keep.
        held: samples of each experiment that are not looked at.

    Raises:
        LdtError: the machine stood still, or numbers that overflow.
    """
    shape = RemainderShape.of(runs)
    search = _Search(shape, _Data(runs, held or [slice(0, 0)] * len(runs)))
    with np.errstate(all="ignore"):  # judged by isfinite
        try:
            search.run(led=True)
            search.run(led=False)
        except np.linalg.LinAlgError as error:
            raise LdtError(f"remainder model: the data determine nothing ({error})") from error
    weights = search.weights
    left = [r.speed - free_run(shape, weights, r)[0] for r in runs]
    noise = float(np.sqrt(np.mean(np.concatenate(left) ** 2)))
    values, vectors = np.linalg.eigh(search.covariance)
    widest = (vectors * np.sqrt(np.maximum(values, 0.0))).T[-directions:]
    if not (np.isfinite(widest).all() and np.isfinite(noise)):
        raise LdtError("remainder model: the data are too large to compute with")
    return LearnedRemainder(shape, weights, widest, noise)


class _Search:
    """Weights and priors under which the data are likeliest.

    Attributes:
        weights: (n,) the best so far.
        sizes: precision of each of the priors.
        covariance: (n, n) of the weights.
    """

    def __init__(self, shape: RemainderShape, data: _Data) -> None:
        self.shape, self.data = shape, data
        self.priors = shape.priors()
        self.sizes = np.full(len(self.priors), FIRST)
        self.weights = np.zeros(shape.size)
        self.covariance: Array = np.eye(shape.size)

    def run(self, led: bool) -> None:
        """Go on from the weights so far; `led` as for `free_run`.

        Raises:
            LdtError: too few samples, or numbers that overflow.
        """
        rest = self.data.residual(self.shape, self.weights, led)
        plain = self.data.residual(self.shape, np.zeros(self.shape.size), led)
        if not float(rest @ rest) < float(plain @ plain):
            self.weights, rest = np.zeros(self.shape.size), plain
        if rest.size < len(self.priors) or not np.isfinite(rest).all():
            raise LdtError("remainder model: too few samples to learn from, or absurd ones")
        variance, memory, slopes = float(np.mean(rest**2)), 1.0, None
        for step in range(STEPS):
            if slopes is None or not led:
                slopes = self.data.slopes(self.shape, self.weights, led)
                square = slopes.T @ slopes
            # Neighbours of a residual with a memory tell less than as many independent ones.
            memory = correlation_time(rest) if step > ROUGH_STEPS else memory
            known = 1.0 / max(variance * memory, 1e-300)
            moved = self._moved(rest, slopes, square, known, led)
            if moved is None:
                return
            rest, gained = moved
            told = self._resize()
            variance = float(rest @ rest) / max(rest.size - told, 1.0)
            if step >= FEWEST_STEPS and gained < CONVERGED * rest.size:
                return

    def _moved(
        self, rest: Array, slopes: Array, square: Array, known: float, led: bool
    ) -> tuple[Array, float] | None:
        """A step that helps: the residual, and the gain in twice the logarithm of the posterior."""
        prior = self._prior()
        precision = known * square + prior
        self.covariance = np.asarray(np.linalg.inv(precision), dtype=np.float64)
        uphill = known * (slopes.T @ rest) - prior @ self.weights
        before = known * (rest @ rest) + self.weights @ prior @ self.weights
        damping, step = 0.0, np.asarray(self.covariance @ uphill)
        for _ in range(DAMPINGS):
            tried = self.weights + step
            left = self.data.residual(self.shape, tried, led)
            after = known * (left @ left) + tried @ prior @ tried
            if np.isfinite(after) and after < before:
                self.weights = tried
                return left, float(before - after)
            damping = max(10 * damping, 1e-6)
            damped = precision + damping * np.diag(np.diag(precision))
            step = np.asarray(np.linalg.solve(damped, uphill))
        return None

    def _prior(self) -> Array:
        whole = np.zeros((self.shape.size, self.shape.size))
        for size, (part, matrix) in zip(self.sizes, self.priors, strict=True):
            whole[part, part] += size * matrix
        return whole

    def _resize(self) -> float:
        """Take the priors that make the data likelier; how many weights the data determine."""
        prior, told, found = self._prior(), 0.0, np.empty(len(self.priors))
        for j, (part, matrix) in enumerate(self.priors):
            gained = np.linalg.inv(prior[part, part]) - self.covariance[part, part]
            determined = self.sizes[j] * float(np.sum(gained * matrix))
            told += (determined := max(determined, LEAST))
            weights = self.weights[part]
            size = determined / max(float(weights @ matrix @ weights), LEAST)
            found[j] = min(max(size, LEAST), MOST)
        self.sizes = found
        return told
