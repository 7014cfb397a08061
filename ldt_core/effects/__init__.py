"""What a real machine may have and its file may not know: friction, wear, sensors and the like."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING

from ldt_core.base.errors import OptionError, did_you_mean, most_alike
from ldt_core.base.registry import Registry

if TYPE_CHECKING:
    from ldt_core.physics.effect import Effect
    from ldt_core.physics.parameter import Parameter

_FILES = {
    "friction": (
        "coulomb_friction",
        "asymmetric_friction",
        "load_friction",
        "stribeck_friction",
        "viscous_friction",
        "viscous_asymmetric",
        "quadratic_drag",
    ),
    "drive": (
        "armature_resistance",
        "motor_constant",
        "magnetic_saturation",
        "armature_inductance",
        "winding_heating",
        "source_resistance",
        "brush_drop",
        "no_regeneration",
        "open_circuit",
        "voltage_saturation",
        "current_limit",
        "input_gain",
        "input_bias",
        "input_deadzone",
        "input_delay",
        "input_lag",
    ),
    "shaft": ("inertia", "cogging_torque", "torsional_compliance", "backlash"),
    "foundation": ("unbalance", "foundation_stiffness", "foundation_damping"),
    "load": ("constant_load", "gravity_imbalance", "spring_load"),
    "sensor": ("sensor_gain", "sensor_bias", "sensor_lag"),
}

PREFIXES = {"": 1.0, "u": 1e-6, "µ": 1e-6, "m": 1e-3, "c": 1e-2, "k": 1e3}  # of SI

EFFECTS = Registry(
    "effect",
    {
        name: f"ldt_core.effects.{file}:{name.upper()}"
        for file, names in _FILES.items()
        for name in names
    },
    "ldt.effect",
)


def known_effect(name: object, more: Iterable[str] = ()) -> str:
    """What a file must name an effect as, which names no Python file: for `expected`."""
    close = most_alike(str(name), [*EFFECTS.names(), *more])
    told = f" (did you mean {close!r}?)" if close else ""
    file = name if ".py:" in str(name) else "file.py:NAME"
    own = f"one of yours once the machine file has `own_effects: [{file}]` (ldt docs effect)"
    return f"a name from `ldt effects`{told}, or {own}"


def get_effect(name: str) -> Effect:
    """The effect of that name, or of `path/to/file.py:NAME`.

    Raises:
        OptionError: nothing of that name, something that is no effect, or one of another name.
    """
    from ldt_core.physics.effect import Effect

    effect = EFFECTS.get(name)
    if not isinstance(effect, Effect):
        raise OptionError(f"effect {name}", "an object of class Effect", repr(effect))
    if effect.name != name and ".py:" not in name:  # a diagnosis names it, and reads it back
        expected = f"an entry point of the effect's own name, {effect.name!r}"
        raise OptionError(f"effect {name}", expected, repr(name))
    return effect


def parse_effect(
    text: str, law: Callable[[str], Effect] = get_effect
) -> tuple[Effect, dict[str, float]]:
    """The effect and all its values from "NAME[:param=value,...]"; `law` finds it by its name.

    The bare name means the effect's typical values; with any value given, the others are neutral.
    A value may have its unit behind it, `e=5mm`; without, it is in SI units.

    Raises:
        OptionError: an unknown effect, parameter or unit, or a value outside its bounds.
    """
    split = text.find(".py:") + len(".py:") if ".py:" in text else 0
    name, colon, rest = text[split:].partition(":")
    bare = re.split(r"[\s=(]", name.strip(), maxsplit=1)[0]
    if bare != name.strip() and bare in EFFECTS.names():
        raise OptionError("effect", f"NAME:param=value, as in {_example(bare)}", repr(text))
    effect = law(text[:split] + name.strip())
    if not colon:
        return effect, effect.check(effect.typical)
    given: dict[str, float] = {}
    names = [p.name for p in effect.all_parameters]
    for entry in rest.split(","):
        parameter, equals, value = (part.strip() for part in entry.partition("="))
        where = f"effect {effect.name}"
        if not equals:
            expected = "param=value[,param=value...] behind the colon"
            if entry.strip().isdigit() and given:
                expected += ", with decimal points"
            raise OptionError(where, expected, repr(entry))
        if parameter not in names:
            raise OptionError(where, did_you_mean(parameter, names), repr(parameter))
        if parameter in given:
            raise OptionError(f"{where}, {parameter}", "one value", "two")
        declared = effect.all_parameters[names.index(parameter)]
        given[parameter] = _amount(f"{where}, {parameter}", value, declared)
    for p in effect.all_parameters:
        size, unit = given.get(p.name, 0.0), p.unit
        if abs(size) > p.meant:
            expected = f"at most {p.meant:g} {unit} ({size:g}m{unit} is {size / 1000:g} {unit})"
            raise OptionError(f"effect {effect.name}, {p.name}", expected, f"{size:g} {unit}")
    return effect.used(given)


def sizes_of(effect: Effect, scales: Mapping[str, float]) -> Mapping[str, float]:
    """A machine's scales (`machine_sizes`), for the library's effects: it is the worked case's.

    An effect of the user's own is written for the user's machine.
    """
    return scales if effect.name in EFFECTS.builtin else {}


def refuse_repeated(uses: Iterable[tuple[Effect, Mapping[str, float]]]) -> None:
    """Refuse (OptionError) an effect that is given twice: both would add up unseen."""
    for name, times in Counter(effect.name for effect, _ in uses).items():
        if times > 1:
            raise OptionError(f"effect {name}", "once, with all its parameters", f"{times} times")


def _example(name: str) -> str:
    """An effect with a value, as it is written on a command line."""
    parameter, value = next(iter(get_effect(name).typical.items()))
    return f"{name}:{parameter}={value:g}"


def _amount(where: str, text: str, parameter: Parameter) -> float:
    """The number of "5mm" in the parameter's unit."""
    base, number = parameter.unit.replace(" ", ""), text.replace(" ", "").replace("μ", "µ")
    units = {p + base: factor for p, factor in PREFIXES.items() if base}
    unit = next((u for u in sorted(units, key=len, reverse=True) if number.endswith(u)), "")
    try:
        return float(number.removesuffix(unit)) * units.get(unit, 1.0)
    except ValueError:
        expected = f"a number, in {parameter.unit} or with its unit" if base else "a number"
        raise OptionError(where, expected, repr(text)) from None
