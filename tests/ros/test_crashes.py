"""Nodes that are killed are started again, and the run comes out as if nothing had happened."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import threading
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil
import pytest

pytest.importorskip("rclpy")

from disturbed import (
    MODEL,
    PATIENCE,
    RUN,
    complaints,
    differences,
    end_at_once,
    finished,
    killed,
    nodes,
    ran,
    recorded,
    wait_for,
)

from ldt_core.base.errors import RecordingError
from ldt_core.base.experiment import Experiment
from ldt_core.cli import invoke
from ldt_core.cli import ldt as commands
from ldt_core.machine.machine_file import load_machine
from ldt_core.recording.bag import read_bag
from ldt_core.recording.writer import BagWriter
from ldt_core.restart.recorded_run import RecordedRun
from ldt_ros.graph.node_graph import Graph
from ldt_ros.graph.supervisor import Supervisor
from ldt_ros.up import launch

#: `RUN` for `launch`.
GIVEN = {
    **{"machine": "dc_motor", "experiments": 40, "seed": 3, "start_time": 1e9},
    **{"model": "linear", "order": 1},
}


def hosted(launcher: int) -> dict[int, psutil.Process]:
    """A fleet's processes that live, by the number of their machines."""
    found = {}
    for process in psutil.Process(launcher).children():
        with contextlib.suppress(psutil.Error):
            if count := process.cmdline().count("--machine"):
                found[count] = process
    return found


def test_every_node_may_be_killed_and_nothing_is_lost_or_doubled(ldt, undisturbed, tmp_path):
    """Each of the five in turn while the run goes on: the same records, to the last bit.

    What stands in /tmp is gone by then, as after a month where old files are removed.
    """
    # 0.25 s an experiment: all five are killed before the run ends, on a quick machine too.
    place = tmp_path / "tmp"
    place.mkdir()
    process = ldt("up", *RUN, "--rate", "40", "--bag", "run", "--json", TMPDIR=str(place))
    wait_for(tmp_path / "run", 1)
    shutil.rmtree(next(place.glob("ldt-*")))
    roles = ("detector", "recorder", "twin", "plant", "adaptor")
    victims = Counter(killed(process, 5, 1.5, 1, roles))
    run = finished(process)
    assert victims == Counter(roles)
    assert set(run["notes"]) >= {f"{role} crashed once and was started again" for role in roles}
    assert run["experiments"] == 40
    assert differences(undisturbed, tmp_path / "run") == {}
    assert differences(tmp_path / "run", tmp_path / "run") == {}
    assert read_bag(tmp_path / "run").notes == []


@pytest.mark.parametrize("at", [(Graph, "_settle"), (Supervisor, "stop")])
def test_a_recorder_killed_when_the_source_has_no_more_loses_nothing(
    at, domain, undisturbed, monkeypatch, tmp_path
):
    """Stopped some experiments before, so that none of those was recorded."""
    monkeypatch.chdir(tmp_path)
    plain, stopped, killed = getattr(*at), [], []

    def on_step(machine, signal, adaptation):
        if adaptation.experiment > 30 and not stopped:
            stopped.append(nodes(os.getpid())["recorder"])
            stopped[0].suspend()

    def kill(*arguments, **more):
        if not killed:
            killed.extend(stopped)
            killed[0].kill()
        plain(*arguments, **more)

    monkeypatch.setattr(*at, kill)
    (run,) = launch({**GIVEN, "bag": "run"}, on_step)
    assert run.summary.notes == ["recorder crashed once and was started again"]
    assert (run.summary.failures, run.summary.experiments) == ([], 40)
    assert differences(undisturbed, tmp_path / "run") == {}


