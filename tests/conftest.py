"""Fixtures that all tests share."""

from __future__ import annotations

import gc
import itertools
import os
import random
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, settings
from programs import Programs

import msgs_config
from ldt_core.__main__ import COLLECT_AFTER
from ldt_core.views.page import blocks
from ldt_core.views.page.style import WIDE

REPOSITORY = Path(__file__).resolve().parents[1]
MEASURED = REPOSITORY.parent / "shared" / "data"
DOMAINS = 100  # which domain_coordinator reserves
#: Begun before all others, in this order. In a fresh checkout the first compiles numerical code for
#: a minute of a processor, which most others use, and would compile as well: beside it run those
#: that use little of it.
FIRST = (
    *("test_docs.py", "test_hung.py", "test_house.py", "test_watch_browser.py"),
    *("test_crashes.py", "test_up.py"),
)
#: Files of the most processor time, above 20 s each: begun late, one of them would be last alone.
LONGEST = {
    *("test_diagnose.py", "test_verdict.py", "test_real_machines.py", "test_tuning.py"),
    *("test_contest.py", "test_bench_faults.py", "test_robustness_short.py"),
}

# Compiling takes seconds at the first call and shared machines stall: time is not what is tested.
settings.register_profile("ldt", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("ldt")

# The hundreds of programs that the tests start would translate all modules again, each of them.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# Before numpy is loaded: on busy cores its threads wait for each other at full speed, and a test of
# 0.1 s of a processor takes 4 s. Nodes have one thread each, and so have the programs started here.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# A shell that runs tests in the background has interrupts ignored, and so had every program that
# they start and mean to interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # the same under nohup


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """One more than there are cores: tests of the node graph mostly wait for its processes."""
    return len(os.sched_getaffinity(0)) + 1


@pytest.hookimpl(tryfirst=True)
def pytest_configure(config: pytest.Config) -> None:
    """Leave the order of the files to us."""
    if hasattr(config.option, "loadscopereorder"):
        config.option.loadscopereorder = False


def is_lone_page(nodeid: str) -> bool:
    """Whether this tests one page of `ldt docs` that shares nothing with another."""
    page = "test_a_page_works_by_copy_and_paste" in nodeid
    # They begin with the same run, which a process makes once.
    return page and not nodeid.endswith(("[start]", "[watch]"))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """With `--dist loadfile`: a file is one piece of work, and so is a page of `ldt docs`."""
    from xdist.scheduler import LoadFileScheduling

    class Pieces(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return nodeid if is_lone_page(nodeid) else super()._split_scope(nodeid)

    return Pieces(config, log) if config.getoption("dist") == "loadfile" else None


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[Any]:
    """Search no garbage meanwhile, a sixth of the time; nor ever after in what is there then.

    400,000 objects that stay: each search took 0.3 s of a processor.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(COLLECT_AFTER)  # as in the program
        gc.enable()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Side by side, `FIRST`, the longest files, then those of few tests, which run whole programs.

    Those of the node graph are spread out among the others: each fills all cores by itself.
    """
    if hasattr(config, "workerinput"):
        size = Counter(item.path for item in items)
        place: dict[Path, float] = {}
        for graph in (True, False):
            files = [f for f in size if (f.parent.name == "ros") is graph]
            files.sort(key=lambda f: size[f])
            place |= {file: index / len(files) for index, file in enumerate(files)}
        place |= {file: -1.0 for file in size if file.name in LONGEST}
        place |= {file: FIRST.index(file.name) - 9.0 for file in size if file.name in FIRST}
        items.sort(key=lambda item: -1.0 if is_lone_page(item.nodeid) else place[item.path])


@pytest.fixture(scope="session")
def measured() -> Path:
    """Folder of recordings of real machines, which are not part of the project."""
    if not MEASURED.is_dir():
        pytest.skip(f"no measured data at {MEASURED}")
    return MEASURED


@pytest.fixture(scope="session")
def short_rotor(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Machine file of the rotor with experiments of 200 samples, which are quick to learn from."""
    data = yaml.safe_load(msgs_config.machine_text("rotor"))
    data["experiment"] = {"duration": 4, "sample_period": 0.02}
    file = tmp_path_factory.mktemp("machine") / "short_rotor.yaml"
    file.write_text(yaml.safe_dump(data))
    return str(file)


@pytest.fixture(scope="module")
def in_one_layout() -> Iterator[None]:
    """A page's figures are drawn for wide screens alone: drawing is half of a diagnosis."""
    drawn = blocks.inline_svg
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(
            blocks, "inline_svg", lambda *what: drawn(*what) if what[1] is WIDE else "<svg></svg>"
        )
        yield


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """A page's figures are not drawn at all."""
    monkeypatch.setattr(blocks, "inline_svg", lambda drawing, layout: "<svg></svg>")


@pytest.fixture
def one_core(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the test asks for computes as on one core, the programs that it starts too.

    Other workers keep the rest busy: threads among which a search is spread cost 7 % of it, and
    processes their start. `test_how_many_cores_there_are_changes_nothing` is about the rest.
    """
    monkeypatch.setenv("LOKY_MAX_CPU_COUNT", "1")


@pytest.fixture
def one_sentence(capsys: pytest.CaptureFixture[str]) -> Callable[[], str]:
    """What was said on standard error, which is one line."""

    def said() -> str:
        line = capsys.readouterr().err
        assert line.count("\n") == 1, line
        return line

    return said


@pytest.fixture
def programs():
    """Starts programs, none of which outlives the test."""
    with Programs() as running:
        yield running


@pytest.fixture(scope="session")
def next_domain() -> Callable[[], int]:
    """Numbers from another begin in every process, so that a domain rests long after its use."""
    numbers = itertools.count(random.SystemRandom().randrange(DOMAINS))
    return lambda: next(numbers) % DOMAINS + 1


@pytest.fixture
def domain(
    next_domain: Callable[[], int],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    tmp_path_factory: pytest.TempPathFactory,
):
    """A ROS domain that nobody else uses, for this process and its children.

    What they leave for a user to look at does not stay in /tmp.
    """
    coordinator = pytest.importorskip("domain_coordinator")
    from ldt_ros.graph.environment import prepare

    with coordinator.domain_id(next_domain) as number:
        before = dict(os.environ)
        monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
        monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "ros_log"))
        place = str(tmp_path_factory.mktemp("tmp"))
        monkeypatch.setenv("TMPDIR", place)
        monkeypatch.setattr(tempfile, "tempdir", place)  # this process has asked already
        prepare()
        yield number
        # prepare() sets what was missing; the next test starts as this one did.
        for name in set(os.environ) - set(before):
            monkeypatch.delenv(name, raising=False)
