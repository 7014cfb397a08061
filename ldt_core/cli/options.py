"""Options of commands, made from the declared parameters."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any

import click
from click.core import ParameterSource

import msgs_config
from ldt_core.settings import check

_TYPES = {"integer": click.INT, "double": click.FLOAT, "string": click.STRING}
UNSET = ("", -1.0)  # defaults that mean "take it from elsewhere", not worth showing


def parameters(*groups: str, without: tuple[str, ...] = ()) -> Callable:
    """Decorator: an option for each declared parameter of the groups.

    The command receives the checked values of all of them, defaults included, in one mapping named
    `settings`, and the names of those that the user gave in the set `given`.

    Args:
        groups: groups of `parameters.yaml`.
        without: parameters of these groups that the command does not offer.
    """
    declared = {n: d for n, d in msgs_config.parameters(*groups).items() if n not in without}

    def decorate(function: Callable) -> Callable:
        @functools.wraps(function)
        def call(**values: Any) -> Any:
            source = click.get_current_context().get_parameter_source
            given = {name for name in declared if source(name) is not ParameterSource.DEFAULT}
            settings = {name: values.pop(name) for name in declared}
            return function(settings=settings, given=given, **values)

        for name, declaration in reversed(declared.items()):
            _option(name, declaration)(call)
        return call

    return decorate


def _option(name: str, declaration: Mapping[str, Any]) -> Callable:
    flag = "--" + name.replace("_", "-")
    kind, unit, default = declaration["type"], declaration.get("unit", ""), declaration["default"]
    text = declaration["description"] + (f" [{unit}]" if unit else "")
    if kind == "bool":
        return click.option(f"{flag}/--no-{flag[2:]}", name, default=default, help=text)
    many = kind == "string_array"

    def checked(_context: click.Context, _parameter: click.Parameter, value: Any) -> Any:
        return check(flag, list(value) if many else value, declaration)

    return click.option(
        flag,
        name,
        type=click.STRING if many else _TYPES[kind],
        multiple=many,
        default=default,
        show_default=bool(default) and default not in UNSET,
        callback=checked,
        help=text,
    )
