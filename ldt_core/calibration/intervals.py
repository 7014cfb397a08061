"""Standard errors that hold when residuals are not white.

With several experiments, each is one independent draw: the leave-one-experiment-out (jackknife,
CV3) form of the cluster-robust sandwich, with G - 1 degrees of freedom. It assumes nothing about
the residual within an experiment. MacKinnon, Nielsen, Webb, "Fast and reliable jackknife and
bootstrap methods for cluster-robust inference", J. Applied Econometrics 38, 2023.

With few experiments, or when one of them holds nearly all that is known of a direction: the
residual is taken as a stationary autoregressive process, whose covariance fills the sandwich; the
degrees of freedom are the number of samples over the correlation time.

Either way the interval covers what a longer record of the same kind would give. It does not cover
a physics that lacks something: then the parameters are those that imitate it best.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import matmul_toeplitz
from scipy.special import stdtrit

from ldt_core.base.arrays import Array

FEWEST_CLUSTERS = 8  # experiments from which their scatter says more than a model of the noise
LEFT_WITHOUT_ONE = 0.1  # of the information on a direction, at least, when one is left out
MOST_ORDER = 20  # of the autoregression: its memory in samples
LEAST_FREEDOM = 3.0  # degrees of freedom: below, Student's t has no variance
RIDGE = 1e-14  # of the information: rounding, so that a direction without any can be inverted


@dataclass(frozen=True)
class Uncertainty:
    """Covariance (p, p) of the fitted coordinates, degrees of freedom of Student's t, method in
    words.
    """

    covariance: Array
    freedom: float
    method: str

    def among(self, inside: Sequence[bool]) -> Uncertainty:
        """The same, with further coordinates between them that lie on a bound and do not vary."""
        at = np.flatnonzero(inside)
        covariance = np.zeros((len(inside), len(inside)))
        covariance[np.ix_(at, at)] = self.covariance
        return Uncertainty(covariance, self.freedom, self.method)

    @property
    def errors(self) -> Array:
        """(p,) standard errors."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def half_widths(self) -> Array:
        """(p,) half of the 95 % intervals."""
        return float(stdtrit(self.freedom, 0.975)) * self.errors


def uncertainty(
    sensitivities: Sequence[Array],
    residuals: Sequence[Array],
    lengths: Sequence[int],
    unknowns: int,
) -> Uncertainty:
    """Covariance of the estimate.

    Args:
        sensitivities: a (rows, p) for each experiment, start states eliminated.
        residuals: a (rows,) for each, at the fit: speed, current if measured, start states.
        lengths: samples of each experiment.
        unknowns: start states that were estimated, all experiments together.
    """
    information = [s.T @ s for s in sensitivities]
    total = np.sum(information, axis=0)
    if not total.size:
        return Uncertainty(total, LEAST_FREEDOM, "none: every free parameter ended on a bound")
    total += RIDGE * np.diag(total).max() * np.eye(len(total))
    if len(sensitivities) >= FEWEST_CLUSTERS and _spread_out(information, total):
        scores = [s.T @ r for s, r in zip(sensitivities, residuals, strict=True)]
        moved = np.array(
            [-np.linalg.solve(total - h, g) for h, g in zip(information, scores, strict=True)]
        )
        moved -= moved.mean(axis=0)
        count = len(moved)
        covariance = (count - 1) / count * moved.T @ moved
        return Uncertainty(covariance, count - 1, f"cluster-robust over {count} experiments")
    return _stationary(sensitivities, residuals, lengths, unknowns, total)


def _spread_out(information: Sequence[Array], total: Array) -> bool:
    root = np.linalg.inv(np.linalg.cholesky(total))
    return all(
        np.linalg.eigvalsh(root @ h @ root.T)[-1] < 1 - LEFT_WITHOUT_ONE for h in information
    )


def _stationary(
    sensitivities: Sequence[Array],
    residuals: Sequence[Array],
    lengths: Sequence[int],
    unknowns: int,
    total: Array,
) -> Uncertainty:
    p = total.shape[0]
    meat = np.zeros((p, p))
    orders, freedom = [], math.inf
    for channel in range(2):
        parts = []
        for s, r, length in zip(sensitivities, residuals, lengths, strict=True):
            if len(r) >= (channel + 1) * length:
                cut = slice(channel * length, (channel + 1) * length)
                parts.append((s[cut], r[cut]))
        if not parts:
            continue
        samples = sum(len(r) for _, r in parts)
        longest = max(len(r) for _, r in parts)
        covariance, order = _autocovariance([r for _, r in parts], longest)
        time = max(1.0, 2 * float(covariance.sum() / covariance[0]) - 1) if covariance[0] else 1.0
        effective = samples / time
        left = max(effective - p - (unknowns if channel == 0 else 0), effective / 2)
        covariance *= effective / left  # the fit has taken its share of the slow part of the noise
        orders.append(order)
        freedom = min(freedom, left)
        for s, _ in parts:
            meat += s.T @ _correlate(s, covariance[: len(s)])
    inverse = np.linalg.inv(total)
    words = ", ".join(f"AR({o})" for o in orders)
    return Uncertainty(
        inverse @ meat @ inverse, max(freedom, LEAST_FREEDOM), f"stationary residual, {words}"
    )


def _autocovariance(residuals: Sequence[Array], longest: int) -> tuple[Array, int]:
    """(longest,) autocovariance of the autoregression that fits the residuals, and its order."""
    samples = sum(len(r) for r in residuals)
    lags = max(1, min(MOST_ORDER, samples // 10, min(len(r) for r in residuals) - 1))
    found = np.array(
        [sum(float(r[: len(r) - k] @ r[k:]) for r in residuals) / samples for k in range(lags + 1)]
    )
    best, chosen, variance = samples * math.log(max(found[0], 1e-300)), np.zeros(0), found[0]
    weights = np.zeros(0)
    for order in range(1, lags + 1):  # Levinson-Durbin, so that each order is stable
        if variance <= 0:
            break
        reflection = (found[order] - weights @ found[order - 1 : 0 : -1]) / variance
        weights = np.append(weights - reflection * weights[::-1], reflection)
        variance *= 1 - reflection**2
        criterion = samples * math.log(max(variance, 1e-300)) + math.log(samples) * order
        if criterion < best:
            best, chosen = criterion, weights.copy()
    full = np.zeros(max(longest, lags + 1))
    full[: lags + 1] = found
    if not chosen.size:
        full[1:] = 0.0
        return full[:longest], 0
    for k in range(chosen.size + 1, full.size):
        full[k] = chosen @ full[k - 1 : k - 1 - chosen.size : -1]
    return full[:longest], chosen.size


def _correlate(columns: Array, covariance: Array) -> Array:
    """The Toeplitz matrix of the covariance times the columns: (L, p)."""
    return matmul_toeplitz(covariance, columns, check_finite=False)
