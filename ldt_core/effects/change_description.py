"""An effect and its amounts in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from ldt_core.base.sentences import measured, spoken
from ldt_core.physics.machine_sizes import is_amount

if TYPE_CHECKING:
    from ldt_core.physics.effect import Effect

#: 95 % interval of each parameter of an effect; None where nothing determines it.
Intervals = Mapping[str, tuple[float, float] | None]


def _amount(value: float, unit: str) -> str:
    """A value with its unit, lengths in mm."""
    return (f"{value * 1e3:.3g} mm" if unit == "m" else f"{value:.3g} {unit}").rstrip()


def change_of(
    effect: Effect,
    before: Mapping[str, float],
    after: Mapping[str, float],
    known: Intervals | None = None,
) -> str:
    """What has become of an effect: "unbalance has grown to 6.1 mm".

    Args:
        effect: whose amounts these are.
        before: its parameters as they were.
        after: as they are.
        known: 95 % interval of each, to be told; a parameter without one is not determined.
    """
    name, amounts = spoken(effect.name), amounts_of(effect, after, known)
    if len(effect.parameters) == 1:
        (p,) = effect.parameters
        return f"{name} has {_way(before[p.name], after[p.name])} {amounts}"
    return f"{name} has changed to {amounts}"


def amounts_of(effect: Effect, after: Mapping[str, float], known: Intervals | None = None) -> str:
    """How much of an effect acts; see `change_of`."""
    told = {
        p.name: measured(after[p.name], p.unit, known.get(p.name))
        if known is not None
        else _amount(after[p.name], p.unit)
        for p in effect.parameters
    }
    if len(effect.parameters) == 1:
        (p,) = effect.parameters
        what = "" if p.unit else f"a {p.name} of "
        return f"{what}{told[p.name]}"
    return ", ".join(f"{spoken(name)} {amount}" for name, amount in told.items())


def doubt_of(effect: Effect, known: Intervals) -> str:
    """Why its amounts may not be told: not determined, or maybe none; "" where they may."""
    amounts = [(p.default or 0.0, known.get(p.name)) for p in effect.parameters if is_amount(p)]
    ends = [(none, ci95) for none, ci95 in amounts if ci95 is not None]
    if len(ends) < len(amounts):
        return f"how much {spoken(effect.name)} acts is not determined"
    if amounts and all(low <= none <= high for none, (low, high) in ends):
        in_file = any(p.idle is not None for p in effect.parameters)
        return f"{spoken(effect.name)} may be " + ("the file's" if in_file else "none at all")
    return ""


def apart(one: tuple[float, float] | None, other: tuple[float, float] | None) -> int:
    """1 where the other interval lies above this one, -1 below, 0 where they are not apart."""
    if one is None or other is None:
        return 0
    return int(other[0] > one[1]) - int(other[1] < one[0])


def _way(before: float, after: float) -> str:
    if before < 0 or after < 0:
        return "changed to"
    return "stayed at" if after == before else "grown to" if after > before else "fallen to"
