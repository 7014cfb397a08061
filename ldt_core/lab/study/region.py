"""Where the Sommerfeld effect takes place in an experiment, by the physics and not by hand."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import binary_closing, binary_opening

from ldt_core.machine.machine_file import Machine
from ldt_core.physics.steady_state import bands

#: s; a stay in a band or an absence from it that is shorter does not count. Noise on a speed near
#: an edge would cut the region into pieces otherwise, and a motor that accelerates through a
#: resonance within its own time constant (J R / K_t^2 = 0.22 s for the rotor) was not captured.
SHORTEST = 0.2

Band = tuple[float, float]


def speed_bands(machine: Machine, e: float) -> list[Band]:
    """The Sommerfeld bands [rad/s] of a machine with the eccentricity e [m].

    Up to the speed that the highest voltage would hold without eccentricity. None for a machine
    without a foundation.
    """
    values = {**machine.parameters, "e": e}
    if e <= 0 or any(name not in values for name in ("M", "K_x", "K_y")):
        return []
    k, most = values["K_t"], max(map(abs, machine.voltage_limits))
    return bands(values, most * k / (k**2 + values["R"] * values["b"]))


def in_region(
    speed: ArrayLike, period: float, where: Sequence[Band], shortest: float = SHORTEST
) -> NDArray[np.bool_]:
    """Which samples of an experiment lie in the region.

    Args:
        speed: (L,) [rad/s], measured or not.
        period: sample period [s].
        where: bands [rad/s], as from `speed_bands`.
        shortest: stays and absences below this [s] are smoothed away.

    Returns:
        (L,) mask.

    >>> in_region([15.0, 17.0, 17.0, 16.0, 17.0, 20.0], 0.2, [(16.5, 18.0)], shortest=0.4).tolist()
    [False, True, True, True, True, False]
    """
    size = np.abs(np.asarray(speed, dtype=np.float64))
    inside = np.zeros(size.shape, dtype=bool)
    for low, high in where:
        inside |= (low <= size) & (size <= high)
    samples = max(1, round(shortest / period))
    if samples == 1 or not inside.any():
        return inside
    # Padded with its own ends, so that the region may begin with the experiment and end with it.
    padded = np.pad(inside, samples, mode="edge")
    stay = np.ones(samples, dtype=bool)
    tidy = binary_opening(binary_closing(padded, stay), stay)
    return np.asarray(tidy[samples:-samples], dtype=np.bool_)


def intervals(mask: ArrayLike) -> list[tuple[int, int]]:
    """(first sample, sample behind the last) of each stretch of a mask.

    >>> intervals([True, False, True, True])
    [(0, 1), (2, 4)]
    """
    edges = np.flatnonzero(np.diff(np.asarray(mask, dtype=np.int8), prepend=0, append=0))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def region_rmse(residual: NDArray[Any], mask: NDArray[np.bool_]) -> float | None:
    """Root mean square of a residual (L,) [rad/s] inside a mask; None where that is empty."""
    return float(np.sqrt(np.mean(residual[mask] ** 2))) if mask.any() else None
