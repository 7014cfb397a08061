"""The runs of the groups robustness, trials and alarms: in parallel, each kept as it comes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from ldt_core.base.code_version import code_version
from ldt_core.base.errors import LdtError, reason_of
from ldt_core.base.parallel import Workers
from ldt_core.base.result_files import ResultFolder
from ldt_core.lab.study.robustness.alarm_trials import (
    AlarmCount,
    AlarmTask,
    alarm_tasks,
    count_alarms,
)
from ldt_core.lab.study.robustness.paper_trials import PAPER_TRIALS
from ldt_core.lab.study.robustness.robust_run import (
    DEFAULT,
    SETUPS,
    TRIAL,
    RobustRun,
    RobustTask,
    run_robust,
)
from ldt_core.lab.study.robustness.streams import STREAMS
from ldt_core.lab.study.study_plan import StudyPlan

FORMAT = "ldt-robustness-1"
#: What a run costs relative to others, to begin the long ones first.
COST = {DEFAULT: 10.0}

Task = RobustTask | AlarmTask
Answer = RobustRun | AlarmCount


class Beyond(NamedTuple):
    """What came of the groups; nothing of one that was not asked for."""

    robust: tuple[RobustRun, ...]
    alarms: tuple[AlarmCount, ...]


def robust_tasks(seeds: Sequence[int], most: int) -> list[RobustTask]:
    """Every stream under every setup, the longest first in each seed.

    Args:
        seeds: of the streams.
        most: experiments of a stream at most.
    """
    found = [
        RobustTask(name, setup, seed, min(kind.experiments, most))
        for seed in seeds
        for name, kind in STREAMS.items()
        for setup in SETUPS
    ]
    return sorted(found, key=lambda t: (t.seed, -COST.get(t.setup, 1.0) * t.experiments))


def trial_tasks(seeds: Sequence[int], most: int) -> list[RobustTask]:
    """Every trial of the paper's hybrid on every seed; `most` bounds its experiments."""
    return [
        RobustTask(name, TRIAL, seed, min(trial.stream.experiments, most))
        for seed in seeds
        for name, trial in PAPER_TRIALS.items()
    ]


def conduct_named(
    plan: StudyPlan, out: Path | str, workers: Workers, progress: Callable[[int, int], None]
) -> Beyond:
    """Make what a plan asks of these groups and is not there yet.

    Args:
        plan: whose groups and seeds count; its experiments bound the streams' own.
        out: folder of the study.
        workers: that compute.
        progress: told of the results that are there, and how many there will be.

    Raises:
        LdtError: a run failed; what was computed before is kept.
    """
    seeds = range(plan.first_seed, plan.first_seed + plan.seeds)
    tasks: list[Task] = []
    if "alarms" in plan.groups:
        tasks += alarm_tasks(seeds)
    if "robustness" in plan.groups:
        tasks += robust_tasks(seeds, plan.experiments)
    if "trials" in plan.groups:
        tasks += trial_tasks(seeds, plan.experiments)
    if not tasks:
        return Beyond((), ())
    folder = ResultFolder(out, FORMAT, code_version())
    compute, about = partial(workers.map, _work), lambda task: {"task": asdict(task)}
    found = folder.complete(tasks, _place, _parsed, compute, progress, about)
    answers = [found[_place(task)] for task in tasks]
    return Beyond(
        tuple(a for a in answers if isinstance(a, RobustRun)),
        tuple(a for a in answers if isinstance(a, AlarmCount)),
    )


def _place(task: Task) -> str:
    return f"{'robustness' if isinstance(task, RobustTask) else 'alarms'}/{task.key}"


def _parsed(task: Task, plain: Mapping[str, Any]) -> Answer:
    if isinstance(task, RobustTask):
        return RobustRun.from_dict(task, plain)
    return AlarmCount.from_dict(task, plain)


def _work(task: Task) -> Answer:
    try:
        return run_robust(task) if isinstance(task, RobustTask) else count_alarms(task)
    except Exception as error:
        where = f"{task.stream}, {task.setup}" if isinstance(task, RobustTask) else task.key
        raise LdtError(f"{where}, seed {task.seed}: {reason_of(error)}") from error
