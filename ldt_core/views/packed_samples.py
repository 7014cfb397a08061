"""An experiment's samples for the page: as many as there is room for, in two bytes each."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.experiment import Experiment, Prediction, Samples

#: Characters of the page that samples may take; the rest of 5 MB is for the library and the tables.
ROOM = 3_900_000
POINTS = 840  # of a curve in a figure: about two for each pixel of its panel
BYTES = 2  # of a number: its error is then a 130,000th of its range
CHARACTERS = 4 / 3  # of a byte in base64
LEVELS = 2**16 - 1  # of a number of two bytes
#: Fewer samples than this show no experiment; those with the least error then go without.
FEWEST_SAMPLES = 240
SHORTER = 0.8  # of the last length of parts: the next one that is tried


@dataclass(frozen=True)
class PackedChannel:
    """How the codes of a row become numbers: low + code * step."""

    name: str
    low: float
    step: float


@dataclass(frozen=True)
class PackedSamples:
    """Samples of one experiment.

    Attributes:
        channels: time first.
        data: uint16 codes, channel by channel, little end first, in base64.
    """

    channels: tuple[PackedChannel, ...]
    data: str
    kept: int
    of: int

    def as_dict(self) -> dict[str, Any]:
        """What the page's script unpacks."""
        channels = [[c.name, c.low, c.step] for c in self.channels]
        return {"channels": channels, "data": self.data, "of": self.of}


def room(experiments: int, channels: int) -> tuple[int, int]:
    """(samples for each experiment, experiments that have samples at all).

    Args:
        experiments: of the run, from 1.
        channels: rows of an experiment, time included.
    """
    samples = int(ROOM / CHARACTERS / BYTES / channels)
    shown = min(experiments, samples // FEWEST_SAMPLES)
    return samples // shown, shown


def extremes(rows: NDArray[np.float64], most: int) -> NDArray[np.intp]:
    """Indices of samples to keep, at most so many; all, where they fit.

    The experiment is cut into equal parts, as short as there is room for, and of each part the
    lowest and the highest sample of every row are kept, as are the first and the last sample.

    Args:
        rows: (C, L).
        most: at least 2 C + 2.
    """
    count, length = rows.shape
    if length <= most:
        return np.arange(length)
    width = -(-length // max(1, (most - 2) // (2 * count)))
    kept = _of_parts(rows, width)
    while width > 1:  # rows often have their extremes in the same samples
        width = int(SHORTER * width)
        more = _of_parts(rows, width)
        if more.size > most:
            break
        kept = more
    return kept


def thinned(x: Samples, y: Samples, most: int = POINTS) -> tuple[Samples, Samples]:
    """The same curve in at most so many points, its extremes over short stretches among them."""
    finite = np.isfinite(y)
    x, y = x[finite], y[finite]
    at = extremes(y[None], most)
    return x[at], y[at]


def _of_parts(rows: NDArray[np.float64], width: int) -> NDArray[np.intp]:
    length = rows.shape[1]
    parts = -(-length // width)
    # What fills the last part repeats the last sample, and the first of equals counts.
    full = np.pad(rows, ((0, 0), (0, parts * width - length)), mode="edge")
    full = full.reshape(len(rows), parts, width)
    begins = width * np.arange(parts)
    extreme = [full.argmin(axis=2) + begins, full.argmax(axis=2) + begins]
    return np.unique(np.append(extreme, [0, length - 1]))


def pack(
    experiment: Experiment, prediction: Prediction | None, original: Prediction | None, most: int
) -> PackedSamples:
    """Voltage, speed, predictions and deviation of an experiment over time, thinned to `most`.

    The rows of what is None are left out.
    """
    rows = {"voltage": experiment.voltage, "measured": experiment.speed}
    if prediction is not None:
        rows["predicted"] = prediction.speed
    if original is not None:
        rows["original"] = original.speed
    judged = list(rows.values())
    if prediction is not None:
        judged.append(prediction.residual(experiment))
        if prediction.speed_std is not None:
            rows["deviation"] = prediction.speed_std
            judged.append(prediction.speed_std)
    at = extremes(np.stack(judged), most)
    every = -(-len(experiment) // (LEVELS + 1))  # an index has to be a code as well
    channels = [PackedChannel("time", 0.0, experiment.period * every)]
    codes: list[NDArray[Any]] = [at // every]
    for name, row in rows.items():
        channel, code = _coded(name, row[at])
        channels.append(channel)
        codes.append(code)
    data = base64.b64encode(np.concatenate(codes).astype("<u2").tobytes()).decode()
    return PackedSamples(tuple(channels), data, at.size, len(experiment))


def _coded(name: str, row: Samples) -> tuple[PackedChannel, NDArray[np.float64]]:
    low, high = float(row.min()), float(row.max())
    step = (high / LEVELS) - (low / LEVELS)  # the difference itself may be beyond a float
    if not step > 0:
        return PackedChannel(name, low, 0.0), np.zeros(row.size)
    return PackedChannel(name, low, step), np.clip(np.rint(row / step - low / step), 0, LEVELS)
