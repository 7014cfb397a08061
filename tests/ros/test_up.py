"""`ldt up` as a user starts and ends it."""

from __future__ import annotations

import itertools
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest
from disturbed import complaints, ran, recorded

from ldt_core.cli import invoke
from ldt_core.cli import ldt as commands
from ldt_core.recording.bag import read_bag

rclpy = pytest.importorskip("rclpy")

from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.signals import SignalHandlerOptions  # noqa: E402
from std_msgs.msg import Float64MultiArray  # noqa: E402

from ldt_ros.nodes.interfaces import qos  # noqa: E402

SHARED_MEMORY = Path("/dev/shm")
PROGRAMS = {"ldt_ros.graph.process", "ldt_ros.graph.fork_server"}
PATIENCE = 180  # s; a stalled machine is not what is tested


@pytest.fixture
def start(domain, programs, tmp_path):
    """Starts the command in the test's folder and domain."""
    program = str(Path(sys.executable).with_name("ldt"))

    def started(*arguments: str, module: bool = False) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "ldt_ros.up"] if module else [program, "up"]
        # What is learned is tested elsewhere; the physics keeps two cores free for the processes.
        model = () if "--model" in arguments else ("--model", "physics")
        return programs.start(
            [*command, *arguments, *model],
            cwd=tmp_path,
            text=True,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )

    return started


def finish(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    output, errors = process.communicate(timeout=PATIENCE)
    return process.returncode, output, errors


def graph_processes(domain: int) -> list[psutil.Process]:
    """Processes of the graph in this test's domain, whoever their parent is."""
    found = []
    for process in psutil.process_iter():
        try:
            ours = PROGRAMS & set(process.cmdline())
            if ours and process.environ().get("ROS_DOMAIN_ID") == str(domain):
                found.append(process)
        except psutil.Error:
            continue
    return found


def wait_for(condition, what: str):
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        if result := condition():
            return result
        time.sleep(0.05)
    raise AssertionError(f"not within {PATIENCE} s: {what}")


def shared_memory() -> set[Path]:
    """Files of the middleware; browsers and worker processes of other tests have theirs here."""
    return {file for file in SHARED_MEMORY.iterdir() if "fastrtps" in file.name}


def test_it_ends_by_itself_and_leaves_nothing_behind(start, domain, tmp_path):
    """After N experiments: exit 0, a summary, a recording; no process, no shared-memory file."""
    before = shared_memory()
    process = start(
        "--experiments", "5", "--seed", "3", "--model", "linear", "--bag", "run", "--json",
    )  # fmt: skip
    code, output, errors = finish(process)
    assert (code, complaints(errors)) == (0, "")
    summary = json.loads(output)["runs"][0]
    assert summary["experiments"] == 5
    assert summary["mme"] > 0
    assert summary["recording"] == "run"
    assert recorded(tmp_path / "run") == 5
    assert graph_processes(domain) == []
    assert shared_memory() <= before


def test_the_table_names_the_figures_and_the_recording(start, tmp_path):
    """Without --json a table; as a Python script as well; a recording is made without --bag."""
    code, output, errors = finish(start("--experiments", "2", module=True))
    assert (code, complaints(errors)) == (0, "")
    for words in ("mean maximum error: twin", "error: original model", "new models"):
        assert words in output
    recording = output.split("recording: ")[1].splitlines()[0]
    assert (tmp_path / recording / "metadata.yaml").is_file()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_in_order(number, start, domain, tmp_path):
    """Exit 0, the summary says that it was interrupted, the recording is whole, nothing is left."""
    process = start("--experiments", "100000", "--rate", "200", "--bag", "run", "--json")
    wait_for(lambda: recorded(tmp_path / "run") > 3, "experiments in the recording")
    process.send_signal(number)
    code, output, errors = finish(process)
    assert (code, complaints(errors)) == (0, "")
    summary = json.loads(output)["runs"][0]
    assert "interrupted" in summary["notes"]
    bag = read_bag(tmp_path / "run")
    assert len(list(bag.records("adaptation"))) == summary["experiments"]
    assert bag.notes == []
    assert graph_processes(domain) == []


def test_a_source_that_somebody_ends_does_not_end_the_run_well(start, domain, tmp_path):
    """Exit code 0 said that all was done, after 8 of 12 experiments."""
    process = start("--experiments", "100000", "--rate", "200", "--bag", "run", "--json")
    wait_for(lambda: recorded(tmp_path / "run") > 3, "experiments in the recording")
    (plant,) = [p for p in graph_processes(domain) if "plant" in p.cmdline()]
    plant.terminate()
    code, output, errors = finish(process)
    assert code == 1
    assert "the plant was ended before its last experiment" in errors
    done = json.loads(output)["runs"][0]["experiments"]
    assert done == len(list(read_bag(tmp_path / "run").records("adaptation")))


def test_a_signal_before_the_nodes_have_met_ends_it_as_well(start, domain):
    """Ctrl-C right after the start leaves no process."""
    process = start("--experiments", "100000", "--rate", "200")
    wait_for(lambda: graph_processes(domain), "first node process")
    process.send_signal(signal.SIGINT)
    code, _, _ = finish(process)
    assert code == 0
    assert graph_processes(domain) == []


def test_killing_the_launching_process_leaves_no_orphan(start, domain, tmp_path):
    """The nodes notice that their parent is gone."""
    process = start("--experiments", "100000", "--rate", "200", "--bag", "run")
    wait_for(lambda: recorded(tmp_path / "run") > 1, "experiments in the recording")
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    wait_for(lambda: not graph_processes(domain), "end of all nodes")


def test_a_node_that_dies_is_named(start, domain, tmp_path):
    """Where none is started again: exit 1 with one sentence, and the rest ends in order."""
    endless = ("--experiments", "100000", "--rate", "200", "--bag", "run")
    process = start(*endless, "--restarts", "0")
    wait_for(lambda: recorded(tmp_path / "run") > 1, "experiments in the recording")
    victim = next(p for p in graph_processes(domain) if "detector" in p.cmdline())
    victim.kill()
    code, _, errors = finish(process)
    assert code == 1
    assert "detector ended with code -9" in errors
    assert "Traceback" not in errors
    output = Path(errors.partition("(all output: ")[2].partition(")")[0])
    assert (output / "detector.log").is_file()
    assert graph_processes(domain) == []


def test_a_second_graph_in_the_same_domain_is_refused(start, tmp_path, monkeypatch, capfd):
    """Two publishers of one topic would make nonsense of both; another namespace is fine."""
    # At a pace that leaves the cores to the others.
    first = start("--experiments", "100000", "--rate", "40", "--bag", "first")
    wait_for(lambda: recorded(tmp_path / "first") > 1, "experiments in the recording")
    monkeypatch.chdir(tmp_path)
    few = ("up", "--model", "physics", "--experiments", "2")
    assert invoke(commands, [*few, "--bag", "second"]) == 2
    errors = capfd.readouterr().err
    assert "expected no publisher before the graph starts" in errors
    assert "ROS_DOMAIN_ID" in errors
    assert ran(tmp_path, *few, "--bag", "third", "--namespace", "other")["experiments"] == 2
    first.send_signal(signal.SIGINT)
    assert finish(first)[0] == 0


def test_an_existing_recording_is_not_touched(start, tmp_path):
    """Exit 2, and what is there stays."""
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "mine.txt").write_text("mine")
    code, _, errors = finish(start("--experiments", "2", "--bag", "run"))
    assert code == 2
    assert errors.startswith("ldt: --out: expected a folder that does not exist yet")
    assert errors.endswith("got run\n")
    assert [f.name for f in (tmp_path / "run").iterdir()] == ["mine.txt"]


