"""A whole study: what is not there yet is computed, in parallel, and kept in its folder.

`OUT/runs/KEY.json`, KEY naming the run (`StudyCase.key`), and `OUT/facts/KEY.json`, KEY naming the
stream. A file counts only if it was computed by this version of LDT and of the libraries that
decide its numbers, on the same machine file; anything else is computed anew.
"""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Callable, Collection, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ldt_core.base.code_version import code_version
from ldt_core.base.digest import json_digest
from ldt_core.base.errors import BadInput, LdtError, reason_of
from ldt_core.base.experiment import Experiment, Level, Prediction, Signal, Step
from ldt_core.base.parallel import Workers
from ldt_core.base.result_files import ResultFolder, check_own_folder, check_writable, write
from ldt_core.base.sentences import counted
from ldt_core.detectors import build_detector
from ldt_core.lab.study import GROUPS, NAMED_ONLY
from ldt_core.lab.study.facts import Facts, facts_of, stream_key
from ldt_core.lab.study.robustness.conduct import conduct_named
from ldt_core.lab.study.stream import Stream, region_rmse, stream
from ldt_core.lab.study.study import Entry, Study
from ldt_core.lab.study.study_case import RunResult, StudyCase
from ldt_core.lab.study.study_plan import Planned, StudyPlan
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import Machine, load_machine
from ldt_core.models import build_model
from ldt_core.twin.detector_stage import DetectorStage
from ldt_core.twin.loop import Twin, faultless

FORMAT = "ldt-study-1"
FILE = "study.json"
#: Folders in it of what has been computed.
PARTS = ("runs", "facts", "robustness", "alarms")
FACTS = "facts/"
#: Told of progress: results that are there, results that there will be as far as is known.
Progress = Callable[[int, int], None]
#: "run" or "facts", of which case, on which machine.
Task = tuple[str, StudyCase, Machine]


def conduct(
    plan: StudyPlan,
    out: Path | str,
    *,
    jobs: int = 0,
    scheduler: str = "",
    progress: Progress = lambda done, total: None,
) -> Study:
    """Run a study, or what is missing of it.

    Args:
        plan: what it consists of.
        out: its folder: new, empty, or of an earlier study, whose results are used where they are
            of the same runs.
        jobs: processes; 0 takes one a core.
        scheduler: address of a Dask scheduler to compute on instead.
        progress: told before the first and after each result.

    Raises:
        BadInput: a plan, machine, folder or scheduler that cannot be used.
        LdtError: a run failed.
    """
    machine = load_machine(plan.machine)
    runs = plan.runs()
    check(plan, runs, machine)
    with Workers(jobs, scheduler, code_version) as workers:
        _open(Path(out), plan)
        folder, found = study_folder(out, code_version(), machine), dict[str, Any]()
        _complete(folder, found, runs, workers, machine, progress)
        baselines = plan.baselines((p, found[_run(p.case)]) for p in runs)
        _complete(folder, found, baselines, workers, machine, progress)
        before = len(found)
        beyond = conduct_named(plan, out, workers, lambda d, t: progress(before + d, before + t))
    entries = [Entry(found[_run(p.case)], p.groups, p.beside) for p in (*runs, *baselines)]
    facts = {n.removeprefix(FACTS): f for n, f in found.items() if n.startswith(FACTS)}
    return Study(dataclasses.asdict(plan), tuple(entries), facts, _notes(folder), *beyond)


def check(plan: StudyPlan, runs: Iterable[Planned], machine: Machine) -> None:
    """Refuse a plan that would fail later.

    Raises:
        BadInput: no runs, or a model, detector or parameters that cannot be used.
    """
    for group in plan.groups:
        if group not in GROUPS:
            raise BadInput("group of a study", f"one of {', '.join(GROUPS)}", repr(group))
    cases = [p.case for p in runs]
    if not cases and not set(plan.groups) & set(NAMED_ONLY):
        raise BadInput("groups of a study", "paper or better beside baseline", plan.groups)
    for case in {stream_key(c): c for c in cases}.values():
        Plant.from_settings(machine, case.resolved)
    for case in {(c.model, c.detector): c for c in cases}.values():
        build_model(case.model, machine, case.resolved)
        build_detector(case.detector, case.resolved)


def work(task: Task) -> RunResult | Facts:
    """What a worker does.

    Raises:
        LdtError: that failed; the sentence says in which run.
    """
    kind, case, machine = task
    try:
        return facts_of(case, machine) if kind == "facts" else run_case(case, machine)
    except Exception as error:
        what = "the stream" if kind == "facts" else f"{case.model} model, {case.detector} detector"
        raise LdtError(f"{what}, seed {case.seed}: {reason_of(error)}") from error


def study_folder(out: Path | str, stamp: Mapping[str, str], machine: Machine) -> ResultFolder:
    """What a study has computed on a machine; `stamp` says by which code, see `code_version`."""
    return ResultFolder(out, FORMAT, {**stamp, "machine": json_digest(machine.as_dict())[:12]})


