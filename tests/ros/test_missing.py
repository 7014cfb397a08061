"""What was sent and not answered, or not recorded, makes a run fail, and which is said."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

import msgs_config
from ldt_core.base.errors import BadInput
from ldt_core.base.settings import resolve
from ldt_core.machine.machine_file import load_machine
from ldt_core.recording.experiment_numbers import ExperimentNumbers
from ldt_core.recording.node_status import (
    INTERRUPTIONS,
    LAST_INTERRUPTION,
    LAST_REJECTION,
    REJECTED,
    RESUMED_AT,
    NodeStatus,
)
from ldt_core.restart.run_key import key_text

pytest.importorskip("rclpy")

from ldt_ros.graph.machine_run import HostProcess, MachineRun, machine_runs, write_parameters
from ldt_ros.graph.respawn import Respawner
from ldt_ros.graph.supervisor import Child

VANISHED = "r1: the file or its folder was deleted"
LOST = {INTERRUPTIONS: "1", LAST_INTERRUPTION: VANISHED}
FAILED = {REJECTED + "experiment: UnansweredExperiment": "1", LAST_REJECTION: "x"}
REFUSED = {REJECTED + "experiment: ExperimentError": "1", LAST_REJECTION: "x"}


def failures(in_bag, adapted, heard, **nodes) -> list[str]:
    """Of a run of four experiments."""
    run = MachineRun("rotor", "", resolve({}), "r1", load_machine("rotor"))
    run.summary.recorded = [(number, 100.0 + number) for number in in_bag]
    run.summary.answered = [(number, 100.0 + number) for number in adapted]
    run.summary._signals[0] = len(adapted)
    told = {"plant": {"sent": "4", "experiment": "4"}, **nodes}
    health = {role: NodeStatus(role, "", values) for role, values in told.items()}
    run.note_health(health, ExperimentNumbers((n, n) for n in heard))
    return run.summary.failures


def test_what_is_not_in_the_recording_is_named_with_the_cause():
    """The experiments went all the way; the recording is what failed."""
    assert failures([], [], [1, 2, 3, 4], recorder=LOST) == [
        "4 of 4 experiments sent are missing, "
        f"answered and not in the recording: experiments 1 to 4 ({VANISHED})"
    ]


def test_what_went_with_a_deleted_folder_is_not_said_to_be_unanswered():
    """A run that was gone on with: the experiments of before were in the recording."""
    words = f"2 of 4 experiments sent are missing, no longer in the recording ({VANISHED})"
    assert failures([3, 4], [3, 4], [3, 4], recorder=LOST) == [words]


def test_what_a_node_rejected_is_one_note_with_one_reason():
    """A disk that was full filled the screen with seven times the same sentence."""
    run = MachineRun("rotor", "", resolve({}), "r1", load_machine("rotor"))
    more = {**FAILED, REJECTED + "model: ModelError": "2", **LOST}
    run.note_health({"twin": NodeStatus("twin", "", more)}, ExperimentNumbers())
    kinds = "experiment: UnansweredExperiment: 1, model: ModelError: 2"
    stopped = f"1 interruption of the recording, the last: {VANISHED}"
    assert run.summary.notes == [f"twin rejected {kinds} (x)", stopped]


def test_what_nobody_answered_is_named():
    """Also where the twin says that it failed, and why it refused."""
    words = "1 of 4 experiments sent are missing, not answered: experiment 3"
    assert failures([1, 2, 3, 4], [1, 2, 4], [1, 2, 4]) == [words]
    assert failures([1, 2, 3, 4], [1, 2, 4], [1, 2, 4], twin=FAILED) == [words]
    words = "1 of 4 experiments sent are refused, not answered: experiment 3 (x)"
    assert failures([1, 2, 3, 4], [1, 2, 4], [1, 2, 4], twin=REFUSED) == [words]
    # A stranger's, beside a run that is answered whole.
    assert failures([1, 2, 3, 4], [1, 2, 3, 4], [1, 2, 3, 4], twin=REFUSED) == []
    assert failures([1, 2, 3, 4], [1, 2, 3, 4], [1, 2, 3, 4]) == []


def test_what_nobody_of_the_run_sent_is_no_success():
    """A stranger that counts alike, too quick for anybody to see it come and go."""
    words = "a stranger's, not sent by the plant: 1 of 5 experiments in the recording"
    assert failures([1, 2, 3, 4, 5], [1, 2, 3, 4, 5], [1, 2, 3, 4, 5]) == [words]


def test_what_the_player_could_not_read_is_named():
    """It was never sent: the others are answered, and the run is not whole."""
    run = MachineRun("rotor", "", resolve({"play": "there"}), "r1", load_machine("rotor"))
    run.note_health({"player": NodeStatus("player", "", REFUSED)}, ExperimentNumbers())
    words = "1 experiment of the recording cannot be sent, not answered (x)"
    assert (run.summary.failures, run.summary.rejected) == ([words], 1)


def test_a_run_that_goes_on_is_judged_by_what_it_sends_itself():
    """Of those before, refused ones among them, its nodes know nothing."""
    began = {"sent": "4", "experiment": "4", "resumed": "3", RESUMED_AT: "103.0"}
    assert failures([1, 2, 3, 4], [1, 3, 4], [4], plant=began) == []
    words = "1 of 1 experiments sent are missing, not answered: experiment 4"
    assert failures([1, 2, 3, 4], [1, 3], [], plant=began) == [words]


def test_a_machines_name_is_no_path(tmp_path):
    """A slash in it made files elsewhere, or none."""
    file = tmp_path / "mine.yaml"
    text = msgs_config.machine_text("rotor")
    file.write_text(text.replace("name: rotor", "name: a/../../b"))
    (run,) = machine_runs(resolve({"machine": str(file), "bag": str(tmp_path / "run")}))
    folder = tmp_path / "run_files"
    folder.mkdir()
    assert Path(write_parameters(run, folder)).resolve().parent == folder
    assert len(list(folder.iterdir())) == 2


@pytest.mark.parametrize("then", ["other", "none"])
def test_a_machine_file_that_is_edited_changes_nothing_in_the_run(then, tmp_path):
    """A node that is started again gets the machine that the run began with."""
    file, text = tmp_path / "mine.yaml", msgs_config.machine_text("rotor")
    file.write_text(text)
    settings = {"machine": str(file), "bag": str(tmp_path / "run")}
    (run,) = machine_runs(resolve(settings))
    file.write_text(text.replace("K_t: 0.3 ", "K_t: 0.6 ") if then == "other" else "{")
    for resume in ("", "run"):  # at first, and again
        told = yaml.safe_load(Path(write_parameters(run, tmp_path, resume=resume)).read_text())
        again = load_machine(told["/**"]["ros__parameters"]["machine"])
        assert key_text(again, {}) == key_text(load_machine("rotor"), {})
    assert str(file) in run.settings["run_settings"]


@pytest.mark.parametrize("then", ["edited", "deleted", "as before"])
def test_an_own_part_that_is_edited_does_not_come_into_the_run(then, tmp_path):
    """A node that crashed would go on by other code than the run began with."""

    class Started:
        folder = tmp_path / "files"
        children, restarted = (), 0

        def start(self, name, *arguments):
            return Child(name, 0, tmp_path / "log", returncode=-9)

        def restart(self, child):
            self.restarted += 1

    part = tmp_path / "mine.py"
    part.write_text("class Mine: pass\n")
    settings = resolve({"detector": f"{part}:Mine"})
    run = MachineRun("rotor", "", settings, tmp_path / "r1", load_machine("rotor"))
    supervisor = Started()
    respawner = Respawner(supervisor, {"rotor": type("", (), {"last_step": 3, "statements": {}})()})
    child = respawner.start(HostProcess("detector", [run], "detector", []))
    if then == "edited":
        part.write_text("class Mine: threshold = 3\n")
    elif then == "deleted":
        part.unlink()
    if then == "as before":
        assert respawner._start_again(child)
        assert supervisor.restarted == 1
        return
    with pytest.raises(BadInput, match=r"mine\.py: expected what it was when the run began"):
        respawner._start_again(child)
    assert supervisor.restarted == 0
