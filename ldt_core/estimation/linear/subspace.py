"""Poles without a start value: subspace identification (PO-MOESP).

Past inputs and outputs serve as instruments, so that noise does not bias the poles, and a constant
is projected out with the future input, so that an offset does not become a pole at 0. One singular
value decomposition gives a start for every order. The noise makes these poles rough, which is all
that the output-error search needs of them.

A rate far above the dynamics squeezes all discrete poles to 1. The data are therefore averaged over
blocks of 1, 4, 16 … samples as well, each giving a start of its own; the search takes the best.

Reference: M. Verhaegen, "Subspace model identification, part 3", Int. J. Control 61 (1995) 555–586.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ldt_core.estimation.linear import schwarz

Array = NDArray[np.float64]

#: Samples averaged at one time scale relative to the scale before.
BLOCK_RATIO = 4
#: Columns of the data matrices, at most: more tell a start nothing more, but cost time.
MOST_COLUMNS = 1000
#: Rows per quarter beyond the order: a longer past helps against noise, at quadratic cost.
SPARE_ROWS = 5


def starts(
    inputs: list[Array], outputs: list[Array], orders: range, sigma: float
) -> dict[int, list[Array]]:
    """Start values θ for each order, one for each time scale that the data allow.

    Args:
        inputs: one (L,) per experiment.
        outputs: as the inputs.
        orders: to find poles for.
        sigma: slowest decay of the model [per sample], see `schwarz`.
    """
    found: dict[int, list[Array]] = {n: [] for n in orders}
    rows = orders[-1] + SPARE_ROWS
    width = 1
    while True:
        hankels = _hankels(inputs, outputs, width, rows)
        if hankels is None:
            return found
        observability = _observability(hankels, rows)
        for n in orders:
            shifted = np.linalg.lstsq(observability[:-1, :n], observability[1:, :n], rcond=None)[0]
            poles = _continuous(np.linalg.eigvals(shifted)) / width
            found[n].append(schwarz.from_poles(poles, sigma))
        width *= BLOCK_RATIO


def _hankels(inputs: list[Array], outputs: list[Array], width: int, rows: int) -> Array | None:
    """(1 + 4 rows, columns): constant, future input, past input, past output, future output."""
    blocks = []
    total = sum(max(0, u.size // width - 2 * rows + 1) for u in inputs)
    if total < 6 * rows:
        return None
    stride = -(-total // MOST_COLUMNS)
    for u, y in zip(inputs, outputs, strict=True):
        size = u.size // width
        if size < 2 * rows:
            continue
        means = [s[: size * width].reshape(size, width).mean(axis=1) for s in (u, y)]
        windows = [np.lib.stride_tricks.sliding_window_view(m, 2 * rows)[::stride] for m in means]
        (past_u, future_u), (past_y, future_y) = (np.hsplit(w, 2) for w in windows)
        one = np.ones((len(past_u), 1))
        blocks.append(np.hstack([one, future_u, past_u, past_y, future_y]))
    return np.vstack(blocks)


def _observability(hankels: Array, rows: int) -> Array:
    """(rows, rows): orthonormal directions of the future output's states, strongest first."""
    factor = np.asarray(np.linalg.qr(hankels, mode="r")).T
    middle = slice(1 + rows, 1 + 3 * rows)
    return np.linalg.svd(factor[1 + 3 * rows :, middle])[0]


def _continuous(poles: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Logarithms; real poles that no held continuous system has (0 and below) become fast ones."""
    poles = poles.astype(np.complex128)
    least = np.exp(-schwarz.FASTEST_DECAY)
    impossible = (np.abs(poles.imag) < 1e-12) & (poles.real < least)
    return np.log(np.where(impossible, np.maximum(np.abs(poles), least), poles))
