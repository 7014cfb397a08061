"""The house's own rules, each by the tool that knows it."""

from __future__ import annotations

import ast
import doctest
import importlib
import re
import shutil
import subprocess
import sys
import tomllib
from collections import defaultdict
from pathlib import Path

import pytest
import yaml

REPOSITORY = Path(__file__).resolve().parents[1]
BIN = Path(sys.executable).parent
CHECKED = ["ldt_core", "ldt_ros", "msgs_config", "tests", "docs", "setup.py"]
#: What a module looks like or is a piece of: no name for one. Modules of `cli` are commands.
SHAPES = {
    *("common", "figure", "figures", "files", "functions", "helper", "helpers", "kept", "misc"),
    *("numbers", "own", "part", "parts", "procedure", "result", "results", "run", "setting"),
    *("table", "tables", "text", "texts", "tools", "util", "utils", "words"),
}


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


def test_the_layers_hold():
    """The import contracts of `pyproject.toml`: the core knows no ROS, for one."""
    tool("lint-imports", "--no-cache")


def test_the_types_hold():
    """Strict, but for what `pyproject.toml` lists."""
    tool("mypy")


def sources() -> dict[str, str]:
    """The text of each Python file of ours, by its path in the repository; no tests."""
    python = (p for f in CHECKED[:3] for p in sorted((REPOSITORY / f).rglob("*.py")))
    return {str(p.relative_to(REPOSITORY)): p.read_text() for p in python}


def test_no_file_is_too_long():
    """A file is about one thing: 400 lines at most."""
    lengths = {path: len(text.splitlines()) for path, text in sources().items()}
    assert {path: n for path, n in lengths.items() if n > 400} == {}


@pytest.mark.parametrize("path", [p for p, text in sources().items() if ">>> " in text])
def test_the_examples_in_docstrings_are_true(path):
    """They run as printed."""
    if "river" in path:
        pytest.importorskip("river")
    module = importlib.import_module(path.removesuffix(".py").replace("/", "."))
    done = doctest.testmod(module)
    assert done.attempted > 0
    assert done.failed == 0


def test_a_public_class_name_stands_for_one_thing():
    """Over the core, the nodes and the tables."""
    found = defaultdict(list)
    for path, text in sources().items():
        for part in ast.parse(text).body:
            if isinstance(part, ast.ClassDef) and not part.name.startswith("_"):
                found[part.name].append(path)
    assert {name: paths for name, paths in found.items() if len(paths) > 1} == {}


def test_a_module_is_named_for_what_it_holds():
    """Not for its shape."""
    paths = [Path(path) for path in sources()]
    assert [p for p in paths if p.stem in SHAPES and p.parent.name != "cli"] == []


@pytest.mark.parametrize("package", ["ldt_core", "ldt_ros"])
def test_every_package_stands_in_a_layer(package):
    """A new one is refused until it has a place; imports for types count, and none is excepted."""
    linted = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["tool"]["importlinter"]
    assert not linted.get("exclude_type_checking_imports")
    assert not [c["name"] for c in linted["contracts"] if "ignore_imports" in c]
    (contract,) = (c for c in linted["contracts"] if package in c.get("containers", ()))
    assert contract["exhaustive"]
    placed = {name for layer in contract["layers"] for name in re.split(r"[\s|:]+", layer)}
    folder = REPOSITORY / package
    packages = {p.parent.name for p in folder.glob("*/__init__.py")}
    inner = packages | {p.stem for p in folder.glob("*.py")}
    assert inner - placed <= {*contract.get("exhaustive_ignores", ()), "__init__"}


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
