"""Where the gap lies: the ranges of speed, voltage, time, ... in which it is largest.

By the torque's mean at each value of a quantity, where it depends on the quantity, and else by its
power there; not by how often the recording was there: a gap at a resonance lies there also in a
recording that mostly ran past it. A range begins and ends where the mean torque falls below a fifth
of its largest, or the power below its average over all values.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ldt_core.diagnosis.result import Place
from ldt_core.diagnosis.starts import Starts
from ldt_core.diagnosis.torque import Torque
from ldt_core.diagnosis.torque_curve import KNOTS, Curve, torque_curve
from ldt_core.diagnosis.trials import Bench, Use
from ldt_core.physics.steady_state import has_foundation, unbalance_torque

Array = NDArray[np.float64]

BINS = 120
MOST = 0.9  # of the gap's power, that a band of frequencies must hold
LEAST = 0.002  # of the samples, that a bin's power is taken over
LIFT = 0.1  # by which a place's share of the gap exceeds its share of the data, to be named
DEPENDS = 0.1  # of the residuals' power, that a torque's dependence on a quantity accounts for
HEARD = 0.2  # of the largest mean torque: with less, the gap lies elsewhere
BOTH = 0.3  # of the larger direction's range, that the other reaches, to look at both as one
CHANCE = 3.0  # deviations of a bin's power that noise alone may give it
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
        over: quantity to (N,) values.
        pieces: length of each experiment.
        periods: sample period of each [s].
        window: samples over which `torque` is smoothed.
        bench: experiments.
        left: (L,) what is wrong with the speed in each [rad/s].
        speeds: (L,) speed in each, not smoothed [rad/s].
        deviation: of the sensor's noise on `left` [rad/s].
    """

    torque: Array
    noise: Array
    over: dict[str, Array]
    pieces: list[int]
    periods: list[float]
    window: int
    bench: Bench
    left: list[Array]
    speeds: list[Array]
    deviation: float

    @functools.cached_property
    def power(self) -> Array:
        """(N,) squared torque beyond noise."""
        return self.torque**2 - self.noise**2

    def curve(self, quantity: str) -> Curve:
        """The mean torque over a quantity."""
        values = self.speeds if quantity == "speed" else self._each(self.over[quantity])
        return torque_curve(
            self.left,
            values,
            self.periods,
            [p.rest for p in self.bench.pieces],
            self.bench.values["J"],
            self.bench.memory,
            self.deviation,
        )

    def _each(self, values: Array) -> list[Array]:
        return np.split(values, np.cumsum(self.pieces)[:-1])


def residual(bench: Bench, use: Use = (), starts: Starts | None = None) -> Residual:
    """The torque left by these effects, and what it may depend on."""
    simulated = [
        bench.outputs(i, use, angle=_angle(bench, starts, i))[0] for i in range(len(bench.pieces))
    ]
    measured = [e.speed for e in bench.experiments]
    left = [a - b for a, b in zip(measured, simulated, strict=True)]
    return _residual(bench, left, measured, bench.noise[0])


def change(bench: Bench, use: Use, to: Use, starts: Starts | None = None) -> Residual:
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
    torque, noise, window = [], [], 1
    over: dict[str, list[Array]] = {name: [] for name in QUANTITIES}
    for e, wrong, speed in zip(bench.experiments, left, speeds, strict=True):
        turn = Torque(bench.values["J"], bench.memory, e.period, len(e))
        torque.append(turn.of(wrong))
        noise.append(np.full(len(e), turn.noise * deviation))
        window = max(window, turn.window)
        over["speed"].append(turn.smooth(speed))
        over["voltage"].append(np.asarray(e.voltage))
        over["acceleration"].append(turn.smooth(speed, 1))
        over["time"].append(e.time)
        over["experiment"].append(np.full(len(e), float(e.number)))
    return Residual(
        np.concatenate(torque),
        np.concatenate(noise),
        {name: np.concatenate(parts) for name, parts in over.items()},
        [len(e) for e in bench.experiments],
        [e.period for e in bench.experiments],
        window,
        bench,
        list(left),
        list(speeds),
        deviation,
    )


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


