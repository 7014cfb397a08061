"""Results kept in files: whole or not at all, and used again only where the same would come out.

Beside a result lies a record in JSON that says of what format and origin the result is, and by its
SHA-256 that it is this one. Nothing is unpickled.
"""

from __future__ import annotations

import contextlib
import csv
import functools
import hashlib
import io
import json
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeVar

from ldt_core.base.errors import BadInput, OptionError
from ldt_core.base.sentences import listed


class _Storable(Protocol):
    def to_dict(self) -> dict[str, Any]: ...


Task = TypeVar("Task")
Answer = TypeVar("Answer", bound=_Storable)
Parsed = TypeVar("Parsed")

OWN = ("format", "origin", "found")  # keys of a record that are ours; the rest is its writer's


class StoredResult(NamedTuple):
    """A result, and what its writer noted beside it."""

    text: str
    about: dict[str, Any]


def check_target(file: str | Path, option: str = "--out", endings: Sequence[str] = ()) -> None:
    """Refuse a file that cannot be made, before any work is done.

    Raises:
        OptionError: it is a folder or a device, has another ending, or is in no folder that can be
            written to.
    """
    path = Path(file)
    if path.is_dir():
        raise OptionError(option, "a file", f"the folder {path}")
    if path.exists() and not path.is_file():  # a device would be replaced, not written to
        raise OptionError(option, "a file", f"{path}, a device or a pipe")
    if endings and path.suffix.lower() not in endings:
        raise OptionError(option, f"a file ending in {listed(endings, 'or')}", str(path))
    if not path.parent.is_dir():
        raise OptionError(option, "a file in a folder that exists", str(path))
    check_writable(path.parent, option)


def check_writable(folder: str | Path, option: str = "--out") -> None:
    """Refuse a folder in which nothing can be made, before any work is done.

    Args:
        folder: that need not exist yet; then it is about the one in which it would be made.

    Raises:
        OptionError: nothing can, with the system's reason.
    """
    path = Path(folder).absolute()
    place = next(p for p in (path, *path.parents) if p.exists())
    try:
        # To ask for permissions does not tell: a medium may be read-only, and root may do all.
        tempfile.TemporaryFile(dir=place).close()
    except OSError as error:
        expected = "a folder that can be written to"
        raise OptionError(option, expected, f"{place} ({error.strerror})") from None


def write(path: Path, text: str, sync: bool = False) -> None:
    """Write a file as a whole: a reader, or an interruption, never meets half of it.

    Args:
        path: of the file, in a folder that exists.
        text: of it; what is no UTF-8, as part of a file's name may be, is written by its code.
        sync: have it on the medium first, so that a power cut does not leave an empty file either.

    Raises:
        OSError: it cannot be written; what was there before is there still.
    """
    with whole(path) as part, part.open("w", encoding="utf-8", errors="backslashreplace") as stream:
        stream.write(text)
        if sync:
            stream.flush()
            os.fsync(stream.fileno())


