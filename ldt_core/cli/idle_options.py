"""Options that change nothing beside the others that were given."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import click
from click.core import ParameterSource

from ldt_core.cli.terminal import warn
from ldt_core.detectors import DETECTORS
from ldt_core.models import MODELS

#: Whose own arguments are known; parts of one's own may take any parameter.
KNOWN = {"model": MODELS.builtin, "detector": DETECTORS.builtin}


def warn_of_idle(settings: Mapping[str, Any], declared: Mapping[str, Mapping[str, Any]]) -> None:
    """A sentence for each option typed that only serves another choice (`only_with`)."""
    context = click.get_current_context(silent=True)
    for name, declaration in declared.items():
        typed = context and context.get_parameter_source(name) is ParameterSource.COMMANDLINE
        for other, served in declaration.get("only_with", {}).items() if typed else ():
            chosen = settings.get(other)
            if other in settings and chosen not in served and chosen in KNOWN.get(other, [chosen]):
                flag, of = (f"--{n.replace('_', '-')}" for n in (name, other))
                beside = f"beside {of} {chosen}" if chosen else f"without {of}"
                ways = " or ".join(of if one is True else f"{of} {one}" for one in served)
                warn(f"{flag} changes nothing {beside}; it belongs to {ways}")
