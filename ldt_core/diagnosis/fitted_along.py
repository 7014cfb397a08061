"""The effects of a diagnosis, apart from the machine's own numbers that were fitted along."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ldt_core.base.errors import BadInput, OptionError
from ldt_core.diagnosis.diagnosis import acting_entries, refused, used_effects
from ldt_core.diagnosis.nominal_prior import CHANGED_BY
from ldt_core.machine.machine_file import Machine
from ldt_core.physics.effect import Effect

Used = tuple[Effect, dict[str, float]]


def acting_and_along(
    file: str, found: Mapping[str, Any], machine: Machine | None = None
) -> tuple[list[Used], list[Used]]:
    """The effects of a diagnosis' keys, and the machine's own numbers that were fitted along.

    Nobody names the latter: they are no effects of the machine, but other values of its file.
    Errors as of `read_effects` and `check_possible`; None takes any machine.
    """
    own = machine.own_laws if machine else ()
    used = used_effects(file, acting_entries(file, found), own)
    if machine:
        check_possible(file, found, machine, used)
    with refused(file):
        named = list(found["verdict"].get("effects") or ())
        refit = {CHANGED_BY.get(r["parameter"]) for r in found.get("refit") or ()} - {*named}
    acting = [u for u in used if u[0].name not in refit]
    return acting, [u for u in used if u[0].name in refit]


def check_possible(
    file: str, found: Mapping[str, Any], machine: Machine, used: Sequence[Used]
) -> None:
    """Refuse what a machine's numbers cannot become, as with another file than the diagnosed one.

    Raises:
        BadInput: names the diagnosis, its file and this one.
    """
    values = machine.parameters
    for effect, given in used:
        effect.require(machine.model)
        try:
            values = effect.change_parameters(machine.model, values, given)
        except OptionError as error:
            made = f"changes of {found.get('machine_file') or 'another file'}"
            expected = f"changes that {machine.source} can have (diagnose with it)"
            raise BadInput(file, expected, f"{made} that it cannot: {error}") from None
