"""What a user meets that no file is to blame for: a full disk, no ROS, a domain that cannot be."""

from __future__ import annotations

import os
import resource
import subprocess
import sys

import click
import pytest

from ldt_core.cli import invoke, ldt
from ldt_core.recording.bag import read_bag

BAD = 2  # exit code: what was given cannot be used
FAILED = 1  # exit code: the work itself failed


def ldt_process(*arguments: str, before=None, code: str = "", **environment: str):
    """(exit code, stdout, stderr) of a command."""
    program = f"{code}\nfrom ldt_core.cli import main\nmain({list(arguments)!r})"
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        preexec_fn=before,
        env={**os.environ, **environment},
    )
    return done.returncode, done.stdout, done.stderr


def one_sentence(errors: str, *words: str) -> None:
    assert errors.startswith("ldt: ")
    assert errors.count("\n") == 1, errors
    for word in words:
        assert word in errors


def test_a_full_disk_is_a_failure_that_keeps_what_was_written(tmp_path):
    """Exit code 1; the experiments before it are in the recording."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (3_000_000, 3_000_000))

    out = str(tmp_path / "out")
    code, _, errors = ldt_process("simulate", "--experiments", "400", "--out", out, before=limit)
    assert code == FAILED, errors
    one_sentence(errors, out, "recording stopped after", "stay readable")
    kept = [e.number for e in read_bag(out).experiments()]
    assert kept == list(range(1, len(kept) + 1))
    assert kept


def test_too_little_memory_to_load_the_libraries_is_a_sentence_at_once():
    """Where it ends while they are loaded, OpenBLAS asks for more for ever, and LLVM aborts."""
    megabytes = 400

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (megabytes * 10**6, megabytes * 10**6))

    code, _, errors = ldt_process("run", "--experiments", "3", "--no-bag", before=limit)
    assert code == FAILED, errors
    one_sentence(errors, "out of memory", "MB of address space", "ulimit -v")


def test_a_current_folder_that_was_deleted_is_named(tmp_path, monkeypatch, capsys):
    """The system names no file where it does not know where it is."""
    monkeypatch.chdir(tmp_path)
    tmp_path.rmdir()
    assert invoke(ldt, ["run", "--experiments", "1"]) in (BAD, FAILED)
    one_sentence(capsys.readouterr().err, "the current folder", "No such file")


BLOCK = """
import sys

class Without:
    def __init__(self, finder):
        self.finder = finder

    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("rclpy", "std_msgs", "diagnostic_msgs", "rcl_interfaces"):
            return None
        return self.finder.find_spec(name, path, target)

    def __getattr__(self, name):
        return getattr(self.finder, name)

sys.meta_path[:] = [Without(finder) for finder in sys.meta_path]
"""


def test_without_ros_up_says_what_is_missing_and_run_works(tmp_path):
    """`ldt run` is the same loop."""
    code, _, errors = ldt_process("up", "--bag", str(tmp_path / "a"), code=BLOCK)
    assert code == BAD
    one_sentence(errors, "ROS 2 Jazzy", "pip install", "`ldt run`")
    run_it = ["run", "--experiments", "1", "--model", "physics", "--bag", str(tmp_path / "b")]
    code, _, errors = ldt_process(*run_it, code=BLOCK)
    assert (code, errors) == (0, "")


@pytest.mark.parametrize("name", ["a.csv", "a.parquet", "a.mcap", "a.png", "a.html"])
def test_a_full_disk_names_the_file_that_is_not_made(name, tmp_path):
    """Nothing of it stays; half a picture and an unnamed place were the answer."""
    bag, out = tmp_path / "bag", tmp_path / name
    run_it = ["run", "--experiments", "2", "--model", "physics", "--out", str(bag)]
    assert invoke(ldt, run_it) == 0

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))

    command = {".png": "plot", ".html": "report"}.get(out.suffix, "export")
    own = {"PYTHONDONTWRITEBYTECODE": "1"}  # Python cuts its own caches short, without a word
    code, _, errors = ldt_process(command, str(bag), "-o", str(out), before=limit, **own)
    assert code == FAILED
    one_sentence(errors, str(out))
    assert list(tmp_path.iterdir()) == [bag]


def test_where_there_is_no_thread_to_be_had_it_is_said(tmp_path):
    """A limit on memory shows there first; nothing of the recording's lock stays."""
    code = """
import threading

def start(thread):
    raise RuntimeError("can't start new thread")

threading.Thread.start = start
"""
    out = str(tmp_path / "out")
    run_it = ["run", "--experiments", "2", "--model", "physics", "--out", out]
    told, _, errors = ldt_process(*run_it, code=code)
    assert told == FAILED
    assert errors.splitlines()[-1].startswith("ldt: can't start new thread: memory or")
    assert "Traceback" not in errors
    assert ldt_process(*run_it, "--force")[0] == 0


def test_a_cache_of_python_that_a_full_disk_cut_is_told_with_its_cure(monkeypatch, capsys):
    """Python writes what there is room for, and fails at each later start."""

    def cut(*_, **__):
        raise click.Abort from EOFError("marshal data too short")

    monkeypatch.setattr(ldt, "main", cut)
    assert invoke(ldt, ["info", "x"]) == FAILED
    one_sentence(capsys.readouterr().err, "marshal data too short", "delete the __pycache__")


