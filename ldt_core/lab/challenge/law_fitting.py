"""Laws fitted: how large one must be, and which of the library's parameters are nearest to it.

For the latter the laws are put back to the library's own form (`odd` = 0), still in this
simulator's words. Their parameters are then fitted in free run to the true motion, without noise,
by Gauss-Newton steps.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.lab.challenge.law import PHASE, Law
from ldt_core.lab.challenge.rig import PROBES, Acting, CaseBench
from ldt_core.lab.challenge.simulation import Unsteady

SIZE_TOLERANCE = 0.12  # relative: near enough to a strength that is drawn at random
SIZE_ROUNDS = 8
SLOPE_RANGE = (0.4, 3.0)  # of a gap over its size, both in logarithms: outside of them it is chance


def size_for(
    bench: CaseBench, law: Law, shape: Mapping[str, float], wanted: float
) -> tuple[Acting, float]:
    """The law at the size whose gap has this root mean square, or as near as its bounds let it.

    Args:
        bench: of the case.
        law: to size.
        shape: its other numbers.
        wanted: root mean square of the gap [rad/s].

    Returns:
        the law in that size, the gap that it has [rad/s].
    """
    low, high = ends = law.sizes
    size, slope = math.sqrt(low * high), 1.0
    best: tuple[float, Acting, float] | None = None
    before: tuple[float, float] | None = None
    for _ in range(SIZE_ROUNDS):
        acting = Acting(law.name, law.values(size, shape, bench.setting.known), shape)
        try:
            gap = bench.gap_rms((acting,))
        except Unsteady:
            high = size
            size = math.sqrt(low * size)
            continue
        off = math.log(max(gap, 1e-9) / wanted)
        if best is None or abs(off) < abs(best[0]):
            best = off, acting, gap
        if abs(off) < SIZE_TOLERANCE:
            break
        if before is not None and abs(math.log(size / before[0])) > 1e-3:
            slope = (off - before[1]) / math.log(size / before[0])
            slope = min(max(slope, SLOPE_RANGE[0]), SLOPE_RANGE[1])
        before = size, off
        if size == ends[0 if off > 0 else 1]:  # as near as the bounds let it
            break
        low, high = (size, high) if off < 0 else (low, size)
        new = size * math.exp(-off / slope)
        if not low < new < high:
            beyond = ends[1] if new >= high else ends[0]
            new = beyond if beyond in (low, high) else math.sqrt(low * high)
        size = new
    if best is None:
        raise Unsteady(f"no size of {law.name} makes a machine that runs")
    return best[1], best[2]


FIT_STEPS = 2
#: Experiments that are not fitted, and count in what is explained all the same.
CHECKED = (3, 7)
DIFFERENCE_STEP = 1e-3  # relative change of a parameter in a finite difference
LEAST_SINGULAR_VALUE = 1e-2  # of the largest singular value: such directions keep their value
LARGEST_STEP = 0.5  # relative change in one step
LEAST_STEP = 0.05  # relative change in a step after which another one tells nothing new
ANGLE_SCALE = 1.0  # rad; an angle has no size of its own
LARGEST_SHARE = 0.98  # of what a share may be


class Nearest(NamedTuple):
    """Laws in the library's form, and the share of the gap's energy that they explain.

    The share is over the experiments fitted and some that were not: near capture by a resonance a
    fit may be good where it was made and nowhere else.
    """

    acting: tuple[Acting, ...]
    explained: float


def nearest(bench: CaseBench, acting: Sequence[Acting]) -> Nearest:
    """Fit the library's forms to the true motion.

    Args:
        bench: of the case.
        acting: the laws that act.

    Raises:
        Unsteady: numbers that make no machine.
    """
    true, gap = bench.speeds(acting, PROBES), bench.gap(acting, PROBES)
    plain = [replace(a, odd=0.0) for a in acting]
    free = [(k, n) for k, a in enumerate(plain) for n in a.law.units if n not in a.law.kept]
    best, error = plain, true - bench.speeds(plain, PROBES)
    for _ in range(FIT_STEPS):
        scales = np.array([_scale(best[k], n) for k, n in free])
        columns = []
        for (k, name), scale in zip(free, scales, strict=True):
            moved = _moved(best, [(k, name)], np.array([DIFFERENCE_STEP * scale]))
            columns.append(((true - bench.speeds(moved, PROBES)) - error).ravel() / DIFFERENCE_STEP)
        step = np.linalg.lstsq(np.array(columns).T, -error.ravel(), rcond=LEAST_SINGULAR_VALUE)[0]
        step *= min(1.0, LARGEST_STEP / max(np.abs(step).max(), 1e-12))
        tried = _moved(best, free, step * scales)
        try:
            new = true - bench.speeds(tried, PROBES)
        except Unsteady:
            break
        gain = 1.0 - float(np.mean(new**2)) / max(float(np.mean(error**2)), 1e-30)
        if gain > 0:
            best, error = tried, new
        if gain <= 0 or np.abs(step).max() < LEAST_STEP:
            break
    left = np.concatenate([error, bench.speeds(acting, CHECKED) - bench.speeds(best, CHECKED)])
    gap = np.concatenate([gap, bench.gap(acting, CHECKED)])
    return Nearest(tuple(best), float(1.0 - np.mean(left**2) / np.mean(gap**2)))


def _scale(acting: Acting, name: str) -> float:
    if name == PHASE:
        return ANGLE_SCALE
    return max(abs(acting.values[name]), 1e-9)


def _moved(
    acting: Sequence[Acting], free: Sequence[tuple[int, str]], change: Array
) -> list[Acting]:
    values = [dict(a.values) for a in acting]
    for (k, name), by in zip(free, change, strict=True):
        moved = values[k][name] + float(by)
        if name == "share":
            moved = min(moved, LARGEST_SHARE)
        values[k][name] = moved
    return [replace(a, values=v) for a, v in zip(acting, values, strict=True)]
