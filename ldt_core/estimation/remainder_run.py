"""What a motor's known physics leaves: an acceleration of its state, with and without memory.

    [i; w]_{k+1} = Ad [i; w]_k + Bd u_k + Gd f_k

f is a sum of a curve over the speed, a curve over the current, and two families that can stand for
any memory of the speed: plays, which follow the speed as a loose joint does and do not forget
(Krasnosel'skii, Pokrovskii, "Systems with hysteresis", 1989: sums of plays of all widths are the
hysteresis of Prandtl and Ishlinskii), and lags, which follow it and forget at all rates.
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

#: Nodes of a curve in the range seen, and of those as a part, beyond it on either side.
NODES = {"speed": 64, "current": 32}
BEYOND = 0.25
#: Half widths of the plays: in thirds of octaves down from half the range of speeds seen. One that
#: lies between two, taken as a mix of both, is off by a quarter of their distance at most, 6 % of
#: its width; of whole octaves it were 18 %. The narrowest is as wide as two nodes of the curve.
PLAYS, PLAYS_AN_OCTAVE = 16, 3
#: Time constants of the lags, in equal ratios from so many samples to a part of an experiment.
LAGS, FASTEST, SLOWEST = 5, 10, 0.25


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

    def knows(self, speed: Array) -> bool:
        """Whether speeds (L,) stay where there are nodes [rad/s]."""
        high = self.speed.low + self.speed.step * (self.speed.nodes - 1)
        return bool(self.speed.low <= speed.min() and speed.max() <= high)

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


def _axis(values: Array, count: int) -> CurveNodes:
    low, high = float(values.min()), float(values.max())
    step = max(high - low, 1e-9) / (count - 1)
    beyond = math.ceil(BEYOND * count)
    return CurveNodes(low - beyond * step, step, count + 2 * beyond)


def _walk(count: int) -> Array:
    change = np.diff(np.eye(count), axis=0)
    return np.asarray(change.T @ change)


def free_run(
    shape: RemainderShape, weights: Array, run: MotorRun, thin: int = 0, led: float = 0.0
) -> tuple[Array, Array]:
    """Speed (L,) under an acceleration, and its derivatives by the weights.

    Args:
        thin: samples over which each row of the derivatives (L / thin, n) is a mean; 0 for none.
        led: part of the measured speed in what the acceleration depends on, from 0 to 1.
    """
    return _run(
        *(run.ad, run.bd, run.gd, run.voltage, run.current, run.speed[0]),
        *(shape.speed, shape.current, shape.plays, 1 - np.exp(-run.period / shape.lags)),
        *(shape.span, weights, thin, run.speed, led),
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
    ad, bd, gd, voltage, i, w, speeds, currents, plays, rates, span, weights, thin, lead, led
):  # pragma: no cover - compiled
    """See `free_run`; `rates` (q,) is what a lag catches up in a sample."""
    samples, n, p, q = len(voltage), len(weights), len(plays), len(rates)
    rows = -(-samples // thin) if thin else 0
    first_play = speeds.nodes + currents.nodes
    speed, slopes = np.empty(samples), np.zeros((rows, n))
    loose, late, free = np.full(p, w), np.full(q, w), 1.0 - led
    drawn = i
    di, dw, df = np.zeros(n), np.zeros(n), np.zeros(n)
    dloose, dlate = np.zeros((p, n)), np.zeros((q, n))
    for k in range(samples):
        speed[k] = w
        if not (abs(w) < math.inf and abs(i) < math.inf):  # it finds no place among the nodes
            speed[k:] = math.nan
            break
        if thin:
            row, part = k // thin, 1.0 / min(thin, samples - k // thin * thin)
            for m in range(n):
                slopes[row, m] += part * dw[m]
                df[m] = 0.0
        force, by_w, by_i = 0.0, 0.0, 0.0
        at_w = free * w + led * lead[k]
        at_i = free * i + led * drawn
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
            if thin and free > 0 and touches:  # as far ahead whatever the speed, which it follows
                for m in range(n):
                    dloose[j, m] = free * dw[m]
            elif thin and free > 0:
                by_w += weight / width
                for m in range(n):
                    df[m] -= weight / width * dloose[j, m]
        for j in range(q):
            weight = weights[first_play + p + j]
            late[j] += rates[j] * (at_w - late[j])
            ahead = min(max((at_w - late[j]) / span, -1.0), 1.0)
            force += weight * ahead
            df[first_play + p + j] += ahead
            if thin and free > 0:
                moving = weight / span if abs(ahead) < 1.0 else 0.0
                by_w += moving
                for m in range(n):
                    dlate[j, m] += rates[j] * (free * dw[m] - dlate[j, m])
                    df[m] -= moving * dlate[j, m]
        if thin:
            for m in range(n):
                dforce = df[m] + free * (by_w * dw[m] + by_i * di[m])
                ahead_i = ad[0, 0] * di[m] + ad[0, 1] * dw[m] + gd[0] * dforce
                dw[m] = ad[1, 0] * di[m] + ad[1, 1] * dw[m] + gd[1] * dforce
                di[m] = ahead_i
        drawn = ad[0, 0] * drawn + ad[0, 1] * lead[k] + bd[0] * voltage[k]
        i, w = (
            ad[0, 0] * i + ad[0, 1] * w + bd[0] * voltage[k] + gd[0] * force,
            ad[1, 0] * i + ad[1, 1] * w + bd[1] * voltage[k] + gd[1] * force,
        )
    return speed, slopes
