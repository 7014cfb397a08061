"""What a machine begins with that stood still at the first sample, of which sensors show noise."""

from __future__ import annotations

from weakref import WeakKeyDictionary

from ldt_core.base.experiment import Experiment
from ldt_core.estimation.noise import white_noise

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
