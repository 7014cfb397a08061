"""Tuning: what there is to choose from is tried on a recording, in parallel, and one is chosen."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ldt_core.base.code_version import code_version
from ldt_core.base.errors import (
    ExperimentError,
    OptionError,
    RecordingError,
    did_you_mean,
)
from ldt_core.base.experiment import Experiment
from ldt_core.base.parallel import Workers
from ldt_core.base.result_files import ResultFolder, check_own_folder, check_writable
from ldt_core.base.sentences import counted
from ldt_core.lab.tuning.candidates import (
    DIGITS,
    NEVER,
    TUNED,
    DetectorSetting,
    candidate_settings,
    first_round,
    second_round,
)
from ldt_core.lab.tuning.choice import Budget, TuningChoice, best_of, choose
from ldt_core.lab.tuning.in_control import (
    LEAST_IN_CONTROL,
    Control,
    Row,
    chosen,
    control,
    judged,
    limit_of,
    parse_ranges,
    row,
)
from ldt_core.lab.tuning.trial import Job, Tried, job_key, matter_key, setting_key, try_setting
from ldt_core.machine.machine_file import Machine
from ldt_core.models import build_model
from ldt_core.models.base import Model
from ldt_core.twin.predictor import Predictor

RUNS = "runs"  # folder of what was tried, by which the folder of a tuning is known
FORMAT = "ldt-tune-1"
#: Fewer experiments than this are no recording to choose from.
LEAST_EXPERIMENTS = 10
#: Sum of the squares of the coefficients of a third difference.
THIRD_DIFFERENCE = 20.0
#: Told of progress: settings tried, settings to try as far as is known.
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Tuning:
    """What was found.

    Attributes:
        machine: as the twin knows it.
        settings: parameters of machine, model and adaptor.
        budget: stated.
        numbers: of the experiments.
        control: experiments in control; None where none are known.
        tried: every setting.
        never: the run without learning.
        choice: which setting.
        notes: what is odd about the recording, a sentence each.
        matter: by which another tuning of the same is known.
    """

    machine: Machine
    settings: Mapping[str, Any]
    budget: Budget
    numbers: tuple[int, ...]
    control: Control | None
    tried: tuple[Tried, ...]
    never: Tried
    choice: TuningChoice
    notes: tuple[str, ...]
    matter: str


def tune(
    machine: Machine,
    settings: Mapping[str, Any],
    experiments: Iterable[Experiment],
    budget: Budget,
    out: Path | str,
    *,
    in_control: str = "",
    detectors: Sequence[str] = tuple(TUNED),
    values: int = 8,
    jobs: int = 0,
    scheduler: str = "",
    source: str = "recording",
    begins: Callable[[str], None] = lambda matter: None,
    progress: Progress = lambda done, total: None,
) -> Tuning:
    """Choose a detector and its threshold.

    Args:
        machine: as the twin knows it.
        settings: all parameters; those of the detector as they are kept beside the tuned one.
        experiments: of the recording.
        budget: what is allowed.
        out: folder for what was tried, an earlier one's is used.
        in_control: numbers of the experiments in which the machine had not changed, as
            "1:20,60:80"; "" judges which they are.
        detectors: to try, each of `TUNED`.
        values: of each detector in the first round.
        jobs: processes; 0 takes one a core.
        scheduler: address of a Dask scheduler to compute on instead.
        source: what the recording is called in messages.
        begins: told of what is tuned before anything is tried, and may refuse it.
        progress: told before the first and after each setting.

    Raises:
        BadInput: a recording, options or a folder that cannot be used.
        LdtError: a run failed.
    """
    for name in detectors:
        if name not in TUNED:
            raise OptionError("detector to tune", did_you_mean(name, TUNED), repr(name))
    check_own_folder(Path(out), "tuning", lambda folder: (folder / RUNS).is_dir())
    check_writable(Path(out) / RUNS)
    wanted = parse_ranges(in_control)
    model = build_model(settings["model"], machine, settings)
    usable, rows, notes = _usable(machine, model, experiments)
    if len(usable) < LEAST_EXPERIMENTS:
        expected = f"at least {LEAST_EXPERIMENTS} experiments to choose from"
        raise RecordingError(source, expected, "; ".join([str(len(usable)), *notes]))
    numbers = tuple(e.number for e in usable)
    indices = chosen(wanted, numbers) if wanted else judged(rows)
    if not indices and budget.every is not None:
        expected = f"{LEAST_IN_CONTROL} experiments without a change, for a rate of false alarms"
        got = "no stretch of so many in which nothing changes (--in-control 1:20 says which)"
        raise OptionError("in-control", expected, got)
    known = control(usable, rows, indices, model, bool(wanted)) if indices else None
    job = Job(machine, settings, usable, known.rows if known else ())
    matter = matter_key(job)
    begins(matter)
    errors = [float(np.abs(residual).max()) for residual, _ in rows]
    first = first_round(detectors, errors, noise_reach(rows), values)
    first += _by_budget(detectors, budget, known, len(usable))
    with Workers(jobs, scheduler, code_version) as workers:
        trials = _Trials(workers, Path(out), job, progress)
        trials.try_all([NEVER, *first])
        trials.try_all(_refined(trials.tried, detectors, budget))
    tried = sorted(trials.tried.values(), key=lambda t: _order(t.setting, detectors))
    never = trials.tried[NEVER]
    choice = choose(tried, budget)
    return Tuning(
        machine, settings, budget, numbers, known, tuple(tried), never, choice, tuple(notes), matter
    )


def noise_reach(rows: Sequence[Row]) -> float:
    """Maximum error that noise alone makes in an experiment, roughly [rad/s].

    That of white noise of the median deviation which the third differences of the residuals show.
    """
    deviations = [
        math.sqrt(float(np.mean(np.diff(residual, 3) ** 2)) / THIRD_DIFFERENCE)
        for residual, _ in rows
        if residual.size > 3
    ]
    longest = max(residual.size for residual, _ in rows)
    return float(np.median(deviations or [0.0])) * math.sqrt(2 * math.log(2 * longest))


class _Trials:
    """Tries settings, each once, and keeps what came of them in `OUT/runs/JOB/SETTING.json`."""

    def __init__(self, workers: Workers, out: Path, job: Job, progress: Progress) -> None:
        self.workers, self.job, self.progress = workers, job, progress
        self.folder = ResultFolder(out / RUNS / job_key(job)[:20], FORMAT, {})
        self.tried: dict[DetectorSetting, Tried] = {}

    def try_all(self, settings: Iterable[DetectorSetting]) -> None:
        """Try what has not been tried yet, and keep what came of it."""
        # What learns most takes longest, and begins first.
        new = dict.fromkeys(s for s in settings if s not in self.tried)
        tasks = [(s, self.job) for s in sorted(new, key=lambda s: (s == NEVER, s.value))]
        before = len(self.tried)
        found = self.folder.complete(
            tasks,
            place=lambda task: setting_key(task[0]),
            parse=lambda task, plain: Tried.from_dict(plain, task[0]),
            compute=partial(self.workers.map, try_setting),
            progress=lambda done, total: self.progress(before + done, before + total),
        )
        self.tried |= {one.setting: one for one in found.values()}


def _usable(
    machine: Machine, model: Model, experiments: Iterable[Experiment]
) -> tuple[list[Experiment], list[Row], list[str]]:
    """Experiments that the loop would accept, how far off the untrained model is, and notes."""
    predictor = Predictor(machine, model)
    usable, rows, rejected = [], [], []
    for experiment in experiments:
        try:
            predictor.predict(experiment)
        except ExperimentError as error:
            rejected.append(str(error))
            continue
        usable.append(experiment)
        rows.append(row(model, experiment))
    notes = []
    if rejected:
        notes.append(f"{counted(len(rejected), 'experiment')} left out, the first: {rejected[0]}")
    return usable, rows, notes


def _by_budget(
    detectors: Sequence[str], budget: Budget, known: Control | None, experiments: int
) -> list[DetectorSetting]:
    """The settings that the budget itself suggests."""
    found = []
    if budget.adaptations is not None and "window" in detectors:
        found += candidate_settings("window", "window", [max(1, experiments // budget.adaptations)])
    if budget.every is not None:
        if "window" in detectors:
            found += candidate_settings("window", "window", [math.ceil(budget.every)])
        if "adequacy" in detectors:
            found.append(
                DetectorSetting("adequacy", "false_alarm_every", float(max(budget.every, 10)))
            )
        if "threshold" in detectors and known is not None:
            limit = limit_of(known.rows, budget.every)
            unit = 10.0 ** (math.floor(math.log10(limit)) - DIGITS + 1)  # of the last digit
            found += candidate_settings("threshold", "threshold", [math.ceil(limit / unit) * unit])
    return found


def _refined(
    tried: Mapping[DetectorSetting, Tried], detectors: Sequence[str], budget: Budget
) -> list[DetectorSetting]:
    """Round the best setting of each detector, or the nearest to the budget."""
    found = []
    for name in detectors:
        own = [t for s, t in tried.items() if s.detector == name and s.parameter == TUNED[name]]
        best = best_of([t for t in own if budget.kept(t)])
        best = best or min(own, key=lambda t: (budget.excess(t), t.mme))
        found += second_round(best.setting, tried)
    return found


def _order(setting: DetectorSetting, detectors: Sequence[str]) -> tuple[int, str, str, float]:
    known = [*detectors, setting.detector]
    value = setting.value if setting.parameter else 0.0
    return known.index(setting.detector), setting.detector, setting.parameter, value