def test_a_recorder_killed_at_an_interrupt_loses_nothing(
    domain, undisturbed, monkeypatch, tmp_path
):
    """Stopped some experiments before Ctrl-C, and killed after that: the source stays for it."""
    monkeypatch.chdir(tmp_path)
    plain, stopped, asked, killed, steps = Graph._settle, [], [], [], []

    def on_step(machine, signal, adaptation):
        steps.append(adaptation.experiment)
        if adaptation.experiment == 10:
            stopped.append(nodes(os.getpid())["recorder"])
            stopped[0].suspend()
        if adaptation.experiment == 15:
            asked.append(True)

    def kill(*arguments, **more):
        killed.append(stopped[0])
        killed[0].kill()
        plain(*arguments, **more)

    monkeypatch.setattr(Graph, "_settle", kill)
    (run,) = launch({**GIVEN, "rate": "40", "bag": "run"}, on_step, lambda: bool(asked))
    told = ["interrupted", "recorder crashed once and was started again"]
    assert (sorted(run.summary.notes), run.summary.failures) == (told, [])
    found = [a.experiment for a in read_bag(tmp_path / "run").records("adaptation")]
    assert found == list(range(1, max(steps) + 1))
    assert 15 <= max(steps) < 20


@pytest.mark.parametrize("role", ["recorder", "detector"])
def test_a_stopped_node_goes_on_at_an_interrupt_and_loses_nothing(
    role, domain, monkeypatch, tmp_path
):
    """It heeded no signal, was killed after 16 s, and what it had missed was not answered."""
    monkeypatch.chdir(tmp_path)
    asked = []

    def on_step(machine, signal, adaptation):
        if adaptation.experiment == 10:
            nodes(os.getpid())[role].suspend()
            threading.Timer(1.0, asked.append, [True]).start()

    given = {"experiments": 4000, "seed": 3, "model": "physics", "start_time": 1e9}
    (run,) = launch({**given, "rate": "40", "bag": "run"}, on_step, lambda: bool(asked))
    assert (run.summary.notes, run.summary.failures) == (["interrupted"], [])
    bag = read_bag(tmp_path / "run")
    assert not bag.notes
    sent = [e.number for e in bag.experiments()]
    assert sent == [a.experiment for a in bag.records("adaptation")]
    assert len(sent) > 10


def test_the_comparison_finds_what_is_lost_doubled_or_other(undisturbed, tmp_path):
    """Else the tests here would show nothing."""
    other = ("--experiments", "8", "--seed", "4", *MODEL, "--start-time", "1e9")
    ran(tmp_path, "run", *other, "--bag", "other")
    found = differences(undisturbed, tmp_path / "other")
    assert found["experiment"] == "40 lost, 8 more or other"
    assert set(found) >= {"experiment", "prediction", "signal", "adaptation"}


def test_a_whole_stack_that_was_killed_goes_on(ldt, undisturbed, tmp_path):
    """After the end of every process at once, `ldt up --resume` makes the run whole."""
    process = ldt("up", *RUN, "--bag", "run", "--rate", "75")
    wait_for(tmp_path / "run", 5)
    end_at_once(process)
    ended = recorded(tmp_path / "run")
    assert 5 <= ended < 40
    run = ran(tmp_path, "up", "--resume", "run", "--rate", "max")
    assert run["experiments"] == 40
    assert differences(undisturbed, tmp_path / "run") == {}
    assert read_bag(tmp_path / "run").notes == []


def test_a_counter_that_began_anew_is_no_reason_to_lose_anything(ldt, tmp_path):
    """Each node killed behind that, then all at once: the records of the run without a graph."""
    rest = np.zeros(5)
    with BagWriter(tmp_path / "played", "rotor") as writer:
        for index, number in enumerate([*range(1, 21), *range(1, 41)]):
            turning = np.linspace(0.0, 5.0 + index, 5)
            one = Experiment(number, 1e9 + index, 0.01, rest + 3, turning)
            writer.write("experiment", one, one.end)
    quick = ("--detector", "threshold", "--threshold", "0.5", "--gate", "none")
    play = ("--play", "played", *MODEL, *quick)
    again = "not answered: experiment 1"
    ran(tmp_path, "run", *play, "--bag", "undisturbed", refused=again)
    process = ldt("up", *play, "--bag", "run", "--rate", "6")
    wait_for(tmp_path / "run", 24)
    roles = ("twin", "detector", "adaptor", "recorder", "player")
    assert Counter(killed(process, 5, 0.2, 1, roles)) == Counter(roles)
    end_at_once(process)
    assert 24 <= recorded(tmp_path / "run") < 59
    ran(tmp_path, "up", "--resume", "run", "--rate", "max")  # refused before
    found = differences(tmp_path / "undisturbed", tmp_path / "run")
    assert found == {"experiment": "0 lost, 1 more or other"}  # the one that was refused


