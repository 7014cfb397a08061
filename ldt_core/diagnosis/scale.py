"""How large an effect's parameters may be on this machine.

The library's sizes are written for the rotor of the worked case. On another machine they are taken
in its own units: of torque at standstill, no-load speed, voltage, current, and the time in which
the motor forgets its speed.
"""

from __future__ import annotations

from collections.abc import Mapping

from ldt_core.physics.motor import memory

#: The worked case at 16 V: torque [N m], speed [rad/s], voltage [V], current [A], memory [s].
REFERENCE = (4.8, 53.3, 16.0, 16.0, 0.2)
SAME = 3.0  # times: a machine within this of the worked case keeps the library's own round numbers


def factors(values: Mapping[str, float], most_voltage: float) -> dict[str, float]:
    """Unit to the factor by which this machine's sizes differ from the worked case's."""
    current = most_voltage / values["R"]
    own = (
        values["K_t"] * current,
        most_voltage / values["K_t"],
        most_voltage,
        current,
        memory(values),
    )
    ratio = [a / b for a, b in zip(own, REFERENCE, strict=True)]
    torque, speed, voltage, amps, time = (1.0 if 1 / SAME < r < SAME else r for r in ratio)
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
