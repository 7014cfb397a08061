"""Options of commands, made from the declared parameters."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any

import click

import msgs_config
from ldt_core.settings import check

_TYPES = {"integer": click.INT, "double": click.FLOAT, "string": click.STRING}
UNSET = ("", -1.0, [])  # defaults that mean "take it from elsewhere", not worth showing

out_option = click.option(
    "--out", required=True, help="Folder of the new recording, which must not exist."
)
namespace_option = click.option(
    "--namespace", default="", help="Machine whose topics are meant, if there are several."
)
json_option = click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")


def parameters(*groups: str) -> Callable:
    """Decorator: an option for each declared parameter of the groups.

    The command receives the checked values of all of them, defaults included, in one mapping named
    `settings`.

    Args:
        groups: groups of `parameters.yaml`.
    """
    declared = msgs_config.parameters(*groups)

    def decorate(function: Callable) -> Callable:
        @functools.wraps(function)
        def call(**values: Any) -> Any:
            return function(settings={name: values.pop(name) for name in declared}, **values)

        for name, declaration in reversed(declared.items()):
            _option(name, declaration)(call)
        return call

    return decorate


def _option(name: str, declaration: Mapping[str, Any]) -> Callable:
    flag = "--" + name.replace("_", "-")
    kind, unit, default = declaration["type"], declaration.get("unit", ""), declaration["default"]
    text = declaration["description"] + (f" [{unit}]" if unit else "")
    if choices := [c for c in declaration.get("choices", ()) if c]:
        text += f" One of {', '.join(choices)}."
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
        show_default=default not in UNSET,
        callback=checked,
        help=text,
    )