def steady_places(found: Residual, use: Use) -> list[Place]:
    """Speeds at which effects change what the foundation takes from a shaft that turns steadily.

    A rotor that is run through its resonances quickly shakes most when it is past them: a recording
    of that shows the gap at higher speeds than those at which it would be captured.

    Args:
        found: the torque in the recording.
        use: the named effects.
    """
    bench, values = found.bench, found.over["speed"]
    changed = bench.changed(use)
    if changed is None or not has_foundation(changed):
        return []
    top = float(np.abs(values).max())
    speed = np.linspace(0.0, top, KNOTS)
    torque = np.abs(unbalance_torque(changed, speed) - unbalance_torque(bench.values, speed))
    if not torque.max() > 0:
        return []
    # From the lowest resonance to the highest: between them it is hardly ever quiet.
    heard = speed[torque >= HEARD * torque.max()]
    ends = float(heard[0]), float(heard[-1])
    if ends[1] - ends[0] > (1 - LIFT) * top:
        return []
    ranges = [ends, (-ends[1], -ends[0])]
    seen = [(a, b) for a, b in ranges if np.any((values > a) & (values < b))]
    return [replace(_place("speed", a, b, found), steady=True) for a, b in seen]


def _places(quantity: str, found: Residual) -> list[Place]:
    values = found.over[quantity]
    low, high = float(values.min()), float(values.max())
    if not high > low:
        return []
    ranges = _depending(quantity, found) if quantity != "experiment" else []
    ranges = ranges or [_powerful(quantity, found)]
    return [_place(quantity, begin, end, found) for begin, end in ranges]


def _place(quantity: str, begin: float, end: float, found: Residual) -> Place:
    values = found.over[quantity]
    here = (values >= begin) & (values <= end)
    total = float(found.power.sum())
    share = min(max(float(found.power[here].sum()) / total, 0.0), 1.0) if total > 0 else 0.0
    data = float(np.count_nonzero(here)) / values.size
    return Place(quantity, begin, end, QUANTITIES[quantity], share, data)


def _depending(quantity: str, found: Residual) -> list[tuple[float, float]]:
    """The range with most of the mean torque, or one for each direction.

    Nothing where the torque does not depend on the quantity.
    """
    curve = found.curve(quantity)
    # What may be chance does not widen a range.
    sure = np.maximum(np.abs(curve.torque) - curve.deviation, 0.0)
    if curve.explained < DEPENDS or not sure.max() > 0:
        return []
    knots, low, high = curve.knots, float(curve.knots[0]), float(curve.knots[-1])
    i, j, lift = _most_beyond(sure, HEARD * sure.max())
    if quantity in ("speed", "voltage") and min(-low, high) > BOTH * max(-low, high):
        # Both directions apart, since what is odd in the direction has no mean over them.
        size = np.linspace(0.0, max(-low, high), knots.size)
        both = np.interp(size, knots, sure, right=0.0) + np.interp(-size, knots, sure, left=0.0)
        k, m, folded = _most_beyond(both, HEARD * both.max())
        if folded > lift:
            first, last = float(size[k]), float(size[m])
            return [(first, min(last, high)), (max(-last, low), -first)]
    return [(float(knots[i]), float(knots[j]))]


def _powerful(quantity: str, found: Residual) -> tuple[float, float]:
    """The range with the most power beyond the average."""
    values = found.over[quantity]
    if quantity == "experiment":
        edges = np.append(np.unique(values), values.max() + 1.0)
    else:
        # Equal steps of the quantity where there are data, so that ends are sharp.
        edges = _merged(np.linspace(values.min(), values.max(), BINS + 1), values)
    which = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, edges.size - 2)
    power = _powers(found, which, edges.size - 1)
    if not power.sum() > 0:
        return float(values.min()), float(values.max())
    width = np.diff(edges)
    share = power * width / float(power @ width)
    i, j, _ = _most_beyond(share, width / width.sum())
    return float(edges[i]), float(edges[j] if quantity == "experiment" else edges[j + 1])


def _most_beyond(share: Array, level: Array | float) -> tuple[int, int, float]:
    """(first, last) of the adjoining bins that exceed a level most, and by what share of all.

    Args:
        share: (bins,) of the gap.
        level: (bins,) or the same for all.
    """
    sums = np.concatenate([[0.0], np.cumsum(share - level)])
    best = (0, share.size - 1, 0.0)
    for i in range(share.size):
        j = i + int(np.argmax(sums[i + 1 :]))
        if float(sums[j + 1] - sums[i]) > best[2] + ROUNDING * float(share.sum()):
            best = (i, j, float(sums[j + 1] - sums[i]))
    i, j, _ = best
    return i, j, float(share[i : j + 1].sum() / share.sum()) - (j + 1 - i) / share.size


def _merged(edges: Array, values: Array) -> Array:
    """Edges without those that leave a bin too few samples for a power."""
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
