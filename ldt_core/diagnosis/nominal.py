"""The machine's own parameters that are fitted with every set, beside what is known of them.

They may make up for a cause: a calibrated motor constant that moves by 61 % has swallowed a brake.
So each is told with its prior, and one far outside it is said in the verdict's sentence.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ldt_core.base.errors import LdtError
from ldt_core.base.sentences import listed
from ldt_core.diagnosis.attribution import DEVIATIONS, deviations
from ldt_core.diagnosis.diagnosis import Refit
from ldt_core.diagnosis.effect_fit import EffectFit, used
from ldt_core.diagnosis.library import CHANGED_BY
from ldt_core.diagnosis.thresholds import THRESHOLDS
from ldt_core.machine.machine_file import Machine


def refits(
    machine: Machine, fitted: EffectFit, left: float, excess: float, part: float | None
) -> list[Refit]:
    """A row for each nominal parameter that was fitted along.

    Args:
        fitted: the set in force, with the machine's own parameters behind its effects.
        left, excess: power beyond noise that it leaves, and that of the gap.
        part: what these parameters close by themselves, all together.
    """
    count = len(fitted.members) - fitted.own
    own, z = fitted.members[count:], fitted.z[count:]
    spread = deviations(fitted, left, excess)[count:]
    found = []
    for k, (c, at) in enumerate(zip(own, z, strict=True)):
        for name in (n for n, effect in CHANGED_BY.items() if effect == c.name):
            nominal = machine.parameters.get(name, 0.0)
            if nominal == 0:  # of which no factor can be told
                continue

            def factor(
                moved: np.ndarray, k: int = k, name: str = name, nominal: float = nominal
            ) -> float:
                values = dict(machine.parameters)
                for effect, given in used([own[k]], [moved]):
                    values = dict(effect.change_parameters(machine.model, values, given))
                return float(values[name]) / nominal

            try:
                low, high = c.bounds
                ends = [np.clip(at + s * DEVIATIONS * spread[k], low, high) for s in (-1, 1)]
                interval = sorted(factor(e) for e in ends) if np.isfinite(spread[k]).all() else None
                here = factor(at)
            except LdtError:  # an increment that no machine has at the interval's end
                interval, here = None, factor(at)
            if name == "e" or (here == 1.0 and interval and interval[0] == interval[1]):
                continue
            bounds = None if interval is None else (interval[0], interval[1])
            found.append(Refit(name, here, bounds, machine.tolerances.get(name), part))
    return found


def beyond(found: Sequence[Refit]) -> list[Refit]:
    """Those that lie further from the machine file than its tolerance allows."""
    most = THRESHOLDS.prior_deviations
    return [r for r in found if r.prior_std and abs(r.factor - 1.0) > most * r.prior_std]


def enough(found: Sequence[Refit], before: float) -> str:
    """The sentence where these parameters close a gap by themselves; "" where there is none.

    Args:
        before: the file's error on held-out experiments [rad/s].
    """
    if not found or found[0].closed_fraction is None:
        return ""
    what = listed(f"{r.parameter} × {r.factor:.3g}" for r in found)
    return (
        f"No effect is needed: nominal parameters that were fitted along ({what}) close "
        f"{found[0].closed_fraction:.0%} of the gap of {before:.3g} rad/s."
    )


def said(found: Sequence[Refit], before: float) -> str:
    """A sentence on those far from the file; "" where there are none.

    Args:
        before: the file's error on held-out experiments [rad/s].
    """
    far = beyond(found)
    if not far:
        return ""
    what = listed(
        f"{r.parameter} × {r.factor:.3g} ({abs(r.factor - 1) / (r.prior_std or 1):.2g} deviations "
        "from the file)"
        for r in far
    )
    part = far[0].closed_fraction
    alone = (
        "" if part is None else f"; nominal parameters alone close {part:.0%} of {before:.3g} rad/s"
    )
    return f"Nominal parameters moved beyond their tolerance: {what}{alone}."
