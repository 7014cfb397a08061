"""An effect and its amounts in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ldt_core.effects.base import Effect
    from ldt_core.physics.parameter import Parameter


def spoken(name: str) -> str:
    """An effect's or parameter's name as words."""
    return name.replace("_", " ")


def amount(value: float, unit: str) -> str:
    """A value with its unit, lengths in mm."""
    return (f"{value * 1e3:.3g} mm" if unit == "m" else f"{value:.3g} {unit}").rstrip()


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
        return (
            f"{name} has {_way(p, before[p.name], after[p.name])} {amount(after[p.name], p.unit)}"
        )
    parts = [f"{spoken(p.name)} {amount(after[p.name], p.unit)}" for p in effect.parameters]
    return f"{name} has changed to {', '.join(parts)}"


def _way(parameter: Parameter, before: float, after: float) -> str:
    """Amounts grow away from 0, factors upwards."""
    if parameter.default == 0:
        before, after = abs(before), abs(after)
    return "stayed at" if after == before else "grown to" if after > before else "fallen to"
