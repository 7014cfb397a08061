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


class StudyStore:
    """What of a study has been computed, in memory and in its folder.

    Args:
        out: folder of the study.
        stamp: what computes now, see `code_version`.
        machine: on which it computes.
    """

    def __init__(self, out: Path | str, stamp: Mapping[str, str], machine: Machine) -> None:
        origin = {**stamp, "machine": json_digest(machine.as_dict())[:12]}
        self.folder = ResultFolder(out, FORMAT, origin)
        self.results: dict[str, RunResult] = {}
        self.facts: dict[str, Facts] = {}

    def result(self, case: StudyCase) -> RunResult | None:
        """The result of a case; None when it has to be computed."""
        return self.folder.read(f"runs/{case.key}", lambda p: RunResult.from_dict(case, p))

    def recall(self, cases: Iterable[StudyCase]) -> list[tuple[str, StudyCase]]:
        """Take what is there of these runs and their streams; the rest is returned, in order."""
        missing, streams = [], set(self.facts)
        for case in cases:
            if (key := stream_key(case)) not in streams:
                streams.add(key)
                facts = self.folder.read(f"facts/{key}", Facts.from_dict)
                if facts is not None:
                    self.facts[key] = facts
                else:
                    missing.append(("facts", case))
            if (result := self.result(case)) is not None:
                self.results[case.key] = result
            else:
                missing.append(("run", case))
        return missing

    def keep(self, case: StudyCase, answer: RunResult | Facts) -> None:
        """Write down what was computed; a reader sees all of it or nothing."""
        about = {"case": dataclasses.asdict(case)}
        if isinstance(answer, Facts):
            key = stream_key(case)
            self.facts[key] = answer
            self.folder.write(f"facts/{key}", answer.to_dict(), about)
        else:
            self.results[case.key] = answer
            self.folder.write(f"runs/{case.key}", answer.to_dict(), about)

    @property
    def notes(self) -> list[str]:
        """What in the folder is not as it should be, a sentence each."""
        notes, folder = [], self.folder
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
        return notes


FILE = "study.json"
#: Folders in it of what has been computed.
PARTS = ("runs", "facts", "robustness", "alarms")
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
        store = StudyStore(out, code_version(), machine)
        _complete(store, runs, workers, machine, progress)
        baselines = plan.baselines((p, store.results[p.case.key]) for p in runs)
        _complete(store, baselines, workers, machine, progress)
        before = len(store.results) + len(store.facts)
        beyond = conduct_named(plan, out, workers, lambda d, t: progress(before + d, before + t))
    study = _study(plan, [*runs, *baselines], store)
    return dataclasses.replace(study, robust=beyond.robust, alarms=beyond.alarms)


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


def _complete(
    store: StudyStore,
    planned: Iterable[Planned],
    workers: Workers,
    machine: Machine,
    progress: Progress,
) -> None:
    """Compute what the store lacks of these runs, and keep each result as it comes.

    Raises:
        LdtError: a run failed; what was computed before is kept.
    """
    tasks: list[Task] = [(kind, case, machine) for kind, case in store.recall(_ordered(planned))]
    before = len(store.results) + len(store.facts)
    total = before + len(tasks)
    progress(before, total)
    for count, (task, answer) in enumerate(workers.map(work, tasks), start=1):
        store.keep(task[1], answer)
        progress(before + count, total)


def _ordered(planned: Iterable[Planned]) -> list[StudyCase]:
    return [p.case for p in sorted(planned, key=lambda p: p.order)]


def _study(plan: StudyPlan, planned: list[Planned], store: StudyStore) -> Study:
    entries = tuple(Entry(store.results[p.case.key], p.groups, p.beside) for p in planned)
    return Study(dataclasses.asdict(plan), entries, store.facts, tuple(store.notes))


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
