"""Least squares from a good start: effect and start states of several experiments together.

Experiments share the effect's parameters, and the start angle where the machine is held to start at
the same one every time; all other unknown start states are each experiment's own.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.experiment import Experiment
from ldt_core.estimation.effect.cause import Cause, CauseRun, UncertainStart
from ldt_core.estimation.least_squares import levenberg_marquardt
from ldt_core.estimation.noise import correlation_time
from ldt_core.physics.base import ANGLE

INTEGRATION_STEP = 0.5e-3  # s, longest: worst relative error of the speed 8e-5
DIFFERENCE = 1e-4  # of a scale or of a start state's spread, for difference quotients
STEPS = 12  # of one descent: from a good start the last ones change nothing
LONGEST_STEP = 0.05  # scales of the effect's parameters: beyond, the free run is not linear at all
WIDEST_STEP = 0.5  # spreads of a start state, for the same reason
LEAST_CHANGE = 0.1  # noise deviations of all samples together: a step below it gains nothing
WEAK_PRIOR = 2.0  # scales: width of the prior that stands in where the data say nothing


@dataclass(frozen=True, eq=False)
class FittedExperiment:
    """What was measured, what is known of its start, which samples count."""

    experiment: Experiment
    start: UncertainStart
    keep: Array


@dataclass(frozen=True, eq=False)
class Minimum:
    """Where a descent ended.

    Attributes:
        q: (p,) effect's coordinates, shared angle if any, then each experiment's own start.
        covariance: (p, p) of q, for residuals as large and as long-lived as those found.
        rests: residual of each experiment [rad/s], held samples left out.
        rms: of them all, corrected for the number of parameters [rad/s].
        memory: samples in which the residual forgets itself; 1 for white noise.
    """

    q: Array
    covariance: Array
    rests: list[Array]
    rms: float
    memory: float


class JointFit:
    """The fit of one effect to several experiments.

    Args:
        cause: machine and effect.
        seen: experiments.
        noise: standard deviation of the speed [rad/s], against which start states count.
        shared: the experiments start at the same angle.
        known: (angle, deviation) of that angle from earlier experiments.
        memory: free runs that were made already.
    """

    def __init__(
        self,
        cause: Cause,
        seen: Sequence[FittedExperiment],
        noise: float,
        shared: bool = False,
        known: tuple[float, float] | None = None,
        memory: dict[Any, Array] | None = None,
    ) -> None:
        self.cause, self.seen, self.noise = cause, list(seen), noise
        self.shared, self.known = shared and cause.turn > 0, known
        self._runs = {} if memory is None else memory
        self._d = len(cause.names)
        own = [np.flatnonzero(s.start.spread > 0) for s in seen]
        self._own = [u[u != ANGLE] if self.shared else u for u in own]
        first = self._d + (1 if self.shared else 0)
        ends = first + np.cumsum([0, *(len(u) for u in self._own)])
        self._places = [slice(a, b) for a, b in itertools.pairwise(ends.tolist())]
        self.size = int(ends[-1])
        own_size = self.size - self._d
        self._bounds = (
            np.append(cause.low, np.full(own_size, -np.inf)),
            np.append(cause.high, np.full(own_size, np.inf)),
        )
        spreads = [s.start.spread[u] for s, u in zip(seen, self._own, strict=True)]
        angle = [cause.turn / math.sqrt(12)] if self.shared else []
        self.spread = np.concatenate([np.full(self._d, WEAK_PRIOR), angle, *spreads])
        # What a start state's guess is worth; the angle is nobody's guess.
        pulled = np.concatenate([np.zeros(first), *(u != ANGLE for u in self._own)])
        self._pulled = np.flatnonzero(pulled)
        # All others keep their spread where the data say nothing; it does not draw the fit.
        self._unpulled = 1.0 - pulled

    def point(self, z: Array, angles: Sequence[float]) -> Array:
        """(p,) coordinates with these start angles and otherwise nominal starts."""
        q = np.zeros(self.size)
        q[: self._d] = z
        if self.shared:
            q[self._d] = angles[0]
            return q
        for angle, own, place in zip(angles, self._own, self._places, strict=True):
            q[place] = np.where(own == ANGLE, angle, 0.0)
        return q

    def offset(self, q: Array, i: int) -> Array:
        """(n,) change of experiment i's nominal start."""
        offset = self.cause.offset(float(q[self._d]) if self.shared else 0.0)
        offset[self._own[i]] = q[self._places[i]]
        return offset

    def angle(self, i: int) -> int | None:
        """Place of experiment i's start angle in q."""
        if self.shared:
            return self._d
        at = np.flatnonzero(self._own[i] == ANGLE)
        return self._places[i].start + int(at[0]) if at.size else None

    def rest(self, q: Array, i: int) -> Array:
        """(L,) residual of experiment i [rad/s], held samples included."""
        return self.rests([(q, i)])[0]

    def rests(self, asked: Sequence[tuple[Array, int]]) -> list[Array]:
        """The same of each (coordinates, experiment), several free runs at once."""
        runs, keys = {}, []
        for q, i in asked:
            run = CauseRun(self.seen[i].experiment, q[: self._d], self.offset(q, i))
            e = run.experiment
            keys.append((e.number, e.start, len(e), run.z.tobytes(), run.offset.tobytes()))
            if keys[-1] not in self._runs:
                runs[keys[-1]] = run._replace(rest=self.seen[i].start.rest)
        speeds = self.cause.speeds(list(runs.values()), INTEGRATION_STEP)
        self._runs |= zip(runs, speeds, strict=True)
        found = zip(asked, keys, strict=True)
        return [self.seen[i].experiment.speed - self._runs[key] for (_, i), key in found]

    def run(self, start: Array) -> Minimum:
        """Descend from coordinates (p,) to the nearest minimum."""
        return self._minimum(
            levenberg_marquardt(
                self._rows,
                self._slopes,
                start,
                *self._bounds,
                np.where(np.arange(self.size) < self._d, LONGEST_STEP, WIDEST_STEP * self.spread),
                STEPS,
                LEAST_CHANGE,
            )
        )

    def loss(self, q: Array, minimum: Minimum) -> float:
        """Sum of squares at q (p,), in deviations of what is left at a minimum near it."""
        rows = self._rows(q)
        measured = rows[: rows.size - self._prior(q).size]
        prior = rows[measured.size :]
        ratio = self._ratio(minimum.rms, minimum.memory)
        return ratio**2 * float(measured @ measured) + float(prior @ prior)

    def _ratio(self, rms: float, memory: float) -> float:
        # Of so many samples that hang together, only one in `memory` counts.
        return self.noise / max(rms * math.sqrt(memory), 1e-6 * self.noise)

    def _minimum(self, q: Array) -> Minimum:
        rests = [self.rest(q, i)[s.keep] for i, s in enumerate(self.seen)]
        together = np.concatenate(rests)
        rms = math.sqrt(float(together @ together) / max(together.size - self.size, 1))
        memory = float(np.mean([correlation_time(r) for r in rests]))
        ratio = self._ratio(rms, memory)
        slopes = self._slopes(q) * self.spread
        measured, prior = slopes[: together.size], slopes[together.size :]
        precision = ratio**2 * measured.T @ measured + prior.T @ prior
        precision[np.diag_indices(self.size)] += self._unpulled
        covariance = np.linalg.inv(precision) * np.outer(self.spread, self.spread)
        return Minimum(q, covariance, rests, rms, memory)

    def _rows(self, q: Array) -> Array:
        rests = self.rests([(q, i) for i in range(len(self.seen))])
        kept = zip(rests, self.seen, strict=True)
        measured = [rest[s.keep] / self.noise for rest, s in kept]
        return np.concatenate([*measured, self._prior(q)])

    def _prior(self, q: Array) -> Array:
        rows = q[self._pulled] / self.spread[self._pulled]
        if self.shared and self.known is not None:
            rows = np.append(rows, (q[self._d] - self.known[0]) / self.known[1])
        return rows

    def _slopes(self, q: Array) -> Array:
        """(rows, p) change of the rows by each coordinate."""
        lengths = [int(np.count_nonzero(s.keep)) for s in self.seen]
        ends = np.cumsum([0, *lengths])
        prior = self._prior(q)
        slopes = np.zeros((ends[-1] + prior.size, self.size))
        base = self.rests([(q, i) for i in range(len(self.seen))])
        points, steps, asked, columns = [], [], [], []
        for j in range(self.size):
            step = DIFFERENCE * (1.0 if j < self._d else self.spread[j])
            if j < self._d and q[j] + step > self.cause.high[j]:
                step = -step
            moved = q.copy()
            moved[j] += step
            points.append(moved)
            steps.append(step)
            shared = j < self._d + (1 if self.shared else 0)
            for i, place in enumerate(self._places):
                if shared or place.start <= j < place.stop:
                    asked.append((moved, i))
                    columns.append(j)
        for rest, (_, i), j in zip(self.rests(asked), asked, columns, strict=True):
            rows = slice(ends[i], ends[i + 1])
            slopes[rows, j] = (rest - base[i])[self.seen[i].keep] / (steps[j] * self.noise)
        for j, moved in enumerate(points):
            slopes[ends[-1] :, j] = (self._prior(moved) - prior) / steps[j]
        return slopes
