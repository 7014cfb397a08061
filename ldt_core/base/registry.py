"""Names that users choose from: models, detectors, effects, physics.

Ours are listed in a table, resolved only when they are asked for (an import of scikit-learn takes a
second). A user's own come by entry point, group `ldt.model`, `ldt.detector` or `ldt.effect`, or as
`path/to/file.py:Name`.
"""

from __future__ import annotations

import contextlib
import functools
import importlib
import importlib.util
import sys
import traceback
from collections.abc import Collection, Iterator, Mapping
from importlib import metadata
from pathlib import Path
from types import ModuleType
from typing import Any

from ldt_core.base.errors import FAULTS, OptionError, did_you_mean, reason_of

FILES_REMEMBERED = 64  # more than a user has of plug-ins
_own_files: set[str] = set()  # that were loaded


def entry_points(group: str) -> metadata.EntryPoints:
    """What installed packages offer under a group, in no particular order."""
    return _entry_points(tuple(sys.path), group)


@functools.lru_cache
def _entry_points(path: tuple[str, ...], group: str) -> metadata.EntryPoints:
    found: metadata.EntryPoints = _all_entry_points(path).select(group=group)
    return found


@functools.lru_cache
def _all_entry_points(path: tuple[str, ...]) -> Any:  # of another type before Python 3.12
    # Hundreds of small files are read, whatever the group, which takes as long as a training.
    return metadata.entry_points()


class Registry:
    """Name → object, lazily.

    Args:
        what: what a member is called in messages ("model").
        builtin: name → "module:attribute".
        group: entry-point group for members from other packages.
    """

    def __init__(self, what: str, builtin: Mapping[str, str], group: str) -> None:
        self.what, self.builtin, self.group = what, dict(builtin), group

    def names(self) -> list[str]:
        """All known names, sorted."""
        return sorted(set(self.builtin) | {e.name for e in entry_points(self.group)})

    def require(self, name: str) -> None:
        """Check that there is a member of that name, without importing it.

        Raises:
            OptionError: nothing of that name.
        """
        if name.endswith(".py"):
            expected = f"{name}:NAME, with the name that it has in the file"
            raise OptionError(self.what, expected, repr(name))
        if name not in self.names() and ".py:" not in name:
            raise OptionError(self.what, did_you_mean(name, self.names()), repr(name))

    def get(self, name: str) -> Any:
        """The member of that name, or the attribute of a file for `path/to/file.py:Name`.

        Raises:
            OptionError: nothing of that name, or what fails as it is imported.
        """
        if name in self.builtin:
            module, _, attribute = self.builtin[name].partition(":")
            return getattr(importlib.import_module(module), attribute)
        for entry in entry_points(self.group):
            if entry.name == name:
                try:
                    found = entry.load()
                    _own_files.add(str(getattr(sys.modules.get(entry.module), "__file__", "")))
                    return found
                except FAULTS as error:  # whatever that package does
                    package = entry.dist.name if entry.dist else "another package"
                    where = f"{self.what} {name} of the package {package}"
                    expected = f"{entry.value} that can be imported"
                    raise OptionError(where, expected, reason_of(error)) from error
        self.require(name)
        return self._from_file(name)

    def _from_file(self, name: str) -> Any:
        path, _, attribute = name.rpartition(":")
        if not Path(path).is_file():
            expected = f"a Python file at {path}, from the folder that ldt runs in"
            raise OptionError(self.what, expected, "no such file")
        try:
            text = Path(path).read_bytes()
        except OSError as error:
            raise OptionError(self.what, f"a Python file at {path}", reason_of(error)) from error
        module = _module(path, str(Path(path).resolve()), text)
        if not hasattr(module, attribute):
            public = [n for n in vars(module) if not n.startswith("_")]
            raise OptionError(name, did_you_mean(attribute, public), repr(attribute))
        return getattr(module, attribute)


@functools.lru_cache(maxsize=FILES_REMEMBERED)
def _module(path: str, _place: str, _text: bytes) -> ModuleType:
    """A user's file, run once a text: an engine is made anew no more often than it was changed."""
    spec = importlib.util.spec_from_file_location(Path(path).stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    _own_files.add(str(Path(path).absolute()))
    folder = str(Path(path).absolute().parent)
    try:
        # A file may leave the folder that results are written to. It finds its neighbours, but only
        # behind all that is installed.
        with contextlib.chdir("."), _also_in(folder):
            spec.loader.exec_module(module)
    except OptionError as error:  # of an effect or a parameter that is made there
        where = f"{path}{line_in(path, error)}, {error.where}"
        raise OptionError(where, error.expected, error.got) from error
    except FAULTS as error:  # whatever the user's file does
        expected = "a Python file that can be imported"
        raise OptionError(path, expected, reason_of(error) + line_in(path, error)) from error
    return module


@contextlib.contextmanager
def _also_in(folder: str) -> Iterator[None]:
    """Modules are found in this folder, too."""
    sys.path.append(folder)
    try:
        yield
    finally:
        with contextlib.suppress(ValueError):  # what runs meanwhile may change the path
            sys.path.remove(folder)


def own_place(error: BaseException) -> str:
    """Where in a user's part an error came up, as "file.py, line 6"; "" where in none."""
    frame = _last_frame(error, _own_files)
    return f"{frame.filename}, line {frame.lineno}" if frame else ""


def line_in(path: str, error: BaseException) -> str:
    """Where in a user's file an error came up, as words behind it; "" where not there."""
    frame = _last_frame(error, {str(Path(path).absolute())})
    return f" (line {frame.lineno})" if frame else ""


def _last_frame(error: BaseException, files: Collection[str]) -> traceback.FrameSummary | None:
    """The innermost that ran in one of these files."""
    frames = reversed(traceback.extract_tb(error.__traceback__))
    return next((f for f in frames if str(Path(f.filename).absolute()) in files), None)