def test_three_machines_run_side_by_side(start, domain, tmp_path):
    """A namespace, a seed and a recording each."""
    process = start(
        "--machines", "3", "--experiments", "4", "--seed", "1", "--bag", "fleet", "--json",
    )  # fmt: skip
    code, output, errors = finish(process)
    assert (code, complaints(errors)) == (0, "")
    runs = json.loads(output)["runs"]
    assert [r["machine"] for r in runs] == ["machine_1", "machine_2", "machine_3"]
    assert len({r["mme"] for r in runs}) == 3
    for run in runs:
        bag = read_bag(tmp_path / run["recording"])
        assert bag.namespace == f"/{run['machine']}"
        assert len(list(bag.records("adaptation"))) == 4
    seeds = [read_bag(tmp_path / r["recording"]).settings()["seed"] for r in runs]
    assert seeds == [1, 2, 3]
    assert graph_processes(domain) == []


def test_a_fleet_s_process_that_somebody_ends_does_not_end_the_run_well(start, domain, tmp_path):
    """Its machines have not had all their experiments: exit 1, and the process is named."""
    endless = ("--experiments", "100000", "--rate", "200", "--bag", "fleet")
    process = start("--machines", "2", "--processes", "1", *endless)
    wait_for(lambda: recorded(tmp_path / "fleet" / "machine_2") > 1, "experiments")
    (victim,) = [p for p in graph_processes(domain) if "ldt_ros.graph.process" in p.cmdline()]
    victim.terminate()
    code, _, errors = finish(process)
    assert code == 1
    assert "machine_1-machine_2 ended with code 0" in errors
    assert graph_processes(domain) == []


