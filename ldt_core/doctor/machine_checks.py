"""What a machine file names of the user's own: its physics, its effects."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from ldt_core.base.errors import LdtError
from ldt_core.checks import check_effect, check_physics
from ldt_core.doctor.check import Finding, ok, problem
from ldt_core.machine.machine_file import load_machine
from ldt_core.physics import PHYSICS


def findings(file: str) -> list[Finding]:
    """Whether the parts of the user's own keep their promises, a line for each that was checked.

    Raises:
        MachineFileError: the file cannot be read, or a part of it not be loaded.
    """
    machine = load_machine(file)
    found = [ok("machine file", f"{file} can be read")]
    if machine.physics not in PHYSICS.builtin:
        found += _checked("physics", partial(check_physics, machine), "ldt docs physics")
    for effect in machine.own_laws:
        found += _checked(effect.name, partial(check_effect, effect, [machine]), "ldt docs effect")
    return found


def _checked(name: str, check: Callable[[], list[str]], page: str) -> list[Finding]:
    try:
        return [ok(name, sentence) for sentence in check()]
    except (AssertionError, LdtError) as error:
        return [problem(name, str(error), f"mend it ({page})")]
