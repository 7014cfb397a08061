"""`ldt effects`: what a machine may have that its file does not know, and a check of your own."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import click

from ldt_core.cli.completion import known
from ldt_core.cli.options import json_option
from ldt_core.cli.terminal import echo, echo_result

if TYPE_CHECKING:
    from ldt_core.machine.machine_file import Machine
    from ldt_core.physics.effect import Effect
    from ldt_core.physics.parameter import Parameter


@click.command("effects", short_help="List the known effects, or check one of your own.")
@click.argument("effect", required=False, shell_complete=known("effect"))
@click.option(
    "--machine",
    metavar="FILE",
    help="Machine file to check EFFECT on, if it needs parameters of your own physics.",
)
@json_option
def command(effect: str | None, machine: str | None, as_json: bool) -> None:
    """List the effects that --effect takes, or check EFFECT, a name or FILE.py:NAME.

    The check runs the effect on the machines that ship with LDT, or on that of --machine, and
    reports the result. If your effect fails a check, the command ends with a sentence and exit
    code 2.

    Example: ldt effects cubic_drag.py:CUBIC_DRAG
    """
    from ldt_core.base.errors import OptionError
    from ldt_core.effects import EFFECTS, get_effect
    from ldt_core.machine.machine_file import load_machine

    known_machine = None if machine is None else load_machine(machine)
    if effect is not None:
        found = get_effect(effect) if known_machine is None else known_machine.law(effect)
        if ".py:" in effect and found.name in EFFECTS.names():
            raise OptionError(f"effect {effect}", "a name that no other has", repr(found.name))
        checked = _check(found, None if known_machine is None else [known_machine])
        record = {**_record(found), "checked": checked}
        lines = [*_lines(found), "", "Checked:", *(f"- {c}" for c in checked)]
        echo_result(as_json, record, *lines)
        return
    if machine is not None:
        raise OptionError("--machine", "an EFFECT to check on it", "none")
    known = _known()
    text = "\n\n".join("\n".join(_lines(e)) for e in known)
    echo_result(as_json, [_record(e) for e in known], text)


def _known() -> list[Effect]:
    """All effects by name; one of another package that cannot be loaded is named on stderr."""
    from ldt_core.effects import EFFECTS, get_effect

    found = []
    for name in EFFECTS.names():
        try:
            found.append(get_effect(name))
        except Exception as error:  # whatever that package does
            if name in EFFECTS.builtin:
                raise
            echo(f"effect {name} cannot be loaded: {_sentence(error)}", err=True)
    return found


def _check(effect: Effect, machines: list[Machine] | None) -> list[str]:
    from ldt_core.base.errors import LdtError
    from ldt_core.checks import check_effect

    try:
        return check_effect(effect, machines)
    except (AssertionError, LdtError) as error:
        raise click.ClickException(str(error)) from error
    except Exception as error:  # whatever the user's functions do
        raise click.ClickException(f"effect {effect.name}: {_sentence(error)}") from error


def _sentence(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"


def _lines(effect: Effect) -> list[str]:
    lines = [f"{effect.name}: {effect.description}", f"    {effect.equation}"]
    for parameter in effect.all_parameters:
        typical = effect.typical.get(parameter.name)
        values = [parameter.range, f"{parameter.default:g} is neutral"]
        values += [] if typical is None else [f"{typical:g} is typical"]
        about = f": {parameter.description}" if parameter.description else ""
        lines.append(f"    {parameter.name}{about} ({', '.join(values)})")
    if effect.needs:
        lines.append(f"    for machines with {', '.join(effect.needs)}")
    if effect.reference:
        lines.append(f"    {effect.reference}")
    return lines


def _record(effect: Effect) -> dict[str, Any]:
    return {
        "name": effect.name,
        "description": effect.description,
        "equation": effect.equation,
        "parameters": [_parameter(p, effect) for p in effect.all_parameters],
        "needs": list(effect.needs),
        "reference": effect.reference,
    }


def _parameter(parameter: Parameter, effect: Effect) -> dict[str, Any]:
    return {
        "name": parameter.name,
        "unit": parameter.unit,
        "low": _finite(parameter.low),
        "high": _finite(parameter.high),
        "low_is_excluded": parameter.open_low,
        "neutral": parameter.default,
        "typical": effect.typical.get(parameter.name, parameter.default),
        "description": parameter.description,
    }


def _finite(bound: float) -> float | None:
    return bound if math.isfinite(bound) else None
