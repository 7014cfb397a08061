"""Where the gap lies: the ranges of speed, voltage, time, ... in which it is largest.

By the torque's mean at each value of a quantity, where it depends on the quantity, and else by its
power there; not by how often the recording was there: a gap at a resonance lies there also in a
recording that mostly ran past it. A range begins and ends where the mean torque falls below a fifth
of its largest, or the power below its average over all values.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.arrays import Array
from ldt_core.diagnosis.diagnosis import GapLocation
from ldt_core.diagnosis.residual_torque import QUANTITIES, ResidualTorque
from ldt_core.diagnosis.simulated_experiments import Use
from ldt_core.diagnosis.torque_curve import KNOTS
from ldt_core.physics.steady_state import has_foundation, unbalance_torque

BINS = 120  # of a quantity's range: a place is found to within a per cent of it
BIN_SAMPLES = 0.002  # share of the samples that a bin's power is taken over, at least
BIN_NOISE = 3.0  # deviations of a bin's power that noise alone may give it
BAND_POWER = 0.9  # share of the gap's power that a band of frequencies holds
NAMED_LIFT = 0.1  # by which a place's share of the gap exceeds its share of the data, to be named
DEPENDENCE = 0.1  # share of the residuals' power that a torque over a quantity accounts for
TORQUE_EDGE = 0.2  # of the largest mean torque: a range ends where it falls below
OTHER_DIRECTION = 0.3  # of one direction's range that the other reaches, to look at both as one
ROUNDING = 1e-9  # share of the sum by which a range must be better than another one


def places(found: ResidualTorque) -> list[GapLocation]:
    """Ranges in which the gap is larger than on average, the clearest first.

    A gap that lies everywhere alike is given as the whole range of speed. What lies at the same
    sizes of speed or voltage in both directions is given as two ranges.
    """
    if not float(found.power.sum()) > 0:
        return []
    named = [p for q in QUANTITIES for p in _places(q, found)]
    named += [p] if (p := _frequency(found)) is not None else []
    clear = [p for p in named if p.share_of_gap - p.share_of_data >= NAMED_LIFT]
    if not clear:
        speed = found.over["speed"]
        return [GapLocation("speed", float(speed.min()), float(speed.max()), "rad/s", 1.0, 1.0)]
    # Where the gap does not stand out at any speed, its speeds are still what people ask for.
    clear += [p for p in named if p.quantity == "speed" and p not in clear]
    return sorted(clear, key=lambda p: p.share_of_data - p.share_of_gap)


def steady_places(found: ResidualTorque, use: Use) -> list[GapLocation]:
    """Speeds at which effects change what the foundation takes from a shaft that turns steadily.

    A rotor that is run through its resonances quickly shakes most when it is past them: a recording
    of that shows the gap at higher speeds than those at which it would be captured.
    """
    residuals, values = found.residuals, found.over["speed"]
    changed = residuals.changed(use)
    if changed is None or not has_foundation(changed):
        return []
    top = float(np.abs(values).max())
    speed = np.linspace(0.0, top, KNOTS)
    torque = np.abs(unbalance_torque(changed, speed) - unbalance_torque(residuals.values, speed))
    if not torque.max() > 0:
        return []
    # From the lowest resonance to the highest: between them it is hardly ever quiet.
    heard = speed[torque >= TORQUE_EDGE * torque.max()]
    ends = float(heard[0]), float(heard[-1])
    if ends[1] - ends[0] > (1 - NAMED_LIFT) * top:
        return []
    ranges = [ends, (-ends[1], -ends[0])]
    seen = [(a, b) for a, b in ranges if np.any((values > a) & (values < b))]
    return [replace(_place("speed", a, b, found), steady=True) for a, b in seen]


def _places(quantity: str, found: ResidualTorque) -> list[GapLocation]:
    values = found.over[quantity]
    low, high = float(values.min()), float(values.max())
    if not high > low:
        return []
    ranges = _depending(quantity, found) if quantity != "experiment" else []
    ranges = ranges or [_powerful(quantity, found)]
    return [_place(quantity, begin, end, found) for begin, end in ranges]


def _place(quantity: str, begin: float, end: float, found: ResidualTorque) -> GapLocation:
    values = found.over[quantity]
    here = (values >= begin) & (values <= end)
    total = float(found.power.sum())
    share = min(max(float(found.power[here].sum()) / total, 0.0), 1.0) if total > 0 else 0.0
    data = float(np.count_nonzero(here)) / values.size
    return GapLocation(quantity, begin, end, QUANTITIES[quantity], share, data)


def _depending(quantity: str, found: ResidualTorque) -> list[tuple[float, float]]:
    """The range with most of the mean torque, or one for each direction.

    Nothing where the torque does not depend on the quantity.
    """
    curve = found.curve(quantity)
    # What may be chance does not widen a range.
    sure = np.maximum(np.abs(curve.torque) - curve.deviation, 0.0)
    if curve.explained < DEPENDENCE or not sure.max() > 0:
        return []
    knots, low, high = curve.knots, float(curve.knots[0]), float(curve.knots[-1])
    i, j, lift = _most_beyond(sure, TORQUE_EDGE * sure.max())
    if quantity in ("speed", "voltage") and min(-low, high) > OTHER_DIRECTION * max(-low, high):
        # Both directions apart, since what is odd in the direction has no mean over them.
        size = np.linspace(0.0, max(-low, high), knots.size)
        both = np.interp(size, knots, sure, right=0.0) + np.interp(-size, knots, sure, left=0.0)
        k, m, folded = _most_beyond(both, TORQUE_EDGE * both.max())
        if folded > lift:
            first, last = float(size[k]), float(size[m])
            return [(first, min(last, high)), (max(-last, low), -first)]
    return [(float(knots[i]), float(knots[j]))]


def _powerful(quantity: str, found: ResidualTorque) -> tuple[float, float]:
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
    share = power / power.max() * width  # of a run that explodes, the product would be no number
    share /= share.sum()
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
        if (
            above - below >= BIN_SAMPLES * values.size
            and values.size - above >= BIN_SAMPLES * values.size
        ):
            kept.append(edge)
    return np.array([*kept, edges[-1]])


def _powers(found: ResidualTorque, which: NDArray[np.int64], size: int) -> Array:
    """(bins,) mean power where it is more than noise gives, else 0."""
    total = np.bincount(which, found.power, size)
    noise = np.bincount(which, found.noise**4, size)
    chance = BIN_NOISE * np.sqrt(2.0 * found.window * noise)
    count = np.maximum(np.bincount(which, minlength=size), 1)
    return np.where(total > chance, total, 0.0) / count


def _shortest(share: Array, data: Array) -> tuple[int, int]:
    """First and last of the adjoining bins with the least data that hold BAND_POWER of the gap."""
    gap, seen = (np.concatenate([[0.0], np.cumsum(v)]) for v in (share, data))
    best = (np.inf, 0, share.size - 1)
    for i in range(share.size):
        enough = np.flatnonzero(gap[i + 1 :] - gap[i] >= BAND_POWER)
        if enough.size:
            j = i + int(enough[0])
            best = min(best, (float(seen[j + 1] - seen[i]), i, j))
    return best[1], best[2]


def _frequency(found: ResidualTorque) -> GapLocation | None:
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
    if constant > (1 - BAND_POWER) * float(np.sum(found.torque**2)):
        return None  # it does not alternate
    wrong[0], moved[0] = 0.0, 0.0
    share, data = wrong / wrong.sum(), moved / max(float(moved.sum()), 1e-300)
    i, j = _shortest(share, data)
    inside, part = float(share[i : j + 1].sum()), float(data[i : j + 1].sum())
    return GapLocation("frequency", float(frequency[i]), float(frequency[j]), "Hz", inside, part)
