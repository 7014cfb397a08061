"""What became of the machine file's own numbers: how far from the file, and what they close.

They may make up for a cause: a calibrated motor constant that moves by 61 % has swallowed a brake.
So each is told with its prior, and one far outside it is said in the verdict's sentence.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError
from ldt_core.base.sentences import listed
from ldt_core.diagnosis.attribution import covariance
from ldt_core.diagnosis.candidate import LIMIT_MARGIN
from ldt_core.diagnosis.diagnosis import Refit
from ldt_core.diagnosis.effect_fit import EffectFit, by_member, used
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.nominal_prior import NominalPrior
from ldt_core.diagnosis.thresholds import THRESHOLDS
from ldt_core.estimation.amount_interval import DEVIATIONS, law_variance
from ldt_core.machine.machine_file import Machine

STRAINED = "Unknown: only machine numbers beyond their tolerances close the gap."
MOST = 0.5  # of a gap: the effects that are named close the smaller part
RANK = 1e-9  # of the largest singular value: a direction with less is none


def with_all(residuals: FreeRunResiduals, fitted: EffectFit, prior: NominalPrior) -> EffectFit:
    """A fit with all coordinates of the prior: those that took no part at the file's values."""
    whole = prior.candidate()
    own = np.zeros(len(whole))
    told = fitted.own_columns
    if told:
        own[list(told)] = fitted.z[-1]
    members, z = (*fitted.effects, whole), (*fitted.z[: len(fitted.effects)], own)
    known = sum(len(c) for c in fitted.effects)
    base = residuals.of(used(members, z), starts=fitted.starts)
    columns = np.zeros((residuals.size, known + own.size))
    columns[:, :known] = fitted.jacobian[:, :known]
    columns[:, [known + j for j in told]] = fitted.jacobian[:, known:]
    for j, by in enumerate(whole.differences):
        if j in told:
            continue
        moved = own.copy()
        moved[j] += by
        with_it = residuals.of(used(members, (*z[:-1], moved)), starts=fitted.starts)
        columns[:, known + j] = (with_it - base) / by
    return replace(fitted, members=members, z=z, jacobian=columns, own=1)


def refits(
    prior: NominalPrior, fitted: EffectFit, left: float, excess: float, part: float | None
) -> list[Refit]:
    """A row for each nominal parameter that was fitted along, or that an effect changed.

    Args:
        fitted: the set in force, with the machine's own parameters behind its effects.
        left, excess: power beyond noise that it leaves, and that of the gap.
        part: what these parameters close by themselves, all together.
    """
    spread = covariance(fitted, left, excess)
    here = np.concatenate(fitted.z)
    try:
        at = _logarithms(prior, fitted, here)
        slopes = _slopes(prior, fitted, here, at)
    except LdtError:  # numbers that no machine has, at the end of what was tried
        return []
    known = prior.deviations if prior.known else {}
    found = []
    for i, name in enumerate(prior.names):
        seen = slopes[i] != 0
        variance = float(slopes[i, seen] @ spread[np.ix_(seen, seen)] @ slopes[i, seen])
        half = DEVIATIONS * variance**0.5
        low, high = np.exp(at[i] - half), np.exp(at[i] + half)
        bounds = (float(low), float(high)) if np.isfinite(high) and seen.any() else None
        found.append(Refit(name, float(np.exp(at[i])), bounds, known.get(name), part))
    return found


def _logarithms(prior: NominalPrior, fitted: EffectFit, z: Array) -> Array:
    """(k,) of what the parameters are multiplied by, effects of the set included."""
    machine = prior.machine
    values: Mapping[str, float] = machine.parameters
    for effect, given in used(fitted.members, by_member(fitted.members, z)):
        if not effect.states:  # what moves into an effect's own states is still there
            values = effect.change_parameters(machine.model, values, given)
    return np.log([values[n] / machine.parameters[n] for n in prior.names])


def _slopes(prior: NominalPrior, fitted: EffectFit, z: Array, at: Array) -> Array:
    """(k, p) change of the logarithms per coordinate."""
    steps = np.concatenate([c.differences for c in fitted.members])
    high = np.concatenate([c.bounds[1] for c in fitted.members])
    slopes = np.empty((len(prior.names), z.size))
    for j, size in enumerate(steps):
        moved = z.copy()
        moved[j] += size if z[j] + size <= high[j] else -size
        slopes[:, j] = (_logarithms(prior, fitted, moved) - at) / (moved[j] - z[j])
    return slopes


def at_the_end(fitted: EffectFit) -> bool:
    """Whether the machine's own parameters went as far as their prior lets them."""
    if not fitted.own:
        return False
    return bool(np.abs(fitted.z[-1]).max() >= THRESHOLDS.prior_deviations - LIMIT_MARGIN)


