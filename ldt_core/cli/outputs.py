"""Where commands write: one rule for all.

`-o`/`--out` names it. What is there already is refused, unless `--force` is given. Then the earlier
result is set aside until the new one is complete; where the command fails before it has anything,
the earlier one comes back. A command that fails leaves no empty folder.

Work that goes on from what is there (a study, a tuning, a score) needs no `--force`. Keys and
sealed cases are never replaced: what was made with them would be lost.
"""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ldt_core.base.errors import BadInput, OptionError
from ldt_core.base.result_files import check_target, check_writable
from ldt_core.base.sentences import listed
from ldt_core.cli.terminal import warn
from ldt_core.recording.lock import is_written

if TYPE_CHECKING:
    from ldt_core.recording.writer import BagWriter

#: By which a folder shows that it is a recording, or that of a fleet's.
RECORDING = ("metadata.yaml", "*/metadata.yaml", "*.mcap")

#: Former spelling → the present one; both work.
FORMER = {"--bag": "--out"}

force_option = click.option(
    "--force", is_flag=True, help="Replace the output of --out if it exists."
)


def check_file(
    file: str | Path, force: bool, option: str = "--out", endings: Sequence[str] = ()
) -> None:
    """Refuse a file that cannot be made, or is there and is not to be replaced.

    Raises:
        OptionError: says which.
    """
    check_target(file, option, endings)
    if not force and Path(file).exists():
        raise OptionError(option, "a file that does not exist yet (or --force)", f"{file}")


def check_results(folder: str | Path, names: Sequence[str], force: bool) -> None:
    """Refuse a folder in which a command's results are already.

    Args:
        names: of the files that the command writes.

    Raises:
        OptionError: one of them is there, the folder is a file, or it cannot be written to.
    """
    place = Path(folder)
    if place.exists() and not place.is_dir():
        raise OptionError("--out", "a folder", f"the file {place}")
    check_writable(place)
    there = [name for name in names if (place / name).exists()]
    if there and not force:
        got = f"{place}, which has {listed(there)}"
        raise OptionError("--out", "a folder without earlier results (or --force)", got)


def refuse_force(force: bool) -> None:
    """Of a run that goes on: it replaces nothing.

    Raises:
        OptionError: --force is given.
    """
    if force:
        raise OptionError("--force", "to be left out with --resume, which goes on recording", "it")


@contextmanager
def no_empty_folder(folder: str | Path) -> Iterator[None]:
    """Of a command nothing stays but what it has written, also where it fails: no empty folder."""
    place = Path(folder)
    before = place.exists()
    try:
        yield
    finally:
        if not before and not _files(place):
            shutil.rmtree(place, ignore_errors=True)


@contextmanager
def replacing(
    out: str, force: bool, sources: Sequence[str] = (), marks: Sequence[str] = RECORDING
) -> Iterator[None]:
    """Sets an earlier folder aside while a new one is made in its place.

    Args:
        out: the folder; "" where none is named.
        sources: what the command reads.
        marks: patterns of files by which a folder shows that LDT has written it.

    Raises:
        OptionError: there is a folder and no `force`, it is none of LDT's, it is what is read, or a
            run is writing it.
    """
    place = Path(out)
    if not out or not place.exists():
        with no_empty_folder(place) if out else nullcontext():
            yield
        return
    if not force:
        expected = "a folder that does not exist yet (or --force to replace it)"
        raise OptionError("--out", expected, out)
    if any(Path(source).resolve() == place.resolve() for source in sources if source):
        raise OptionError("--out", "another recording than the one that is read", out)
    if not place.is_dir() or not any(any(place.glob(mark)) for mark in marks):
        raise OptionError("--force", "a folder to replace that ldt has written", out)
    if any(is_written(folder) for folder in (place, *place.glob("*/"))):
        raise OptionError("--force", "a recording that nobody is writing", out)
    aside = place.with_name(f".{place.name}.{os.getpid()}.before")
    place.rename(aside)
    try:
        yield
    except BaseException:
        if _files(place):
            warn(f"{place} is incomplete; the earlier one is kept as {aside}")
        else:
            shutil.rmtree(place, ignore_errors=True)
            aside.rename(place)
        raise
    try:
        if aside.is_symlink():
            aside.unlink()
        else:
            shutil.rmtree(aside)
    except OSError as error:  # another user's, which may be renamed and not deleted
        warn(f"the earlier {place} cannot be deleted and is kept as {aside}: {error.strerror}")


@contextmanager
def nothing_if_refused(writer: BagWriter) -> Iterator[None]:
    """Of a recording nothing stays where an input that comes later is refused; an interrupt leaves
    what is written so far.
    """
    try:
        yield
    except BadInput:
        writer.close()
        for file in writer.path.glob("*.mcap"):
            file.unlink()
        (writer.path / "metadata.yaml").unlink()
        raise


def present_spelling(arguments: Sequence[str], flags: Sequence[str]) -> list[str]:
    """The arguments with former spellings replaced, and a note on a terminal.

    On a pipe there is none: programs go on as they did.

    Args:
        arguments: of a command.
        flags: that the command has.
    """
    present: list[str] = []
    for index, argument in enumerate(arguments):
        name, equals, value = argument.partition("=")
        if argument == "--":
            return [*present, *arguments[index:]]
        now = FORMER.get(name)
        if now in flags and name not in flags:
            if sys.stderr.isatty():
                warn(f"{name} is {now} now; the old spelling still works")
            argument = f"{now}{equals}{value}"
        present.append(argument)
    return present


def _files(folder: Path) -> bool:
    return folder.exists() and (not folder.is_dir() or any(p.is_file() for p in folder.rglob("*")))
