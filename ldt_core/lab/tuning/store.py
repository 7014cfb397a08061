"""What was tried, in a folder, so that tuning goes on where it was interrupted.

`OUT/runs/KEY.json`, KEY naming all that decides the numbers: recording, machine, settings, and the
version of LDT and of its libraries. Nothing is unpickled: the files are JSON.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from ldt_core.base.code_version import code_version
from ldt_core.base.errors import BadInput
from ldt_core.base.result_files import write
from ldt_core.lab.tuning.candidates import Setting
from ldt_core.lab.tuning.trial import Job, Tried

RUNS = "runs"
FORMAT = "ldt-tune-1"


class Store:
    """The runs in the folder of a tuning.

    Args:
        out: the folder: new, empty, or of an earlier tuning.
        job: what the runs have in common.
        fresh: do not use what is there.

    Raises:
        BadInput: a folder of something else.
    """

    def __init__(self, out: Path | str, job: Job, fresh: bool = False) -> None:
        self.out, self.fresh = Path(out), fresh
        check_folder(self.out)
        (self.out / RUNS).mkdir(parents=True, exist_ok=True)
        self.job_key = _job_key(job)

    def recall(self, setting: Setting) -> Tried | None:
        """What is known of a setting; None when it has to be tried."""
        if self.fresh:
            return None
        try:
            record = json.loads(self._path(setting).read_text(encoding="utf-8"))
            if record["format"] != FORMAT:
                return None
            return Tried.from_dict(record["content"], setting)
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            return None

    def keep(self, tried: Tried) -> None:
        """Write down what came of a setting; a reader sees all of it or nothing."""
        record = {"format": FORMAT, "content": tried.as_dict()}
        write(self._path(tried.setting), json.dumps(record, separators=(",", ":")))

    def _path(self, setting: Setting) -> Path:
        text = json.dumps([self.job_key, setting.settings, _code(setting.detector)])
        return self.out / RUNS / f"{hashlib.sha256(text.encode()).hexdigest()[:20]}.json"


def check_folder(out: Path) -> None:
    """Refuse a folder that is something else's.

    Raises:
        BadInput: it is.
    """
    expected = "a new folder, or that of an earlier tuning"
    if out.exists() and not out.is_dir():
        raise BadInput(out, expected, "a file")
    if out.exists() and any(out.iterdir()) and not (out / RUNS).is_dir():
        raise BadInput(out, expected, "a folder with other files")


def _job_key(job: Job) -> str:
    plain: Any = [FORMAT, code_version(), job.machine.as_dict(), dict(job.settings)]
    digest = hashlib.sha256(json.dumps(plain, sort_keys=True).encode())
    digest.update(_code(job.settings["model"]).encode())
    rows = [(e.voltage, e.speed, e.current, [e.number, e.period]) for e in job.experiments]
    for row in [*rows, *job.rows]:
        for samples in row:
            digest.update(b"|" if samples is None else np.asarray(samples, np.float64).tobytes())
    return digest.hexdigest()


def _code(name: str) -> str:
    """The text of a user's own part, `file.py:Name`; "" of what is installed."""
    path = Path(name.rpartition(":")[0])
    return path.read_text(encoding="utf-8") if path.suffix == ".py" and path.is_file() else ""
