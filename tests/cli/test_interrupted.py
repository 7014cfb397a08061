"""`ldt run` and `ldt replay` asked to end: in order, with everything recorded and summed up."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
import zstandard

from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment
from ldt_core.base.metrics import Summary
from ldt_core.base.stopping import stop_on_signals
from ldt_core.cli import invoke, ldt
from ldt_core.doctor.check import Grade
from ldt_core.doctor.recording_checks import findings
from ldt_core.machine.machine_file import load_machine
from ldt_core.recording.bag import read_bag
from ldt_core.recording.health import inspect
from ldt_core.recording.mcap_writer import McapWriter
from ldt_core.recording.pace import paced
from ldt_core.recording.writer import BagWriter
from ldt_core.runs.offline import recorded_summary

PROGRAM = (sys.executable, "-c", "from ldt_core.cli import main; main()")
PATIENCE = 120  # s; a stalled machine is not what is tested


def started(programs, folder, *arguments):
    return programs.start(
        [*PROGRAM, *arguments, "--json"],
        cwd=folder,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


def recorded(recording):
    """Experiments in what is still being written."""
    try:
        return len(list(read_bag(recording).experiments()))
    except LdtError:
        return 0


def ended(process, recording, number):
    """Asked once something is recorded: the summary that it prints."""
    deadline = time.monotonic() + PATIENCE
    while recorded(recording) < 1 and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(number)
    output, errors = process.communicate(timeout=PATIENCE)
    (run,) = json.loads(output)["runs"]
    said = errors.partition("\n")[2].rstrip()  # behind the line that ^C stands in
    assert process.returncode == 130
    assert said.startswith(f"ldt: interrupted after {run['experiments']} ")
    assert f"; go on with: ldt run --resume {recording.name}" in said
    return run


def whole(recording, run):
    """Every experiment that counts is in the recording, to its last message."""
    bag = read_bag(recording)
    assert not bag.notes
    assert "interrupted" in run["notes"]
    assert [a.experiment for a in bag.records("adaptation")] == list(
        range(1, run["experiments"] + 1)
    )


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_run_that_is_asked_to_ends_in_order(programs, tmp_path, number):
    """Also one that waits for the machine."""
    process = started(
        *(programs, tmp_path, "run", "--experiments", "100000", "--model", "physics"),
        *("--rate", "40", "--bag", "run"),
    )
    run = ended(process, tmp_path / "run", number)
    assert 0 < run["experiments"] < 100000
    whole(tmp_path / "run", run)


def test_so_does_a_replay(programs, tmp_path):
    """Of a recording that takes long to play."""
    made = ["simulate", "--experiments", "4", "--out", str(tmp_path / "made")]
    assert invoke(ldt, made) == 0
    process = started(
        *(programs, tmp_path, "replay", "made", "--model", "physics", "--rate", "4"),
        *("--out", "again"),
    )
    run = ended(process, tmp_path / "again", signal.SIGINT)
    assert 0 < run["experiments"] < 4
    whole(tmp_path / "again", run)


def test_waiting_for_the_machine_ends_at_once():
    """The next experiment, an hour away, does not come any more."""
    stop = threading.Event()
    threading.Timer(0.2, stop.set).start()
    hours = [Experiment(k, 3600.0 * k, 0.01, np.zeros(3), np.zeros(3)) for k in (1, 2)]
    begin = time.monotonic()
    assert [e.number for e in paced(hours, 1.0, stop)] == [1]
    assert time.monotonic() - begin < 60


def test_who_insists_is_heard_at_once():
    """A second Ctrl-C does not wait; a patient one never interrupts; handlers are given back."""
    before = signal.getsignal(signal.SIGINT)
    with stop_on_signals() as stop:
        signal.raise_signal(signal.SIGTERM)
        assert stop.is_set()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    with stop_on_signals(insist=False):
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before


def test_a_terminal_that_is_closed_ends_nothing_under_nohup():
    """Which has that signal ignored; else it ends in order, where it cut a recording off."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with stop_on_signals() as stop:
            signal.raise_signal(signal.SIGHUP)
            assert not stop.is_set()
    finally:
        signal.signal(signal.SIGHUP, before)
    with stop_on_signals() as stop:
        signal.raise_signal(signal.SIGHUP)
        assert stop.is_set()


def test_an_alarm_of_somebody_else_ends_nothing():
    """A user's own part may set one; only who has asked to end is not waited for."""

    def items():
        for k in range(3):
            signal.raise_signal(signal.SIGALRM)
            yield k

    with stop_on_signals() as stop:
        assert list(stop.in_time(items())) == [0, 1, 2]


INTERRUPTED_WHILE_LOADING = """
import signal, sys

class Finder:
    def find_spec(self, name, *_):
        if name == "click":
            signal.raise_signal(signal.SIGINT)

sys.meta_path.insert(0, Finder())
if "ignored" in sys.argv:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
sys.argv[1:] = ["docs"]
from ldt_core.__main__ import main
main()
"""


