"""Parts of the user's own that end, double or empty the process that runs them."""

from __future__ import annotations

import os

import pytest

from ldt_core.base.errors import LdtError
from ldt_core.base.own_process import OpenFiles, kept_alive, undivided
from ldt_core.cli import invoke, ldt
from ldt_core.recording.bag import read_bag
from ldt_core.recording.writer import BagWriter

OWN = """
import os, sys, warnings
from ldt_core.detectors.threshold import Threshold
from ldt_core.models.physics import PhysicsModel

class Exits(Threshold):
    def judge(self, *given):
        os._exit(0)

class Mute(PhysicsModel):
    kind = "mute"

    def predict(self, experiment):
        if len(experiment) > 3:
            os.execvp("true", ["true"])
        return super().predict(experiment)

class Begins(Threshold):
    def __init__(self, *given, **named):
        sys.exit(0)

class Forks(Threshold):
    def judge(self, *given):
        with warnings.catch_warnings(action="ignore"):
            child = os.fork()
        if child:
            assert os.waitpid(child, 0)[1] == 0
        return super().judge(*given)
"""
RUN = ["run", "--experiments", "2", "--out", "out"]


@pytest.fixture(autouse=True)
def own(tmp_path, monkeypatch):
    """The file above, in the current folder; a copy of this process ends with its test."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.py").write_text(OWN)
    owner = os.getpid()
    yield
    if os.getpid() != owner:
        os._exit(1)


@pytest.mark.parametrize(
    ("part", "code", "words"),
    [
        (["--detector", "own.py:Exits", "--model", "physics"], 0, "SystemExit: os._exit(0)"),
        (["--model", "own.py:Mute"], 1, "experiment 2 is not answered: SystemExit: os.execv("),
        (["--detector", "own.py:Begins"], 2, "one that can be made, got SystemExit: 0"),
    ],
)
def test_a_part_that_ends_the_program_is_one_that_fails(part, code, words, capsys):
    """A run that ended in its midst had exit code 0, and two experiments without an answer."""
    end = os._exit
    assert invoke(ldt, [*RUN, *part]) == code
    assert os._exit is end
    assert words in " ".join("".join(capsys.readouterr()).split())
    if code == 0:
        assert len(list(read_bag("out").records("signal"))) == 2


def test_a_part_that_ends_the_program_elsewhere_is_a_sentence(monkeypatch, capsys):
    """Where nothing is sent that could be unanswered; it passed for success."""
    monkeypatch.setattr("ldt_core.machine.plant.Plant.experiment", lambda *_: os._exit(0))
    assert invoke(ldt, ["simulate", "--out", "out"]) == 1
    told = capsys.readouterr().err
    assert told == "ldt: a part of your own would end the program: SystemExit: os._exit(0)\n"


def test_a_part_that_forks_is_recorded_once(capfd):
    """Its copy went on with the run: in the same file, and with a table of its own."""
    assert invoke(ldt, [*RUN, "--model", "physics", "--detector", "own.py:Forks"]) == 0
    assert capfd.readouterr().out.count("recording: out") == 1
    assert [len(list(read_bag("out").records(t))) for t in ("experiment", "signal")] == [2, 2]


def test_what_is_forked_by_right_ends_as_it_likes():
    """Workers of `multiprocessing` end by `os._exit`, within a command too."""
    with kept_alive(), undivided():
        child = os.fork()
        if not child:
            os._exit(7)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7


def test_files_that_were_closed_are_noticed(tmp_path):
    """A node waited for messages for ever; a recording said "input or output"."""
    files = OpenFiles()
    assert not files.closed
    for end in files._ends:
        os.close(end)
    assert files.closed
    writer = BagWriter(tmp_path / "bag", topics=("experiment",))
    os.close(writer._part._stream.fileno())
    with pytest.raises(LdtError, match="its file was closed, as by a part of your own"):
        writer.close()


def test_a_folder_that_lost_its_permission_is_not_called_deleted(tmp_path, monkeypatch):
    """What was written is there, and said to be."""

    def closed(path, **_):
        raise PermissionError(13, "Permission denied")

    writer = BagWriter(tmp_path / "bag", topics=("experiment",))
    monkeypatch.setattr("pathlib.Path.stat", closed)
    with pytest.raises(LdtError, match=r"Permission denied; recording stopped .* stay readable"):
        writer.close()
