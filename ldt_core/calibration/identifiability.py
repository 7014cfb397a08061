"""What a recording determines of the parameters, and how well.

The sensitivities of the free run to the logarithms of the parameters (start states projected out,
in noise deviations) are compressed to their triangle R (p, p). The largest well-conditioned set of
columns is called determined; every other parameter then either moves the free run only as some of
the determined ones do (a group, with exponents) or not at all. The statement is local: it is made
at the machine file's values and again at the fitted ones. Reference: Brun, Reichert, Kuensch,
"Practical identifiability analysis of large environmental simulation models", Water Resources
Research 37, 2001.

Standard errors hold when residuals are not white. With several experiments, each is one independent
draw: the leave-one-experiment-out (jackknife, CV3) form of the cluster-robust sandwich, with G - 1
degrees of freedom (MacKinnon, Nielsen, Webb, "Fast and reliable jackknife and bootstrap methods for
cluster-robust inference", J. Applied Econometrics 38, 2023). With few experiments, or when one of
them holds nearly all that is known of a direction, the residual is taken as a stationary process
(`autocovariance`), whose covariance fills the sandwich; the degrees of freedom are the number of
samples over the correlation time.

Either way the interval covers what a longer record of the same kind would give. It does not cover
a physics that lacks something: then the parameters are those that imitate it best.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import matmul_toeplitz
from scipy.special import stdtrit

from ldt_core.base.arrays import Array
from ldt_core.base.experiment import Experiment
from ldt_core.calibration.autocovariance import autocovariance
from ldt_core.estimation.noise import white_noise

NORMAL_95 = 1.959964  # standard deviations of a normal law on either side that hold 95 % of it
MOST_ERROR = 0.25  # standard error of a logarithm: 95 % lie within a factor of 1.6 either way
EXACT_TOLERANCE = 1e-6  # of the largest singular value: rounding of difference quotients
INTEGRATED_TOLERANCE = 1e-3  # of the same, where sensitivities are differences of integrated runs
LEAST_EXPONENT = 0.01  # below which a parameter has no part in a group
PRINTED_EXPONENT = 0.05  # below which it is left out of a product that is printed
ONE_PRODUCT = 1.0  # sum of squared exponents that is no worse than one product of two parameters
WHOLE_NUMBER = 0.1  # an exponent this near to a whole number is written as that
FEWEST_CLUSTERS = 8  # experiments from which their scatter says more than a model of the noise
LEFT_WITHOUT_ONE = 0.1  # of the information on a direction, at least, when one is left out
LEAST_FREEDOM = 3.0  # degrees of freedom: below, Student's t has no variance
COLOURED = 1.2  # of white noise as rough: what a diagnosis lets noise change beyond what it saw
RIDGE = 1e-14  # of the information: rounding, so that a direction without any can be inverted


@dataclass(frozen=True)
class Identifiability:
    """What the recordings determine.

    Attributes:
        names: (p,) the parameters examined.
        determined: the largest set that can be fitted together.
        groups: for each other parameter that shows, the exponents c of the determined ones: if it
            were 1 % larger, the same free run would need each of them c per cent larger.
        silent: parameters that do not show at all.
    """

    names: tuple[str, ...]
    determined: tuple[str, ...]
    groups: dict[str, dict[str, float]]
    silent: tuple[str, ...]

    def with_settled(self, names: Collection[str]) -> Identifiability:
        """The same, with parameters counted as determined because they ended on their bounds."""
        return replace(
            self,
            determined=tuple(n for n in self.names if n in self.determined or n in names),
            groups={n: c for n, c in self.groups.items() if n not in names},
            silent=tuple(n for n in self.silent if n not in names),
        )

    @property
    def unsure(self) -> set[str]:
        """Parameters whose values hang on those of others, or that do not show."""
        return {n for cluster in self.clusters for n in cluster}

    @property
    def clusters(self) -> list[list[str]]:
        """Parameters that cannot be told apart, each group once; silent ones alone."""
        sets: list[set[str]] = []
        for name, exponents in self.groups.items():
            new = {name, *exponents}
            for other in [s for s in sets if s & new]:
                sets.remove(other)
                new |= other
            sets.append(new)
        ordered = [[n for n in self.names if n in s] for s in sets]
        return ordered + [[n] for n in self.silent]

    @property
    def products(self) -> list[str]:
        """What is determined of the groups: products of powers, "J R^2 / K_t"."""
        found = []
        for name in self.determined:
            powers = {name: 1.0}
            powers |= {
                x: -c[name]
                for x, c in self.groups.items()
                if abs(c.get(name, 0)) > PRINTED_EXPONENT
            }
            if len(powers) > 1:
                found.append(product(powers))
        return found


def identifiability(
    names: Sequence[str],
    sensitivities: Array,
    exact: bool = True,
    prefer: Collection[str] = (),
) -> Identifiability:
    """Find the largest determined set.

    Among sets of equal size it is the one whose members would suffer least from wrong values of the
    parameters left out.

    Args:
        names: (p,) parameters.
        sensitivities: (N, p) change of the free run per coordinate, in noise deviations.
        exact: whether they come from an exact solution, so that small ones count.
        prefer: a set to stay with as long as it is determined and none is larger.
    """
    tolerance = EXACT_TOLERANCE if exact else INTEGRATED_TOLERANCE
    triangle: Array = np.asarray(np.linalg.qr(sensitivities, mode="r"))
    size = np.linalg.norm(triangle, axis=0)
    loud = [
        j
        for j in range(len(names))
        if size[j] * MOST_ERROR > 1 and size[j] > tolerance * size.max()
    ]
    chosen: tuple[int, ...] = ()
    for count in range(len(loud), 0, -1):
        sets = [
            s
            for s in itertools.combinations(loud, count)
            if _errors(triangle[:, s], tolerance).max() <= MOST_ERROR
        ]
        if sets:
            kept = tuple(j for j in loud if names[j] in prefer)
            best = min(sets, key=lambda s: _price(triangle, loud, s, tolerance))
            chosen = kept if kept in sets else best
            break
    groups, silent = {}, []
    for j in sorted(set(range(len(names))) - set(chosen)):
        c = _shares(triangle[:, chosen], triangle[:, j], tolerance) if j in loud else np.zeros(0)
        shares = zip(chosen, -c, strict=False)
        exponents = {names[i]: float(share) for i, share in shares if abs(share) > LEAST_EXPONENT}
        if exponents:
            groups[names[j]] = exponents
        else:
            silent.append(names[j])
    determined = tuple(names[j] for j in chosen)
    return Identifiability(tuple(names), determined, groups, tuple(silent))


def _errors(columns: Array, tolerance: float) -> Array:
    """Standard errors in a set of columns; infinite when they depend on each other."""
    _, s, right = np.linalg.svd(columns, full_matrices=False)
    if s[-1] <= tolerance * s[0]:
        return np.full(columns.shape[1], math.inf)
    return np.sqrt(np.sum((right / s[:, None]) ** 2, axis=0))


def _price(
    triangle: Array, loud: Sequence[int], chosen: tuple[int, ...], tolerance: float
) -> tuple[float, float]:
    """What fixing the others costs: how far wrong values of theirs would move the chosen ones, then
    how uncertain these are. In decades, so that of equals those listed first are free.
    """
    others = [j for j in loud if j not in chosen]
    shares = _shares(triangle[:, chosen], triangle[:, others], tolerance)
    errors = _errors(triangle[:, chosen], tolerance)
    suffering = max(float(np.sum(shares**2)), ONE_PRODUCT)
    return round(math.log10(suffering)), round(math.log10(float(np.sum(errors**2))), 1)


def _shares(basis: Array, column: Array, tolerance: float) -> Array:
    return np.asarray(np.linalg.lstsq(basis, column, rcond=tolerance)[0], dtype=np.float64)


def product(powers: dict[str, float]) -> str:
    """A product of powers in words: {"J": 1, "R": 1, "K_t": -2} is "J R / K_t^2"."""
    above = " ".join(_power(n, p) for n, p in powers.items() if p > 0)
    below = " ".join(_power(n, -p) for n, p in powers.items() if p < 0)
    return f"{above} / {below}" if below else above


def _power(name: str, exponent: float) -> str:
    shown = _shown(exponent)
    return name if shown == "1" else f"{name}^{shown}"


def _shown(exponent: float) -> str:
    whole = round(exponent)
    return str(whole) if whole and abs(exponent - whole) < WHOLE_NUMBER else f"{exponent:.2g}"


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
        """(p,) standard errors; infinite where rounding has left nothing of a variance."""
        variances = np.diag(self.covariance)
        return np.sqrt(np.where(variances < 0, np.inf, variances))

    @property
    def half_widths(self) -> Array:
        """(p,) half of the 95 % intervals."""
        return self.quantile * self.errors

    @property
    def quantile(self) -> float:
        """Half of a 95 % interval, in standard errors."""
        return float(stdtrit(self.freedom, 0.975))


def uncertainty(
    sensitivities: Sequence[Array],
    residuals: Sequence[Array],
    lengths: Sequence[int],
    unknowns: int,
    prior: Array | None = None,
) -> Uncertainty:
    """Covariance of the estimate.

    Args:
        sensitivities: a (rows, p) for each experiment, start states eliminated.
        residuals: a (rows,) for each, at the fit: speed, current if measured, start states.
        lengths: samples of each experiment.
        unknowns: start states that were estimated, all experiments together.
        prior: (p, p) precision of what was known beforehand, None for nothing.
    """
    information = [s.T @ s for s in sensitivities]
    total = np.sum(information, axis=0)
    if prior is not None:
        total = total + prior
    if not total.size:
        return Uncertainty(total, LEAST_FREEDOM, "none: every free parameter ended on a bound")
    if not total.any():
        unknown = np.diag(np.full(len(total), np.inf))
        return Uncertainty(unknown, LEAST_FREEDOM, "none: nothing moves what was measured")
    total += RIDGE * np.diag(total).max() * np.eye(len(total))
    if len(sensitivities) >= FEWEST_CLUSTERS and _spread_out(information, total):
        scores = [s.T @ r for s, r in zip(sensitivities, residuals, strict=True)]
        moved = np.array(
            [-np.linalg.solve(total - h, g) for h, g in zip(information, scores, strict=True)]
        )
        moved -= moved.mean(axis=0)
        count = len(moved)
        covariance = (count - 1) / count * moved.T @ moved
        if prior is not None:
            covariance += np.linalg.solve(total, np.linalg.solve(total, prior).T)
        return Uncertainty(covariance, count - 1, f"cluster-robust over {count} experiments")
    spread = _stationary(sensitivities, residuals, lengths, unknowns, total)
    if prior is None:
        return spread
    beforehand = np.linalg.solve(total, np.linalg.solve(total, prior).T)
    return replace(spread, covariance=spread.covariance + beforehand)


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
    methods, freedom = [], math.inf
    for channel in range(2):
        parts = _of_channel(channel, residuals, lengths)
        if not parts:
            continue
        samples = sum(len(r) for r in parts)
        longest = max(len(r) for r in parts)
        found = autocovariance(parts, longest)
        covariance = found.values
        time = max(1.0, 2 * float(covariance.sum() / covariance[0]) - 1) if covariance[0] else 1.0
        effective = samples / time
        left = max(effective - p - (unknowns if channel == 0 else 0), effective / 2)
        covariance *= effective / left  # the fit has taken its share of the slow part of the noise
        methods.append(found.method)
        freedom = min(freedom, left)
        for s in _of_channel(channel, sensitivities, lengths):
            meat += s.T @ matmul_toeplitz(covariance[: len(s)], s, check_finite=False)
    inverse = np.linalg.inv(total)
    words = ", ".join(methods)
    return Uncertainty(
        inverse @ meat @ inverse, max(freedom, LEAST_FREEDOM), f"stationary residual, {words}"
    )


def _of_channel(channel: int, rows: Sequence[Array], lengths: Sequence[int]) -> list[Array]:
    """Of each experiment the rows of the speed (0) or of the current (1), where measured."""
    return [
        r[channel * length : (channel + 1) * length]
        for r, length in zip(rows, lengths, strict=True)
        if len(r) >= (channel + 1) * length
    ]


def coloured(
    noise: Mapping[str, float], residuals: Sequence[Array], experiments: Sequence[Experiment]
) -> dict[str, tuple[float, float]]:
    """The channels whose noise is stronger at low frequencies, and by how much.

    Args:
        noise: deviation of what is left of the speed, and of the current where it was measured.
        residuals: a (rows,) for each experiment, in such deviations, as of `uncertainty`.

    Returns:
        By name, the deviations of two white noises: of the one that is as rough as the residuals,
        and of the one that has as much power at the lowest frequencies.
    """
    found, lengths = {}, [len(e) for e in experiments]
    for channel, (name, size) in enumerate(noise.items()):
        parts = _of_channel(channel, residuals, lengths)
        process = autocovariance(parts, max(lengths))
        covariance = process.values
        white = size * white_noise(parts)
        slow = size * math.sqrt(max(2 * float(covariance.sum()) - float(covariance[0]), 0.0))
        if not process.white and slow > COLOURED * white > 0:
            found[name] = white, slow
    return found
