"""Where the gap lies: the narrowest ranges of speed, voltage, time, ... that hold most of it.

By the power at each value of a quantity, not by how often the recording was there: a gap at a
resonance lies there also in a recording that mostly ran past it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldt_core.diagnosis.bench import Bench
from ldt_core.diagnosis.result import Place
from ldt_core.diagnosis.starts import Starts
from ldt_core.diagnosis.torque import WINDOW, Torque

Array = NDArray[np.float64]

BINS = 60
MOST = 0.9  # of the gap's power, that a place must hold
LIFT = 0.1  # by which a place's share of the gap exceeds its share of the data, to be named
LEAST = 0.004  # of the samples, that a bin's mean is taken over
SHARP = (0.05, 0.1, 0.2, 0.4)  # memories of the motor to smooth over, if the noise allows:
QUIET = 0.05  # of the torque's power, at most
BOTH = 0.3  # of the larger direction's range, that the other reaches, to look at both as one
CHANCE = 3.0  # deviations of a bin's power that noise alone may give it
QUANTITIES = {
    "speed": "rad/s",
    "voltage": "V",
    "acceleration": "rad/s^2",
    "time": "s",
    "experiment": "",
}


@dataclass(frozen=True, eq=False)
class Residual:
    """The torque that explains what is wrong, sample by sample, over all experiments.

    Attributes:
        torque: (N,) [N m].
        noise: (N,) its deviation that comes from the sensor's noise [N m].
        over: quantity to (N,) values.
        pieces: length of each experiment.
        periods: sample period of each [s].
        window: samples over which the torque is smoothed.
    """

    torque: Array
    noise: Array
    over: dict[str, Array]
    pieces: list[int]
    periods: list[float]
    window: int

    @property
    def power(self) -> Array:
        """(N,) squared torque beyond noise."""
        return self.torque**2 - self.noise**2


def residual(
    bench: Bench, use: Sequence = (), starts: Starts | None = None, window: float = WINDOW
) -> Residual:
    """The torque left by these effects, and what it may depend on."""
    return _residual(bench, _left(bench, use, starts), bench.noise[0], window)


def sharp_residual(bench: Bench, use: Sequence = (), starts: Starts | None = None) -> Residual:
    """The same, smoothed no longer than the noise asks for: sharp where the gap is large."""
    left = _left(bench, use, starts)
    for window in SHARP:
        found = _residual(bench, left, bench.noise[0], window)
        if float(np.mean(found.noise**2)) < QUIET * float(np.mean(found.torque**2)):
            return found
    return _residual(bench, left, bench.noise[0])


def _left(bench: Bench, use: Sequence, starts: Starts | None) -> list[Array]:
    return [
        e.speed - bench.outputs(i, use, angle=_angle(bench, starts, i))[0]
        for i, e in enumerate(bench.experiments)
    ]


def change(bench: Bench, use: Sequence, to: Sequence, starts: Starts | None = None) -> Residual:
    """The torque that effects add to others, as simulated: free of noise.

    Args:
        bench: experiments.
        use: effects before.
        to: effects after.
        starts: states at the first samples, with the latter.
    """
    moved = []
    for i in range(len(bench.pieces)):
        after, _ = bench.outputs(i, to, angle=_angle(bench, starts, i))
        before, _ = bench.outputs(i, use, angle=_angle(bench, bench.starts, i))
        moved.append(after - before)
    return _residual(bench, moved, 0.0)  # smoothed: a ripple of no mean is no place


def _angle(bench: Bench, starts: Starts | None, i: int) -> float:
    return float((starts or bench.starts).angles[i])


def _residual(
    bench: Bench, speeds: Sequence[Array], deviation: float, window: float = WINDOW
) -> Residual:
    torque, noise = [], []
    over: dict[str, list[Array]] = {name: [] for name in QUANTITIES}
    samples = 1
    for e, speed in zip(bench.experiments, speeds, strict=True):
        turn = Torque(bench.values["J"], bench.memory, e.period, len(e), window)
        torque.append(turn.of(speed))
        noise.append(np.full(len(e), turn.noise * deviation))
        samples = max(samples, turn.window)
        over["speed"].append(turn.smooth(e.speed))
        over["voltage"].append(np.asarray(e.voltage))
        over["acceleration"].append(turn.smooth(e.speed, 1))
        over["time"].append(e.time)
        over["experiment"].append(np.full(len(e), float(e.number)))
    return Residual(
        np.concatenate(torque),
        np.concatenate(noise),
        {name: np.concatenate(parts) for name, parts in over.items()},
        [len(e) for e in bench.experiments],
        [e.period for e in bench.experiments],
        samples,
    )


def places(found: Residual) -> list[Place]:
    """Ranges that hold most of the gap in a smaller part of the data, the clearest first.

    A gap that lies everywhere alike is given as the whole range of speed. What lies at the same
    sizes of speed or voltage in both directions is given as two ranges.
    """
    if not float(found.power.sum()) > 0:
        return []
    named = [p for q in QUANTITIES for p in _places(q, found)]
    named += [p] if (p := _frequency(found)) is not None else []
    clear = [p for p in named if p.share_of_gap - p.share_of_data >= LIFT]
    if not clear:
        speed = found.over["speed"]
        return [Place("speed", float(speed.min()), float(speed.max()), "rad/s", 1.0, 1.0)]
    # Where the gap does not stand out at any speed, its speeds are still what people ask for.
    clear += [p for p in named if p.quantity == "speed" and p not in clear]
    return sorted(clear, key=lambda p: p.share_of_data - p.share_of_gap)


def _places(quantity: str, found: Residual) -> list[Place]:
    values = found.over[quantity]
    low, high = float(values.min()), float(values.max())
    if not high > low:
        return []
    begin, end, part = _narrowest(quantity, values, found)
    ranges = [(begin, end)]
    if quantity in ("speed", "voltage") and min(-low, high) > BOTH * max(-low, high):
        first, last, folded = _narrowest(quantity, np.abs(values), found)
        if folded < part:
            ranges = [(first, last), (-last, -first)]
    total = float(found.power.sum())
    named = []
    for begin, end in ranges:
        here = (values >= begin) & (values <= end)
        share = min(max(float(found.power[here].sum()) / total, 0.0), 1.0)
        data = float(np.count_nonzero(here)) / values.size
        named.append(Place(quantity, begin, end, QUANTITIES[quantity], share, data))
    return named


def _narrowest(quantity: str, values: Array, found: Residual) -> tuple[float, float, float]:
    """(from, to, part of the whole range) of the narrowest range with most of the gap."""
    if quantity == "experiment":
        numbers = np.unique(values)
        edges = np.append(numbers, numbers[-1] + 1.0)
    else:
        # Equal steps of the quantity where there are data, so that ends are sharp.
        edges = _merged(np.linspace(values.min(), values.max(), BINS + 1), values)
    last = edges.size - 2
    which = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, last)
    power, count = _powers(found, which, last + 1)
    if not power.sum() > 0:
        return float(values.min()), float(values.max()), 1.0
    width = np.diff(edges)
    mean = power / np.maximum(count, 1) * width
    i, j = _shortest(mean / mean.sum(), width / width.sum())
    share = power / power.sum()
    while share[i : j + 1].sum() < MOST:
        below, above = (share[i - 1] if i else -1.0), (share[j + 1] if j < last else -1.0)
        i, j = (i - 1, j) if below > above else (i, j + 1)
    part = float(width[i : j + 1].sum() / width.sum())
    end = float(edges[j] if quantity == "experiment" else edges[j + 1])
    return float(edges[i]), end, part


def _merged(edges: Array, values: Array) -> Array:
    """Edges without those that leave a bin too few samples for a mean."""
    order = np.sort(values)
    kept = [edges[0]]
    for edge in edges[1:-1]:
        below, above = np.searchsorted(order, [kept[-1], edge])
        if above - below >= LEAST * values.size and values.size - above >= LEAST * values.size:
            kept.append(edge)
    return np.array([*kept, edges[-1]])


def _powers(found: Residual, which: NDArray[np.int64], size: int) -> tuple[Array, Array]:
    """(bins,) sums of power where they are more than noise gives, else 0; and (bins,) counts."""
    total = np.bincount(which, found.power, size)
    noise = np.bincount(which, found.noise**4, size)
    # Smoothed samples are alike over a window, so there are fewer than they seem.
    chance = CHANCE * np.sqrt(2.0 * found.window * noise)
    count = np.bincount(which, minlength=size).astype(np.float64)
    return np.where(total > chance, total, 0.0), count


def _shortest(share: Array, data: Array) -> tuple[int, int]:
    """First and last of the adjoining bins with the least data that hold MOST of the gap."""
    gap, seen = (np.concatenate([[0.0], np.cumsum(v)]) for v in (share, data))
    best = (np.inf, 0, share.size - 1)
    for i in range(share.size):
        enough = np.flatnonzero(gap[i + 1 :] - gap[i] >= MOST)
        if enough.size:
            j = i + int(enough[0])
            best = min(best, (float(seen[j + 1] - seen[i]), i, j))
    return best[1], best[2]


def _frequency(found: Residual) -> Place | None:
    """The band of frequencies that holds more of the torque than of the speed's own motion."""
    if len(set(found.pieces)) > 1 or len(set(found.periods)) > 1:
        return None
    length, period = found.pieces[0], found.periods[0]
    torque = found.torque.reshape(-1, length)
    speed = found.over["speed"].reshape(-1, length)
    frequency = np.fft.rfftfreq(length, period)
    wrong = np.sum(np.abs(np.fft.rfft(torque - torque.mean(axis=1, keepdims=True))) ** 2, axis=0)
    moved = np.sum(np.abs(np.fft.rfft(speed - speed.mean(axis=1, keepdims=True))) ** 2, axis=0)
    constant = float(np.sum(torque.mean(axis=1) ** 2)) * length
    if constant > (1 - MOST) * float(np.sum(found.torque**2)):
        return None  # it does not alternate
    wrong[0], moved[0] = 0.0, 0.0
    share, data = wrong / wrong.sum(), moved / max(float(moved.sum()), 1e-300)
    i, j = _shortest(share, data)
    inside, part = float(share[i : j + 1].sum()), float(data[i : j + 1].sum())
    return Place("frequency", float(frequency[i]), float(frequency[j]), "Hz", inside, part)
