"""Whether somebody has edited the amounts of a `diagnosis.json` where nobody reads them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ldt_core.base.errors import BadInput
from ldt_core.effects import EFFECTS, get_effect


def refuse_hand_edits(file: str, found: Mapping[str, Any]) -> None:
    """Refuse a diagnosis whose `candidates` have other amounts of an acting effect than `effects`.

    The latter are taken: whoever has changed the former would not see that nothing follows. What
    changes the machine's own numbers is left out, since these may have been fitted along.

    Raises:
        BadInput: says which amount, and what to edit.
    """
    try:
        ranked = {c["effect"]: c["parameters"] for c in found["candidates"]}
        pairs = [
            (e["effect"], name, value, ranked[e["effect"]][name]["value"])
            for e in found["effects"]
            for name, value in e["parameters"].items()
            if name in ranked.get(e["effect"], ())
        ]
    except (KeyError, TypeError, AttributeError):  # `effects` alone must be right
        return
    for effect, name, value, shown in pairs:
        own = effect in EFFECTS.names() and get_effect(effect).on_parameters is not None
        if shown != value and not own:
            raise BadInput(
                f"{file}, candidates, {effect}, {name}",
                f"{value!r} as under the key effects, which is what counts (edit it there)",
                repr(shown),
            )
