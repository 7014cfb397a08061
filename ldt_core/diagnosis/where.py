"""Where the gap lies: the ranges of speed, voltage, time, ... in which it is largest.

By the torque's mean at each value of a quantity, where it depends on the quantity, and else by its
power there; not by how often the recording was there: a gap at a resonance lies there also in a
recording that mostly ran past it. A range begins and ends where the power falls below its average
over all values, so that the range is as sharp as the torque's fall is.
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

BINS = 120
MOST = 0.9  # of the gap's power, that a band of frequencies must hold
LIFT = 0.1  # by which a place's share of the gap exceeds its share of the data, to be named
LEAST = 0.002  # of the samples, that a bin's mean is taken over
SHARP = (0.05, 0.1, 0.2, 0.4)  # memories of the motor to smooth over, if the noise allows:
QUIET = 0.5  # of the torque's power, at most
DEPENDS = 0.1  # of the power, that the means over a quantity hold where the torque depends on it
BOTH = 0.3  # of the larger direction's range, that the other reaches, to look at both as one
CHANCE = 3.0  # deviations of a bin's power that noise alone may give it, and
MEANT = 2.0  # of its mean
ROUNDING = 1e-9  # by which a range must be better than another one
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
        torque: (N,) smoothed so long that ripples and noise are small [N m].
        noise: (N,) its deviation that comes from the sensor's noise [N m].
        sharp: (N,) smoothed no longer than the noise asks for [N m].
        sharp_noise: (N,) its deviation [N m].
        over: quantity to (N,) values.
        pieces: length of each experiment.
        periods: sample period of each [s].
        window: samples over which `torque` is smoothed.
        sharp_window: and `sharp`.
    """

    torque: Array
    noise: Array
    sharp: Array
    sharp_noise: Array
    over: dict[str, Array]
    pieces: list[int]
    periods: list[float]
    window: int
    sharp_window: int

    @property
    def power(self) -> Array:
        """(N,) squared torque beyond noise."""
        return self.torque**2 - self.noise**2


def residual(bench: Bench, use: Sequence = (), starts: Starts | None = None) -> Residual:
    """The torque left by these effects, and what it may depend on."""
    simulated = [
        bench.outputs(i, use, angle=_angle(bench, starts, i))[0] for i in range(len(bench.pieces))
    ]
    measured = [e.speed for e in bench.experiments]
    left = [a - b for a, b in zip(measured, simulated, strict=True)]
    return _residual(bench, left, measured, bench.noise[0])


def change(bench: Bench, use: Sequence, to: Sequence, starts: Starts | None = None) -> Residual:
    """The torque that effects add to others, as simulated: free of noise.

    Args:
        bench: experiments.
        use: effects before.
        to: effects after.
        starts: states at the first samples, with the latter.
    """
    moved, after = [], []
    for i in range(len(bench.pieces)):
        after.append(bench.outputs(i, to, angle=_angle(bench, starts, i))[0])
        moved.append(after[-1] - bench.outputs(i, use, angle=_angle(bench, bench.starts, i))[0])
    return _residual(bench, moved, after, 0.0)


def _angle(bench: Bench, starts: Starts | None, i: int) -> float:
    return float((starts or bench.starts).angles[i])


def _residual(
    bench: Bench, left: Sequence[Array], speeds: Sequence[Array], deviation: float
) -> Residual:
    torque, noise, samples = _turned(bench, left, deviation, WINDOW)
    sharp = torque, noise, samples
    for window in SHARP:
        tried = _turned(bench, left, deviation, window)
        if float(np.mean(tried[1] ** 2)) <= QUIET * float(np.mean(tried[0] ** 2)):
            sharp = tried
            break
    over: dict[str, list[Array]] = {name: [] for name in QUANTITIES}
    for e, speed in zip(bench.experiments, speeds, strict=True):
        turn = Torque(bench.values["J"], bench.memory, e.period, len(e))
        over["speed"].append(turn.smooth(speed))
        over["voltage"].append(np.asarray(e.voltage))
        over["acceleration"].append(turn.smooth(speed, 1))
        over["time"].append(e.time)
        over["experiment"].append(np.full(len(e), float(e.number)))
    return Residual(
        torque,
        noise,
        sharp[0],
        sharp[1],
        {name: np.concatenate(parts) for name, parts in over.items()},
        [len(e) for e in bench.experiments],
        [e.period for e in bench.experiments],
        samples,
        sharp[2],
    )


def _turned(
    bench: Bench, left: Sequence[Array], deviation: float, window: float
) -> tuple[Array, Array, int]:
    """((N,) torque, (N,) deviation of its noise, samples it is smoothed over)."""
    torque, noise, samples = [], [], 1
    for e, speed in zip(bench.experiments, left, strict=True):
        turn = Torque(bench.values["J"], bench.memory, e.period, len(e), window)
        torque.append(turn.of(speed))
        noise.append(np.full(len(e), turn.noise * deviation))
        samples = max(samples, turn.window)
    return np.concatenate(torque), np.concatenate(noise), samples


