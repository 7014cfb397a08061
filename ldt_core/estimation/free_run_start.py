"""What a free run begins with, as far as the samples tell."""

from __future__ import annotations

from collections.abc import Callable
from weakref import WeakKeyDictionary

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment
from ldt_core.estimation.noise import white_noise
from ldt_core.physics.base import CURRENT, NOT_TRACKED, SPEED
from ldt_core.physics.motor import MOTOR
from ldt_core.physics.parameter import Values

#: A machine stood still whose first speed, and no current flowed whose first sample, is within so
#: many deviations of the noise: one of 16,000 samples of normal noise is beyond.
AT_REST = 4.0

#: Of a motor's speed without a load: a first speed below may be a sensor's error, of which half a
#: per cent is usual. With 0.01, starts of 2 rad/s of 240 are taken for rest, and are alarms.
STANDSTILL = 0.005
#: Steps to a first current: those behind the first take off what a friction's sign has bent. And
#: part of the sum of squares; a step that promises less is not taken.
MOST_STEPS, LEAST_GAIN = 6, 0.01

_KNOWN: WeakKeyDictionary[Experiment, float | None] = WeakKeyDictionary()


def first_current(experiment: Experiment) -> float | None:
    """Current [A] that a free run is to begin with; None leaves it to the physics.

    None where none was recorded, and where the machine stood still and it shows no more than noise:
    a winding with a long time constant would keep that for as long.
    """
    if experiment.current is None:
        return None
    if experiment not in _KNOWN:
        still = all(
            abs(float(samples[0])) <= AT_REST * white_noise([samples])
            for samples in (experiment.speed, experiment.current)
        )
        _KNOWN[experiment] = None if still else float(experiment.current[0])
    return _KNOWN[experiment]


def is_running(values: Values, experiment: Experiment) -> bool:
    """Whether the machine did not stand still at the first sample.

    That is its noise where it is small beside the speed that the voltages drive, whatever the
    samples behind it show.

    Args:
        values: of the motor.
    """
    first, speed = abs(float(experiment.speed[0])), [experiment.speed]
    driven = float(np.abs(experiment.voltage).max()) / values["K_t"]
    # Most machines stand still, which spares them the estimate of the noise.
    return first > STANDSTILL * driven and first > AT_REST * white_noise(speed)


def told_current(run: Callable[[float], Array], values: Values, experiment: Experiment) -> float:
    """Current [A] that flowed at the first sample beside the one that a free run begins with.

    The speed tells it where a machine was running and nobody measured it: with it the free run
    comes nearest, by Gauss-Newton steps of the ideal motor under a prior. It is no more than the
    voltages there can drive. (To estimate unknown first states along is usual in simulation: Ljung,
    "System Identification", 2nd edition 1999.)

    Args:
        run: the free run's speed (L,) [rad/s] from so much beside it.
        values: of the motor.

    Returns:
        0 where a current was recorded, or the machine stood still.
    """
    from ldt_core.physics.integrate import propagate  # with its compiler it takes long to import

    if experiment.current is not None or not is_running(values, experiment):
        return 0.0
    speed, noise = experiment.speed, white_noise([experiment.speed])
    volts = float(np.abs(experiment.voltage).max() + values["K_t"] * np.abs(speed).max())
    most = volts / values["R"]
    ad, bd = MOTOR.discretised(values, experiment.period)
    one = np.zeros(len(MOTOR.states))
    one[CURRENT] = 1.0
    moved = propagate(ad, bd, np.zeros(speed.size), one, *NOT_TRACKED)[:, SPEED]
    known = (noise / most) ** 2
    power = float(moved @ moved) + known
    found, left, share = 0.0, speed - run(0.0), 1.0
    for _ in range(MOST_STEPS if power > 0 else 0):
        by = (float(moved @ left) - known * found) / power
        if by**2 * power <= LEAST_GAIN * float(left @ left):
            break
        tried = float(np.clip(found + share * by, -most, most))
        try:
            rest = speed - run(tried)
        except LdtError:  # it grows without bound from there
            share /= 2
            continue
        if float(rest @ rest) < float(left @ left):
            found, left, share = tried, rest, 1.0
        else:
            share /= 2
    return found
