"""What each member of a set contributes: its amounts with confidence intervals, its Shapley share.

Noise alone would give the covariance (J'J)^-1; what the laws are off by adds to the variance, see
`estimation.amount_interval`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.diagnosis.diagnosis import ParameterAmount
from ldt_core.diagnosis.effect_fit import EffectFit, by_member
from ldt_core.diagnosis.effect_set_search import EffectSetSearch
from ldt_core.diagnosis.nominal_prior import masses_leave_open
from ldt_core.estimation.amount_interval import DEVIATIONS, has_interval, shown_variance
from ldt_core.machine.machine_file import Machine
from ldt_core.physics.machine_sizes import is_amount


def share(part: float) -> float:
    """A part of a gap between nothing and all of it: noise and misfits may lead beyond."""
    return float(np.clip(part, 0.0, 1.0))


def covariance(fit: EffectFit, left: float, gap: float) -> Array:
    """(p, p) of all coordinates; infinite variance where nothing depends on one.

    Arguments as of `amount_interval.law_variance`.
    """
    # What is known beforehand does not get wider with what the laws leave.
    variance = shown_variance(left, gap)
    rows = np.vstack([fit.jacobian / math.sqrt(variance), fit.prior_rows])
    size = np.linalg.norm(rows, axis=0)
    seen = np.flatnonzero(size > 1e-9)
    found = np.diag(np.full(size.size, math.inf))
    if seen.size:
        scaled = rows[:, seen] / size[seen]
        _, s, right = np.linalg.svd(scaled, full_matrices=False)
        half = right.T / np.maximum(s, 1e-7) / size[seen][:, None]
        found[np.ix_(seen, seen)] = half @ half.T
    return found


def deviations(fit: EffectFit, left: float, gap: float) -> tuple[Array, ...]:
    """Standard deviation of each member's coordinates; arguments as of `covariance`."""
    return by_member(fit.members, np.sqrt(np.diag(covariance(fit, left, gap))))


def amounts(fit: EffectFit, left: float, gap: float) -> dict[str, dict[str, ParameterAmount]]:
    """Effect to parameter to amount, of every member of a set; arguments as of `covariance`."""
    found: dict[str, dict[str, ParameterAmount]] = {}
    for c, z, spread in zip(fit.effects, fit.z, deviations(fit, left, gap), strict=False):
        low, high = c.bounds
        own = {}
        known = has_interval(spread, np.where([is_amount(p) for p in c.parameters], z, 0.0))
        for j, p in enumerate(c.parameters):
            interval = None
            if known[j]:
                ends = np.clip(z[j] + DEVIATIONS * spread[j] * np.array([-1, 1]), low[j], high[j])
                interval = c.value(j, float(ends[0])), c.value(j, float(ends[1]))
                if p.cyclic:  # of which an end may lie beyond the range
                    half, value = DEVIATIONS * spread[j] * c.scale(j), c.value(j, float(z[j]))
                    interval = value - half, value + half
            own[p.name] = ParameterAmount(c.value(j, float(z[j])), p.unit, interval)
        found[c.name] = own
    return found


def vague(fit: EffectFit, left: float, gap: float) -> list[str]:
    """Members whose amounts may all be none, by their 95 % intervals; as of `covariance`.

    Amounts are those whose neutral value is 0, or 1 of a factor; a limit has no such value.
    """
    found = []
    for c, z, spread in zip(fit.effects, fit.z, deviations(fit, left, gap), strict=False):
        amount = [
            abs(z[j]) > DEVIATIONS * spread[j] for j, p in enumerate(c.parameters) if is_amount(p)
        ]
        if amount and not any(amount):
            found.append(c.name)
    return found


def with_masses(
    machine: Machine, found: Mapping[str, Mapping[str, ParameterAmount]]
) -> dict[str, Mapping[str, ParameterAmount]]:
    """Amounts of which an unbalance's e is as uncertain as the masses: only their product shows."""
    open_by = masses_leave_open(machine).get("e")
    amount = found.get("unbalance", {}).get("e")
    if open_by is None or amount is None or amount.ci95 is None:
        return dict(found)
    more = DEVIATIONS * float(np.linalg.norm(open_by)) * amount.value
    low, high = (
        amount.value + s * math.hypot(end - amount.value, more)
        for s, end in zip((-1, 1), amount.ci95, strict=True)
    )
    wide = replace(amount, ci95=(max(low, 0.0), high))
    return {**found, "unbalance": {**found["unbalance"], "e": wide}}


def shapley_shares(search: EffectSetSearch, fit: EffectFit) -> dict[str, float]:
    """Each member's share of what the set takes off the sum of squares; they sum to 1.

    It is the mean, over all orders of adding the members, of what the member then takes off
    (Shapley, "A value for n-person games", 1953). Every subset is fitted on all experiments. A set
    takes off no less than its parts do, since an effect may be neutral: a fit that found less ended
    in a poor minimum.
    """
    if len(fit.names) == 1:
        return {fit.names[0]: 1.0}
    found = search.found
    worth: dict[frozenset[str], float] = {frozenset(): 0.0}
    start = float(found.base @ found.base)
    for count in range(1, len(fit.names) + 1):
        for names in itertools.combinations(fit.names, count):
            parts = [worth[frozenset(names) - {n}] for n in names]
            worth[frozenset(names)] = max(start - search.subset(fit, names).loss, *parts)
    whole = worth[frozenset(fit.names)]
    shares = dict.fromkeys(fit.names, 0.0)
    orders = list(itertools.permutations(fit.names))
    for order in orders:
        for k, name in enumerate(order):
            gain = worth[frozenset(order[: k + 1])] - worth[frozenset(order[:k])]
            shares[name] += gain / whole / len(orders)
    return shares
