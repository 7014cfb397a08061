"""The files of a diagnosis: what it found for programs, and a page for people."""

from __future__ import annotations

import json
from pathlib import Path

from ldt_core.base.result_files import write
from ldt_core.diagnosis.diagnosis import Diagnosis
from ldt_core.views.diagnosis_page import page

JSON, PAGE = "diagnosis.json", "diagnosis.html"


def as_json(diagnosis: Diagnosis) -> str:
    """The content of `diagnosis.json`."""
    return json.dumps(diagnosis.as_dict(), allow_nan=False, indent=1) + "\n"


def write_files(diagnosis: Diagnosis, folder: Path) -> None:
    """Write `diagnosis.json` and `diagnosis.html`.

    Raises:
        LdtError: matplotlib is not installed, and no page written.
    """
    write(folder / JSON, as_json(diagnosis))
    write(folder / PAGE, page(diagnosis))
