"""Whether a measured current can be this motor's: its unit and its sign.

The voltage drives it through the resistance, against the speed: i = (V - K_t w) / R, but for the
short time of the inductance. So of the current as a sum of voltage and speed the voltage's share is
1/R, whatever the load, the inertia and the torque constant are. A current in mA, or of a clamp the
other way round, is far from that. Fitted to, it moves R by as much, with assurance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ldt_core.base.experiment import Experiment
from ldt_core.machine.machine_file import Machine

#: By which the voltage's share may differ from the file's 1/R: a hot or worn motor's by a few, a
#: unit's error is a thousand.
FACTOR = 30.0
#: Of the current's power: a sum of voltage and speed that leaves more shows no motor at all.
MOST_LEFT = 0.3
#: Standard errors that the voltage's share has to differ from 0 by.
LEAST_ERRORS = 10.0


def wrong_current(machine: Machine, experiments: Sequence[Experiment]) -> str:
    """What cannot be right about the current, in words; "" where nothing tells, or all is well."""
    resistance = machine.parameters.get("R", 0.0)
    rows = [
        np.stack([np.ones(len(e) - 1), e.speed[1:], e.voltage[:-1], e.current[1:]], 1)
        for e in experiments  # a voltage is held until the next sample, which shows what it drove
        if e.current is not None
    ]
    table = np.concatenate(rows or [np.zeros((0, 4))])
    if len(table) and not np.ptp(table[:, 3]) and np.ptp(table[:, 2]):
        return f"{table[0, 3]:.4g} A to the last digit, while the voltage moves"
    sizes = np.abs(table).max(axis=0, initial=0.0)
    freedom = len(table) - table.shape[1]
    if resistance <= 0 or freedom < 1 or not sizes.all():
        return ""
    # Of the current in the last column, above the diagonal, what is new in the voltage and in it.
    upper = np.asarray(np.linalg.qr(table / sizes, mode="r"))
    by_volts, left = upper[2, 3], upper[3, 3] ** 2
    power = float(np.sum(upper[1:, 3] ** 2))
    if left > MOST_LEFT * power or by_volts**2 < LEAST_ERRORS**2 * left / freedom:
        return ""
    times = float(by_volts / upper[2, 2] * sizes[3] / sizes[2] * resistance)
    if 1 / FACTOR <= times <= FACTOR:
        return ""
    if times < 0:
        return f"a current of the wrong sign for R = {resistance:g} Ohm"
    return f"{float(f'{times:.2g}'):g} times what the voltage drives through R = {resistance:g} Ohm"


def without_wrong_current(
    machine: Machine, experiments: Sequence[Experiment]
) -> tuple[list[Experiment], str]:
    """(the experiments, without their current where it is wrong, what is wrong or "")."""
    if note := wrong_current(machine, experiments):
        told = f"the current was left out, since its unit, its sign or R is wrong: {note}"
        return [replace(e, current=None) for e in experiments], told
    return list(experiments), ""
