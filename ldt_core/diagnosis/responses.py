"""Responses of the effects, and what each promises by them before anything is fitted.

Every candidate is simulated at the values its search starts with. The responses, all of the same
residuals, are columns; how well any one, two or three of them together explain the residual needs
only their inner products, so every pair is tried, also of effects that explain nothing alone.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.arrays import Array
from ldt_core.base.threads import spread
from ldt_core.diagnosis.candidate import LIMIT_MARGIN, Candidate
from ldt_core.diagnosis.effect_fit import EffectFit
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals

#: Largest factor by which a response may be scaled: up to it, it hardly changes shape.
STRETCH = 4.0
SHRINK = 0.02  # of a response that points the wrong way: a fit that begins there may turn it
ALIKE = 1e-3  # squared sine of the angle below which two responses are one
OTHER_START = 0.3  # change of a response's scale factor from which it counts as another start


@dataclass(frozen=True, eq=False)
class Responses:
    """Responses of all candidates at their starts.

    Attributes:
        residuals: of the experiments on which the candidates were simulated.
        owner: (K,) place of each response's candidate.
        z: coordinates of each response.
        responses: (K, size) what each takes off the residual.
        gram: (K, K) inner products of the responses.
        base: (size,) residual without any effect.
    """

    residuals: FreeRunResiduals
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

    def _free_of(self, base: EffectFit) -> tuple[Array, Array]:
        """(K, size) responses and (size,) residuals without what a set's own parameters follow."""
        if not base.members:
            return self.responses, base.residual
        span = following(base)
        moved = self.responses - (self.responses @ span) @ span.T
        return moved, base.residual - span @ (span.T @ base.residual)

    def promised_beside(self, base: EffectFit) -> list[tuple[Candidate, Array, float]]:
        """What each other effect promises beside a set, the most promising first.

        Returns:
            The effect, its most promising coordinates, and the loss that it then takes away,
            to first order and with the set's own parameters free to follow.
        """
        moved, left = self._free_of(base)
        size, target = np.einsum("ij,ij->i", moved, moved), moved @ left
        scale, gain = at_best_strength(target, size)
        for group in self._phases:
            gain[group], scale[group] = self._at_any_angle(moved[group], left)
        chosen: dict[int, int] = {}
        for k in np.argsort(-gain):
            owner = int(self.owner[k])
            if self.candidates[owner].name not in base.names:
                chosen.setdefault(owner, int(k))
        return [
            (c := self.candidates[i], c.scaled(self.z[k], float(scale[k])), float(gain[k]))
            for i, k in chosen.items()
        ]

    def explained_beside(self, base: EffectFit) -> tuple[float, float]:
        """Most of a set's loss that one response explains, and that two of different effects do.

        To first order, of any size, and with the set's own parameters free to follow.
        """
        moved, left = self._free_of(base)
        size = np.einsum("ij,ij->i", moved, moved)
        shown = size > ALIKE * np.diag(self.gram)
        if not shown.any():
            return 0.0, 0.0
        unit, owner = moved[shown] / np.sqrt(size[shown])[:, None], self.owner[shown]
        along, cosine = unit @ left, unit @ unit.T
        power = along**2
        rest = 1.0 - cosine**2
        apart = (owner[:, None] != owner) & (rest > ALIKE)
        both = power[:, None] + power - 2 * cosine * np.outer(along, along)
        two = np.where(apart, both / np.where(apart, rest, 1.0), 0.0)
        return float(power.max()), float(two.max())

    def promising(self, base: EffectFit, count: int) -> Callable[[Candidate], Sequence[Array]]:
        """For a candidate, those of its coordinates that promise most beside a set.

        Of one that shows nothing without the set, as many that are spread over its starts.
        """
        moved, left = self._free_of(base)
        _, gain = at_best_strength(moved @ left, np.einsum("ij,ij->i", moved, moved))
        order = np.argsort(-gain)
        place = {c.name: i for i, c in enumerate(self.candidates)}

        def of(candidate: Candidate) -> Sequence[Array]:
            own = [k for k in order if self.owner[k] == place[candidate.name]]
            if not own:
                return candidate.starts()[:: -(-len(candidate.starts()) // (2 * count))]
            return [self.z[k] for k in own[:count]]

        return of

    def likest(self, candidate: Candidate, moved: Array) -> Array:
        """Coordinates with which a candidate moves the residuals most as that (size,) does."""
        own = np.flatnonzero(self.owner == self.candidates.index(candidate))
        if not own.size:
            return candidate.starts()[0]
        scale, gain = at_best_strength(self.responses[own] @ moved, np.diag(self.gram)[own])
        best = int(np.argmax(gain))
        return candidate.scaled(self.z[own[best]], float(scale[best]))

    @functools.cached_property
    def with_free_phase(self) -> frozenset[str]:
        """Effects whose phase each experiment may choose, since start angles are not known."""
        return frozenset(self.candidates[int(self.owner[group[0]])].name for group in self._phases)

    @functools.cached_property
    def _phases(self) -> list[NDArray[np.int64]]:
        """Places of responses that differ by a phase alone, if start angles are not known."""
        found = []
        if all(p.at_rest for p in self.residuals.pieces):
            return []
        for i, c in enumerate(self.candidates):
            own = np.flatnonzero(self.owner == i)
            other = [j for j, p in enumerate(c.parameters) if not p.cyclic]
            if len(other) == len(c.parameters) or not self.residuals.angular([c.effect]):
                continue
            same: dict[bytes, list[int]] = {}
            for k in own:
                same.setdefault(self.z[k][other].tobytes(), []).append(int(k))
            found += [np.array(group) for group in same.values()]
        return found

    def _at_any_angle(self, moved: Array, left: Array) -> tuple[float, float]:
        """(promise, how many times as strong) of an effect whose phase each experiment may choose.

        Args:
            moved: (phases, size) responses that differ by the phase alone.
            left: (size,) residuals.
        """
        gain = size = 0.0
        for piece in self.residuals.pieces:
            part = moved[:, piece.rows]
            power, along = np.linalg.eigh(part @ part.T)
            kept = along[:, -2:][:, power[-2:] > 1e-9 * max(power[-1], 1e-300)]  # a sine, a cosine
            onto = kept.T @ (part @ left[piece.rows])
            gain += float(np.sum(onto**2 / power[-2:][-kept.shape[1] :])) if onto.size else 0.0
            size += float(power.sum()) / power.size
        return gain, float(strength(np.sqrt(gain), np.sqrt(size)))


def strength(target: Array | float, size: Array | float = 1.0) -> Array:
    """How many times as strong each response explains most; however small, if it points right.

    Args:
        target: inner products of responses with a residual.
        size: those with themselves.
    """
    wanted = np.minimum(target / np.maximum(size, 1e-9), STRETCH)
    return np.asarray(np.where(wanted > 0, wanted, SHRINK))


def at_best_strength(target: Array, size: Array) -> tuple[Array, Array]:
    """(strength, what it then takes off the sum of squares) of responses; arguments as there."""
    scale = strength(target, size)
    return scale, 2 * scale * target - scale**2 * size


def simulate_all(
    residuals: FreeRunResiduals,
    candidates: Sequence[Candidate],
    tick: Callable[[], None] = lambda: None,
    own: EffectFit | None = None,
    workers: int = 1,
    begun: Callable[[Candidate], Sequence[Array]] = Candidate.starts,
) -> Responses:
    """Simulate every candidate at its starts; responses that do not show are left out.

    Args:
        own: the machine's own parameters as fitted, or a set with them, beside which the candidates
            are simulated; the directions in which its parameters may follow are projected out.
        begun: coordinates at which a candidate is simulated.
    """
    given = own.use if own else []
    starts = own.starts if own else None
    base = residuals.of(given, starts=starts)
    # What following the speed alone changes is no effect's response.
    led = base if residuals.led(given) else residuals.always_led().of(given, starts=starts)
    span = following(own) if own else np.zeros((residuals.size, 0))
    owner: list[int] = []
    z: list[Array] = []
    for i, c in enumerate(candidates):
        tried = begun(c)
        owner += [i] * len(tried)
        z += tried
    rows = np.empty((len(z), residuals.size))

    def fill(i: int) -> int:
        c, own = candidates[i], [k for k, j in enumerate(owner) if j == i]
        uses = [[(c.effect, c.given(z[k])), *given] for k in own]
        without = led if uses and residuals.led(uses[0]) else base
        for k, left in zip(own, residuals.of_all(uses, starts=starts), strict=True):
            rows[k] = without - left
        return len(own)

    for count in spread(fill, len(candidates), workers):
        for _ in range(count):
            tick()
    rows -= (rows @ span) @ span.T
    shown = np.flatnonzero(np.einsum("ij,ij->i", rows, rows) > 1e-12)
    rows = rows[shown]
    return Responses(
        residuals,
        tuple(candidates),
        np.array(owner, dtype=np.int64)[shown],
        [z[k] for k in shown],
        rows,
        rows @ rows.T,
        base,
    )


def following(base: EffectFit) -> Array:
    """(size, q) orthonormal directions in which a set's own parameters follow a further effect.

    Those that lie at a bound of theirs, or are known better than these data tell, do not follow.
    """
    low, high = (np.concatenate([c.bounds[k] for c in base.members]) for k in (0, 1))
    z, rows = np.concatenate(base.z), base.jacobian
    own = z.size - sum(len(c) for c in base.effects)
    free = (z - low > LIMIT_MARGIN) & (high - z > LIMIT_MARGIN)
    told = np.linalg.norm(rows, axis=0) > 1.0  # deviations: more than the prior says
    free &= told | (np.arange(z.size) < z.size - own)
    return np.linalg.qr(rows[:, free])[0]


def best_alone(d: Responses, i: int) -> list[Array]:
    """Coordinates of candidate i from which to fit: best as simulated, and best when scaled."""
    own = np.flatnonzero(d.owner == i)
    if own.size == 0:
        return []
    size, target = np.diag(d.gram)[own], d.target[own]
    scale, gain = at_best_strength(target, size)
    first, c = int(np.argmin(size - 2 * target)), d.candidates[i]
    found = [d.z[own[first]]]
    for k in np.argsort(-gain):
        if len(found) < 2 and (k != first or abs(scale[k] - 1) > OTHER_START):
            found.append(c.scaled(d.z[own[k]], float(scale[k])))
    return found


def rank_pairs(d: Responses) -> dict[tuple[int, int], tuple[float, int, int]]:
    """For each pair of candidates: (what its best two responses gain, the two responses).

    The gain is a reduction of the sum of squares, both responses scaled within SHRINK..STRETCH.
    """
    size, target = np.diag(d.gram), d.target
    determinant = size[:, None] * size - d.gram**2
    determinant[determinant < 1e-9 * size[:, None] * size] = np.inf
    first = (target[:, None] * size - d.gram * target) / determinant
    second = first.T
    a, b = strength(first), strength(second)
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
