"""What a free run begins with, as far as the samples tell."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.experiment import Experiment
from ldt_core.estimation.noise import white_noise
from ldt_core.physics.base import CURRENT, NOT_TRACKED, SPEED
from ldt_core.physics.motor import MOTOR
from ldt_core.physics.parameter import Values

#: A machine stood still whose first speed, and no current flowed whose first sample, is within so
#: many deviations of the noise: one of 16,000 samples of normal noise is beyond.
AT_REST = 4.0

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


def is_current_unknown(experiment: Experiment) -> bool:
    """Whether a machine was running of which nobody measured the current."""
    speed = experiment.speed
    rest = abs(float(speed[0])) <= AT_REST * white_noise([speed])
    return experiment.current is None and not rest


def current_beside(values: Values, experiment: Experiment, predicted: Array) -> float:
    """Current [A] that flowed at the first sample beside the one that a free run began with.

    The speed tells it where nobody measured it: with it the free run of the ideal motor comes
    nearest, by least squares under a prior. It is no more than the voltages there can drive.

    Args:
        values: of the motor.
        predicted: (L,) speed of the free run [rad/s].
    """
    from ldt_core.physics.integrate import propagate  # with its compiler it takes long to import

    speed = experiment.speed
    volts = float(np.abs(experiment.voltage).max() + values["K_t"] * np.abs(speed).max())
    most = volts / values["R"]
    ad, bd = MOTOR.discretised(values, experiment.period)
    one = np.zeros(len(MOTOR.states))
    one[CURRENT] = 1.0
    moved = propagate(ad, bd, np.zeros(speed.size), one, *NOT_TRACKED)[:, SPEED]
    told = float(moved @ moved) + (white_noise([speed]) / most) ** 2
    return float(np.clip(moved @ (speed - predicted) / told, -most, most)) if told > 0 else 0.0
