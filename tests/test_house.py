"""The house's own rules, each by the tool that knows it."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

REPOSITORY = Path(__file__).resolve().parents[1]
BIN = Path(sys.executable).parent
CHECKED = ["ldt_core", "ldt_ros", "msgs_config", "tests", "setup.py"]


def tool(name: str, *arguments: str) -> None:
    program = BIN / name
    if not program.exists() and not shutil.which(name):
        pytest.skip(f"{name} is not installed")
    done = subprocess.run(
        [str(program), *arguments], cwd=REPOSITORY, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_ruff_finds_nothing():
    """Lint."""
    tool("ruff", "check", "--no-cache", *CHECKED)


def test_the_code_is_formatted():
    """One format."""
    tool("ruff", "format", "--no-cache", "--check", *CHECKED)


def test_the_core_knows_no_ros():
    """The import contract of `pyproject.toml`."""
    tool("lint-imports", "--no-cache")


def test_the_core_s_types_hold():
    """Strict, but for what `pyproject.toml` lists."""
    tool("mypy")


def test_no_file_is_too_long():
    """A file is about one thing: 400 lines at most."""
    python = [p for f in CHECKED[:3] for p in (REPOSITORY / f).rglob("*.py")]
    lengths = {p: len(p.read_text().splitlines()) for p in python}
    assert {p.name: n for p, n in lengths.items() if n > 400} == {}


def test_pre_commit_runs_the_same_tools():
    """Every hook is one of the tools above, from the active environment."""
    hooks = yaml.safe_load((REPOSITORY / ".pre-commit-config.yaml").read_text())["repos"]
    assert [repo["repo"] for repo in hooks] == ["local"]
    programs = [hook["entry"].split()[0] for hook in hooks[0]["hooks"]]
    assert programs == ["ruff", "ruff", "lint-imports", "mypy"]


def test_the_readmes_commands_stand_in_ci():
    """`.ci/run` calls the README's test command."""
    command = "python3 setup.py test"
    assert f"\n{command}\n" in (REPOSITORY / "README.md").read_text()
    assert command in (REPOSITORY / ".ci" / "run").read_text()
