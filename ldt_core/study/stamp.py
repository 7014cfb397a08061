"""What a result was computed with: it is comparable, and reusable, only if this is the same."""

from __future__ import annotations

import functools

from ldt_core.stamp import fingerprint, parts, versions

LIBRARIES = ("numba", "numpy", "scikit-learn", "scipy")
#: Parts of `ldt_core` that show, store or fetch numbers and decide none.
SHOWING = (
    *("calibration", "challenge", "cli", "doctor", "figures.py", "kept.py", "parallel.py"),
    *("recording", "report", "run_page", "session.py", "stamp.py", "study", "tuning", "words.py"),
)
#: What of `ldt_core.study` decides numbers after all.
DECIDING = ("study/region.py", "study/run.py", "study/stream.py")


@functools.cache
def stamp() -> dict[str, str]:
    """LDT's version, a fingerprint of its code, and the versions of its numerical libraries."""
    deciding = [name for name in parts() if name not in SHOWING]
    known = versions(LIBRARIES)
    return {"ldt": known.pop("ldt"), "code": fingerprint([*deciding, *DECIDING]), **known}