def _complete(
    folder: ResultFolder,
    found: dict[str, Any],
    planned: Iterable[Planned],
    workers: Workers,
    machine: Machine,
    progress: Progress,
) -> None:
    """Add these runs and the facts of their streams to what was found, by their places.

    Raises:
        LdtError: a run failed; what was computed before is kept.
    """
    tasks: dict[str, Task] = {}
    for case in [p.case for p in sorted(planned, key=lambda p: p.order)]:
        for task in (("facts", case, machine), ("run", case, machine)):
            tasks.setdefault(_place(task), task)
    before = len(found)
    found |= folder.complete(
        [task for name, task in tasks.items() if name not in found],
        _place,
        _parsed,
        compute=partial(workers.map, work),
        progress=lambda done, total: progress(before + done, before + total),
        about=lambda task: {"case": dataclasses.asdict(task[1])},
    )


def _place(task: Task) -> str:
    kind, case, _ = task
    return FACTS + stream_key(case) if kind == "facts" else _run(case)


def _run(case: StudyCase) -> str:
    return f"runs/{case.key}"


def _parsed(task: Task, plain: Mapping[str, Any]) -> RunResult | Facts:
    kind, case, _ = task
    return Facts.from_dict(plain) if kind == "facts" else RunResult.from_dict(case, plain)


def _notes(folder: ResultFolder) -> tuple[str, ...]:
    """What in the folder is not as it should be, a sentence each."""
    notes = []
    if folder.damaged:
        notes.append(
            f"{counted(len(folder.damaged), 'result')} could not be read and were computed "
            f"again, the first being {folder.damaged[0]}"
        )
    if folder.foreign:
        notes.append(
            f"{counted(folder.foreign, 'result')} came from another version of LDT, of its "
            "libraries or of the machine file and were computed again"
        )
    return tuple(notes)


def _open(out: Path, plan: StudyPlan) -> None:
    """Make the folder of a study, or refuse one that is something else's."""
    check_own_folder(out, "study", _is_study)
    for kind in PARTS:
        check_writable(out / kind)
    out.mkdir(parents=True, exist_ok=True)
    record = {"format": FORMAT, "plan": dataclasses.asdict(plan)}
    write(out / FILE, json.dumps(record, indent=1))


def _is_study(out: Path) -> bool:
    try:
        record: Any = json.loads((out / FILE).read_text(encoding="utf-8"))
        return record["format"] == FORMAT and "groups" in record["plan"]
    except (OSError, ValueError, KeyError, TypeError):
        return False


DIGITS = 4  # of the series kept for a figure, which shows 0.1 mrad/s at the very best


class Scripted(DetectorStage):
    """Stage 2 by a list: positive in these experiments and negative in all others.

    Args:
        name: in the signal.
        alarms: numbers of experiments.
    """

    def __init__(self, name: str, alarms: Collection[int]) -> None:
        self.name = name
        self.alarms = frozenset(alarms)

    def step(self, experiment: Experiment, prediction: Prediction) -> Signal:
        """The signal for one experiment; only its number is looked at."""
        level = Level.POSITIVE if experiment.number in self.alarms else Level.NEGATIVE
        error = prediction.max_error(experiment)
        return Signal(experiment.number, level, self.name, prediction.model_version, error)


def run_case(case: StudyCase, machine: Machine | None = None) -> RunResult:
    """Take the stream of a case through a twin.

    Args:
        case: what to run.
        machine: that of the case, for a process that may not have the file.

    Raises:
        BadInput: a machine, model, detector or parameters that cannot be used.
    """
    machine = machine or load_machine(case.machine)
    given = stream(case, machine)
    detector = None if case.alarms is None else Scripted(case.detector, case.alarms)
    begin = time.thread_time()
    twin = Twin.from_settings(machine, case.resolved, detector)
    steps = list(faultless(twin.steps(given.experiments, _refuse)))
    return _result(case, given, steps, time.thread_time() - begin)


def _refuse(error: LdtError) -> None:
    raise error


def _result(case: StudyCase, given: Stream, steps: list[Step], seconds: float) -> RunResult:
    learning = [s.prediction.residual(s.experiment) for s in steps]
    original = [s.original.residual(s.experiment) for s in steps]
    return RunResult(
        case=case,
        number=[s.experiment.number for s in steps],
        truth=list(given.truth),
        max_error=[s.signal.max_error for s in steps],
        original=[s.original.max_error(s.experiment) for s in steps],
        level=[int(s.signal.level) for s in steps],
        action=[str(s.adaptation.action) for s in steps],
        region_rmse=[region_rmse(r, m) for r, m in zip(learning, given.region, strict=True)],
        region_rmse_original=[
            region_rmse(r, m) for r, m in zip(original, given.region, strict=True)
        ],
        kept={s.experiment.number: _series(s) for s in steps if s.experiment.number in case.keep},
        seconds=round(seconds, 3),
    )


def _series(step: Step) -> dict[str, list[float]]:
    rows = {
        "time": step.experiment.time,
        "voltage": step.experiment.voltage,
        "speed": step.experiment.speed,
        "prediction": step.prediction.speed,
        "original": step.original.speed,
    }
    return {n: np.round(row, DIGITS).tolist() for n, row in rows.items()}
