"""Motors whose numbers a test gives."""

from __future__ import annotations

from collections.abc import Mapping

from ldt_core.effects import EFFECTS
from ldt_core.machine.machine_file import Machine, machine_from_dict


def motor_file(parameters: Mapping[str, float], samples: int, period: float) -> Machine:
    """A motor's file with these parameters, for experiments of so many samples.

    Args:
        period: of a sample [s].
    """
    keys = {
        "name": "m",
        "physics": "dc_motor",
        "parameters": dict(parameters),
        "limits": {"voltage": [-24, 24]},
        "experiment": {"duration": samples * period, "sample_period": period},
    }
    return machine_from_dict(keys, "m")


def all_but(*kept: str) -> list[str]:
    """Names of the library's other effects, to be left out where its size is not the point."""
    return [name for name in EFFECTS.names() if name not in kept]
