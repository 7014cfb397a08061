"""The checks of `ldt doctor` that need no ROS, each with its fault provoked."""

from __future__ import annotations

import itertools
import resource
import shutil
import time
from importlib import metadata

import pytest

from ldt_core.doctor import computer_checks
from ldt_core.doctor.check import Grade, Probe, found_probes, ok, passed, run_probes

OK, WARNING, PROBLEM = Grade.OK, Grade.WARNING, Grade.PROBLEM


def one(found, grade: Grade, *words: str) -> None:
    """One finding of this grade that says the words; what is not well has a remedy."""
    (finding,) = found
    assert finding.grade is grade, finding
    assert bool(finding.remedy) == (grade is not OK), finding
    for word in words:
        assert word in f"{finding.message}: {finding.remedy}"


def test_a_probe_that_raises_or_hangs_is_a_problem_and_the_others_answer():
    """The report never waits longer than its limit, and keeps the probes' order."""

    def broken():
        raise RuntimeError("two\nlines")

    probes = [
        Probe("hangs", lambda: time.sleep(60) or []),
        Probe("breaks", broken),
        Probe("fine", lambda: [ok("fine", "well")]),
    ]
    began = time.monotonic()
    found = run_probes(probes, limit=0.5)
    assert time.monotonic() - began < 5
    assert [f.name for f in found] == ["hangs", "breaks", "fine"]
    assert [f.grade for f in found] == [PROBLEM, PROBLEM, OK]
    assert "no answer within 0.5 s" in found[0].message
    assert "RuntimeError: two lines" in found[1].message
    assert not passed(found)
    assert passed(found[2:])


def test_the_checks_of_another_part_that_cannot_be_loaded_are_one_problem(monkeypatch):
    """An entry point of a broken package ends nothing."""
    broken = metadata.EntryPoint("other", "no_such_thing:PROBES", "ldt.check")
    monkeypatch.setattr("ldt_core.doctor.check.entry_points", lambda group: [broken])
    one(run_probes(found_probes()), PROBLEM, "ModuleNotFoundError: No module named 'no_such_thing'")


def test_this_environment_is_well():
    """The tests run in what the project asks for."""
    one(computer_checks.python(), OK, "3.")
    one(computer_checks.libraries(), OK, "ldt ", "numba ", "rosbags ")
    one(computer_checks.temporary(), OK, "free in")
    one(computer_checks.clock(0.1), OK, "steady")


def test_a_library_that_is_missing_or_old_is_named(monkeypatch):
    """With the version that is there and the one that is wanted."""
    versions = {"ldt": "0.1.0", "numpy": "1.9.3", "scipy": "1.14"}

    def version(name):
        if name not in versions:
            raise metadata.PackageNotFoundError(name)
        return versions[name]

    wanted = ["numpy>=1.26", "scipy>=1.14", "numba>=0.61", 'river>=1; extra == "river"']
    monkeypatch.setattr(metadata, "version", version)
    monkeypatch.setattr(metadata, "requires", lambda name: wanted)
    words = ("numpy 1.9.3 is older than 1.26", "numba is missing", "pip install")
    one(computer_checks.libraries(), PROBLEM, *words)


@pytest.mark.slow
def test_kernels_that_cannot_be_loaded_are_a_problem(monkeypatch):
    """As numba refuses when it may keep what it compiles nowhere; and when it takes too long."""
    monkeypatch.setattr(computer_checks, "KERNELS_TIMEOUT", 300.0)  # s; the tests fill the machine
    one(computer_checks.kernels(), OK)
    refusal = "cannot cache function: no locator available"
    monkeypatch.setattr(computer_checks, "LOAD_KERNELS", f"raise RuntimeError('{refusal}')")
    one(computer_checks.kernels(), PROBLEM, refusal, "NUMBA_CACHE_DIR")
    monkeypatch.setattr(computer_checks, "LOAD_KERNELS", "import time; time.sleep(60)")
    monkeypatch.setattr(computer_checks, "KERNELS_TIMEOUT", 0.2)
    one(computer_checks.kernels(), WARNING, "not loaded within 0.2 s")


def test_a_place_for_recordings_is_told_with_its_room(tmp_path, monkeypatch):
    """The folder that a run would make need not be there yet, and is not made."""
    monkeypatch.chdir(tmp_path)
    one(computer_checks.recordings(), OK, str(tmp_path), "experiments")
    one(computer_checks.recordings("deep/down/here"), OK, str(tmp_path))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("free", "grade"), [(10**6, PROBLEM), (10**8, WARNING), (10**10, OK)])
def test_a_disk_that_is_nearly_full_is_told(free, grade, tmp_path, monkeypatch):
    """A default run does not fit, or a long one may not."""
    monkeypatch.chdir(tmp_path)
    usage = shutil.disk_usage(tmp_path)._replace(free=free)
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: usage)
    one(computer_checks.recordings(), grade, "free in")


def test_a_place_that_cannot_be_written_is_a_problem(tmp_path):
    """Existing recording, a file in the way, a file system that takes nothing."""
    (tmp_path / "there").mkdir()
    (tmp_path / "file").write_text("")
    one(computer_checks.recordings(str(tmp_path / "there")), PROBLEM, "exists already")
    one(computer_checks.recordings(str(tmp_path / "file" / "run")), PROBLEM, "is a file")
    one(computer_checks.recordings("/proc/ldt/run"), PROBLEM, "cannot be written in /proc")


def test_no_folder_for_temporary_files_is_a_problem(monkeypatch):
    """The nodes' output goes there."""

    def none():
        raise FileNotFoundError(2, "No usable temporary directory")

    monkeypatch.setattr(computer_checks.tempfile, "gettempdir", none)
    one(computer_checks.temporary(), PROBLEM, "No usable temporary directory", "TMPDIR")


def test_a_clock_that_jumps_or_is_decades_off_is_told():
    """The wall clock is set while it is watched; or it began in 1970."""
    ahead = itertools.chain([0.0] * 5, itertools.repeat(0.5))
    one(computer_checks.clock(0.2, lambda: time.time() + next(ahead)), WARNING, "moved by 0.500 s")
    one(computer_checks.clock(0.1, lambda: time.time() - 1.6e9), WARNING, "19", "timedatectl")


def test_little_memory_is_told(tmp_path):
    """And a system that tells nothing of its memory is no traceback."""
    table = tmp_path / "meminfo"
    table.write_text("MemTotal: 2000000 kB\nMemAvailable:     300000 kB\n")
    one(computer_checks.memory(table), WARNING, "293 MiB available")
    one(computer_checks.memory(tmp_path / "nowhere"), WARNING, "cannot be read")


def test_tight_limits_of_files_are_told(monkeypatch):
    """Few descriptors; files cut at a size."""
    given = {resource.RLIMIT_NOFILE: (64, 4096), resource.RLIMIT_FSIZE: (10**6, 10**6)}
    monkeypatch.setattr(resource, "getrlimit", given.__getitem__)
    files, size = computer_checks.limits()
    one([files], WARNING, "64 open files", "at most 4096 here")
    one([size], WARNING, "files of at most 1 MiB")
