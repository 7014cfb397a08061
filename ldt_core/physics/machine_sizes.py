"""How large an effect is on a machine of its size: the library's values are the worked case's."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ldt_core.physics.effect import Effect
from ldt_core.physics.motor_rates import memory
from ldt_core.physics.parameter import Parameter, logarithmic

#: The worked case at 16 V: torque [N m], speed [rad/s], voltage [V], current [A], memory [s].
REFERENCE = (4.8, 53.3, 16.0, 16.0, 0.2)
#: Parts of the largest voltage and current, at which a limit on them is looked for: above, none is
#: felt. A motor seldom takes the current of a reversal, so that lower limits show as well.
LIMITS = {"V": (0.4, 0.55, 0.7, 0.85, 0.95), "A": (0.08, 0.15, 0.25, 0.4, 0.6)}
SAME_SIZE = 3.0  # factor within which a machine keeps the library's own round numbers


def machine_scales(values: Mapping[str, float], most_voltage: float) -> dict[str, float]:
    """Unit to the factor by which this machine's sizes differ from the worked case's.

    The library's sizes are written for the rotor of the worked case. On another machine they are
    taken in its own units: of torque at standstill, no-load speed, voltage, current, and the time
    in which the motor forgets its speed.

    Args:
        values: of the machine's parameters; one that is no motor keeps the library's sizes.
        most_voltage: largest voltage that the machine is given [V].
    """
    if not {"K_t", "R", "J", "b"} <= values.keys():
        return {}
    current = most_voltage / values["R"]
    own = (
        values["K_t"] * current,
        most_voltage / values["K_t"],
        most_voltage,
        current,
        memory(values),
    )
    ratio = [a / b for a, b in zip(own, REFERENCE, strict=True)]
    torque, speed, voltage, amps, time = (
        1.0 if 1 / SAME_SIZE < r < SAME_SIZE else r for r in ratio
    )
    return {
        "N m": torque,
        "N m s": torque / speed,
        "N m s^2": torque / speed**2,
        "N m s^3": torque / speed**3,
        "N m/rad": torque / (speed * time),
        "N m s/rad": torque / speed,
        "rad/s": speed,
        "V": voltage,
        "A": amps,
        "Ohm": voltage / amps,
        "s": time,
        "K/W": 1.0 / (voltage * amps),
    }


def in_own_sizes(
    effect: Effect, given: Mapping[str, float], sizes: Mapping[str, float]
) -> dict[str, float]:
    """Values of an effect in a machine's sizes: each is scaled with its unit.

    A factor has none, and a limit is no amount.

    Args:
        given: in the library's; what is left out is neutral.
        sizes: see `machine_scales`.
    """
    found = {}
    for p in effect.parameters:
        value = {**effect.neutral, **given}[p.name]
        found[p.name] = value if is_limit(p) else value * sizes.get(p.unit, 1.0)
        if math.isfinite(p.low) and math.isfinite(p.high):
            found[p.name] = min(max(found[p.name], p.low), p.high)
        elif value == p.default and not value:
            found[p.name] = value
        found[p.name] = max(found[p.name], p.low)
    return found


def is_limit(p: Parameter) -> bool:
    """Whether the parameter is a voltage or current that nothing exceeds."""
    return logarithmic(p) and p.unit in LIMITS


def is_amount(p: Parameter) -> bool:
    """Whether it says how much of an effect there is: none at 0, or at a factor of 1."""
    none = p.default if p.idle is None else p.idle
    return not p.cyclic and (none == 0 or (logarithmic(p) and not is_limit(p)))


def most_of(values: Mapping[str, float], most_voltage: float) -> dict[str, float]:
    """Unit to the largest voltage [V] and current [A]: that of a reversal at full speed."""
    return {"V": most_voltage, "A": 2 * most_voltage / values.get("R", 1.0)}
