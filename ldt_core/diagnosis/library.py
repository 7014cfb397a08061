"""The effects that may explain a gap."""

from __future__ import annotations

from collections.abc import Sequence

from ldt_core.base.errors import OptionError
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
        OptionError: a name that is not known, or an own effect that this machine cannot have, that
            does not compile, or that has the name of another.
    """
    own = [effect.name for effect in machine.own_laws]
    for name in without:
        if name not in own:
            EFFECTS.require(name)
    found = [effect for effect in machine.possible_effects() if effect.name not in without]
    for name in more:
        effect = get_effect(name)
        effect.require(machine.model)
        if effect.torque is not None or effect.terminal is not None:
            _ = effect.compiled  # else it would be one that cannot be simulated
        other = next((e for e in found if e.name == effect.name), None)
        if other is not None and effect.name not in own and other is not effect:
            told = f"an effect with a name of its own, or --without {effect.name}"
            raise OptionError(f"--effect {name}", told, f"one more {effect.name}")
        if other is None:
            found.append(effect)
    return found
