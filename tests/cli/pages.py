"""Runs what a page of Markdown shows, block by block, as a reader who copies it would.

- A code block of another language than bash whose first line is a comment with a file name, as
  `# mine.py`, becomes that file.
- A bash block is run in the same folder; it must end without an error. Plain `ldt` commands and
  programs of the page without nodes, at its begin and its end, are run in this process: that saves
  each of them the seconds of its start.
- A text block behind one is what it prints, line by line; `...` stands for anything.
- `ldt demo`, with which some pages begin, is run once and its folder copied after that.
- `<!-- not run: REASON -->` before a block leaves it out; the reason is kept.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import io
import os
import re
import runpy
import shlex
import shutil
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from programs import Programs

from ldt_core.cli import invoke, ldt

BLOCK = re.compile(r"(?:<!-- not run: ([^>]*?) -->\n+)?^```(\w+)\n(.*?)^```$", re.S | re.M)
FILE = re.compile(r"(?:#|<!--|//) ([\w.@/-]+\.\w+)(?: -->)?$", re.M)
PLAIN = r"(?:ldt (?!up )[^|&;<>$`*#\\\n]*|python \w+\.py)\n"  # no shell needed
PARTS = re.compile(rf"((?:{PLAIN})*)(.*?)((?:^(?<!\\\n){PLAIN})*)", re.S | re.M)
PATIENCE = 900.0  # s; a stalled machine is not what is tested


@dataclass
class Done:
    """What became of a page.

    Attributes:
        files: written.
        commands: bash blocks that were run.
        left_out: why a block was not run, a reason each.
    """

    files: list[str] = field(default_factory=list)
    commands: int = 0
    left_out: list[str] = field(default_factory=list)


def execute(text: str, folder: Path, programs: Programs) -> Done:
    """Run a page's blocks in a folder.

    Args:
        text: the page.
        folder: an empty one.
        programs: among which what the page starts is counted.

    Raises:
        AssertionError: a command fails, or prints something else than the page says.
    """
    done, printed = Done(), ""
    for reason, language, block in BLOCK.findall(text):
        if reason:
            done.left_out.append(" ".join(reason.split()))
        elif language == "bash":
            printed = _run(block, folder, programs)
            done.commands += 1
        elif language == "text":
            for line in block.splitlines():
                assert _shows(printed, line), f"expected {line!r} in:\n{printed}"
        elif named := FILE.match(block):
            (folder / named[1]).write_text(block)
            done.files.append(named[1])
    return done


def _run(block: str, folder: Path, programs: Programs) -> str:
    """Everything that the commands print."""
    parts = PARTS.fullmatch(block)
    assert parts
    begin, middle, end = parts.groups()
    printed = [_line(line, folder, programs) for line in begin.splitlines()]
    printed += [_shell(middle, folder, programs)] if middle else []
    return "".join(printed + [_line(line, folder, programs) for line in end.splitlines()])


def _line(line: str, folder: Path, programs: Programs) -> str:
    if line.startswith("ldt "):
        return _call(line, folder)
    program = line.removeprefix("python ")
    if "ldt_ros" in (folder / program).read_text():
        return _shell(line, folder, programs)
    return _printed_in(folder, functools.partial(runpy.run_path, program, None, "__main__"))


def _shell(block: str, folder: Path, programs: Programs) -> str:
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "COLUMNS": "200"}
    command = ["bash", "-euo", "pipefail", "-c", block]
    code, printed = programs.run(command, PATIENCE, cwd=folder, env=environment)
    assert code == 0, f"{block}\nended with {code}:\n{printed}"
    return printed


def _call(line: str, folder: Path) -> str:
    """What a command of ours prints, run in this process."""
    if line != "ldt demo":
        return _invoke(line, folder)
    place, printed = _demo()
    shutil.copytree(place, folder, dirs_exist_ok=True)
    return printed


@functools.cache
def _demo() -> tuple[Path, str]:
    """A folder that the demo has filled, and what it printed."""
    place = Path(tempfile.mkdtemp(prefix="ldt-demo-"))
    atexit.register(shutil.rmtree, place, ignore_errors=True)
    return place, _invoke("ldt demo", place)


def _invoke(line: str, folder: Path) -> str:
    def command() -> None:
        assert invoke(ldt, shlex.split(line)[1:]) == 0, line

    return _printed_in(folder, command)


def _printed_in(folder: Path, work: Callable[[], object]) -> str:
    printed = io.StringIO()
    try:
        with (
            contextlib.chdir(folder),
            contextlib.redirect_stdout(printed),
            contextlib.redirect_stderr(printed),
        ):
            work()
    except AssertionError as error:
        raise AssertionError(f"{error} failed:\n{printed.getvalue()}") from error
    return printed.getvalue()


def _shows(printed: str, line: str) -> bool:
    pattern = ".*".join(re.escape(" ".join(p.split())) for p in line.split("..."))
    return re.search(pattern, " ".join(printed.split())) is not None
