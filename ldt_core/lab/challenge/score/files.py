"""What a score leaves in its folder: numbers, words, pictures."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from ldt_core.base.result_files import write
from ldt_core.lab.challenge.score.answer import DIAGNOSIS
from ldt_core.lab.challenge.score.judge import Judged
from ldt_core.lab.challenge.score.markdown import markdown
from ldt_core.lab.challenge.score.pictures import write_pictures
from ldt_core.lab.challenge.score.score import SAME_CASES, Score


def write_files(score: Score, folder: str | Path) -> list[Path]:
    """Write score.json, score.md and the pictures.

    Returns:
        the files that a person looks at.

    Raises:
        LdtError: matplotlib is not installed.
    """
    out = Path(folder)
    write(out / "score.json", json.dumps(as_dict(score), allow_nan=False, indent=1) + "\n")
    pictures = write_pictures(score.judged[DIAGNOSIS], out)
    write(out / "score.md", markdown(score, pictures))
    return [out / "score.md", out / "score.json", *(out / name for name in pictures)]


def as_dict(score: Score) -> dict[str, Any]:
    """The content of `score.json`."""
    return {
        "keys": [{"file": file, "sha256": digest} for file, digest in score.keys.items()],
        "stamp": dict(score.stamp),
        "notes": list(score.notes),
        "figures": [row.as_dict() for row in score.table.rows],
        "cases": [
            {"who": who, **_case(j)}
            for who, judged in score.judged.items()
            if who != SAME_CASES
            for j in judged
        ],
    }


def _case(j: Judged) -> dict[str, Any]:
    truth, answer = j.truth, j.answer
    return {
        "case": truth.case,
        "kind": truth.kind,
        "effects": list(truth.effects),
        "outside": truth.outside,
        "signal_to_noise": truth.signal_to_noise,
        "verdict": answer.kind,
        "acting": answer.acting,
        "outcome": j.outcome,
        "right": j.right,
        "amounts": [vars(a) | {"covered": a.covered and list(a.covered)} for a in j.amounts],
        "place_right": j.place,
        "closure": {
            name: {"promised": promised, "realised": real if math.isfinite(real) else None}
            for name, (promised, real) in j.closure.items()
        },
        "seconds": answer.seconds,
        "error": answer.error,
    }
