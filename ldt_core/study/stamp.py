"""What a result was computed with: it is comparable, and reusable, only if this is the same."""

from __future__ import annotations

import functools
import hashlib
from importlib.metadata import version
from importlib.resources import files
from importlib.resources.abc import Traversable

LIBRARIES = ("numba", "numpy", "scikit-learn", "scipy")
#: Parts of `ldt_core` that show, store or fetch numbers and decide none.
SHOWING = (
    *("calibration", "cli", "figures.py", "parallel.py", "recording", "session.py"),
    *("report", "study", "tuning"),
)
#: What of `ldt_core.study` decides numbers after all.
DECIDING = ("region.py", "run.py", "stream.py")


@functools.cache
def stamp() -> dict[str, str]:
    """LDT's version, a fingerprint of its code, and the versions of its numerical libraries."""
    core = files("ldt_core")
    digest = hashlib.sha256()
    for part in sorted(core.iterdir(), key=lambda p: p.name):
        if part.name not in SHOWING:
            _feed(digest, part, part.name)
    for name in DECIDING:
        _feed(digest, core / "study" / name, f"study/{name}")
    return {
        "ldt": version("ldt"),
        "code": digest.hexdigest()[:12],
        **{name: version(name) for name in LIBRARIES},
    }


def _feed(digest: hashlib._Hash, part: Traversable, name: str) -> None:
    if part.is_dir():
        for inner in sorted(part.iterdir(), key=lambda p: p.name):
            _feed(digest, inner, f"{name}/{inner.name}")
    elif name.endswith(".py"):
        digest.update(f"{name}\n".encode())
        digest.update(part.read_bytes())
