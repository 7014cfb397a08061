"""What speaks against a measured speed, though no plain fault does."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from ldt_core.base.experiment import Experiment
from ldt_core.estimation.noise import ROUGHER, white_noise
from ldt_core.machine.machine_file import Machine
from ldt_core.machine.sensor_check import doubt


def speed_doubt(machine: Machine, experiment: Experiment, recent: Sequence[Experiment] = ()) -> str:
    """What the machine file rules out, or a noise that it does not know, in words; else empty.

    Args:
        machine: as its file knows it.
        experiment: that is no plain `fault`.
        recent: sound experiments before it.
    """
    return doubt(machine, experiment, recent) or _rougher(machine, experiment)


def _rougher(machine: Machine, e: Experiment) -> str:
    """A speed much rougher than the calibration left it; a file that tells no noise knows nothing.

    A model that errs by a ripple faster than half the sample rate leaves what looks like noise.
    """
    noise = machine.calibration.get("noise")
    told = noise.get("speed") if isinstance(noise, Mapping) else None
    if not isinstance(told, int | float) or not 0 < told < math.inf:
        return ""
    found = white_noise([e.speed])
    if found <= ROUGHER * told:
        return ""
    return (
        f"a noise of {found:.3g} rad/s, {told:.3g} in the machine file: a worse sensor, or a "
        "ripple too fast for the sample rate"
    )
