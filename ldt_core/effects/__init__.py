"""What a real machine may have and its file may not know: friction, wear, sensors and the like."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ldt_core.base.errors import OptionError, did_you_mean
from ldt_core.base.registry import Registry

if TYPE_CHECKING:
    from ldt_core.physics.effect import Effect

_FILES = {
    "friction": (
        "coulomb_friction",
        "asymmetric_friction",
        "gear_friction",
        "stribeck_friction",
        "viscous_friction",
        "quadratic_drag",
    ),
    "drive": (
        "armature_resistance",
        "motor_constant",
        "armature_inductance",
        "winding_heating",
        "source_resistance",
        "brush_drop",
        "no_regeneration",
        "voltage_saturation",
        "input_deadzone",
        "input_delay",
    ),
    "shaft": ("inertia", "cogging_torque", "torsional_compliance"),
    "foundation": ("unbalance", "foundation_stiffness", "foundation_damping"),
    "load": ("constant_load", "gravity_imbalance"),
    "sensor": ("sensor_gain", "sensor_bias", "sensor_lag"),
}

EFFECTS = Registry(
    "effect",
    {
        name: f"ldt_core.effects.{file}:{name.upper()}"
        for file, names in _FILES.items()
        for name in names
    },
    "ldt.effect",
)


def get_effect(name: str) -> Effect:
    """The effect of that name, or of `path/to/file.py:NAME`.

    Raises:
        OptionError: nothing of that name, or something that is no effect.
    """
    from ldt_core.physics.effect import Effect

    effect = EFFECTS.get(name)
    if not isinstance(effect, Effect):
        raise OptionError(f"effect {name}", "an object of class Effect", repr(effect))
    return effect


def parse_effect(text: str) -> tuple[Effect, dict[str, float]]:
    """The effect and all its values from "NAME[:param=value,...]".

    The bare name means the effect's typical values; with any value given, the others are neutral.

    Raises:
        OptionError: an unknown effect or parameter, or a value outside its bounds.
    """
    split = text.find(".py:") + len(".py:") if ".py:" in text else 0
    name, colon, rest = text[split:].partition(":")
    effect = get_effect(text[:split] + name.strip())
    if not colon:
        return effect, effect.check(effect.typical)
    given: dict[str, float] = {}
    names = [p.name for p in effect.parameters]
    for entry in rest.split(","):
        parameter, equals, value = (part.strip() for part in entry.partition("="))
        where = f"effect {effect.name}"
        if not equals:
            raise OptionError(where, "param=value[,param=value...] behind the colon", repr(entry))
        if parameter not in names:
            raise OptionError(where, did_you_mean(parameter, names), repr(parameter))
        if parameter in given:
            raise OptionError(f"{where}, {parameter}", "one value", "two")
        try:
            given[parameter] = float(value)
        except ValueError:
            raise OptionError(f"{where}, {parameter}", "a number", repr(value)) from None
    return effect, effect.check(given)
