"""Options that have no effect with the others that were given: refused, with what they serve."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import click
from click.core import ParameterSource

from ldt_core.base.errors import OptionError
from ldt_core.base.settings import flag_of, idle_beside


def refuse_idle(settings: Mapping[str, Any], declared: Mapping[str, Mapping[str, Any]]) -> None:
    """Refuse an option typed that only serves another choice (`only_with`, `idle_beside`).

    A run that goes on (`resume`) has its choices in its recording; nothing is refused there.

    Raises:
        OptionError: says which choice it serves.
    """
    context = click.get_current_context(silent=True)
    if context is None or settings.get("resume"):
        return
    for name, declaration in declared.items():
        if context.get_parameter_source(name) is not ParameterSource.COMMANDLINE:
            continue
        other = idle_beside(name, settings)
        if other is None:
            continue
        of, chosen = flag_of(other), settings.get(other)
        served = declaration.get("only_with", {}).get(other)
        if served is None:
            raise OptionError(flag_of(name), f"to be left out: it has no effect with {of}", of)
        ways = " or ".join(of if one is True else f"{of} {one}" for one in served)
        expected = f"{ways} as well: it has no effect otherwise"
        raise OptionError(flag_of(name), expected, f"{of} {chosen}" if chosen else f"no {of}")
