"""Where a grey box that was running began, as its speed tells."""

from __future__ import annotations

import math

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.experiment import Experiment, rms
from ldt_core.estimation.free_run_start import is_running, told_current
from ldt_core.estimation.grey_box import ANGLES, COARSE_STEP, Case, GreyBox
from ldt_core.physics.base import ANGLE, CURRENT


def running_start(box: GreyBox, q: Array, experiment: Experiment, turn: float) -> Array:
    """(3,) offset of the first state, see `GreyBox.speed`: angle, speed and current.

    The angle of a machine that shakes its foundation is one of `ANGLES`, from which the free run
    comes nearest. Zeros of a machine that was at rest.

    Args:
        turn: angle [rad] by which starts may differ without a difference; 0 where it is not known.
    """
    start, motor = np.zeros(CURRENT + 1), box.motor(q)
    if not is_running(motor, experiment):
        return start
    if box.physics.shakes(box.values(q)[0]):
        angles = (turn or 2 * math.pi) * np.arange(ANGLES) / ANGLES
        cases = [Case(q, experiment, False, np.array([angle, 0.0, 0.0])) for angle in angles]
        left = [rms(experiment.speed - run) for run in box.speeds(cases, step=COARSE_STEP)]
        start[ANGLE] = angles[int(np.argmin(left))]

    def run(current: float) -> Array:
        begun = start.copy()
        begun[CURRENT] = current
        return box.speed(q, experiment, False, begun)

    start[CURRENT] = told_current(run, motor, experiment)
    return start
