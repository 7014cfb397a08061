"""A whole study: what is not there yet is computed, in parallel, and all of it put together."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from ldt_core.base.code_version import code_version
from ldt_core.base.errors import BadInput, LdtError
from ldt_core.base.parallel import Workers
from ldt_core.base.result_files import write
from ldt_core.detectors import build_detector
from ldt_core.lab.study import GROUPS
from ldt_core.lab.study.facts import Facts, facts_of, stream_key
from ldt_core.lab.study.run_case import run_case
from ldt_core.lab.study.study import Entry, Study
from ldt_core.lab.study.study_case import RunResult, StudyCase
from ldt_core.lab.study.study_plan import Planned, StudyPlan
from ldt_core.lab.study.study_store import FORMAT, StudyStore
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import Machine, load_machine
from ldt_core.models import build_model

FILE = "study.json"
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
    fresh: bool = False,
    progress: Progress = lambda done, total: None,
) -> Study:
    """Run a study, or what is missing of it.

    Args:
        plan: what it consists of.
        out: its folder: new, empty, or of an earlier study, whose results are used where they are
            of the same runs.
        jobs: processes; 0 takes one a core.
        scheduler: address of a Dask scheduler to compute on instead.
        fresh: compute everything anew.
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
        store = StudyStore(out, code_version(), machine, fresh=fresh)
        _complete(store, runs, workers, machine, progress)
        baselines = plan.baselines((p, store.results[p.case.key]) for p in runs)
        _complete(store, baselines, workers, machine, progress)
    return _study(plan, [*runs, *baselines], store)


def load_study(out: Path | str) -> Study:
    """The study in a folder as far as it has got; nothing is computed.

    Raises:
        BadInput: the folder is not a study's.
    """
    plan = _read(Path(out))
    if plan is None:
        raise BadInput(out, f"the folder of a study, with {FILE}", "none")
    store = StudyStore(out, code_version(), load_machine(plan.machine), any_origin=True)
    runs = plan.runs()
    store.recall(_ordered(runs))
    there = [p for p in runs if p.case.key in store.results]
    baselines = plan.baselines((p, store.results[p.case.key]) for p in there)
    store.recall(_ordered(baselines))
    return _study(plan, [*runs, *baselines], store)


def check(plan: StudyPlan, runs: Iterable[Planned], machine: Machine) -> None:
    """Refuse a plan that would fail later.

    Raises:
        BadInput: no runs, or a model, detector or parameters that cannot be used.
    """
    for group in plan.groups:
        if group not in GROUPS:
            raise BadInput("group of a study", f"one of {', '.join(GROUPS)}", repr(group))
    cases = [p.case for p in runs]
    if not cases:
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
        reason = str(error) if isinstance(error, LdtError) else f"{type(error).__name__}: {error}"
        raise LdtError(f"{what}, seed {case.seed}: {reason}") from error


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
    there = [p for p in planned if p.case.key in store.results]
    entries = tuple(Entry(store.results[p.case.key], p.groups, p.beside) for p in there)
    missing = len(planned) - len(there)
    return Study(dataclasses.asdict(plan), entries, store.facts, missing, tuple(store.notes))


def _open(out: Path, plan: StudyPlan) -> None:
    """Make the folder of a study, or refuse one that is something else's."""
    expected = "a new folder, or that of an earlier study"
    if out.exists() and not out.is_dir():
        raise BadInput(out, expected, "a file")
    if out.exists() and any(out.iterdir()) and _read(out) is None:
        raise BadInput(out, expected, "a folder with other files")
    out.mkdir(parents=True, exist_ok=True)
    record = {"format": FORMAT, "plan": dataclasses.asdict(plan)}
    write(out / FILE, json.dumps(record, indent=1))


def _read(out: Path) -> StudyPlan | None:
    """The plan of the study in a folder; None when it is not a study's."""
    try:
        record: Any = json.loads((out / FILE).read_text(encoding="utf-8"))
        if record["format"] != FORMAT:
            return None
        given = record["plan"]
        return StudyPlan(**{**given, "groups": tuple(given["groups"])})
    except (OSError, ValueError, KeyError, TypeError):
        return None
