"""Build description of LDT, and its first-time set-up.

`python3 setup.py up [OPTIONS]` makes a virtual environment in `.venv`, installs LDT and ROS 2 into
it, and runs `ldt up`. `python3 setup.py test [PYTEST OPTIONS]` does the same for the tests;
`python3 setup.py test --quick` runs the core's unit tests only, in 5 min of processor time.
Everything else is setuptools, as pip and colcon call it.
"""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
ENVIRONMENT = HERE / ".venv"
#: Versions with which all tests have passed (CONTRIBUTING.md says how they are written).
CONSTRAINTS = HERE / "constraints.txt"

# Unpinned ros-* names give another ROS distribution, so both are pinned.
ROS = ["ros-jazzy-rclpy[fastrtps]==7.1.6", "ros-jazzy-common-interfaces==5.3.6"]
TEST = [
    "axe-playwright-python>=0.1.7",
    "colcon-common-extensions",
    "cryptography>=50.0.0",
    "dask>=2026.1",
    "distributed>=2026.1",
    "foxglove-sdk>=0.30",
    "hypothesis>=6.100",
    "import-linter>=2.0",
    "mcap-ros2-support>=0.5.5",
    "mkdocs-material>=9.5.32",
    "mujoco>=3.7",
    "mypy>=1.18",
    "pandas>=2.2",
    "pre-commit>=4",
    "playwright>=1.56",
    "psutil>=5.9",
    "pyarrow>=23.0.1",
    "pysindy>=2",
    "pytest>=9.0.3",
    "pytest-timeout>=2.3",
    "pytest-xdist>=3.6",
    "ros-jazzy-domain-coordinator==0.12.0",
    "ruff>=0.14",
    "setuptools>=78.1.1",
    "twine>=6",
]
# A sourced ROS installation, or another environment of these wheels, would leak into ours.
FOREIGN = ("PYTHONPATH", "PYTHONHOME", "LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")


def clean_environment() -> dict[str, str]:
    """This process's environment without what other Python or ROS set-ups left in it."""
    return {k: v for k, v in os.environ.items() if k not in FOREIGN}


def quiet(*command: str) -> bool:
    """Run a command whose failure has a fallback."""
    try:
        done = subprocess.run(command, env=clean_environment(), capture_output=True, check=False)
    except FileNotFoundError:
        return False
    return done.returncode == 0


def make_environment() -> list[str]:
    """Create the virtual environment; return the pip command that installs into it."""
    python = str(ENVIRONMENT / "bin" / "python")
    if not quiet(python, "-m", "pip", "--version"):
        if quiet(sys.executable, "-m", "venv", "--clear", str(ENVIRONMENT)):
            pass
        elif not quiet(sys.executable, "-m", "virtualenv", "--clear", str(ENVIRONMENT)):
            # Debian's Python has no ensurepip, but its pip can install into another environment.
            made = quiet(sys.executable, "-m", "venv", "--clear", "--without-pip", str(ENVIRONMENT))
            host = [sys.executable, "-m", "pip", "--python", python]
            if not (made and quiet(*host, "install", "pip")):
                sys.exit(
                    f"setup.py: {sys.executable} can make no virtual environment: install its venv "
                    "module (Debian and Ubuntu: apt install python3-venv) and try again"
                )
    quietly = [] if sys.stdout.isatty() else ["--quiet"]
    return [python, "-m", "pip", "install", "--disable-pip-version-check", *quietly]


def bootstrap(extras: str) -> None:
    """Install this checkout with the extras into `.venv`, once for each state of this file."""
    if sys.version_info < (3, 11):  # noqa: UP036 - this runs before pip has checked anything
        sys.exit(f"setup.py: expected Python 3.11 or newer, got {sys.version.split()[0]}")
    stamp = ENVIRONMENT / f"ldt-{extras.replace(',', '-')}"
    said = Path(__file__).read_bytes() + CONSTRAINTS.read_bytes() + sys.version.encode()
    state = hashlib.sha256(said).hexdigest()
    if stamp.exists() and stamp.read_text() == state:
        return
    print(f"setup.py: installing LDT and ROS 2 into {ENVIRONMENT}, once", flush=True)
    pip = make_environment()
    command = [*pip, "-c", str(CONSTRAINTS), "-e", f"{HERE}[{extras}]"]
    done = subprocess.run(command, env=clean_environment(), check=False)
    if done.returncode:
        sys.exit(
            "setup.py: pip could not install LDT, see above (the ROS 2 wheels exist for x86-64 "
            "Linux and CPython 3.11 to 3.13)"
        )
    stamp.write_text(state)


def run(*command: str) -> None:
    """Become a command of the virtual environment."""
    program = ENVIRONMENT / "bin" / command[0]
    os.execve(program, [str(program), *command[1:]], clean_environment())


def description() -> str:
    """The README for a package index, which has neither its pictures nor the pages it links to."""
    text = re.sub(r"<!--.*?-->\n", "", (HERE / "README.md").read_text(encoding="utf-8"), flags=re.S)
    blocks = (block for block in text.split("\n\n") if not block.startswith("!["))  # with captions
    lines = (line for line in "\n\n".join(blocks).split("\n") if not line.startswith("| !["))
    return re.sub(r"\[([^][]+)\]\((?!https?:)[^()]+\)", r"\1", "\n".join(lines))


