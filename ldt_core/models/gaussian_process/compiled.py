"""Mean, slope and deviation of a trained function as compiled loops read them in nanoseconds.

For one input that is a table on a regular axis: the mean as cubic Hermite polynomials through exact
values and slopes, the deviation by straight lines. For more inputs `speed_run` evaluates the
inducing points as they are, in microseconds a sample: a table for two inputs, of 27,000 nodes, was
seen to take as long to fill as 78 runs of 2000 samples, and three inputs would need millions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ldt_core.models.gaussian_process.kernel import Array
from ldt_core.models.gaussian_process.sparse import SparsePosterior
from ldt_core.models.gaussian_process.speed_run import run_inducing, run_table

#: What f may depend on, in the order in which the compiled loop keeps them.
INPUTS = ("current", "speed", "voltage")
#: (ad, bd, gd, voltage, start) -> speed (L,), slopes (L, 2), deviation of f (L,): `speed_run`.
FreeRun = Callable[[Array, Array, Array, Array, Array], tuple[Array, Array, Array]]

#: Nodes of the table in a length scale. The Hermite error is h⁴/384 max|f⁗| <= 8e-8 of the size
#: that a function with this length scale has (f⁗ is 3 of it over ℓ⁴ for a single bump), smaller
#: than any sensor resolves. The line's error of the deviation is h²/8 over the length scale
#: squared, 8e-4.
NODES_PER_LENGTH = 16
#: [length scales] Margin of the table on both sides: a bump has fallen to 4e-6 there, so that the
#: step to the prior beyond it is of that size.
MARGIN = 5.0
#: Nodes at most: more are no table of a machine, and would not fit the cache.
MOST_NODES = 1_000_000


@dataclass(frozen=True, eq=False)
class SpeedTable:
    """A function of one input on a regular axis; beyond its ends mean 0 and the prior's deviation.

    Args:
        low: first node, in the input's unit.
        step: distance of nodes.
        cubic: (c, 4) polynomial of each cell in t = 0..1, lowest power first.
        std: (c + 1,) deviation at the nodes.
        prior_std: deviation beyond the ends.
    """

    low: float
    step: float
    cubic: Array
    std: Array
    prior_std: float


def tabulate(posterior: SparsePosterior) -> SpeedTable:
    """The table of a posterior with one input.

    Raises:
        ValueError: length scale and range of the inputs differ absurdly.
    """
    (length,) = posterior.kernel.length_scales
    z = posterior.inducing[:, 0]
    low, high = float(z.min()) - MARGIN * length, float(z.max()) + MARGIN * length
    nodes_needed = (high - low) / length * NODES_PER_LENGTH
    if not nodes_needed <= MOST_NODES:
        raise ValueError(f"a length scale of {length:g} over inputs from {low:g} to {high:g}")
    count = max(int(np.ceil(nodes_needed)), 1)
    step = (high - low) / count
    nodes = np.linspace(low, high, count + 1)
    rows = posterior.kernel(nodes[:, None], posterior.inducing)
    value = rows @ posterior.weights
    slope = (rows * (z - nodes[:, None])) @ posterior.weights / length**2 * step
    a, b, rise = slope[:-1], slope[1:], np.diff(value)
    cubic = np.column_stack([value[:-1], a, 3 * rise - 2 * a - b, a + b - 2 * rise])
    std = posterior.std(nodes[:, None])
    return SpeedTable(low, step, np.ascontiguousarray(cubic), std, posterior.kernel.signal_std)


def compile_run(posterior: SparsePosterior | None, inputs: Sequence[str]) -> FreeRun:
    """The free run of a motor that this function drives.

    Args:
        posterior: the function; None for f = 0.
        inputs: its inputs, names of `INPUTS`.

    Raises:
        ValueError: as `tabulate`.
    """
    if posterior is None:
        table: SpeedTable | None = SpeedTable(0.0, 1.0, np.empty((0, 4)), np.empty(0), 0.0)
    elif tuple(inputs) == ("speed",):
        table = tabulate(posterior)
    else:
        table = None
    if table is not None:
        t = table
        return lambda ad, bd, gd, voltage, start: run_table(
            ad, bd, gd, voltage, start, t.low, t.step, t.cubic, t.std, t.prior_std
        )
    assert posterior is not None
    kernel, indices = posterior.kernel, np.array([INPUTS.index(name) for name in inputs])
    lengths, signal_std = np.array(kernel.length_scales), kernel.signal_std
    inducing, weights = np.ascontiguousarray(posterior.inducing), posterior.weights
    explained = np.tril(posterior.explained) + np.tril(posterior.explained, -1)  # half the work
    return lambda ad, bd, gd, voltage, start: run_inducing(
        *(ad, bd, gd, voltage, start),
        *(indices, lengths, signal_std, inducing, weights, explained),
    )
