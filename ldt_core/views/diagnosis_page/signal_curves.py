"""Samples made into what a figure draws: bins and spectra."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.estimation.smoothing import power_density

BINS = 48  # over the range of a quantity: about one for five pixels
OWN_BINS = 24  # different values up to which each is a bin of its own
BIN_SAMPLES = 8  # of a bin, at least: fewer have no spread
BAND_TAIL = 0.1  # share of a bin's samples below its band, and as many above it
SPECTRUM_LINES = 160  # over frequency: about one for two pixels
MOST_ORDER = 20.0  # per turn: where the axis of orders ends
ORDER_STEP = 0.05  # per turn: finer than the orders of a section are apart
SECTION_TURNS = 24.0  # of the shaft in one section: its orders are then 1/24 apart
LEAST_TURNS = 4.0  # of the shaft in a section that has orders to speak of


@dataclass(frozen=True, eq=False)
class Binned:
    """What y is at each x.

    Attributes:
        x: (n,) middle of the bins.
        mean: (n,)
        low: (n,) that a tenth of the samples lies below.
        high: (n,) that a tenth lies above.
    """

    x: Array
    mean: Array
    low: Array
    high: Array


def binned(x: Array, y: Array) -> Binned:
    """Mean and spread of y over equal ranges of x, or over its values where they are few."""
    finite = np.isfinite(x) & np.isfinite(y)
    x, y = x[finite], y[finite]
    if x.size == 0:
        return Binned(*(np.zeros(0) for _ in range(4)))
    levels = np.unique(x)
    if levels.size <= OWN_BINS:
        edges = np.concatenate([[-np.inf], (levels[1:] + levels[:-1]) / 2, [np.inf]])
        middle = levels
    else:
        edges = np.linspace(levels[0], levels[-1], BINS + 1)
        middle = (edges[1:] + edges[:-1]) / 2
    which = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, middle.size - 1)
    rows = []
    for i, at in enumerate(middle):
        inside = y[which == i]
        if inside.size >= min(BIN_SAMPLES, y.size):
            rows.append((at, inside.mean(), *np.quantile(inside, [BAND_TAIL, 1 - BAND_TAIL])))
    return Binned(*np.array(rows, dtype=np.float64).reshape(-1, 4).T)


def spectrum(rows: Sequence[Array], periods: Sequence[float]) -> tuple[Array, Array]:
    """(frequency [Hz], density [unit/√Hz]), the mean power over rows of one signal each.

    Lines that are closer to each other than a figure shows are one, the strongest.
    """
    found = []
    for row, period in zip(rows, periods, strict=True):
        if np.isfinite(row).all() and row.size > BIN_SAMPLES:
            found.append(power_density(row, period))
    if not found:
        return np.zeros(0), np.zeros(0)
    grid = max((f for f, _ in found), key=len)[1:]
    total, lines = np.zeros(grid.size), np.zeros(grid.size)
    for f, p in found:
        line = np.interp(grid, f[1:], p[1:], left=math.nan, right=math.nan)
        seen = np.isfinite(line)
        total[seen] += line[seen]
        lines += seen
    mean = total / np.maximum(lines, 1)
    edges = np.geomspace(grid[0], grid[-1] * (1 + 1e-9), SPECTRUM_LINES + 1)
    which = np.searchsorted(edges, grid, side="right") - 1
    at = [np.flatnonzero(which == i) for i in range(SPECTRUM_LINES)]
    best = [i[np.argmax(mean[i])] for i in at if i.size]
    return grid[best], np.sqrt(mean[best])


def orders(
    rows: Sequence[Array], speeds: Sequence[Array], periods: Sequence[float]
) -> tuple[Array, Array]:
    """(order [1/turn], amplitude [unit]) of what repeats with the shaft's angle.

    The sum over samples of row times exp(-i order angle), each weighted by the angle that it
    stands for: the spectrum over an evenly divided angle, also where the shaft turns back. Orders
    that turn more than half a period from sample to sample are left out of those samples.
    """
    order = np.arange(0.0, MOST_ORDER + ORDER_STEP / 2, ORDER_STEP)
    power, weight = np.zeros(order.size), np.zeros(order.size)
    for row, speed, period in zip(rows, speeds, periods, strict=True):
        if not (np.isfinite(row).all() and np.isfinite(speed).all()):
            continue
        step = speed * period
        turned = np.cumsum(np.abs(step)) / (2 * math.pi)
        for section in range(max(1, math.ceil(turned[-1] / SECTION_TURNS))):
            begin, stop = np.searchsorted(
                turned, [section * SECTION_TURNS, (section + 1) * SECTION_TURNS]
            )
            part = slice(int(begin), int(stop))
            if stop - begin <= BIN_SAMPLES or turned[part][-1] - turned[part][0] < LEAST_TURNS:
                continue
            along = (turned[part] - turned[part][0]) / np.ptp(turned[part])
            share = np.abs(step[part]) * np.sin(math.pi * along) ** 2
            seen = order[:, None] * np.abs(step[part]) < math.pi
            # Powers of the smallest order's turn: the exponential itself takes most of the time.
            turn = np.empty(seen.shape, dtype=np.complex128)
            turn[0], turn[1:] = 1.0, np.exp(-1j * ORDER_STEP * np.cumsum(step[part]))
            np.cumprod(turn, axis=0, out=turn)
            total = seen @ share
            enough = total > 0.5 * share.sum()
            sides = np.where(order > 0, 2.0, 1.0)
            amplitude = sides * np.abs((turn * seen) @ (row[part] * share))
            amplitude[enough] /= total[enough]
            power[enough] += share.sum() * amplitude[enough] ** 2
            weight[enough] += share.sum()
    enough = weight > 0
    return order[enough], np.sqrt(power[enough] / weight[enough])
