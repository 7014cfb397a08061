"""The source as a package of a ROS 2 workspace: colcon builds it, and what is built runs."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from ldt_core.recording.bag import read_bag
from ldt_core.recording.writer import BagWriter

REPOSITORY = Path(__file__).resolve().parents[2]
COLCON = Path(sys.executable).with_name("colcon")
SOURCES = ("ldt_core", "ldt_ros", "msgs_config", "resource")
FILES = ("package.xml", "setup.py", "setup.cfg", "README.md")
ROLES = ("plant", "player", "segmenter", "twin", "detector", "adaptor", "recorder")


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A workspace with a copy of this package, built."""
    if not COLCON.exists():
        pytest.skip("colcon is not installed beside this Python")
    root = tmp_path_factory.mktemp("workspace")
    package = root / "src" / "ldt"
    package.mkdir(parents=True)
    for name in SOURCES:
        # Without what numba compiled for the other place.
        shutil.copytree(
            REPOSITORY / name, package / name, ignore=shutil.ignore_patterns("__pycache__")
        )
    for name in FILES:
        shutil.copy(REPOSITORY / name, package / name)
    done = subprocess.run(
        [COLCON, "--log-base", "log", "build"],
        cwd=root,
        env={**os.environ, "PYTHONPATH": ""},
        capture_output=True,
        text=True,
        timeout=600,  # a stalled machine is not what is tested
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "1 package finished" in done.stdout
    return root


def installed(workspace: Path) -> dict[str, str]:
    """The environment after `source install/setup.sh`."""
    script = f". {workspace / 'install' / 'setup.sh'} && env -0"
    clean = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "AMENT_PREFIX_PATH")}
    done = subprocess.run(["sh", "-c", script], env=clean, capture_output=True, check=True)
    return dict(line.split("=", 1) for line in done.stdout.decode().split("\0") if line)


def test_everything_is_where_ros_looks_for_it(workspace):
    """Marker, package.xml, launch file, an executable for each node, declarations."""
    prefix = workspace / "install" / "ldt"
    share = prefix / "share"
    assert (share / "ament_index" / "resource_index" / "packages" / "ldt").is_file()
    assert (share / "ldt" / "package.xml").is_file()
    assert (share / "ldt" / "launch" / "ldt.launch.py").is_file()
    for name in ("ldt", *(f"ldt_{role}" for role in ROLES)):
        assert os.access(prefix / "lib" / "ldt" / name, os.X_OK), name
    modules = next(prefix.glob("lib/python*/site-packages"))
    for name in ("topics.yaml", "fastdds.xml", "machines/rotor.yaml"):
        assert (modules / "msgs_config" / name).is_file(), name


def test_the_launch_file_is_python_that_names_existing_executables(workspace):
    """`launch` comes with full ROS installations only, so the file is compiled here, not run."""
    file = workspace / "install" / "ldt" / "share" / "ldt" / "launch" / "ldt.launch.py"
    source = file.read_text()
    compile(source, str(file), "exec")
    assert 'executable=f"ldt_{role}"' in source
    assert "def generate_launch_description" in source


def test_package_xml_and_setup_py_agree(workspace):
    """Name, version and description are stated twice, for colcon and for pip."""
    root = ElementTree.parse(REPOSITORY / "package.xml").getroot()
    setup = subprocess.run(
        [sys.executable, "setup.py", "--name", "--version", "--description"],
        cwd=workspace / "src" / "ldt",
        capture_output=True,
        text=True,
        check=True,
    )
    stated = [root.findtext(tag) for tag in ("name", "version", "description")]
    assert setup.stdout.splitlines()[-3:] == stated


def test_the_installed_package_runs(workspace, tmp_path):
    """The command, from the install space and not from the checkout."""
    environment = installed(workspace)
    program = workspace / "install" / "ldt" / "lib" / "ldt" / "ldt"
    done = subprocess.run(
        [program, "--version"], env=environment, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "0.2.0" in done.stdout
    where = [sys.executable, "-c", "import ldt_core; print(ldt_core.__file__)"]
    file = subprocess.run(
        where, env=environment, capture_output=True, text=True, check=True, cwd=tmp_path
    )
    assert file.stdout.startswith(str(workspace))


def test_an_installed_node_runs(workspace, domain, tmp_path):
    """`ros2 run ldt ldt_player` by its executable: it plays to the end, and ends by itself."""
    pytest.importorskip("rclpy")
    from stranger import experiment

    with BagWriter(tmp_path / "bag", machine="rotor") as writer:
        writer.write("experiment", experiment(1), experiment(1).end)
    assert len(list(read_bag(tmp_path / "bag").experiments())) == 1
    program = workspace / "install" / "ldt" / "lib" / "ldt" / "ldt_player"
    ros = ["--ros-args", "-p", f"play:={tmp_path / 'bag'}", "-p", "adaptation_timeout:=0.1"]
    done = subprocess.run(
        [program, *ros],
        env=installed(workspace),
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "no adaptation of experiment 1 within 0.1 s, going on" in done.stderr
    assert "Traceback" not in done.stderr
