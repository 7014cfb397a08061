"""All laws of the challenge by name: of the library's effects, and outside of it."""

from __future__ import annotations

from ldt_core.lab.challenge.law import Law
from ldt_core.lab.challenge.laws import drive, friction, mechanics, outside, sensor

#: Effects that a diagnosis may name, by their names there.
LAWS: dict[str, Law] = {
    law.name: law for module in (friction, drive, mechanics, sensor) for law in module.LAWS
}
#: Causes that no candidate of a diagnosis is.
OUTSIDE: dict[str, Law] = {law.name: law for law in outside.LAWS}
