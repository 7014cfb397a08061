"""A challenge scored: all cases answered first, the keys opened then."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ldt_core.base.digest import file_digest
from ldt_core.base.errors import BadInput
from ldt_core.base.parallel import Workers
from ldt_core.lab.challenge.comparators import COMPARATORS
from ldt_core.lab.challenge.comparators.sparse_regression import installed
from ldt_core.lab.challenge.score.answer import DIAGNOSIS, Answers, CaseAnswer
from ldt_core.lab.challenge.score.judge import Judged, judge
from ldt_core.lab.challenge.score.key import Truth, left_out, read_keys, sha256
from ldt_core.lab.challenge.score.score_table import ScoreTable
from ldt_core.lab.challenge.score.sealed import (
    AnswerTask,
    answer,
    answer_stamp,
    cases,
    check_entries,
)

OUT_SUFFIX = ".score"
SAME_CASES = "diagnosis, same cases"  # those that comparators answered, if these are fewer


@dataclass(frozen=True)
class ChallengeScore:
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
    table: ScoreTable
    stamp: dict[str, str]
    notes: tuple[str, ...] = ()


def score_challenge(
    folder: str | Path,
    keys: Sequence[str | Path],
    out: str | Path,
    *,
    comparators: bool = False,
    subset: int = 0,
    jobs: int = 0,
    scheduler: str = "",
    say: Callable[[str, str], None] = lambda file, digest: None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> ChallengeScore:
    """Answer every case, then open the keys.

    Of a key nothing is looked at before all answers are on disk but its bytes' SHA-256, the names
    of its cases and the effects that the diagnosis has to do without.

    Args:
        folder: of the cases.
        keys: files.
        out: folder for the answers; those that are there already are taken if case and code are
            the same.
        comparators: let them answer, too.
        subset: how many cases, from the first, they answer; 0 for all.
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
    names = list(sealed)
    answering = {DIAGNOSIS: names}
    if comparators:
        answering |= dict.fromkeys(_able(), names[: subset or None])
    answers = _answers(sealed, without, answering, out, (jobs, scheduler), progress)
    truths = read_keys(keys)
    for name in names:
        _check(truths[name], answers[DIAGNOSIS, name], folder)
    judged = {
        who: [judge(truths[name], answers[who, name]) for name in those]
        for who, those in answering.items()
    }
    notes = []
    if comparators and 0 < subset < len(names):
        judged[SAME_CASES] = judged[DIAGNOSIS][:subset]
        notes.append(f"comparators answered the first {subset} of {len(names)} cases only")
    if comparators and not installed():
        notes.append("sparse_regression needs PySINDy, which is not installed, and is left out")
    return ChallengeScore(sums, judged, ScoreTable(judged), answer_stamp(), tuple(notes))


def _able() -> list[str]:
    return [name for name in COMPARATORS if name != "sparse_regression" or installed()]


def _answers(
    sealed: dict[str, Path],
    without: dict[str, str | None],
    answering: dict[str, list[str]],
    out: Path,
    where: tuple[int, str],
    progress: Callable[[int, int], None],
) -> dict[tuple[str, str], CaseAnswer]:
    """(who, case) to answer; those that are not on disk are made, and written as they come.

    Args:
        sealed: case to folder.
        without: case to the effect to do without.
        answering: who to the cases to answer.
        out: folder of the answers.
        where: processes and scheduler.
        progress: is told answers that are there, and will be.
    """
    store = Answers(out)
    origins, found = {}, {}
    for name, folder in sealed.items():
        about = {"case": file_digest(folder), "left_out": without[name]}
        for w in (w for w, those in answering.items() if name in those):
            origins[w, name] = {**answer_stamp(w), **about}
            known = store.read(name, w, origins[w, name])
            if known is not None:
                found[w, name] = known
    tasks = []
    for first in (True, False):
        for name, folder in sealed.items():
            asked = [w for w in answering if (w == DIAGNOSIS) == first and (w, name) in origins]
            missing = tuple(w for w in asked if (w, name) not in found)
            if missing:
                tasks.append(AnswerTask(name, folder.resolve(), missing, without[name]))
    total = len(origins)
    progress(len(found), total)
    jobs, scheduler = where
    # Workers of another version would answer as another version: the stamp that knows most decides.
    identity = functools.partial(answer_stamp, list(answering)[-1])
    with Workers(jobs, scheduler, identity) as workers:
        for task, made in workers.map(answer, tasks):
            for one in made:
                store.write(task.name, one, origins[one.who, task.name])
                found[one.who, task.name] = one
            progress(len(found), total)
    return found


def _check(truth: Truth, answer: CaseAnswer, folder: str | Path) -> None:
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
