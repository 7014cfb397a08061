"""An evenly spread part of a recording that is far larger than any fit needs."""

from __future__ import annotations

from collections.abc import Sequence

from ldt_core.base.experiment import Experiment

#: Experiments that a fit and its held-out check work on, and samples of these, at most: they bound
#: time and memory.
MOST_EXPERIMENTS = 2_000
MOST_SAMPLES = 2_000_000
#: Experiments that are left whatever their length: ten of them are held out.
LEAST_EXPERIMENTS = 40


def evenly_spread(experiments: Sequence[Experiment]) -> tuple[list[Experiment], str]:
    """(experiments to work on, a note or "" if that is all of them).

    Every so many-th, so that what changes in the course of the recording is in them, as in what is
    then held out of them.
    """
    count, samples = len(experiments), sum(len(e) for e in experiments)
    bearable = int(MOST_SAMPLES * count / max(samples, 1))
    kept = min(MOST_EXPERIMENTS, max(LEAST_EXPERIMENTS, bearable))
    if count <= kept:
        return list(experiments), ""
    chosen = [experiments[int((i + 0.5) * count / kept)] for i in range(kept)]
    return chosen, (
        f"of {count} experiments {kept} were used, evenly spread: what shows in the others alone "
        "was not seen"
    )
