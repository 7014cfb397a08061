"""The wheel has all that LDT needs, and runs away from the checkout."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]
SOURCES = ("ldt_core", "ldt_ros", "msgs_config", "resource")
FILES = ("setup.py", "setup.cfg", "pyproject.toml", "package.xml", "README.md", "LICENSE")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    """Built from a copy of what is in the checkout, as `pip wheel .` does."""
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    for name in SOURCES:
        shutil.copytree(
            REPOSITORY / name, source / name, ignore=shutil.ignore_patterns("__pycache__")
        )
    for name in FILES:
        shutil.copy(REPOSITORY / name, source / name)
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check"]
    options = ["--quiet", "--no-deps", "--no-build-isolation", "-w", str(folder)]
    _done([*pip, "wheel", *options, str(source)], folder)
    return next(folder.glob("ldt-*.whl"))


@pytest.fixture(scope="module")
def ldt(wheel, tmp_path_factory):
    """The wheel's command, in an empty folder; libraries are those of this environment."""
    folder = tmp_path_factory.mktemp("elsewhere")
    target = folder / "installed"
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "--quiet"]
    _done([*pip, "--no-deps", "--target", str(target), str(wheel)], folder)
    environment = {**os.environ, "PYTHONPATH": str(target), "NUMBA_CACHE_DIR": str(folder / "n")}

    def call(*arguments: str) -> str:
        return _done([str(target / "bin" / "ldt"), *arguments], folder, environment)

    where = _done(
        [sys.executable, "-c", "import ldt_core; print(ldt_core.__file__)"], folder, environment
    )
    assert where.startswith(str(target))
    return call


def _done(command: list[str], folder: Path, environment: dict[str, str] | None = None) -> str:
    ran = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, f"{command}:\n{ran.stdout}{ran.stderr}"
    return ran.stdout


def test_every_file_that_is_no_python_is_in_it(wheel):
    """Machine files, templates, scripts, pages, layouts: whatever stands beside the modules."""
    inside = set(zipfile.ZipFile(wheel).namelist())
    beside = {
        str(file.relative_to(REPOSITORY))
        for name in SOURCES[:3]
        for file in (REPOSITORY / name).rglob("*")
        if file.is_file() and "__pycache__" not in file.parts
    }
    launch = {name for name in beside if "/launch/" in name}  # installed where ROS looks for it
    assert beside - launch - inside == set()
    assert any(name.endswith("share/ldt/launch/ldt.launch.py") for name in inside)


def test_it_runs_and_reports(ldt):
    """Run, page of the run, and the pages of how to."""
    ldt("run", "--machine", "dc_motor", "--model", "physics", "--experiments", "2", "--bag", "done")
    ldt("report", "done", "-o", "done.html")
    assert ldt("docs", "connect").startswith("# Connect")


def test_its_graph_runs(ldt, domain):
    """The nodes are started by the wheel's own modules."""
    pytest.importorskip("rclpy")
    options = ("--machine", "dc_motor", "--experiments", "2", "--model", "physics")
    assert "experiments" in ldt("up", *options, "--bag", "graph")
