"""What the README shows of Python works as it stands there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from ldt_core.checks import check_detector
from ldt_core.cli import ldt, run
from ldt_core.registry import Registry

README = (Path(__file__).resolve().parents[2] / "README.md").read_text()


@pytest.fixture
def mine(tmp_path, monkeypatch) -> Path:
    """The detector of the README in a file of its own."""
    monkeypatch.chdir(tmp_path)
    block = next(b for b in re.findall(r"```python\n(.*?)```", README, re.S) if "# mine.py" in b)
    Path("mine.py").write_text(block)
    return tmp_path / "mine.py"


def test_the_readme_s_detector_runs(mine, capsys):
    """By the command that stands below it, with fewer experiments."""
    command = next(c for c in README.splitlines() if "mine.py:RootMeanSquare" in c)
    arguments = command.replace("--experiments 20", "--experiments 3").split()[1:]
    assert run(ldt, [*arguments, "--model", "physics", "--no-bag"]) == 0
    assert "mine.py:RootMeanSquare detector" in capsys.readouterr().out


def test_the_readme_s_detector_keeps_the_protocol(mine):
    """As the line below it says."""
    check_detector(Registry("detector", {}, "none").get(f"{mine}:RootMeanSquare")())