@contextlib.contextmanager
def whole(path: Path, ending: str = "") -> Iterator[Path]:
    """A file to write in the place of another, which it becomes when all is written.

    Args:
        path: of the file, in a folder that exists.
        ending: that the file to write must have for who writes it.

    Raises:
        OSError: it cannot be written, with the path, which the system leaves out of a full disk.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}.part{ending}")
    try:
        yield part
        part.replace(path)
    except OSError as error:
        error.filename = error.filename or str(path)
        raise
    finally:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)


def check_own_folder(out: Path, of: str, is_own: Callable[[Path], bool]) -> None:
    """Refuse a folder that is something else's.

    Args:
        of: whose folder it may be, "study".
        is_own: whether a folder with files in it is one.

    Raises:
        BadInput: it is a file, or has other files in it.
    """
    expected = f"a new folder, or that of an earlier {of}"
    if out.exists() and not out.is_dir():
        raise BadInput(out, expected, "a file")
    if out.exists() and any(out.iterdir()) and not is_own(out):
        raise BadInput(out, expected, "a folder with other files")


def csv_text(rows: Sequence[Mapping[str, Any]], columns: Sequence[str] = ()) -> str:
    """A table with a head; without columns, those of its first row."""
    text = io.StringIO()
    writer = csv.DictWriter(text, columns or list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def keep(
    record: Path,
    found: Path,
    text: str,
    format: str,
    origin: Mapping[str, Any],
    about: Mapping[str, Any] | None = None,
    beside: Mapping[Path, str] | None = None,
) -> None:
    """Write a result and its record; their folder is made if need be.

    Args:
        record: file of the record.
        found: file of the result.
        text: the result.
        format: of the record.
        origin: all that decides the result, in JSON types.
        about: what else to note.
        beside: further files of the result, and their texts.
    """
    known = {"format": format, "origin": dict(origin), "found": _sha256(text.encode())}
    # Last what makes a result of the others: after an interruption there is none.
    files = {found: text, **(beside or {})}
    files[record] = json.dumps({**known, **(about or {})}, allow_nan=False, indent=1) + "\n"
    for file, content in files.items():
        file.parent.mkdir(parents=True, exist_ok=True)
        write(file, content)


def recall(
    record: Path, found: Path, format: str, origin: Mapping[str, Any]
) -> StoredResult | None:
    """A result of this format and origin; None if there is none that can be used."""
    try:
        about = json.loads(record.read_text(encoding="utf-8"))
        data = found.read_bytes()
        if [about.pop(key) for key in OWN] != [format, dict(origin), _sha256(data)]:
            return None
        return StoredResult(data.decode(), about)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None


class ResultFolder:
    """Results of one kind of work in a folder, each by itself a JSON file, to go on from.

    Args:
        out: the folder.
        format: of the files.
        origin: all that decides the results and is not in their names, in JSON types.
    """

    def __init__(
        self,
        out: Path | str,
        format: str,
        origin: Mapping[str, Any],
    ) -> None:
        self.out, self.format, self.origin = Path(out), format, dict(origin)
        #: Results met that came from elsewhere, and files met that cannot be read.
        self.foreign, self.damaged = 0, list[str]()

    def read(self, name: str, parse: Callable[[Any], Parsed]) -> Parsed | None:
        """A result by its name, such as "runs/KEY"; None if there is none that can be used.

        Args:
            name: of the file, without its ending.
            parse: makes the result from its content; may raise what a wrong content raises.
        """
        path = self._path(name)
        try:
            record = json.loads(path.read_text(encoding="utf-8"))
            if (record["format"], record["key"]) != (self.format, path.stem):
                raise ValueError("another file's content")
            foreign = record["origin"] != self.origin
            found = None if foreign else parse(record["content"])
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
            self.damaged.append(str(path))
            return None
        self.foreign += foreign
        return found

    def write(self, name: str, content: Any, about: Mapping[str, Any] | None = None) -> None:
        """Keep a result, with what else is to be noted; a reader sees all of it or nothing."""
        path = self._path(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        record = {"format": self.format, "key": path.stem, "origin": self.origin}
        record |= {**(about or {}), "content": content}
        write(path, json.dumps(record, separators=(",", ":"), allow_nan=False))

    def complete(
        self,
        tasks: Sequence[Task],
        place: Callable[[Task], str],
        parse: Callable[[Task, Any], Answer],
        compute: Callable[[list[Task]], Iterable[tuple[Task, Answer]]],
        progress: Callable[[int, int], None],
        about: Callable[[Task], Mapping[str, Any]] = lambda task: {},
    ) -> dict[str, Answer]:
        """Every result by its name; what is not there is computed, and kept as it comes.

        Args:
            tasks: whose results are asked for.
            place: the name of a task's result, no other one's.
            parse: as in `read`.
            compute: answers tasks, in any order.
            progress: told how many results are there and will be, first and after each.
            about: what is to be noted of a task.
        """
        found = {}
        for task in tasks:
            known = self.read(place(task), functools.partial(parse, task))
            if known is not None:
                found[place(task)] = known
        missing = [task for task in tasks if place(task) not in found]
        progress(len(found), len(tasks))
        for task, answer in compute(missing):
            self.write(place(task), answer.to_dict(), about(task))
            found[place(task)] = answer
            progress(len(found), len(tasks))
        return found

    def _path(self, name: str) -> Path:
        return self.out / f"{name}.json"


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
