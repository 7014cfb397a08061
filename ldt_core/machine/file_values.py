"""Values of a machine file: numbers, numbers with a tolerance, and effects known to act."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from ldt_core.base.errors import MachineFileError, OptionError, described, did_you_mean
from ldt_core.effects import EFFECTS, get_effect, known_effect
from ldt_core.physics.parameter import LARGEST, SMALLEST, Parameter, own_name

if TYPE_CHECKING:
    from ldt_core.physics.base import Physics
    from ldt_core.physics.effect import Effect

NEEDED = ("J", "K_t", "R", "L", "b")  # of a motor: effects and start states find them by name


class Stated(NamedTuple):
    """What a machine file states of its parameters, known effects' (`effect.parameter`) included.

    `values`: complete, in SI units; `deviations`: standard deviations of those that have one.
    """

    values: dict[str, float]
    deviations: dict[str, float]


def mapping_of(where: str, value: Any) -> dict[str, Any]:
    """A section of a machine file; a MachineFileError where it is no names with values."""
    if not isinstance(value, Mapping):
        raise MachineFileError(where, "names with values (a YAML mapping)", described(value))
    for key in value:
        if not isinstance(key, str):
            expected = "names with values (quote a name that YAML takes for something else)"
            raise MachineFileError(where, expected, f"the name {described(key)}")
    return dict(value)


def check_keys(
    where: str, data: Mapping[str, Any], required: tuple[str, ...], optional: tuple[str, ...]
) -> None:
    """Refuse a section that lacks a key, or has one that nobody knows (MachineFileError)."""
    for key in required:
        if key not in data:
            raise MachineFileError(where, f"the key {key!r}", f"only {sorted(data)}")
    for key in data:
        if key not in required + optional:
            raise MachineFileError(
                where, did_you_mean(key, required + optional), f"unknown key {key!r}"
            )


def real_number(where: str, value: Any) -> float:
    """A number that can be computed with, in quotes as well."""
    if isinstance(value, str):
        try:
            value = float(value)
        except ValueError:
            raise MachineFileError(where, "a number in SI units", described(value)) from None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise MachineFileError(where, "a number in SI units", described(value))
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise MachineFileError(where, "a finite number", described(value))
    if abs(number) > LARGEST:
        raise MachineFileError(where, f"at most {LARGEST:g} in SI units", f"{number:g}")
    return number


def stated_parameters(source: str, physics: Physics, given: Mapping[str, Any]) -> Stated:
    """The parameters of a physics, each a number or {value, std}; defaults where they are missing.

    Raises:
        MachineFileError: a physics without the motor's parameters, an unknown or missing name, or
            a value that is none or out of bounds.
    """
    where = f"{source}, parameters"
    missing = [n for n in NEEDED if n not in {p.name for p in physics.parameters}]
    if missing:
        expected = f"one with parameters {', '.join(NEEDED)}, which effects and start states need"
        got = f"{physics.name} without {', '.join(missing)}"
        raise MachineFileError(f"{source}, physics", expected, got)
    needed = tuple(p.name for p in physics.parameters if p.default is None)
    known = tuple(p.name for p in physics.parameters)
    check_keys(where, given, needed, tuple(n for n in known if n not in needed))
    found = Stated({}, {})
    for p in physics.parameters:
        _state(found, where, p, p.name, given.get(p.name, p.default))
    return found


def own_effects(source: str, physics: Physics, given: Any) -> dict[str, Effect]:
    """The effects of the key `own_effects`, by their names.

    Raises:
        MachineFileError: no list of file.py:NAME, a file that fails, no effect, one that this
            machine cannot have or numba not compile, or a name that another effect has.
    """
    where = f"{source}, own_effects"
    if not isinstance(given, list):
        raise MachineFileError(where, "a list of file.py:NAME", described(given))
    found: dict[str, Effect] = {}
    for number, name in enumerate(given, start=1):
        if not isinstance(name, str) or ".py:" not in name:
            expected = "file.py:NAME (ldt docs effect)"
            raise MachineFileError(f"{where}, entry {number}", expected, described(name))
        try:
            effect = get_effect(name)
            effect.require(physics)
            for term in effect.terms:
                _ = term.compiled
        except OptionError as error:
            raise MachineFileError(f"{where}, {error.where}", error.expected, error.got) from error
        if effect.name in (*EFFECTS.names(), *found):
            expected = "a name that no other effect has"
            raise MachineFileError(f"{where}, {name}", expected, repr(effect.name))
        found[effect.name] = effect
    return found


def stated_effects(
    source: str,
    physics: Physics,
    values: Mapping[str, float],
    given: Any,
    own: Mapping[str, Effect],
) -> tuple[tuple[Effect, ...], Stated]:
    """The effects of the key `effects`, and what is stated of their parameters.

    `own` are those of the key `own_effects`.

    Raises:
        MachineFileError: no list, an effect that is unknown, listed twice or impossible for this
            machine, no parameters, or a value that is none or out of bounds.
    """
    where = f"{source}, effects"
    if not isinstance(given, list):
        raise MachineFileError(where, "a list of {name: , parameters: }", described(given))
    effects: list[Effect] = []
    found = Stated({}, {})
    changed = values
    for number, entry in enumerate(given, start=1):
        at = f"{where}, entry {number}"
        section = mapping_of(at, entry)
        check_keys(at, section, ("name", "parameters"), ())
        name = section["name"]
        if not isinstance(name, str) or name not in (*EFFECTS.names(), *own):
            raise MachineFileError(f"{at}, name", known_effect(name, own), repr(name))
        at, effect = f"{where}, {name}", own.get(name) or get_effect(name)
        if name in [e.name for e in effects]:
            raise MachineFileError(at, "one entry an effect", "two")
        parameters = mapping_of(f"{at}, parameters", section["parameters"])
        known = {p.name: p for p in effect.all_parameters}
        check_keys(f"{at}, parameters", parameters, (), tuple(known))
        if not parameters:
            raise MachineFileError(f"{at}, parameters", f"a value for {' or '.join(known)}", "none")
        effect = effect.in_detail(parameters)
        known = {p.name: p for p in effect.parameters}
        for p in effect.parameters:
            value = parameters.get(p.name, p.default)
            _state(found, f"{at}, parameters", p, own_name(effect.name, p.name), value)
        stated = {n: found.values[own_name(effect.name, n)] for n in known}
        try:
            changed = effect.change_parameters(physics, changed, stated)
        except OptionError as error:
            raise MachineFileError(at, error.expected, error.got) from None
        effects.append(effect)
    return tuple(effects), found


def _state(found: Stated, where: str, parameter: Parameter, name: str, given: Any) -> None:
    at = f"{where}.{parameter.name}"
    std: Any = None
    if isinstance(given, Mapping):
        section = mapping_of(at, given)
        check_keys(at, section, ("value",), ("std",))
        given, std = section["value"], section.get("std")
    value = real_number(at, given)
    if not parameter.accepts(value):
        raise MachineFileError(at, parameter.range, f"{value:g}")
    if abs(value) < SMALLEST and not parameter.accepts(0.0):
        raise MachineFileError(at, f"at least {SMALLEST:g} {parameter.unit}", f"{value:g}")
    found.values[name] = value
    if std is None:
        return
    deviation = real_number(f"{at}.std", std)
    if deviation <= 0:
        raise MachineFileError(
            f"{at}.std", "a standard deviation above 0, or none", f"{deviation:g}"
        )
    if value == 0:  # tolerances are parts of a value everywhere: one of 0 would be none
        raise MachineFileError(at, "a value other than 0 where there is a std", "0")
    if deviation < SMALLEST * abs(value):
        expected = f"at least {SMALLEST:g} of the value (a small one keeps it as it is)"
        raise MachineFileError(f"{at}.std", expected, f"{deviation:g}")
    found.deviations[name] = deviation
