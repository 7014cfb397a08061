"""The learned acceleration (`remainder_run`) under which free runs are nearest to experiments.

Gauss-Newton steps begin where the measured speed leads: with it in the place of the predicted one
the fit is linear, and has no other minimum. Where the free run stays far from what that reaches, as
of a loop that feeds back its own error, there are other ways to it, and the likeliest fit is taken.

By its prior a curve is a random walk from node to node, hence as uncertain beyond what was seen as
it is far away; the weights of a family are independent. The sizes of these priors are those under
which the data are likeliest (MacKay, "Bayesian interpolation", Neural Computation 4, 1992), so that
what the data do not ask for vanishes.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import rms
from ldt_core.estimation.misfit import EXPLAINED
from ldt_core.estimation.motor_run import MotorRun
from ldt_core.estimation.noise import correlation_time
from ldt_core.estimation.remainder_run import RemainderShape, free_run

#: Rows of a fit at most: longer experiments are averaged over as many neighbours as that takes.
ROWS = 4000
#: Steps, at least and at most, and halvings of one that does not help.
FEWEST_STEPS, STEPS, DAMPINGS = 8, 40, 12
#: Steps that are made before the residual is taken for what no remainder explains.
ROUGH_STEPS = 3
#: What a step has to raise the logarithm of the posterior by, a row, to be worth another one.
CONVERGED = 1e-3
#: Stages of a fit behind the one that is led: the part of the measured speed in what the
#: acceleration depends on; the rest is the predicted one. By halves, and from zero, are for where
#: the first way stays far from what is led: of 28 such fits, to a measured motor and a rotor, 11
#: were likeliest by the first, 9 by halves.
AT_ONCE, BY_HALVES = (0.0,), (0.5, 0.0)
#: Precision of a prior [s^4/rad^2]: of one of which nothing is known, and the limits.
FIRST, LEAST, MOST = 1e-6, 1e-9, 1e9


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

    def residual(self, shape: RemainderShape, weights: Array, led: float) -> Array:
        """(rows,) measured minus predicted."""
        speeds = [self._means(free_run(shape, weights, r, 0, led)[0]) for r in self.runs]
        return np.asarray((self.measured - np.concatenate(speeds))[self.kept])

    def slopes(self, shape: RemainderShape, weights: Array, led: float) -> Array:
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
    data = _Data(runs, held or [slice(0, 0)] * len(runs))
    with np.errstate(all="ignore"):  # judged by isfinite
        try:
            search = _likeliest(shape, data)
        except np.linalg.LinAlgError as error:
            raise LdtError(f"remainder model: the data determine nothing ({error})") from error
    weights = search.weights
    left = [r.speed - free_run(shape, weights, r)[0] for r in runs]
    noise = rms(np.concatenate(left))
    values, vectors = np.linalg.eigh(search.covariance)
    widest = (vectors * np.sqrt(np.maximum(values, 0.0))).T[-directions:]
    if not (np.isfinite(widest).all() and np.isfinite(noise)):
        raise LdtError("remainder model: the data are too large to compute with")
    return LearnedRemainder(shape, weights, widest, noise)


def _likeliest(shape: RemainderShape, data: _Data) -> _Search:
    """The fit that begins where the measured speed leads; where it stays far from what that
    reaches, the likeliest of several.

    Raises:
        LdtError, LinAlgError: as for `_Search.run`.
    """
    led, zero = _Search(shape, data), _Search(shape, data)
    led.run(1.0)
    reached = data.residual(shape, led.weights, 1.0)
    found = []
    for start, stages in ((led, AT_ONCE), (led, BY_HALVES), (zero, AT_ONCE)):
        search = copy.copy(start)
        for part in stages:
            search.run(part)
        found.append(search)
        rest, count = search.left()
        ratio = float(rest @ rest) / max(float(reached @ reached), 1e-300)
        # What is led is the best of this shape: another fit can gain no more likelihood than that.
        if not count / 2 * math.log(max(ratio, 1e-300)) > math.log(EXPLAINED):
            break
    return max(found, key=_Search.evidence) if len(found) > 1 else found[0]


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

    def run(self, led: float) -> None:
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
            if slopes is None or led < 1:
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

    def left(self) -> tuple[Array, float]:
        """What the free run leaves (rows,), and as how many independent rows that counts."""
        rest = self.data.residual(self.shape, self.weights, 0.0)
        return rest, rest.size / correlation_time(rest)

    def evidence(self) -> float:
        """Logarithm of the likelihood of the free run under these priors, by Laplace's method."""
        (rest, count), prior = self.left(), self._prior()
        spread = np.linalg.slogdet(prior)[1] + np.linalg.slogdet(self.covariance)[1]
        fit = -count * math.log(max(float(np.mean(rest**2)), 1e-300))
        found = (fit - self.weights @ prior @ self.weights + spread) / 2
        return float(found) if np.isfinite(found) else -math.inf

    def _moved(
        self, rest: Array, slopes: Array, square: Array, known: float, led: float
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
