"""Where the gap lies: the shortest ranges of speed, voltage, time, ... that hold most of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldt_core.diagnosis.bench import Bench
from ldt_core.diagnosis.result import Place
from ldt_core.diagnosis.starts import Starts
from ldt_core.diagnosis.torque import Torque

Array = NDArray[np.float64]

BINS = 60
MOST = 0.9  # of the gap's power, that a place must hold
LIFT = 0.1  # by which a place's share of the gap exceeds its share of the data, to be named
QUIET = 0.02  # of the samples at either end of a quantity's range that get no bin of their own
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
    """

    torque: Array
    noise: Array
    over: dict[str, Array]
    pieces: list[int]
    periods: list[float]

    @property
    def power(self) -> Array:
        """(N,) squared torque beyond noise."""
        return self.torque**2 - self.noise**2


def residual(bench: Bench, use: Sequence = (), starts: Starts | None = None) -> Residual:
    """The torque left by these effects, and what it may depend on."""
    torque, noise = [], []
    over: dict[str, list[Array]] = {name: [] for name in QUANTITIES}
    for i, piece in enumerate(bench.pieces):
        e = piece.experiment
        turn = Torque(bench.values["J"], bench.memory, e.period, len(e))
        speed, _ = bench.outputs(i, use, angle=float((starts or bench.starts).angles[i]))
        torque.append(turn.of(e.speed - speed))
        noise.append(np.full(len(e), turn.noise * bench.noise[0]))
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
    )


def places(found: Residual) -> list[Place]:
    """Ranges that hold most of the gap in a smaller part of the data, the clearest first.

    A gap that lies everywhere alike is given as the whole range of speed.
    """
    power = found.power
    total = float(power.sum())
    if total <= 0:
        return []
    named = [p for q in QUANTITIES if (p := _place(q, found.over[q], power, total)) is not None]
    named += [p] if (p := _frequency(found)) is not None else []
    clear = [p for p in named if p.share_of_gap - p.share_of_data >= LIFT]
    if not clear:
        speed = found.over["speed"]
        return [Place("speed", float(speed.min()), float(speed.max()), "rad/s", 1.0, 1.0)]
    return sorted(clear, key=lambda p: p.share_of_data - p.share_of_gap)


def _place(quantity: str, values: Array, power: Array, total: float) -> Place | None:
    low, high = np.quantile(values, [0.0, 1.0])
    if not high > low:
        return None
    if quantity == "experiment":
        edges = np.unique(values)
        edges = np.append(edges - 0.5, edges[-1] + 0.5)
    else:
        # Equal steps of the quantity where there are data, so that ends are sharp.
        edges = np.linspace(low, high, BINS + 1)
    which = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, edges.size - 2)
    share = np.bincount(which, power, edges.size - 1) / total
    data = np.bincount(which, minlength=edges.size - 1) / values.size
    i, j = _shortest(share, data)
    begin, end = float(edges[i]), float(edges[j + 1])
    if quantity == "experiment":
        begin, end = begin + 0.5, end - 0.5
    inside, part = float(share[i : j + 1].sum()), float(data[i : j + 1].sum())
    return Place(quantity, begin, end, QUANTITIES[quantity], min(inside, 1.0), part)


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
