"""Many recordings, each diagnosed by itself: in processes here, or on a Dask cluster.

Each has a folder of its own with `diagnosis.json` and `diagnosis.html`, as `ldt diagnose` writes
them for one, and `diagnosis.run.json`, which says of what and by which code. What is there already
and would come out the same again is not computed again.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from ldt_core.base.code_version import code_version
from ldt_core.base.digest import file_digest, json_digest
from ldt_core.base.errors import BadInput, LdtError, reason_of
from ldt_core.base.parallel import Workers
from ldt_core.base.result_files import keep, recall
from ldt_core.base.settings import HOLDOUT
from ldt_core.machine.machine_file import Machine
from ldt_core.views.diagnosis_page.diagnosis_page import JSON, PAGE, as_json

FORMAT = "ldt-each-1"
#: File that says of what and by which code a diagnosis was made.
ORIGIN = "diagnosis.run.json"
#: Exit code of what should not have happened.
CRASHED = 1


@dataclass(frozen=True)
class Options:
    """How to diagnose, as `diagnose` and `library` take it."""

    namespace: str = ""
    more: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    refit: tuple[str, ...] | None = None
    holdout: float = HOLDOUT
    seed: int = 0
    only: str = ""


@dataclass(frozen=True)
class RecordingTask:
    """One recording to diagnose."""

    name: str
    recording: str
    machine: Machine
    options: Options


@dataclass(frozen=True)
class RecordingAnswer:
    """What came out for one recording.

    Attributes:
        found: the keys of `diagnosis.json`; None of a failure.
        exit_code: 0, or that of the error.
    """

    recording: str
    folder: Path
    found: Mapping[str, Any] | None
    notes: tuple[str, ...] = ()
    error: str = ""
    exit_code: int = 0


@dataclass(frozen=True)
class DiagnosisTexts:
    """What a worker gives back: texts of the files, or an error."""

    text: str = ""
    page: str = ""
    notes: tuple[str, ...] = field(default=())
    error: str = ""
    exit_code: int = 0


def diagnose_each(
    recordings: Sequence[str],
    machine: Machine,
    out: str | Path,
    options: Options,
    *,
    jobs: int = 0,
    scheduler: str = "",
    say: Callable[[RecordingAnswer], None] = lambda answer: None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[RecordingAnswer]:
    """Diagnose every recording by itself; one that fails does not stop the others.

    Args:
        scheduler: address of a Dask scheduler, whose workers must see the same recordings.

    Returns:
        Their answers, in the order of the recordings.

    Raises:
        BadInput: two recordings of one name, or no such scheduler.
    """
    options = _absolute(options)
    found: dict[str, RecordingAnswer] = {}
    origins, tasks = {}, []
    names = folders(recordings)
    for recording, name in zip(recordings, names, strict=True):
        folder = Path(out) / name
        origins[name] = _origin(recording, machine, options)
        kept = recall(folder / ORIGIN, folder / JSON, FORMAT, origins[name])
        if kept is not None and (folder / PAGE).exists():
            found[name] = RecordingAnswer(recording, folder, json.loads(kept.text))
        else:
            tasks.append(RecordingTask(name, os.path.abspath(recording), machine, options))
    named = dict(zip(names, recordings, strict=True))
    progress(len(found), len(names))
    with Workers(jobs, scheduler, code_version) as workers:
        for task, made in workers.map(diagnose_one, tasks):
            folder = Path(out) / task.name
            _keep(folder, made, origins[task.name])
            known = json.loads(made.text) if made.text else None
            about = (made.notes, made.error, made.exit_code)
            found[task.name] = RecordingAnswer(named[task.name], folder, known, *about)
            say(found[task.name])
            progress(len(found), len(names))
    return [found[name] for name in names]


def diagnose_one(task: RecordingTask) -> DiagnosisTexts:
    """What a worker does; a failure is an answer, too."""
    try:
        return _diagnosed(task)
    except LdtError as error:
        return DiagnosisTexts(error=reason_of(error), exit_code=error.exit_code)
    except OSError as error:
        why = f"{error.filename or task.recording}: {error.strerror or error}"
        return DiagnosisTexts(error=why, exit_code=CRASHED)
    except Exception as error:  # a crash is no reason to lose the others
        why = f"{task.recording}: the diagnosis failed, {reason_of(error)}"
        return DiagnosisTexts(error=why, exit_code=CRASHED)


def _diagnosed(task: RecordingTask) -> DiagnosisTexts:
    from ldt_core.diagnosis.diagnose import diagnose
    from ldt_core.diagnosis.library import library
    from ldt_core.recording.bag import read_bag
    from ldt_core.recording.held_samples import HeldSamples
    from ldt_core.views.diagnosis_page.diagnosis_page import page

    options, machine = task.options, task.machine
    effects = library(machine, options.more, options.without)
    bag = read_bag(task.recording, options.namespace, only=options.only)
    found = diagnose(
        machine,
        list(HeldSamples().of(bag, machine)),
        recordings=[task.recording],
        effects=effects,
        refit=options.refit,
        holdout=options.holdout,
        seed=options.seed,
        workers=1,
    )
    return DiagnosisTexts(as_json(found), page(found), tuple(bag.notes))


def folders(recordings: Sequence[str]) -> list[str]:
    """A name for each recording's folder: its own, or its path where several are called the same.

    Raises:
        BadInput: two that have one name all the same, such as one recording given twice.
    """
    places = [Path(os.path.abspath(r)) for r in recordings]
    bare = [p.with_suffix("") if p.suffix == ".mcap" else p for p in places]
    names = [p.name for p in bare]
    if len(set(names)) < len(names):
        common = os.path.commonpath([p.parent for p in bare])
        names = [p.relative_to(common).as_posix() for p in bare]
    for name in names:
        if names.count(name) > 1:
            raise BadInput("RECORDINGS", "recordings of different names", f"{name} twice")
    return names


def _absolute(options: Options) -> Options:
    """The options with the paths of the user's effects as any process sees them."""
    more = []
    for text in options.more:
        file, colon, name = text.rpartition(":")
        more.append(f"{os.path.abspath(file)}:{name}" if colon and Path(file).exists() else text)
    return Options(**{**asdict(options), "more": tuple(more)})


def _origin(recording: str, machine: Machine, options: Options) -> dict[str, Any]:
    """What decides the answer, as JSON gives it back."""
    files = [text.rpartition(":")[0] for text in options.more if ":" in text]
    about = {
        **code_version(),
        "recording": os.path.abspath(recording),
        "content": [file_digest(Path(p)) for p in (recording, *files)],
        "machine": json_digest(machine.as_dict()),
        "options": asdict(options),
    }
    return dict(json.loads(json.dumps(about)))


def _keep(folder: Path, made: DiagnosisTexts, origin: Mapping[str, Any]) -> None:
    """Write the files; of a failure, leave none that would be taken for its answer."""
    if made.error:
        for name in (ORIGIN, JSON, PAGE):
            (folder / name).unlink(missing_ok=True)
        return
    page = {folder / PAGE: made.page}
    keep(folder / ORIGIN, folder / JSON, made.text, FORMAT, origin, beside=page)
