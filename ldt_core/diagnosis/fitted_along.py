"""The effects of a diagnosis, apart from the machine's own numbers that were fitted along."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ldt_core.diagnosis.diagnosis import acting_entries, refused, used_effects
from ldt_core.diagnosis.nominal_prior import CHANGED_BY
from ldt_core.physics.effect import Effect

Used = tuple[Effect, dict[str, float]]


def acting_and_along(
    file: str, found: Mapping[str, Any], own: Sequence[Effect] = ()
) -> tuple[list[Used], list[Used]]:
    """The effects of a diagnosis' keys, and the machine's own numbers that were fitted along.

    Nobody names the latter: they are no effects of the machine, but other values of its file.
    Errors as of `read_effects`.
    """
    used = used_effects(file, acting_entries(file, found), own)
    with refused(file):
        named = list(found["verdict"].get("effects") or ())
        refit = {CHANGED_BY.get(r["parameter"]) for r in found.get("refit") or ()} - {*named}
    acting = [u for u in used if u[0].name not in refit]
    return acting, [u for u in used if u[0].name in refit]
