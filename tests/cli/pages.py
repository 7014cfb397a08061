"""Runs what a page of Markdown shows, block by block, as a reader who copies it would.

- A code block of another language than bash whose first line is a comment with a file name, as
  `# mine.py`, becomes that file.
- A bash block is run in the same folder; it must end without an error.
- A text block behind one is what it prints, line by line; `...` stands for anything.
- `<!-- not run: REASON -->` before a block leaves it out; the reason is kept.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

BLOCK = re.compile(r"(?:<!-- not run: ([^>]*?) -->\n+)?^```(\w+)\n(.*?)^```$", re.S | re.M)
FILE = re.compile(r"(?:#|<!--|//) ([\w.@/-]+\.\w+)(?: -->)?$", re.M)
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


def execute(text: str, folder: Path) -> Done:
    """Run a page's blocks in a folder.

    Raises:
        AssertionError: a command fails, or prints something else than the page says.
    """
    done, printed = Done(), ""
    for reason, language, block in BLOCK.findall(text):
        if reason:
            done.left_out.append(" ".join(reason.split()))
        elif language == "bash":
            printed = _run(block, folder)
            done.commands += 1
        elif language == "text":
            for line in block.splitlines():
                assert _shows(printed, line), f"expected {line!r} in:\n{printed}"
        elif named := FILE.match(block):
            (folder / named[1]).write_text(block)
            done.files.append(named[1])
    return done


def _run(block: str, folder: Path) -> str:
    """Everything that the commands print."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    ran = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", block],
        cwd=folder,
        env={**os.environ, "PATH": path, "COLUMNS": "200"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    assert ran.returncode == 0, f"{block}\nended with {ran.returncode}:\n{ran.stdout}"
    return ran.stdout


def _shows(printed: str, line: str) -> bool:
    pattern = ".*".join(re.escape(" ".join(p.split())) for p in line.split("..."))
    return re.search(pattern, " ".join(printed.split())) is not None