def places(found: Residual) -> list[Place]:
    """Ranges in which the gap is larger than on average, the clearest first.

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
    begin, end, lift = _range(quantity, [(values, slice(None))], found)
    ranges = [(begin, end)]
    if quantity in ("speed", "voltage") and min(-low, high) > BOTH * max(-low, high):
        # Both directions apart, since what is odd in the direction has no mean over them.
        size, ahead = np.abs(values), values >= 0
        first, last, folded = _range(quantity, [(size, ahead), (size, ~ahead)], found)
        if folded > lift:
            ranges = [(first, last), (-last, -first)]
    total = float(found.power.sum())
    named = []
    for begin, end in ranges:
        here = (values >= begin) & (values <= end)
        share = min(max(float(found.power[here].sum()) / total, 0.0), 1.0)
        data = float(np.count_nonzero(here)) / values.size
        named.append(Place(quantity, begin, end, QUANTITIES[quantity], share, data))
    return named


def _range(
    quantity: str, parts: Sequence[tuple[Array, slice | NDArray[np.bool_]]], found: Residual
) -> tuple[float, float, float]:
    """(from, to, lift) of the range with the most power beyond the average.

    Args:
        quantity: for which.
        parts: its values, and which samples of them are taken together; powers of the parts add up.
        found: the torque.
    """
    values = parts[0][0]
    if quantity == "experiment":
        edges = np.append(np.unique(values), values.max() + 1.0)
    else:
        # Equal steps of the quantity where there are data, so that ends are sharp.
        edges = _merged(np.linspace(values.min(), values.max(), BINS + 1), values)
    bins = edges.size - 1
    which = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, bins - 1)
    mean, held = np.zeros(bins), 0.0
    for _, chosen in parts:
        there, power = _meant(found, which, chosen, bins)
        mean += there
        held += power
    # The experiments' means are of many directions and voltages: their power is what counts.
    if quantity == "experiment" or held < DEPENDS * max(float(found.power.sum()), 0.0):
        mean = _powers(found, which, bins)
    if not mean.sum() > 0:
        return float(values.min()), float(values.max()), 0.0
    width = np.diff(edges)
    share = mean * width / float(mean @ width)
    i, j, lift = _most_beyond(share, width / width.sum())
    return float(edges[i]), float(edges[j] if quantity == "experiment" else edges[j + 1]), lift


def _most_beyond(share: Array, data: Array) -> tuple[int, int, float]:
    """First and last of the adjoining bins whose share of the gap exceeds that of the range most.

    Args:
        share: (bins,) of the gap.
        data: (bins,) of the whole range.
    """
    sums = np.concatenate([[0.0], np.cumsum(share - data)])
    best = (0, share.size - 1, 0.0)
    for i in range(share.size):
        j = i + int(np.argmax(sums[i + 1 :]))
        if float(sums[j + 1] - sums[i]) > best[2] + ROUNDING:
            best = (i, j, float(sums[j + 1] - sums[i]))
    return best


def _meant(
    found: Residual, which: NDArray[np.int64], chosen: slice | NDArray[np.bool_], bins: int
) -> tuple[Array, float]:
    """(bins,) squared means of the sharp torque, 0 where noise gives as much; and their power.

    The power is that of the smoothed torque's means, summed over all samples.
    """
    here = which[chosen]
    count = np.maximum(np.bincount(here, minlength=bins), 1)
    mean = np.bincount(here, found.sharp[chosen], bins) / count
    # Smoothed samples are alike over a window, so there are fewer than they seem.
    noise = np.bincount(here, found.sharp_noise[chosen] ** 2, bins) * found.sharp_window / count**2
    smooth = np.bincount(here, found.torque[chosen], bins) / count
    random = np.bincount(here, found.noise[chosen] ** 2, bins) * found.window / count**2
    held = float(np.sum(count * np.maximum(smooth**2 - random, 0.0)))
    return np.maximum(np.abs(mean) - MEANT * np.sqrt(noise), 0.0) ** 2, held


def _merged(edges: Array, values: Array) -> Array:
    """Edges without those that leave a bin too few samples for a mean."""
    order = np.sort(values)
    kept = [edges[0]]
    for edge in edges[1:-1]:
        below, above = np.searchsorted(order, [kept[-1], edge])
        if above - below >= LEAST * values.size and values.size - above >= LEAST * values.size:
            kept.append(edge)
    return np.array([*kept, edges[-1]])


def _powers(found: Residual, which: NDArray[np.int64], size: int) -> Array:
    """(bins,) mean power where it is more than noise gives, else 0."""
    total = np.bincount(which, found.power, size)
    noise = np.bincount(which, found.noise**4, size)
    chance = CHANCE * np.sqrt(2.0 * found.window * noise)
    count = np.maximum(np.bincount(which, minlength=size), 1)
    return np.where(total > chance, total, 0.0) / count


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
