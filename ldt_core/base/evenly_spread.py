"""An evenly spread part of a recording that is far larger than any fit needs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ldt_core.base.experiment import Experiment

#: Experiments that a fit and its held-out check work on, and samples of these, about: they bound
#: time and memory. Of 20,000 experiments of 1 s of a motor with dry friction, 500, 1000, 2000 and
#: all give one verdict; amounts differ by 0.01 %, and their interval is 4 %, by how inexact laws
#: are. With 250, one of three effects that are not told apart was left out.
MOST_EXPERIMENTS = 2_000
MOST_SAMPLES = 2_000_000
#: Experiments that are left whatever their length: ten of them are held out.
LEAST_EXPERIMENTS = 40
#: Samples of each that so many may have.
LONGEST = MOST_SAMPLES // LEAST_EXPERIMENTS


def evenly_spread(experiments: Sequence[Experiment]) -> tuple[list[Experiment], str]:
    """(experiments to work on, a note or "" if that is all of them).

    Every so many-th, so that what changes in the course of the recording is in them, as in what is
    then held out of them. Of those that are too long even so, evenly spread stretches.
    """
    count, samples = len(experiments), sum(len(e) for e in experiments)
    if count <= MOST_EXPERIMENTS and samples <= MOST_SAMPLES:
        return list(experiments), ""
    bearable = max(LEAST_EXPERIMENTS, MOST_SAMPLES * count // samples)
    kept = min(count, MOST_EXPERIMENTS, bearable)
    chosen = [experiments[int((i + 0.5) * count / kept)] for i in range(kept)]
    each = max(1, LEAST_EXPERIMENTS // kept)
    places = np.linspace(0.0, 1.0, kept)
    parts = [s for e, at in zip(chosen, places, strict=True) for s in _stretches(e, each, at)]
    used = sum(len(e) for e in parts)
    return parts, (
        f"of {count} experiments of {samples} samples {kept} were used, of them {used} samples, "
        "evenly spread: what shows in the others alone was not seen"
    )


def _stretches(e: Experiment, count: int, place: float) -> list[Experiment]:
    """So many of `LONGEST` samples, from begin to end; of one alone, at this place (0 to 1).

    The first begins with the experiment, at rest for one: that tells a sensor's offset.
    """
    if len(e) <= count * LONGEST:
        return [e]
    places = np.linspace(0.0, 1.0, count) if count > 1 else [place]
    begins = [int(at * (len(e) - LONGEST)) for at in places]
    return [e.part(begin, begin + LONGEST) for begin in begins]
