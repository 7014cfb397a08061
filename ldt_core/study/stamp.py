"""What a study's result was computed with: it is reusable only if this is the same."""

from __future__ import annotations

import functools

from ldt_core import stamp as general

#: What of `ldt_core.study` decides numbers after all.
DECIDING = ("study/region.py", "study/run.py", "study/stream.py")


@functools.cache
def stamp() -> dict[str, str]:
    """LDT's version, a fingerprint of its code, and the versions of its numerical libraries."""
    return general.stamp(DECIDING)