def beyond(
    prior: NominalPrior | None, fitted: EffectFit, left: float, excess: float
) -> dict[str, float]:
    """Parameters further from the file than its tolerance allows, by how many deviations.

    A fit weighs the data by their noise alone, so that a narrow prior gives way to what the laws
    are off by. Here they weigh as little as those errors make them worth, as in `covariance`.

    Args:
        fitted, left, excess: as of `refits`.
    """
    if prior is None or not (fitted.own and prior.known):
        return {}
    z = np.concatenate(fitted.z)
    count = len(fitted.z[-1])
    others, own = np.split(fitted.jacobian, [z.size - count], axis=1)
    basis, size, _ = np.linalg.svd(others, full_matrices=False)
    basis = basis[:, size > RANK * size.max(initial=0.0)]
    own = own - basis @ (basis.T @ own)
    known, variance = own.T @ own, law_variance(left, excess)
    pulled = known @ z[-count:] - own.T @ fitted.residual
    low, high = fitted.members[-1].bounds
    z[-count:] = np.clip(np.linalg.solve(known + variance * np.eye(count), pulled), low, high)
    try:
        moved = _logarithms(prior, fitted, z)
    except LdtError:  # as in `refits`
        return {}
    far = {n: abs(float(m)) / prior.deviations[n] for n, m in zip(prior.names, moved, strict=True)}
    return {n: d for n, d in far.items() if d > THRESHOLDS.prior_deviations}


def own_part(found: Sequence[Refit]) -> float | None:
    """The share of a gap that nominal parameters close by themselves; None for next to nothing."""
    part = (found[0].closed_fraction if found else None) or 0.0
    return part if part > THRESHOLDS.told_of_gap else None


def moved(found: Sequence[Refit]) -> str:
    """Those whose interval says that they are other ones than the file's, in brackets; or ""."""
    rows = _moved(found)
    return f" ({_factors(rows)})" if rows else ""


def _moved(found: Sequence[Refit]) -> list[Refit]:
    return [r for r in found if r.ci95 is not None and not r.ci95[0] <= 1.0 <= r.ci95[1]]


def beside_effects(found: Sequence[Refit]) -> str:
    """A sentence where these numbers, and not the effects named, close most of a gap; or ""."""
    part, rows = own_part(found) or 0.0, _moved(found)
    if part <= MOST or not rows:
        return ""
    return (
        f"Fitted along, within their tolerances: {_factors(rows)}. "
        f"Such numbers alone close {part:.0%} of the gap."
    )


def closing(found: Sequence[Refit]) -> str:
    """What nominal parameters close by themselves, as a clause; "" for next to nothing."""
    part = own_part(found)
    return "" if part is None else f"nominal parameters{moved(found)} close {part:.0%} of the gap"


def _factors(found: Sequence[Refit]) -> str:
    return listed(f"{r.parameter} × {r.factor:.3g}" for r in found)


def enough(machine: Machine, found: Sequence[Refit], before: float) -> str:
    """The sentence where these parameters close a gap by themselves; "" where there is none.

    Args:
        before: the file's error on held-out experiments [rad/s].
    """
    part = own_part(found)
    if part is None:
        return ""
    what = _factors(found)
    left = _left_when_made(machine)
    since = (
        f" The file left {left:.3g} rad/s on experiments held out when it was made: the machine, "
        "or how it is used, has changed since."
        if left is not None and before > THRESHOLDS.noise_level_change * left
        else ""
    )
    return (
        f"No effect is needed: nominal parameters that were fitted along ({what}) close "
        f"{part:.0%} of the gap of {before:.3g} rad/s.{since}"
    )


def _left_when_made(machine: Machine) -> float | None:
    """The file's error on experiments held out when it was made [rad/s], where it states one."""
    told = machine.calibration.get("held_out")
    left = told.get("rmse_after", told.get("rmse")) if isinstance(told, dict) else None
    return left if isinstance(left, float) else None


def as_calibrated(machine: Machine, before: float) -> str:
    """The sentence where the file left as much when it was calibrated; "" where it left less.

    Args:
        before: the file's error on held-out experiments [rad/s].
    """
    left = _left_when_made(machine)
    if left is None or not before <= THRESHOLDS.noise_level_change * left:
        return ""
    return (
        f"The file left {left:.3g} rad/s on experiments held out of its calibration, so the "
        "machine need not have changed since."
    )


def said(machine: Machine, found: Sequence[Refit], far: Mapping[str, float], before: float) -> str:
    """A sentence on those far from the file; "" where there are none.

    Args:
        far: see `beyond`.
        before: the file's error on held-out experiments [rad/s].
    """
    if not far:
        return ""
    units = {p.name: p.unit for p in machine.model.parameters}
    what = listed(
        f"{r.parameter} is not {machine.parameters[r.parameter]:.4g} {units[r.parameter]} any more "
        f"but {r.factor * machine.parameters[r.parameter]:.4g} (× {r.factor:.3g}, "
        f"{far[r.parameter]:.{max(2, len(str(int(far[r.parameter]))))}g} deviations)"
        for r in found
        if r.parameter in far
    )
    part = found[0].closed_fraction
    alone = (
        ""
        if part is None
        else f"; within their tolerances nominal parameters alone close {part:.0%} of "
        f"{before:.3g} rad/s"
    )
    return f"Beyond its tolerance in the file: {what}{alone}."
