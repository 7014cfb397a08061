"""An effect and its amounts in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from ldt_core.base.sentences import spoken

if TYPE_CHECKING:
    from ldt_core.physics.effect import Effect


def _amount(value: float, unit: str) -> str:
    """A value with its unit, lengths in mm."""
    return (f"{value * 1e3:.3g} mm" if unit == "m" else f"{value:.3g} {unit}").rstrip()


def reads_the_same(effect: Effect, before: Mapping[str, float], after: Mapping[str, float]) -> bool:
    """Whether nobody could tell these amounts apart as they are printed."""
    was = {**effect.neutral, **before}
    return all(
        _amount(was[p.name], p.unit) == _amount(after[p.name], p.unit) for p in effect.parameters
    )


def change_of(effect: Effect, before: Mapping[str, float], after: Mapping[str, float]) -> str:
    """What has become of an effect: "unbalance has grown to 6.1 mm".

    Args:
        effect: whose amounts these are.
        before: its parameters as they were.
        after: as they are.
    """
    name = spoken(effect.name)
    if len(effect.parameters) == 1:
        (p,) = effect.parameters
        value = _amount(after[p.name], p.unit)
        if p.default == 1 and not p.unit:
            value = f"a factor of {value}"
        return f"{name} has {_way(before[p.name], after[p.name])} {value}"
    parts = [f"{spoken(p.name)} {_amount(after[p.name], p.unit)}" for p in effect.parameters]
    return f"{name} has changed to {', '.join(parts)}"


def _way(before: float, after: float) -> str:
    if before < 0 or after < 0:
        return "changed to"
    return "stayed at" if after == before else "grown to" if after > before else "fallen to"