@pytest.mark.parametrize("when", [-3e8, 1e10])
@pytest.mark.parametrize("command", ["run --model physics --no-bag", "simulate --out a"])
def test_a_clock_that_is_not_set_is_named(command, when, tmp_path, monkeypatch, capsys):
    """It was the start time of each experiment, or the namespace of a node."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("time.time", lambda: when)
    assert invoke(ldt, [*command.split(), "--experiments", "2"]) == BAD
    one_sentence(capsys.readouterr().err, "the computer's clock: expected a time from 1970 to 2261")
    assert not list(tmp_path.iterdir())


def test_a_graph_says_which_of_its_surroundings_is_wrong(tmp_path, monkeypatch, capfd):
    """A clock that ROS cannot hold, too few files: both were a domain or namespace."""
    pytest.importorskip("rclpy")
    up = ["up", "--experiments", "1", "--out", str(tmp_path / "a")]
    with monkeypatch.context() as patched:
        patched.setattr("ldt_core.base.clock.time.time", lambda: 4.2e9)
        assert invoke(ldt, up) == BAD
    one_sentence(capfd.readouterr().err, "clock", "1970 to 2038, as ROS 2 holds", "2103-02-04")
    monkeypatch.setattr("resource.getrlimit", lambda _: (10, 10))
    assert invoke(ldt, up) == BAD
    one_sentence(capfd.readouterr().err, "open files", "at least 64", "ulimit -n 64", "got 10")


def test_effects_that_cannot_be_loaded_are_a_failure(monkeypatch, capsys):
    """In a folder that was deleted, one by one was named, with exit code 0."""

    def gone(name):
        raise FileNotFoundError(2, "No such file or directory")

    monkeypatch.setattr("ldt_core.effects.get_effect", gone)
    assert invoke(ldt, ["effects"]) == FAILED
    one_sentence(capsys.readouterr().err, "No such file or directory")


def test_a_file_that_has_a_library_s_name_is_named(monkeypatch, capsys):
    """A numpy.py of the user's on PYTHONPATH."""

    def fail(*_, **__):
        raise ModuleNotFoundError("No module named 'numpy.x'", name="numpy.x")

    monkeypatch.setattr(ldt, "main", fail)
    assert invoke(ldt, ["info", "x"]) == FAILED
    one_sentence(capsys.readouterr().err, "No module named 'numpy.x'", "numpy/__init__.py")


def test_a_folder_of_links_in_a_circle_is_refused(tmp_path, capsys):
    """It was a traceback."""
    (tmp_path / "a").symlink_to(tmp_path / "a")
    assert invoke(ldt, ["run", "--experiments", "1", "--out", str(tmp_path / "a" / "run")]) != 0
    one_sentence(capsys.readouterr().err, "a/run")


@pytest.mark.parametrize("domain", ["abc", "999", "-1", "1.5", "233"])
def test_a_domain_that_cannot_be_is_refused(domain, tmp_path, monkeypatch, capfd):
    """Fast DDS would end the process without a word of ours."""
    pytest.importorskip("rclpy")
    monkeypatch.setenv("ROS_DOMAIN_ID", domain)
    code = invoke(ldt, ["up", "--experiments", "1", "--bag", str(tmp_path / "bag")])
    assert code == BAD
    one_sentence(capfd.readouterr().err, "ROS_DOMAIN_ID", "0 to 232", repr(domain))


def test_a_library_that_cannot_be_loaded_is_named(tmp_path):
    """As where there is no memory for it; it was a traceback."""
    block = BLOCK.replace('"rclpy", ', '"yaml", ')
    code, _, errors = ldt_process("run", "--bag", str(tmp_path / "a"), code=block)
    assert code == FAILED
    one_sentence(errors, "a library cannot be loaded", "yaml")


def test_an_environment_in_which_nothing_can_be_compiled_is_said(tmp_path):
    """What is left of somebody's debugging; it was a traceback of numba's."""
    code, _, errors = ldt_process("run", "--bag", str(tmp_path / "a"), NUMBA_DISABLE_JIT="1")
    assert code == FAILED
    one_sentence(errors, "a library cannot be loaded", "NUMBA_DISABLE_JIT")


def test_where_compiled_code_can_be_kept_nowhere_it_is_said(tmp_path):
    """A read-only installation and home, as in a container; it was a traceback of numba's."""
    code = """
import tempfile

def read_only(*_, **__):
    raise OSError(30, "Read-only file system")

tempfile.TemporaryFile = read_only
"""
    run_it = ["run", "--bag", str(tmp_path / "a")]
    told, _, errors = ldt_process(*run_it, code=code)
    assert told == FAILED
    one_sentence(errors, "a library cannot be loaded", "compiled code", "NUMBA_CACHE_DIR")


@pytest.mark.parametrize("said", ["docs", "run --experiments 1 --no-bag"])
def test_a_reader_that_leaves_early_is_not_told_of(said, programs):
    """`ldt docs | head -1`: by click, and by Rich."""
    program = f"from ldt_core.cli import main; main({said.split()!r})"
    command = [sys.executable, "-c", program]
    process = programs.start(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    errors = process.stderr.read()
    assert (process.wait(60), errors) == (1, "")
