"""A challenge scored: all cases answered first, the keys opened then."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ldt_core.challenge.comparators import COMPARATORS
from ldt_core.challenge.comparators.sparse_regression import installed
from ldt_core.challenge.score.answer import DIAGNOSIS, Answer, Answers
from ldt_core.challenge.score.judge import Judged, judge
from ldt_core.challenge.score.key import Truth, left_out, read_keys, sha256
from ldt_core.challenge.score.run import Task, answer, stamp
from ldt_core.challenge.score.sealed import cases, check_entries, digest
from ldt_core.challenge.score.table import Table
from ldt_core.errors import BadInput
from ldt_core.parallel import Workers

OUT_SUFFIX = ".score"


@dataclass(frozen=True)
class Score:
    """What came out.

    Attributes:
        keys: file to SHA-256.
        judged: of the diagnosis and each comparator, one for each case.
        table: all figures.
        stamp: code and libraries that gave the answers of the diagnosis.
        notes: for a person.
    """

    keys: dict[str, str]
    judged: dict[str, list[Judged]]
    table: Table
    stamp: dict[str, str]
    notes: tuple[str, ...] = ()


def score_challenge(
    folder: str | Path,
    keys: Sequence[str | Path],
    out: str | Path,
    *,
    comparators: bool = False,
    jobs: int = 0,
    scheduler: str = "",
    say: Callable[[str, str], None] = lambda file, digest: None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Score:
    """Answer every case, then open the keys.

    Of a key nothing is looked at before all answers are on disk but its bytes' SHA-256, the names
    of its cases and the effects that the diagnosis has to do without.

    Args:
        folder: of the cases.
        keys: files.
        out: folder for the answers; those that are there already are taken if case and code are
            the same.
        comparators: let them answer, too.
        jobs: processes; 0 takes one for each core.
        scheduler: address of a Dask scheduler, whose workers must see the same folder.
        say: is told each key's file and SHA-256 before anything else happens.
        progress: is told the answers that are there and how many there will be.

    Raises:
        BadInput: no cases, keys that are not theirs, a folder that cannot be written to.
    """
    sealed, out = cases(folder), Path(out)
    sums = {str(file): sha256(file) for file in keys}
    for file, known in sums.items():
        say(file, known)
    without = left_out(keys)
    check_entries(sealed, without, folder)
    if out.exists() and not out.is_dir():
        raise BadInput(out, "a folder for the answers", "a file")
    if Path(folder).resolve() in (out.resolve(), *out.resolve().parents):
        raise BadInput(out, f"a folder that is not in {folder}, with the cases", "one that is")
    who = [DIAGNOSIS, *(_able() if comparators else [])]
    answers = _answers(sealed, without, who, out, (jobs, scheduler), progress)
    truths = read_keys(keys)
    for name, truth in truths.items():
        _check(truth, answers[DIAGNOSIS, name], folder)
    judged = {w: [judge(truths[n], answers[w, n]) for n in sealed] for w in who}
    notes = []
    if comparators and len(who) <= len(COMPARATORS):
        notes.append("sparse_regression needs PySINDy, which is not installed, and is left out")
    return Score(sums, judged, Table(judged), stamp(), tuple(notes))


def _able() -> list[str]:
    return [name for name in COMPARATORS if name != "sparse_regression" or installed()]


def _answers(
    sealed: dict[str, Path],
    without: dict[str, str | None],
    who: Sequence[str],
    out: Path,
    where: tuple[int, str],
    progress: Callable[[int, int], None],
) -> dict[tuple[str, str], Answer]:
    """(who, case) to answer; those that are not on disk are made, and written as they come."""
    store = Answers(out)
    origins, found = {}, {}
    for name, folder in sealed.items():
        about = {"case": digest(folder), "left_out": without[name]}
        for w in who:
            origins[w, name] = {**stamp(w), **about}
            known = store.read(name, w, origins[w, name])
            if known is not None:
                found[w, name] = known
    tasks = []
    for group in ([DIAGNOSIS], [w for w in who if w != DIAGNOSIS]):
        for name, folder in sealed.items():
            missing = tuple(w for w in group if (w, name) not in found)
            if missing:
                tasks.append(Task(name, folder.resolve(), missing, without[name]))
    total = len(sealed) * len(who)
    progress(len(found), total)
    jobs, scheduler = where
    with Workers(jobs, scheduler, stamp) as workers:
        for task, made in workers.map(answer, tasks):
            for one in made:
                store.write(task.name, one, origins[one.who, task.name])
                found[one.who, task.name] = one
            progress(len(found), total)
    return found


def _check(truth: Truth, answer: Answer, folder: str | Path) -> None:
    """Refuse a key whose case is another one of the same name.

    Raises:
        BadInput: another machine, or a current where there is none.
    """
    where, about, seen = f"{folder}, {truth.case}", truth.about or {}, answer.seen
    physics: Any = about.get("physics")
    if physics is not None and physics != seen["physics"]:
        raise BadInput(where, f"the machine of the key, {physics}", seen["physics"])
    if "current_noise" in about and (about["current_noise"] is not None) != seen["current"]:
        said, there = "without current", "with it"
        if about["current_noise"] is not None:
            said, there = "with current", "without it"
        raise BadInput(where, f"a recording {said}, as the key says", f"one {there}")