@pytest.mark.parametrize(("given", "code"), [("", 130), ("ignored", 0)])
def test_a_program_that_is_interrupted_while_it_loads_ends_without_a_word(given, code):
    """Unless whoever has started it has interrupts ignored."""
    program = [sys.executable, "-c", INTERRUPTED_WHILE_LOADING, given]
    done = subprocess.run(program, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert (done.returncode, done.stderr) == (code, "")
    assert bool(done.stdout) is (code == 0)


def options(command, folder):
    """Of a command that records four experiments or more, and what it reads."""
    made, columns = folder / "made", folder / "made.csv"
    if command == "predict":
        assert invoke(ldt, ["simulate", "--experiments", "4", "--out", str(made)]) == 0
        return [str(made), "--machine", "rotor"]
    if command == "import":
        columns.write_text("t,u,n\n" + "".join(f"{k / 100:.2f},9,30\n" for k in range(1200)))
        return [str(columns), "--voltage=u", "--speed=n", "--time=t", "--length=2"]
    return ["--experiments", "4"]


@pytest.mark.parametrize("command", ["simulate", "predict", "import"])
def test_what_is_interrupted_before_its_first_result_leaves_nothing(command, tmp_path, monkeypatch):
    """So that the same command can be given again; nobody else's file is touched."""
    arguments = [command, *options(command, tmp_path), "--out", str(tmp_path / "out")]
    enter, beside = BagWriter.__enter__, []

    def entered(writer):
        for name in beside:
            (writer.path / name).write_text("mine")
        signal.raise_signal(signal.SIGINT)
        return enter(writer)

    with monkeypatch.context() as patched:
        patched.setattr(BagWriter, "__enter__", entered)
        assert invoke(ldt, arguments) == 130
        assert not (tmp_path / "out").exists()
        beside.append("mine.txt")
        assert invoke(ldt, arguments) == 130
        assert [f.name for f in (tmp_path / "out").iterdir()] == ["mine.txt"]
        (tmp_path / "out" / "mine.txt").unlink()
        (tmp_path / "out").rmdir()
    assert invoke(ldt, arguments) == 0


@pytest.mark.parametrize("command", ["simulate", "predict", "import"])
def test_a_recording_that_is_interrupted_is_whole_so_far(command, tmp_path, monkeypatch, capsys):
    """Ctrl-C while a chunk is being written: that one is written, then the command ends."""
    out, arguments = tmp_path / "out", options(command, tmp_path)
    add, compress, chunks = McapWriter.add, zstandard.compress, []

    def added(part, *message):
        add(part, *message)
        part.flush()  # a chunk a message

    def compressed(data):
        chunks.append(data)
        if len(chunks) == 2:
            signal.raise_signal(signal.SIGINT)
        return compress(data)

    monkeypatch.setattr(McapWriter, "add", added)
    monkeypatch.setattr(zstandard, "compress", compressed)
    capsys.readouterr()
    assert invoke(ldt, [command, *arguments, "--out", str(out)]) == 130
    assert capsys.readouterr().err == "\nldt: interrupted\n"
    bag = read_bag(out)
    assert len(list(bag.messages())) == 2
    files = [f for f in findings(inspect(bag)) if f.name in ("files", "metadata")]
    assert [f.grade for f in files] == [Grade.OK]


def test_a_graph_that_ended_before_its_first_experiment_is_not_called_damaged(tmp_path):
    """Its recording has all topics, and nothing on them."""
    topics = ("experiment", "original_prediction", "prediction", "signal", "adaptation", "model")
    with BagWriter(tmp_path / "run", topics=topics):
        pass
    summary = Summary()
    recorded_summary(tmp_path / "run", "", load_machine("rotor"), summary)
    assert (summary.experiments, summary.notes) == (0, [])


SLOW = """
import time
from ldt_core.detectors.threshold import Threshold

class Slow(Threshold):
    name = "slow"

    def update(self, residual, deviation=None):
        self.count = getattr(self, "count", 0) + 1
        end = time.monotonic() + (0 if self.count == 1 else 300)
        while time.monotonic() < end:
            time.sleep(0.01)
        super().update(residual, deviation)
"""


def test_an_experiment_that_takes_too_long_is_left_out_at_an_interrupt(programs, tmp_path):
    """It was waited for, two minutes where its samples are half a million."""
    (tmp_path / "slow.py").write_text(SLOW)
    process = started(
        programs,
        tmp_path,
        "run",
        "--bag",
        "run",
        "--model",
        "physics",
        "--detector",
        "slow.py:Slow",
    )
    run = ended(process, tmp_path / "run", signal.SIGINT)
    assert run["experiments"] == 1
    whole(tmp_path / "run", run)