def build() -> None:
    """What pip and colcon ask for."""
    from setuptools import find_packages, setup

    setup(
        name="ldt",
        version="0.2.0",
        description="A digital twin that runs next to a machine, notices changes and learns again",
        long_description=description(),
        long_description_content_type="text/markdown",
        license="Apache-2.0",
        maintainer="LDT developers",
        maintainer_email="ldt@example.org",
        python_requires=">=3.11",
        packages=find_packages(include=["ldt_core*", "ldt_ros*", "msgs_config*"]),
        package_data={
            "ldt_core": ["py.typed"],
            "ldt_core.diagnosis": ["*.json"],
            "ldt_core.docs": ["*.md"],
            "ldt_core.views.page": ["templates/*"],
            "ldt_core.views.report": ["templates/*", "uplot/*"],
            "ldt_core.views.watch": ["templates/*"],
            "msgs_config": ["*.yaml", "*.xml", "machines/*.yaml", "layouts/*"],
        },
        data_files=[
            ("share/ament_index/resource_index/packages", ["resource/ldt"]),
            ("share/ldt", ["package.xml"]),
            ("share/ldt/launch", ["ldt_ros/launch/ldt.launch.py"]),
        ],
        zip_safe=False,
        install_requires=[
            "click>=8.3.3",
            "Jinja2>=3.1.6",
            "joblib>=1.5",
            "lz4>=4.3",
            "mcap>=1.5",
            "numba>=0.61",
            "numpy>=1.26",
            "packaging>=24",
            "PyYAML>=6.0.1",
            "rich>=13.9",
            "rosbags>=0.11",
            "scikit-learn>=1.5",
            "scipy>=1.14",
            "threadpoolctl>=3.5",
            "zstandard>=0.22",
        ],
        extras_require={
            "ros": ROS,
            "plot": ["matplotlib>=3.9"],
            "notebook": ["matplotlib>=3.9", "pandas>=2.2"],
            "cluster": ["dask>=2026.1", "distributed>=2026.1"],
            "challenge": ["pysindy>=2"],
            "river": ["river>=0.21"],
            "watch": ["aiohttp>=3.14.3"],
            "foxglove": ["foxglove-sdk>=0.30"],
            "parquet": ["pyarrow>=23.0.1"],
            "rerun": ["rerun-sdk>=0.23"],
            "security": ["cryptography>=50.0.0"],
            "docs": ["mkdocs-material>=9.5.32", "matplotlib>=3.9"],
            "audit": ["pip-audit>=2.9"],
            "test": TEST,
        },
        entry_points={
            "console_scripts": [
                "ldt = ldt_core.__main__:main",
                *(
                    f"ldt_{role} = ldt_ros.graph.process:{role}"
                    for role in (
                        *("plant", "player", "segmenter", "twin", "detector"),
                        *("adaptor", "diagnoser", "advisor", "recorder"),
                    )
                ),
            ],
            "ldt.command": [
                "advise = ldt_core.cli.advise:command",
                "calibrate = ldt_core.cli.calibrate:command",
                "challenge = ldt_core.cli.challenge:command",
                "completion = ldt_core.cli.completion:command",
                "demo = ldt_core.cli.demo:command",
                "diagnose = ldt_core.cli.diagnose:command",
                "docs = ldt_core.cli.docs:command",
                "doctor = ldt_core.cli.doctor:command",
                "effects = ldt_core.cli.effects:command",
                "export = ldt_core.cli.export:command",
                "identify = ldt_core.cli.identify:command",
                "info = ldt_core.cli.info:command",
                "import = ldt_core.cli.import_file:command",
                "learning = ldt_ros.learning:command",
                "plot = ldt_core.cli.plot:command",
                "predict = ldt_core.cli.predict:command",
                "replay = ldt_core.cli.replay:command",
                "report = ldt_core.cli.report:command",
                "rollback = ldt_core.cli.rollback:command",
                "run = ldt_core.cli.run:command",
                "serve = ldt_core.cli.serve:command",
                "security = ldt_core.cli.security:command",
                "simulate = ldt_core.cli.simulate:command",
                "study = ldt_core.cli.study:command",
                "tune = ldt_core.cli.tune:command",
                "up = ldt_ros.up:command",
                "watch = ldt_core.cli.watch:command",
            ],
            "ldt.check": ["ros = ldt_ros.doctor:PROBES"],
            "ldt.watch": ["graph = ldt_ros.watch:GraphSource"],
        },
    )


if __name__ == "__main__" and sys.argv[1:2] == ["up"]:
    bootstrap("ros,plot,watch")
    run("ldt", "up", *sys.argv[2:])
elif __name__ == "__main__" and sys.argv[1:2] == ["test"]:
    bootstrap("ros,plot,river,watch,test")
    # All tests take all cores; those of one file share what it sets up.
    ALL = ["-n", "auto", "--dist", "loadfile", "--durations=15", "--durations-min=1"]
    QUICK = ["tests/core", "tests/contract", "-m", "not slow", *ALL]
    given = sys.argv[2:]
    run("python", "-m", "pytest", *(QUICK if given == ["--quick"] else given or ALL))
else:
    build()
