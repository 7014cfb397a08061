"""The same function on many items, wherever it is computed."""

from __future__ import annotations

import functools
import importlib.metadata
import math
import os
import platform
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import resources
from pathlib import Path

import pytest
from programs import Programs

from ldt_core.base.code_version import SHOWING, code_version
from ldt_core.base.errors import BadInput, OptionError
from ldt_core.base.parallel import Workers
from ldt_core.lab.study.engine import run_case
from ldt_core.lab.study.study_case import StudyCase

pytestmark = pytest.mark.slow

PATIENCE = 60  # s; a stalled machine is not what is tested


def cases(machine: str, count: int = 3) -> list[StudyCase]:
    literal = {"gate": "none", "data": "warning-set"}
    return [StudyCase("hybrid", "lddm", seed, 8, machine, literal) for seed in range(count)]


def figures(result):
    return result.max_error, result.level, result.action, result.region_rmse


@functools.cache
def here(machine: str):
    return {case.key: figures(run_case(case)) for case in cases(machine)}


@pytest.mark.parametrize("jobs", [1, 2])
def test_results_come_with_their_items(short_rotor, jobs):
    """All of them, the same as in this process, in whichever order."""
    with Workers(jobs) as workers:
        found = {c.key: figures(r) for c, r in workers.map(run_case, cases(short_rotor))}
        assert list(workers.map(run_case, [])) == []
    assert found == here(short_rotor)


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_failure_is_raised_here(jobs):
    """As it was there, and the workers go on to be of use."""
    with Workers(jobs) as workers:
        with pytest.raises(ValueError, match="math domain"):
            list(workers.map(math.sqrt, [-1.0, *range(20)]))
        assert sorted(workers.map(math.sqrt, [9.0, 4.0])) == [(4.0, 2.0), (9.0, 3.0)]


