"""How large a law must be for its gap to be so many times the noise."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ldt_core.lab.challenge.law import Law
from ldt_core.lab.challenge.rig import Acting, Bench
from ldt_core.lab.challenge.simulation import Unsteady

CLOSE = 0.12  # relative: near enough to a strength that is drawn at random
ROUNDS = 8
SLOPES = (0.4, 3.0)  # of a gap over its size, both in logarithms: outside of them it is chance


def size_for(
    bench: Bench, law: Law, shape: Mapping[str, float], wanted: float
) -> tuple[Acting, float]:
    """The law at the size whose gap has this root mean square, or as near as its bounds let it.

    Args:
        bench: of the case.
        law: to size.
        shape: its other numbers.
        wanted: root mean square of the gap [rad/s].

    Returns:
        the law in that size, the gap that it has [rad/s].
    """
    low, high = ends = law.sizes
    size, slope = math.sqrt(low * high), 1.0
    best: tuple[float, Acting, float] | None = None
    before: tuple[float, float] | None = None
    for _ in range(ROUNDS):
        acting = Acting(law.name, law.values(size, shape, bench.setting.known), shape)
        try:
            gap = bench.gap_rms((acting,))
        except Unsteady:
            high = size
            size = math.sqrt(low * size)
            continue
        off = math.log(max(gap, 1e-9) / wanted)
        if best is None or abs(off) < abs(best[0]):
            best = off, acting, gap
        if abs(off) < CLOSE:
            break
        if before is not None and abs(math.log(size / before[0])) > 1e-3:
            slope = (off - before[1]) / math.log(size / before[0])
            slope = min(max(slope, SLOPES[0]), SLOPES[1])
        before = size, off
        if size == ends[0 if off > 0 else 1]:  # as near as the bounds let it
            break
        low, high = (size, high) if off < 0 else (low, size)
        new = size * math.exp(-off / slope)
        if not low < new < high:
            beyond = ends[1] if new >= high else ends[0]
            new = beyond if beyond in (low, high) else math.sqrt(low * high)
        size = new
    if best is None:
        raise Unsteady(f"no size of {law.name} makes a machine that runs")
    return best[1], best[2]
