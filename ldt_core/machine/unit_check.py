"""Whether a machine file may have a number in another unit: inertia in g m², resistance in mOhm.

A wrong unit makes the file's motor a thousand times as slow or as fast as the recorded one. Told is
what lies nearer to that, by its logarithm, than to the file: no wear and no load changes so much.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from ldt_core.base.experiment import Experiment
from ldt_core.machine.machine_file import Machine
from ldt_core.machine.speed_jumps import MOST_STEP, median_step
from ldt_core.physics.base import SPEED
from ldt_core.physics.motor import MOTOR

#: The geometric mean of 1 and the thousand between units.
UNIT_FACTOR = math.sqrt(1000.0)
FILE = "the machine file, of which a number may be in another unit"
#: Means of samples of which the time constant is fitted: noise would shorten it.
BLOCKS = 200
#: Least share of the speed's variance that the voltage explains, with one time constant.
EXPLAINED = 0.9


def other_unit(machine: Machine, e: Experiment) -> str:
    """What the file's motor would need a number in another unit for, in words; otherwise empty."""
    p, volts = machine.parameters, float(np.abs(e.voltage).max())
    braked = p["K_t"] ** 2 + p["R"] * p["b"]
    noise = MOST_STEP * median_step(e)
    # At top speed, with the voltage reversed, twice the torque that it has at rest.
    quickest = UNIT_FACTOR * 2 * volts * p["K_t"] / (p["R"] * p["J"])
    apart = 1
    while apart < len(e):
        rise = float(np.abs(e.speed[apart:] - e.speed[:-apart]).max())
        if rise > (most := quickest * apart * e.period + noise):
            return _told(f"changes by {rise:.3g} rad/s within {apart * e.period:.3g} s", most)
        apart *= 2
    reached = UNIT_FACTOR * max(volts * p["K_t"] / braked, abs(float(e.speed[0]))) + noise
    if (fastest := float(np.abs(e.speed).max())) > reached:
        return _told(f"reaches {fastest:.3g} rad/s with {volts:.3g} V", reached)
    constant, gain = _response(e)
    if gain < 0:
        return (
            f"the speed falls by {-gain:.3g} rad/s for each volt: one of the two has the other sign"
        )
    file = p["J"] * p["R"] / braked
    if constant > UNIT_FACTOR * max(file, p["L"] / p["R"]):
        # Where the voltage changes slowly, any slow load looks like a time constant.
        if _left({**p, "J": p["J"] * constant / file}, e) >= _left(p, e):
            return ""
        return f"the speed follows the voltage in {constant:.2g} s, in {file:.2g} s by {FILE}"
    if _explains(p, e) or not any(_explains({**p, **other}, e) for other in _sooner(p)):
        return ""
    slow = f"a current that takes {p['L'] / p['R']:.2g} s"
    return f"the speed follows the voltage sooner than {slow} by {FILE}"


def _sooner(p: Mapping[str, float]) -> list[dict[str, float]]:
    """What makes the current a thousand times as quick."""
    return [{"L": p["L"] / UNIT_FACTOR**2}, {"R": p["R"] * UNIT_FACTOR**2}]


def _explains(p: Mapping[str, float], e: Experiment) -> bool:
    """Whether a motor with these parameters follows the speed, but for an offset by a load."""
    return _left(p, e) <= (1 - EXPLAINED) * float(np.var(e.speed))


def _left(p: Mapping[str, float], e: Experiment) -> float:
    """Variance that a motor with these parameters leaves of the speed [rad^2/s^2]."""
    start = MOTOR.initial_state(p, float(e.speed[0]))
    return float(np.var(e.speed - MOTOR.simulate(p, e.voltage, e.period, start)[:, SPEED]))


def _told(what: str, most: float) -> str:
    return f"the speed {what}, at most {most / UNIT_FACTOR:.2g} by {FILE}"


def _response(e: Experiment) -> tuple[float, float]:
    """(time constant [s], too short where noise is; gain [rad/s/V]); 0 where none fits.

    Ljung (1999), System Identification, 4.2: least squares of an ARX model of first order.
    """
    size = max(1, len(e) // BLOCKS)
    count = len(e) // size
    u, w = (x[: count * size].reshape(-1, size).mean(axis=1) for x in (e.voltage, e.speed))
    spread = float(np.var(w[1:])) if count > 8 else 0.0
    if spread == 0.0 or np.ptp(u) == 0.0:
        return 0.0, 0.0
    rows = np.column_stack([w[:-1], u[:-1], u[1:], np.ones(count - 1)])
    fit, *_ = np.linalg.lstsq(rows, w[1:], rcond=None)
    pole = float(fit[0])
    if not 0 < pole < 1:
        return 0.0, 0.0
    # Free run: one step ahead, any slow speed explains itself.
    now, left = float(w[0]), 0.0
    for pushed, measured in zip((rows[:, 1:] @ fit[1:]).tolist(), w[1:].tolist(), strict=True):
        now = pole * now + pushed
        left += (measured - now) ** 2
    explained = left <= (1 - EXPLAINED) * spread * (count - 1)
    if not explained:
        return 0.0, 0.0
    return -size * e.period / math.log(pole), float(fit[1] + fit[2]) / (1 - pole)
