"""The effects that may explain a gap."""

from __future__ import annotations

from collections.abc import Sequence

from ldt_core.effects import EFFECTS, get_effect
from ldt_core.machine.machine_file import Machine
from ldt_core.physics.effect import Effect


def library(
    machine: Machine, more: Sequence[str] = (), without: Sequence[str] = ()
) -> list[Effect]:
    """The effects that may explain a gap of this machine.

    Args:
        machine: those that it cannot have are left out.
        more: further effects, by name or `path/to/file.py:NAME`.
        without: names to leave out.

    Raises:
        OptionError: a name that is not known, or an own effect that this machine cannot have.
    """
    for name in without:
        EFFECTS.require(name)
    found = [effect for effect in machine.possible_effects() if effect.name not in without]
    for name in more:
        effect = get_effect(name)
        effect.require(machine.model)
        if effect.name not in [e.name for e in found]:
            found.append(effect)
    return found