def test_a_run_without_the_graph_goes_on_as_well(ldt, undisturbed, tmp_path):
    """`ldt run` killed, and taken up by `ldt run --resume` and by `ldt up --resume`."""
    process = ldt("run", *RUN, "--rate", "100", "--bag", "run")
    wait_for(tmp_path / "run", 10)
    process.kill()
    process.communicate()
    assert recorded(tmp_path / "run") < 40
    shutil.copytree(tmp_path / "run", tmp_path / "up" / "run")
    for command, bag in (("run", "run"), ("up", "up/run")):
        ran(tmp_path, command, "--resume", bag, "--rate", "max")
        assert differences(undisturbed, tmp_path / bag) == {}


def test_a_fleet_s_process_goes_on_with_all_its_machines(ldt, tmp_path):
    """All nodes of two machines die at once; the third machine does not notice."""
    fleet = (*RUN, "--experiments", "16", "--machines", "3")
    ran(tmp_path, "run", *fleet, "--bag", "undisturbed")
    # Paced, since a run at full speed can end before the second kill.
    paced = ("--rate", "30", "--processes", "2")
    process = ldt("up", *fleet, *paced, "--bag", "run", "--json")
    recording = tmp_path / "run" / "machine_1"
    so_far = 0
    for _ in range(2):
        wait_for(recording, so_far + 3)
        machines = hosted(process.pid)
        assert sorted(machines) == [1, 2]
        machines[2].kill()
        machines[2].wait(PATIENCE)
        so_far = recorded(recording)  # after this, only the next process adds to it
    output, errors = process.communicate(timeout=PATIENCE)
    assert (process.returncode, complaints(errors)) == (0, "")
    runs = json.loads(output)["runs"]
    words = "machine_1-machine_2 crashed 2 times and was started again"
    assert [words in run["notes"] for run in runs] == [True, True, False]
    for name in ("machine_1", "machine_2", "machine_3"):
        assert differences(tmp_path / "undisturbed" / name, tmp_path / "run" / name) == {}


def test_a_node_that_crashes_over_and_over_ends_the_run(ldt, tmp_path):
    """After `restarts` times without an experiment in between, with what it said last."""
    (tmp_path / "own.py").write_text(
        "import os\n"
        "from ldt_core.detectors.never import Never\n"
        "class Fragile(Never):\n"
        "    def judge(self, residual, deviation):\n"
        "        print('out of cheese', flush=True)\n"
        "        os.kill(os.getpid(), 9)\n"
    )
    process = ldt("up", *RUN, "--detector", "own.py:Fragile", "--bag", "run", "--restarts", "2")
    _, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 1
    assert "detector ended with code -9: out of cheese" in errors
    assert errors.count("\n") == 1


@pytest.mark.parametrize("command", ["run", "up"])
@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--seed", "4"), "--seed: expected 3, with which run began, got 4"),
        (("--bag", "other"), "bag: expected none beside resume"),
        (("--model", "physics"), "--model: expected 'linear'"),
    ],
)
def test_another_run_is_not_taken_up(
    command, options, words, undisturbed, monkeypatch, capsys, domain
):
    """Its numbers would not be those of one run; the recording stays as it is."""
    monkeypatch.chdir(undisturbed.parent)
    before = {f: f.read_bytes() for f in undisturbed.iterdir()}
    assert invoke(commands, [command, "--resume", "run", *options]) == 2
    assert words in capsys.readouterr().err
    assert {f: f.read_bytes() for f in undisturbed.iterdir()} == before