PROGRAM = """
    import os, sys, time
    from ldt_core.base.parallel import Workers
    with Workers(2) as workers:
        for item, pid in workers.map(SLEEPER, [0.0, 0.0, 60.0, 60.0]):
            print(pid, flush=True)
"""


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_workers_do_not_outlive_who_started_them(tmp_path, programs, end):
    """Ctrl-C, a polite end, and an end without warning."""
    (tmp_path / "sleeper.py").write_text(
        "import os, time\ndef sleeper(t):\n    time.sleep(t)\n    return os.getpid()\n"
    )
    program = "from sleeper import sleeper\n" + textwrap.dedent(PROGRAM)
    process = programs.start(
        [sys.executable, "-c", program.replace("SLEEPER", "sleeper")],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    pids = [int(process.stdout.readline()) for _ in range(2)]
    time.sleep(0.5)  # so that the long items are begun
    if end is signal.SIGINT:
        os.killpg(process.pid, end)  # as a terminal does
    else:
        process.send_signal(end)
    process.wait(PATIENCE)
    deadline = time.monotonic() + PATIENCE
    while any(map(alive, pids)) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not any(map(alive, pids))


def alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except OSError:
        return False
    return state != "Z"


# ---- on a cluster


def dask(programs: Programs, *arguments: str) -> None:
    command = [sys.executable, "-m", *arguments]
    programs.start(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


@contextmanager
def workers_at(address: str, count: int, *more: str) -> Iterator[None]:
    """Worker processes of the scheduler; they are gone afterwards."""
    quiet = ("--nthreads", "1", "--no-dashboard", "--no-nanny", *more)
    with Programs() as programs:
        for _ in range(count):
            dask(programs, "distributed.cli.dask_worker", address, *quiet)
        yield


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory):
    """Address of a real scheduler on the loopback interface, without workers."""
    distributed = pytest.importorskip("distributed")
    file = tmp_path_factory.mktemp("dask") / "scheduler.json"
    local = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard")
    with Programs() as programs:
        dask(programs, "distributed.cli.dask_scheduler", *local, "--scheduler-file", str(file))
        deadline = time.monotonic() + PATIENCE
        while not file.exists() and time.monotonic() < deadline:
            time.sleep(0.05)
        with distributed.Client(scheduler_file=str(file), set_as_default=False) as client:
            yield client


def wait_for(client, count: int) -> str:
    """The scheduler's address, once it has so many workers."""
    deadline = time.monotonic() + PATIENCE
    while len(client.nthreads()) != count and time.monotonic() < deadline:
        time.sleep(0.05)
    assert len(client.nthreads()) == count
    return client.scheduler.address


def test_a_cluster_gives_the_same_results(scheduler, short_rotor):
    """Two worker processes behind a scheduler: equal to the last bit; failures come back too."""
    address = scheduler.scheduler.address
    with workers_at(address, 2):
        wait_for(scheduler, 2)
        with Workers(scheduler=address, identity=platform.python_version) as workers:
            found = {c.key: figures(r) for c, r in workers.map(run_case, cases(short_rotor))}
            with pytest.raises(OptionError, match="ldmd"):
                list(workers.map(run_case, [StudyCase("hybrid", "ldmd", 0, 8, short_rotor)]))
    wait_for(scheduler, 0)
    assert found == here(short_rotor)


def test_a_scheduler_without_workers_is_refused(scheduler):
    """Instead of waiting for ever."""
    with (
        pytest.raises(BadInput, match="at least one worker"),
        Workers(scheduler=wait_for(scheduler, 0)),
    ):
        pass


@pytest.mark.parametrize(
    ("preload", "words"),
    [
        (
            "m.version = lambda name: (_ for _ in ()).throw(m.PackageNotFoundError(name))",
            "one with",
        ),
        ("s.code_version.__wrapped__.__code__ = (lambda: {'ldt': '0.0'}).__code__", "'0.0'"),
    ],
)
def test_workers_without_this_ldt_are_refused(scheduler, tmp_path, preload, words):
    """None at all, or another version."""
    file = tmp_path / "preload.py"
    file.write_text(
        f"import importlib.metadata as m\nimport ldt_core.base.code_version as s\n{preload}\n"
    )
    with workers_at(scheduler.scheduler.address, 1, "--preload", str(file)):
        address = wait_for(scheduler, 1)
        with (
            pytest.raises(BadInput, match=words) as caught,
            Workers(scheduler=address, identity=code_version),
        ):
            pass
        assert "\n" not in str(caught.value)
    wait_for(scheduler, 0)


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense", "udp://127.0.0.1:1"])
def test_a_scheduler_that_cannot_be_reached_is_refused(monkeypatch, address):
    """In one sentence with its address."""
    pytest.importorskip("distributed")
    monkeypatch.setattr("ldt_core.base.parallel.SCHEDULER_TIMEOUT", 0.5)
    with pytest.raises(BadInput, match=address), Workers(scheduler=address):
        pass


def test_without_dask_the_extra_is_named(monkeypatch):
    """What to install."""
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(BadInput, match=r"ldt\[cluster\]"), Workers(scheduler="tcp://127.0.0.1:1"):
        pass


def test_the_version_names_code_and_libraries():
    """So that a result is never taken for another version's."""
    assert code_version()["ldt"] == importlib.metadata.version("ldt")
    assert len(code_version()["code"]) == 12
    assert {"numba", "numpy", "scikit-learn", "scipy"} < set(code_version())


def test_what_does_not_count_is_there():
    """By the names that it has now."""
    package = resources.files("ldt_core")
    assert [name for name in SHOWING if not (package / name).exists()] == []


def test_what_computes_a_diagnosis_counts():
    """An answer by other code is never taken for one of this."""
    code = "import sys, ldt_core.diagnosis.diagnose\nprint(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    modules = [m.split(".")[1:] for m in done.stdout.split() if m.startswith("ldt_core.")]
    assert len(modules) > 20
    for module in modules:
        prefixes = {"/".join(module[:k]) for k in range(1, len(module) + 1)}
        assert not prefixes & SHOWING, module
