"""SHA-256 digests by which contents are told apart: they show damage, not who wrote."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any


def json_digest(content: Any) -> str:
    """Of a content's canonical JSON, the same wherever the content is.

    Canonical: names sorted, no blanks, ASCII, the shortest digits that give a float back.

    Raises:
        TypeError, ValueError: a content that is not in JSON types, or a number that is not finite.
    """
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode("ascii")).hexdigest()


def file_digest(place: Path) -> str:
    """Of all bytes of a file, or of the files in a folder, and of their names.

    Where there is nothing, it is that of nothing.
    """
    total = hashlib.sha256()
    files = {place.name: place} if place.is_file() else _files(place)
    for name, file in files.items():
        total.update(f"{name}\n".encode())
        with file.open("rb") as stream:
            total.update(hashlib.file_digest(stream, "sha256").digest())
    return total.hexdigest()


def _files(folder: Path) -> dict[str, Path]:
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    return {file.relative_to(folder).as_posix(): file for file in files}
