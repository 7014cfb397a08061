"""The effects that may explain a gap, and those that are fitted with every set of them.

The latter change the machine's own parameters that its file does not know for certain. A file that
was fitted to measured data has a gap of its own: its parameters have made up for what the machine
has and the file lacks. So a change of theirs is never the diagnosis.
"""

from __future__ import annotations

from collections.abc import Sequence

from ldt_core.base.errors import OptionError, did_you_mean
from ldt_core.effects import EFFECTS, get_effect
from ldt_core.machine.machine_file import Machine
from ldt_core.physics.effect import Effect

#: Parameter to the effect that changes it.
CHANGED_BY = {
    "J": "inertia",
    "K_t": "motor_constant",
    "R": "armature_resistance",
    "L": "armature_inductance",
    "b": "viscous_friction",
    "K_x": "foundation_stiffness",
    "K_y": "foundation_stiffness",
    "R_x": "foundation_damping",
    "R_y": "foundation_damping",
    "e": "unbalance",
}
EQUIVALENT = ("J", "K_t", "L")  # of an identified motor; its R and b are convention
NONE = "none"


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


def uncertain(machine: Machine) -> list[str]:
    """Parameters that the machine file says were fitted, which it then knows about itself."""
    if machine.calibration.get("equivalent"):
        return list(EQUIVALENT)
    free = machine.calibration.get("free", {})
    return [name for name in free if name in CHANGED_BY] if isinstance(free, dict) else []


def refitted_effects(machine: Machine, refit: Sequence[str] | None = None) -> list[Effect]:
    """The effects that change the uncertain parameters.

    Args:
        refit: names instead; ["none"] for no parameter; None takes the file's.

    Raises:
        OptionError: a name that is no parameter of this machine.
    """
    names = uncertain(machine) if refit is None else [n for n in refit if n != NONE]
    known = [n for n in CHANGED_BY if n in machine.parameters]
    for name in names:
        if name not in known:
            raise OptionError("--refit", did_you_mean(name, [*known, NONE]), repr(name))
    return [machine.effect(e) for e in dict.fromkeys(CHANGED_BY[n] for n in names)]