@pytest.fixture
def sent(domain):
    """When experiments were sent, by their sender's stamps [ns]; to be asked for again and again.

    Whoever takes them, a recorder or this one, may be late with one and in time with the next.
    """
    context = rclpy.Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("listener", context=context)
    stamps: list[int] = []

    def take(_message: Float64MultiArray, about: dict[str, int]) -> None:
        stamps.append(about["source_timestamp"])

    node.create_subscription(Float64MultiArray, "experiment", take, qos("experiment"))
    executor = SingleThreadedExecutor(context=context)  # the other one knows no stamps
    executor.add_node(node)

    def so_far() -> list[int]:
        executor.spin_once(timeout_sec=0.05)
        return stamps

    yield so_far
    executor.shutdown()
    node.destroy_node()
    rclpy.try_shutdown(context=context)


def test_real_time_paces_the_experiments(start, sent):
    """At 20 times real time, three experiments of 20 s take three seconds and not much more."""
    began = time.monotonic()
    process = start("--experiments", "3", "--rate", "20", "--bag", "run")
    stamps = wait_for(lambda: len(found := sent()) == 3 and found, "three experiments")
    code, _, errors = finish(process)
    assert (code, complaints(errors)) == (0, "")
    gaps = [(b - a) / 1e9 for a, b in itertools.pairwise(stamps)]
    assert all(0.9 <= gap <= 1.5 for gap in gaps), gaps
    assert time.monotonic() - began > 3


def test_the_caller_keeps_its_own_ros_and_its_environment(domain, tmp_path):
    """`launch` from other code leaves the default context, the environment and the domain alone."""
    from ldt_ros.up import launch

    rclpy.init()
    before = dict(os.environ)
    try:
        (run,) = launch({"experiments": 2, "model": "physics", "bag": str(tmp_path / "run")})
        assert run.summary.experiments == 2
        assert rclpy.ok()
        assert dict(os.environ) == before
        observer = rclpy.create_node("observer")
        time.sleep(0.5)
        assert observer.get_node_names() == ["observer"]
        observer.destroy_node()
    finally:
        rclpy.try_shutdown()


def test_the_settings_of_a_run_that_goes_on_are_read_once(tmp_path, monkeypatch, capsys):
    """Of a long recording that takes a while; whoever calls `launch` gets them as well."""
    from ldt_core.base.errors import LdtError
    from ldt_core.cli import invoke
    from ldt_core.restart import run_key
    from ldt_ros import up

    read = []

    def resumed(settings):
        read.append(settings["resume"])
        return {**settings, "seed": 5}

    def secured(settings, *_):
        raise LdtError(f"seed {settings['seed']}")

    monkeypatch.setattr(run_key, "resumed", resumed)
    monkeypatch.setattr(up, "secured", secured)
    monkeypatch.setattr(up, "prepare", lambda folder: {})
    assert invoke(up.command, ["--resume", "run"]) == 1
    assert capsys.readouterr().err == "ldt: seed 5\n"
    with pytest.raises(LdtError, match="seed 5"):
        up.launch({"resume": "run"})
    assert read == ["run", "run"]


def test_a_start_that_fails_leaves_nothing_that_nobody_is_told_of(tmp_path, monkeypatch):
    """An empty folder in /tmp, each time."""
    from ldt_core.base.errors import LdtError
    from ldt_ros import up

    def secured(*_):
        raise LdtError("no process of a node can be started")

    monkeypatch.setattr(up, "secured", secured)
    monkeypatch.setattr(up, "prepare", lambda folder: {})
    monkeypatch.setattr(up.tempfile, "tempdir", str(tmp_path))
    with pytest.raises(LdtError, match="no process"):
        up.launch({})
    assert list(tmp_path.iterdir()) == []


def test_a_run_beside_a_machine_that_streams_has_no_end_unless_one_is_given(monkeypatch, tmp_path):
    """It ended after 200 experiments, a quarter of an hour, and nobody had asked for that."""
    from ldt_core.base.errors import LdtError
    from ldt_core.cli import invoke
    from ldt_ros import up

    asked = []

    def secured(settings, *_):
        asked.append(settings["experiments"])
        raise LdtError("enough")

    monkeypatch.setattr(up, "secured", secured)
    monkeypatch.setattr(up, "prepare", lambda folder: {})
    file = tmp_path / "given.yaml"
    file.write_text("experiments: 300\n")
    stream = ("--source", "stream")
    for more in (stream, (*stream, "--experiments", "200"), (*stream, "--settings", str(file)), ()):
        assert invoke(up.command, list(more)) == 1
    assert asked == [up.ENDLESS, 200, 300, 200]


def test_two_graphs_that_start_at_the_same_moment_do_not_merge(start):
    """Whichever goes on alone is right; one that shares its topics with another ends with 2."""
    common = ("--experiments", "15", "--rate", "40", "--json")
    both = [start(*common, "--seed", k, "--bag", f"run_{k}") for k in ("5", "6")]
    ends = [finish(process) for process in both]
    assert any(code == 2 for code, _, _ in ends), ends
    for code, output, errors in ends:
        if code == 2:
            assert "ROS_DOMAIN_ID" in errors
        else:
            assert code == 0
            assert json.loads(output)["runs"][0]["experiments"] == 15
