"""What a result was computed with: it is comparable, and reusable, only with the same."""

from __future__ import annotations

import functools
import hashlib
from importlib.metadata import version
from importlib.resources import files
from importlib.resources.abc import Traversable

LIBRARIES = ("numba", "numpy", "scikit-learn", "scipy")
#: Parts of `ldt_core` that show, store or fetch numbers and decide none.
SHOWING = frozenset(
    (
        *("checks", "cli", "docs", "doctor", "recording", "security", "views"),
        *(f"lab/study/{part}" for part in ("claims", "figures", "sections", "study_page.py")),
        "lab/challenge/score/score_files.py",
    )
)
DIGITS = 12  # of a fingerprint


@functools.cache
def code_version() -> dict[str, str]:
    """LDT's version, a fingerprint of the code that decides numbers, and its libraries' versions.

    Read from the files once in a process.
    """
    digest = hashlib.sha256()
    _feed(digest, files("ldt_core"), "")
    return {"ldt": version("ldt"), "code": digest.hexdigest()[:DIGITS]} | {
        name: version(name) for name in LIBRARIES
    }


def _feed(digest: hashlib._Hash, part: Traversable, name: str) -> None:
    if name in SHOWING:
        return
    if part.is_dir():
        for inner in sorted(part.iterdir(), key=lambda p: p.name):
            _feed(digest, inner, f"{name}/{inner.name}".lstrip("/"))
    elif name.endswith(".py"):
        digest.update(f"{name}\n".encode())
        digest.update(part.read_bytes())
