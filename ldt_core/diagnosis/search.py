"""Which set of effects explains the residuals: simulated shapes first, then fits.

Every candidate is simulated at the values its search starts with. The responses, all of the same
residuals, are columns; how well any one, two or three of them together explain the residual needs
only their inner products, so every pair is tried, also of effects that explain nothing alone. The
best sets are then fitted with all their parameters by nonlinear least squares.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ldt_core.base.threads import spread
from ldt_core.diagnosis.candidate import Candidate
from ldt_core.diagnosis.starts import Starts, turns
from ldt_core.diagnosis.trials import COARSE, Bench, Used

Array = NDArray[np.float64]
T = TypeVar("T")

DIFFERENCE = 1e-3  # of a coordinate, for difference quotients
AWAY = 4  # steps from the start before its states are sought again
NOTABLY = 0.3  # by which a response is scaled for that to be another start
EVALUATIONS = 12  # steps of one fit
TURNS = 4  # times that start angles are sought for what a fit has found, until
STILL = 0.02  # of the sum of squares is all that one more gains
WORTH_AN_ANGLE = 12.0  # fall of the sum of squares for each experiment's own start angle
PRECISION = 1e-5  # of the sum of squares: a step that gains less was the last
SHRINK, STRETCH = (
    0.02,
    4.0,
)  # how far a response may be scaled: small ones are alike, large ones not


@dataclass(frozen=True, eq=False)
class Fit:
    """A set of effects, fitted.

    Attributes:
        members: its candidates, then those of the machine's own parameters that are fitted with it.
        z: their coordinates, one array each.
        rest: (size,) residuals that it leaves, in noise deviations.
        jacobian: (size, p) change of the residuals per coordinate.
        loss: sum of squares of `rest`.
        own: how many of the members are the machine's own parameters.
        starts: states at the first samples.
    """

    members: tuple[Candidate, ...]
    z: tuple[Array, ...]
    rest: Array
    jacobian: Array
    loss: float
    own: int = 0
    starts: Starts | None = None

    @property
    def effects(self) -> tuple[Candidate, ...]:
        """The set itself."""
        return self.members[: len(self.members) - self.own]

    @property
    def names(self) -> tuple[str, ...]:
        """Of the set itself."""
        return tuple(c.name for c in self.effects)

    @property
    def use(self) -> list[Used]:
        """The effects with all their values, as a simulation takes them."""
        return used(self.members, self.z)

    @property
    def free(self) -> int:
        """Parameters fitted."""
        return sum(len(c) for c in self.effects)


def used(members: Sequence[Candidate], z: Sequence[Array]) -> list[Used]:
    """Effects with all their values, as a simulation takes them."""
    return [(c.effect, c.given(part)) for c, part in zip(members, z, strict=True)]


def split(members: Sequence[Candidate], z: Array) -> tuple[Array, ...]:
    """A row of coordinates, an array for each member."""
    edges = np.cumsum([len(c) for c in members])[:-1]
    return tuple(np.split(z, edges))


def fit(
    bench: Bench,
    members: Sequence[Candidate],
    start: Sequence[Array],
    step: float = COARSE,
    evaluations: int = EVALUATIONS,
    precision: float = PRECISION,
    own: int = 0,
    known: Starts | None = None,
) -> Fit:
    """Least squares of a set's parameters, from a start.

    Args:
        bench: experiments to fit.
        members: the set, then the machine's own parameters.
        start: coordinates of each.
        step: longest integration step [s].
        evaluations: steps, at most.
        precision: part of the sum of squares; a step that gains less was the last.
        own: how many members are the machine's own parameters.
        known: states at the first samples, nearly, if an earlier fit has found them.
    """
    members = tuple(members)
    low = np.concatenate([c.bounds[0] for c in members])
    high = np.concatenate([c.bounds[1] for c in members])

    starts = [bench.starts]

    def rest(z: Array) -> Array:
        return bench.rest(used(members, split(members, z)), step, starts[0])

    last: dict[str, Array] = {}

    def jacobian(z: Array) -> Array:
        base = last["rest"] if np.array_equal(last.get("z", z * np.nan), z) else rest(z)
        columns = np.empty((bench.size, z.size))
        for j in range(z.size):
            moved = z.copy()
            moved[j] += DIFFERENCE if z[j] + DIFFERENCE <= high[j] else -DIFFERENCE
            columns[:, j] = (rest(moved) - base) / (moved[j] - z[j])
        return columns

    def remembered(z: Array) -> Array:
        last["rest"], last["z"] = rest(z), z.copy()
        return last["rest"]

    def descend(z: Array, count: int) -> tuple[Array, Array, Array]:
        solved = least_squares(
            remembered,
            np.clip(z, low + margin, high - margin),
            jacobian,
            bounds=(low, high),
            ftol=precision,
            xtol=1e-6,
            gtol=1e-8,
            max_nfev=count,
        )
        return solved.x, solved.fun, solved.jac

    def settled(z: Array, free: bool = False, near: Starts | None = None) -> Starts:
        return bench.settle(used(members, split(members, z)), free, step, near)

    margin = 1e-7 * np.maximum(1.0, np.minimum(high - low, 1.0))
    first = np.clip(np.concatenate(start), low + margin, high - margin)
    starts[0] = settled(first, near=known)
    if starts[0] is bench.starts:
        z, left, slopes = descend(first, evaluations)
    else:
        quick = bench.shaking and precision > PRECISION  # nearly the right angles will do
        z = first if quick else descend(first, AWAY)[0]
        starts[0] = starts[0] if quick else settled(z, near=known)
        z, left, slopes = descend(z, evaluations)
    sought = bench.shaking or not any(p.rest for p in bench.pieces)
    if not sought and turns(bench, used(members, split(members, z))):
        shared, kept = (z, left, slopes), starts[0]
        before = math.inf
        for turn in range(TURNS):
            starts[0] = settled(z, free=True, near=starts[0] if turn else None)
            z, left, slopes = descend(z, evaluations // 2)
            if float(left @ left) > (1 - STILL) * before:
                break
            before = float(left @ left)
        gain = float(shared[1] @ shared[1] - left @ left)
        if gain < len(bench.pieces) * WORTH_AN_ANGLE:
            (z, left, slopes), starts[0] = shared, kept
    return Fit(members, split(members, z), left, slopes, float(left @ left), own, starts[0])


@dataclass(frozen=True, eq=False)
class Dictionary:
    """Responses of all candidates at their starts.

    Attributes:
        candidates: in order.
        owner: (K,) place of each response's candidate.
        z: coordinates of each response.
        responses: (K, size) what each takes off the residual.
        gram: (K, K) inner products of the responses.
        base: (size,) residual without any effect.
    """

    candidates: tuple[Candidate, ...]
    owner: NDArray[np.int64]
    z: list[Array]
    responses: Array
    gram: Array
    base: Array

    @functools.cached_property
    def cosine(self) -> Array:
        """(K, K) inner products of the responses, each scaled to length 1."""
        return np.asarray(self.gram / np.outer(self.length, self.length))

    @functools.cached_property
    def length(self) -> Array:
        """(K,) of the responses."""
        return np.sqrt(np.maximum(np.diag(self.gram), 1e-12))

    @property
    def target(self) -> Array:
        """(K,) inner products of the responses with the residual."""
        return np.asarray(self.responses @ self.base)


def simulate_all(
    bench: Bench,
    candidates: Sequence[Candidate],
    tick: Callable[[], None] = lambda: None,
    own: Fit | None = None,
    workers: int = 1,
) -> Dictionary:
    """Simulate every candidate at its starts; responses that do not show are left out.

    Args:
        bench: experiments.
        candidates: effects.
        tick: called after each simulation.
        own: the machine's own parameters as fitted, whose directions are projected out.
        workers: threads among which the candidates are spread.
    """
    given = own.use if own else []
    base = bench.rest(given)
    span = np.linalg.qr(own.jacobian)[0] if own else np.zeros((bench.size, 0))
    owner, z = [], []
    for i, c in enumerate(candidates):
        starts = c.starts()
        owner += [i] * len(starts)
        z += starts
    rows = np.empty((len(z), bench.size))

    def fill(k: int) -> None:
        c = candidates[owner[k]]
        rows[k] = base - bench.rest([(c.effect, c.given(z[k])), *given])

    for _ in spread(fill, len(z), workers):
        tick()
    rows -= (rows @ span) @ span.T
    shown = np.flatnonzero(np.einsum("ij,ij->i", rows, rows) > 1e-12)
    rows = rows[shown]
    return Dictionary(
        tuple(candidates),
        np.array(owner, dtype=np.int64)[shown],
        [z[k] for k in shown],
        rows,
        rows @ rows.T,
        base,
    )


def best_alone(d: Dictionary, i: int, count: int = 2) -> list[Array]:
    """Starts of candidate i from which to fit: best as simulated, and best when scaled."""
    own = np.flatnonzero(d.owner == i)
    if own.size == 0:
        return []
    size, target = np.diag(d.gram)[own], d.target[own]
    exact = size - 2 * target
    scale = np.clip(target / size, SHRINK, STRETCH)
    scaled = scale**2 * size - 2 * scale * target
    first, c = int(np.argmin(exact)), d.candidates[i]
    found = [d.z[own[first]]]
    for k in np.argsort(scaled):
        if len(found) < count and (k != first or abs(scale[k] - 1) > NOTABLY):
            found.append(c.scaled(d.z[own[k]], float(scale[k])))
    return found


def rank_pairs(d: Dictionary) -> dict[tuple[int, int], tuple[float, int, int]]:
    """For each pair of candidates: (what its best two responses gain, the two responses).

    The gain is a reduction of the sum of squares, both responses scaled within SHRINK..STRETCH.
    """
    size, target = np.diag(d.gram), d.target
    determinant = size[:, None] * size - d.gram**2
    determinant[determinant < 1e-9 * size[:, None] * size] = np.inf
    first = (target[:, None] * size - d.gram * target) / determinant
    second = first.T
    a = np.clip(first, SHRINK, STRETCH)
    b = np.clip(second, SHRINK, STRETCH)
    gain = 2 * (a * target[:, None] + b * target) - (
        a**2 * size[:, None] + b**2 * size + 2 * a * b * d.gram
    )
    best: dict[tuple[int, int], tuple[float, int, int]] = {}
    groups = [np.flatnonzero(d.owner == i) for i in range(len(d.candidates))]
    for i in range(len(groups)):
        for j in range(i + 1, len(groups)):
            block = gain[np.ix_(groups[i], groups[j])]
            if block.size:
                k, m = np.unravel_index(int(np.argmax(block)), block.shape)
                best[i, j] = float(block[k, m]), int(groups[i][k]), int(groups[j][m])
    return best


def ceiling(d: Dictionary) -> float:
    """Part of the residual's sum of squares that all responses together could take away at most.

    To first order: effects that distort each other's responses can do better.
    """
    values, vectors = np.linalg.eigh(d.cosine)
    kept = values > 1e-9 * values[-1]
    along = vectors[:, kept].T @ (d.target / d.length)
    return float(np.sum(along**2 / values[kept])) / float(d.base @ d.base)
