"""The wheel has all that LDT needs, and runs away from the checkout."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from ldt_core.cli import invoke
from ldt_core.cli import ldt as command
from ldt_core.security.bill_of_materials import normalized

REPOSITORY = Path(__file__).resolve().parents[1]
SOURCES = ("ldt_core", "ldt_ros", "msgs_config", "resource")
#: Optional ones that the tests do without.
UNPINNED = ("pip-audit", "rerun-sdk")
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


@pytest.fixture(scope="module")
def sdist(tmp_path_factory) -> Path:
    """Built from a copy of what is under version control."""
    if shutil.which("git") is None or not (REPOSITORY / ".git").exists():
        pytest.skip("no checkout")
    folder = tmp_path_factory.mktemp("sdist")
    source = folder / "source"
    for name in tracked():
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(REPOSITORY / name, source / name)
    build = f"from setuptools import build_meta as b; print(b.build_sdist({str(folder)!r}))"
    _done([sys.executable, "-c", build], source)
    return next(folder.glob("ldt-*.tar.gz"))


def tracked() -> list[str]:
    listed = _done(["git", "ls-files"], REPOSITORY).splitlines()
    return [name for name in listed if (REPOSITORY / name).is_file()]


def test_the_source_distribution_has_all_that_is_under_version_control(sdist):
    """Tests, pages and recordings too; not what only a checkout needs."""
    with tarfile.open(sdist) as archive:
        inside = {name.partition("/")[2] for name in archive.getnames()}
    checkout = {".gitignore", ".ci/run"}
    assert set(tracked()) - checkout - inside == set()


def test_the_description_stands_alone(wheel, sdist):
    """An index shows it without the checkout: no picture or link leads there, and all words do."""
    with zipfile.ZipFile(wheel) as archive:
        name = next(n for n in archive.namelist() if n.endswith(".dist-info/METADATA"))
        said = archive.read(name).decode()
    with tarfile.open(sdist) as archive:
        inside = next(n for n in archive.getnames() if n.count("/") == 1 and "PKG-INFO" in n)
        assert archive.extractfile(inside).read().decode().endswith(said.partition("\n\n")[2])
    assert "![" not in said
    assert all(to.startswith("https://") for to in re.findall(r"\]\(([^)]*)\)", said))
    headings = re.findall(r"(?m)^## .*", (REPOSITORY / "README.md").read_text())
    assert headings == re.findall(r"(?m)^## .*", said)
    assert "| **It learns** | **It says why** |\n|---|---|\n| After each" in said


def test_all_files_name_one_version():
    """Of the package, of the ROS package, of the citation, and at the top of the changelog."""
    version = re.search(r'version="([^"]+)"', (REPOSITORY / "setup.py").read_text())[1]
    assert f"<version>{version}</version>" in (REPOSITORY / "package.xml").read_text()
    cited = (REPOSITORY / "CITATION.cff").read_text()
    released = re.search(r"date-released: (\S+)", cited)[1]
    assert f"\nversion: {version}\n" in cited
    heads = re.findall(r"(?m)^## \[(.*)\](?: - (\S+))?$", (REPOSITORY / "CHANGELOG.md").read_text())
    assert heads[:2] == [("Unreleased", ""), (version, released)]


def test_an_index_would_take_both(wheel, sdist):
    """Their metadata and the description are as it wants them."""
    pytest.importorskip("twine")
    assert "FAILED" not in _done(
        [sys.executable, "-m", "twine", "check", "--strict", str(wheel), str(sdist)], wheel.parent
    )


def test_the_constraints_keep_to_what_is_asked():
    """Each library that LDT and its tests ask for is pinned, to a version that is let in."""
    pins = dict(
        line.split("==") for line in (REPOSITORY / "constraints.txt").read_text().splitlines()
    )
    for text in metadata.requires("ldt") or ():
        need = Requirement(text)
        pin = pins.get(normalized(need.name))
        if need.name not in UNPINNED:
            assert pin is not None, need
            assert need.specifier.contains(pin), need


def test_the_bill_of_materials_has_what_is_needed_and_what_is_embedded(tmp_path):
    """With versions; of what stands in our own files the version that its file says."""
    assert invoke(command, ["security", "sbom", "-o", str(tmp_path / "bill.json")]) == 0
    bill = json.loads((tmp_path / "bill.json").read_text())
    assert (bill["bomFormat"], bill["specVersion"]) == ("CycloneDX", "1.5")
    versions = {c["name"]: c["version"] for c in bill["components"]}
    assert {"numpy", "click", "mcap", "uPlot"} <= set(versions)
    assert versions["numpy"] == metadata.version("numpy")
    script = REPOSITORY / "ldt_core/views/report/uplot/uPlot.iife.min.js"
    assert f"(v{versions['uPlot']})" in script.read_text()[:200]


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
