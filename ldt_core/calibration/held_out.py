"""Which experiments a calibration is judged by."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ldt_core.base.errors import OptionError
from ldt_core.base.evenly_spread import evenly_spread
from ldt_core.base.experiment import Experiment
from ldt_core.base.settings import HOLDOUT

LEAST_TO_HOLD_OUT = 4  # experiments; fewer are all needed for the fit


def split_evenly(
    experiments: Sequence[Experiment], holdout: float | None
) -> tuple[list[Experiment], list[Experiment], list[str]]:
    """Experiments to fit, and those held out: every so many-th, so that both cover all.

    With them a note where they are not all of the experiments, see `evenly_spread`.
    """
    experiments, part = evenly_spread(experiments)
    count = len(experiments)
    if not count:
        raise OptionError("calibration", "one experiment or more", "none")
    if holdout is None:
        holdout = HOLDOUT if count >= LEAST_TO_HOLD_OUT else 0.0
    if not 0 <= holdout < 1:
        raise OptionError("--holdout", "a share from 0 to below 1", f"{holdout:g}")
    number = math.ceil(holdout * count)
    if number >= count:
        raise OptionError("--holdout", f"a share that leaves one of {count} to fit", f"{holdout:g}")
    chosen = {int((i + 0.5) * count / number) for i in range(number)}
    return (
        [e for i, e in enumerate(experiments) if i not in chosen],
        [e for i, e in enumerate(experiments) if i in chosen],
        [f"{part[0].upper()}{part[1:]}."] if part else [],
    )
