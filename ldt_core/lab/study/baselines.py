"""What every detector's score is compared with: never, periodic and random alarms."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

import msgs_config
from ldt_core.base.experiment import Action, Level
from ldt_core.lab.study.study_case import RunResult, StudyCase

STREAM = (0, 4)  # of random numbers, apart from the plant's (`ldt_core.machine`)


def never(result: RunResult) -> RunResult:
    """The run on the same stream whose detector never says anything: the original model's."""
    count = len(result.number)
    return replace(
        result,
        case=replace(result.case, detector="never", alarms=()),
        max_error=result.original,
        level=[int(Level.NEGATIVE)] * count,
        action=[str(Action.KEPT)] * count,
        region_rmse=result.region_rmse_original,
        kept={},
        seconds=0.0,
    )


def baseline_cases(result: RunResult) -> list[StudyCase]:
    """The periodic and the random run that raise as many alarms as this one adapted.

    All else is as in the run: its model, its stream, its way to learn.
    """
    case, count = result.case, len(result.adaptations)
    alarms = {
        "periodic": periodic(count, case.experiments),
        "random": random(count, case.experiments, case.seed),
    }
    plain = {n: v for n, v in case.settings.items() if n not in msgs_config.parameters("detector")}
    return [
        replace(case, detector=name, alarms=when, settings=plain, keep=())
        for name, when in alarms.items()
        if when
    ]


def periodic(count: int, experiments: int) -> tuple[int, ...]:
    """One alarm in the middle of each of `count` equal parts of the stream.

    >>> periodic(4, 200)
    (26, 76, 126, 176)
    """
    return tuple(math.floor((i + 0.5) * experiments / count) + 1 for i in range(count))


def random(count: int, experiments: int, seed: int) -> tuple[int, ...]:
    """`count` different experiments drawn with the seed, in order."""
    generator = np.random.default_rng(np.random.SeedSequence([seed, *STREAM]))
    drawn = generator.choice(np.arange(1, experiments + 1), size=count, replace=False)
    return tuple(sorted(drawn.tolist()))
