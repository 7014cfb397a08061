"""All laws of the challenge by name: of the library's effects, and outside of it."""

from __future__ import annotations

from ldt_core.lab.challenge.law import Law
from ldt_core.lab.challenge.laws.electrical_laws import ELECTRICAL
from ldt_core.lab.challenge.laws.friction_laws import FRICTION
from ldt_core.lab.challenge.laws.mechanical_laws import MECHANICAL
from ldt_core.lab.challenge.laws.outside_laws import OUTSIDE

__all__ = ["LAWS", "OUTSIDE"]

#: Effects that a diagnosis may name, by their names there; `OUTSIDE`: what none of them is.
LAWS: dict[str, Law] = {**FRICTION, **ELECTRICAL, **MECHANICAL}
