"""Fingerprints of parts of the code: a result is comparable, and reusable, only with the same."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from importlib.metadata import version
from importlib.resources import files
from importlib.resources.abc import Traversable

LIBRARIES = ("numba", "numpy", "scikit-learn", "scipy")
#: Parts of `ldt_core` that show, store or fetch numbers and decide none.
SHOWING = (
    *("calibration", "challenge", "cli", "doctor", "figures.py", "kept.py", "parallel.py"),
    *("docs", "recording", "report", "run_page", "security", "session.py", "stamp.py", "study"),
    *("tuning", "watch", "words.py"),
)
DIGITS = 12  # of a fingerprint


def parts() -> list[str]:
    """Names of all that `ldt_core` consists of, modules and packages."""
    return sorted(p.name for p in files("ldt_core").iterdir())


def fingerprint(names: Iterable[str], but: Iterable[str] = ()) -> str:
    """Of the Python code of some parts.

    Args:
        names: of modules (`errors.py`) and packages in `ldt_core`.
        but: of what in them does not count (`diagnosis/page`).
    """
    digest, left_out = hashlib.sha256(), frozenset(but)
    for name in names:
        _feed(digest, files("ldt_core").joinpath(name), name, left_out)
    return digest.hexdigest()[:DIGITS]


def stamp(also: Iterable[str] = ()) -> dict[str, str]:
    """LDT's version, a fingerprint of the code that decides numbers, and its libraries' versions.

    Args:
        also: further files of `ldt_core` that decide numbers.
    """
    deciding = [name for name in parts() if name not in SHOWING]
    known = versions()
    return {"ldt": known.pop("ldt"), "code": fingerprint([*deciding, *also]), **known}


def versions() -> dict[str, str]:
    """Versions of LDT and of these libraries."""
    return {name: version(name) for name in ("ldt", *LIBRARIES)}


def _feed(digest: hashlib._Hash, part: Traversable, name: str, but: frozenset[str]) -> None:
    if name in but:
        return
    if part.is_dir():
        for inner in sorted(part.iterdir(), key=lambda p: p.name):
            _feed(digest, inner, f"{name}/{inner.name}", but)
    elif name.endswith(".py"):
        digest.update(f"{name}\n".encode())
        digest.update(part.read_bytes())