def test_a_recording_under_another_key_is_not_taken_up(
    tmp_path, short_rotor, monkeypatch, capsys, domain
):
    """The machine file has changed; a recording that is none of a run has no key at all."""
    machine = tmp_path / "own.yaml"
    machine.write_text(Path(short_rotor).read_text())
    monkeypatch.chdir(tmp_path)
    own = ["--machine", "own.yaml", "--experiments", "4", "--model", "physics"]
    assert invoke(commands, ["run", *own, "--bag", "run", "--json"]) == 0
    assert invoke(commands, ["run", "--resume", "run"]) == 2
    assert "--machine: expected 'own.yaml' to be given again" in capsys.readouterr().err
    machine.write_text(machine.read_text().replace("m: 4.9", "m: 4.8"))
    for command in ("run", "up"):
        assert invoke(commands, [command, "--resume", "run", "--machine", "own.yaml"]) == 2
        errors = capsys.readouterr().err
        assert "run, machine: expected the machine file as it was" in errors
        assert "under which the run began, got one in which m is 4.8, was 4.9 (take" in errors
    assert invoke(commands, ["simulate", "--experiments", "2", "--out", "other"]) == 0
    assert invoke(commands, ["run", "--resume", "other"]) == 2
    assert "other: expected a recording of a run" in capsys.readouterr().err


def test_a_run_goes_on_in_another_folder_with_the_machine_file_there(
    tmp_path, short_rotor, monkeypatch, capsys, domain
):
    """What the file says counts, and not what it is called."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.yaml").write_text(Path(short_rotor).read_text())
    own = ("--experiments", "4", "--model", "physics", "--bag", "run")
    ran(tmp_path, "run", "--machine", "own.yaml", *own)
    (tmp_path / "there").mkdir()
    for name in ("run", "own.yaml"):
        (tmp_path / name).rename(tmp_path / "there" / name)
    for command in ("run", "up"):
        ran(tmp_path, command, "--resume", "there/run", "--machine", "there/own.yaml")
    assert invoke(commands, ["up", "--resume", "there/run", "--machine", "dc_motor"]) == 2
    assert "--machine: expected 'own.yaml', with which" in capsys.readouterr().err


def test_a_node_alone_goes_on_with_no_edited_machine_file(tmp_path, short_rotor):
    """The other nodes would have the machine of before: a service is started again by itself."""
    from ldt_ros.nodes.own_recording import OwnRecording

    own = ("--experiments", "4", "--model", "physics", "--bag", "run")
    ran(tmp_path, "run", "--machine", short_rotor, *own)
    machine = load_machine(short_rotor)
    run = RecordedRun(tmp_path / "run", "/", machine)
    assert len(list(OwnRecording(run).steps())) == 4
    edited = replace(run, machine=machine.with_parameters(m=4.8))
    with pytest.raises(RecordingError, match="run, machine: expected the machine file as it was"):
        OwnRecording(edited)


def test_a_part_that_was_edited_since_the_run_began_does_not_go_on_with_it(
    tmp_path, monkeypatch, capsys, domain
):
    """The sentence names the file; the recording stays as it is, and may be rolled back."""
    part = tmp_path / "mine.py"
    part.write_text("from ldt_core.detectors.lddm import LDDM\nclass Mine(LDDM): pass\n")
    monkeypatch.chdir(tmp_path)
    own = ("--detector", "mine.py:Mine")
    for command, other in (("run", "up"), ("up", "run")):
        ran(tmp_path, command, *RUN, "--experiments", "4", *own, "--bag", command)
        ran(tmp_path, other, "--resume", command, *own)
        before = {f: f.read_bytes() for f in (tmp_path / command).iterdir()}
        text = part.read_text()
        part.write_text(text + "    threshold = 3\n")
        for again in (command, other):
            assert invoke(commands, [again, "--resume", command, *own]) == 2
            errors = capsys.readouterr().err
            assert f"{command}, file mine.py: expected" in errors
            assert "under which the run began" in errors
        assert invoke(commands, ["rollback", command]) == 0
        part.write_text(text)
        assert {f: f.read_bytes() for f in (tmp_path / command).iterdir()} == before
