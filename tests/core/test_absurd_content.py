"""Valid messages of absurd content, and parts that fail: each costs one experiment, never a run."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from ldt_core.base.errors import ExperimentError, MachineFileError, UnansweredExperiment
from ldt_core.base.experiment import FAILED, Action, Experiment
from ldt_core.base.metrics import Summary
from ldt_core.base.settings import resolve
from ldt_core.cli import invoke, ldt
from ldt_core.detectors.threshold import Threshold
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine, machine_from_dict
from ldt_core.models.physics import PhysicsModel
from ldt_core.python_api.gap_diagnosis import diagnose
from ldt_core.recording.bag import read_bag
from ldt_core.recording.experiment_messages import samples_cdr
from ldt_core.recording.messages import MULTI_ARRAY
from ldt_core.recording.pace import paced
from ldt_core.recording.writer import BagWriter
from ldt_core.restart.recorded_run import complete_steps
from ldt_core.runs import offline
from ldt_core.twin.loop import Twin
from msgs_config import machine_text

SHORT = replace(load_machine("rotor"), duration=2.0)
SAMPLE = Path(__file__).resolve().parents[2] / "bags" / "rotor_drift"
COUNT, BAD = 6, 3  # experiments, the one among them that is absurd


def zigzag(e: Experiment, size: float) -> Experiment:
    """Alternating finite speeds."""
    return replace(e, speed=np.where(np.arange(len(e)) % 2, size, -size))


ABSURD = {
    "largest speeds": (lambda e: zigzag(e, 1e308), "speed: expected at most 8e+05 rad/s"),
    "squares overflow": (lambda e: zigzag(e, 1e200), "speed: expected"),
    "a unit a million too small": (lambda e: zigzag(e, 40e6), "speed: expected"),
    "a time that no recording can hold": (
        lambda e: replace(e, start=1e17),
        "start time: expected 0 to 9.2e+09 s",
    ),
    "before all time": (lambda e: replace(e, start=-1e9), "start time: expected"),
    "largest current": (lambda e: replace(e, current=0 * e.speed + 1e200), "current: expected"),
    "seconds for milliseconds": (lambda e: replace(e, period=10.0), "sample period: expected"),
    "longest period": (lambda e: replace(e, period=1e300), "sample period: expected"),
    "shortest period": (lambda e: replace(e, period=5e-324), "sample period: expected"),
    "a day at a stroke": (
        lambda e: Experiment(e.number, e.start, 1.0, np.zeros(86400), np.zeros(86400)),
        "duration: expected at most 25000 s",
    ),
    "more samples than anybody needs": (
        lambda e: Experiment(e.number, e.start, 0.001, np.zeros(4_000_001), np.zeros(4_000_001)),
        "expected at most 4000000 samples",
    ),
}


def made(count: int = COUNT) -> list[Experiment]:
    """Sound experiments of the short rotor."""
    plant = Plant.from_settings(SHORT, resolve({"seed": 3, "start_time": 1e9}))
    return [plant.experiment(number) for number in range(1, count + 1)]


@pytest.mark.parametrize("name", ABSURD)
@pytest.mark.parametrize("gate", ["none", "holdout"])
def test_what_is_absurd_is_refused_before_anything_is_computed(name, gate, monkeypatch):
    """With one clear reason; the others come out as if it had never been sent."""
    change, words = ABSURD[name]
    settings = resolve({"model": "linear", "gate": gate, "sensor_check": False})
    sound = made()
    spared = [e for e in sound if e.number != BAD]
    sent = [change(e) if e.number == BAD else e for e in sound]
    refused: list[Exception] = []
    steps = list(Twin.from_settings(SHORT, settings).steps(sent, refused.append))
    (error,) = refused
    assert isinstance(error, ExperimentError)
    assert words in str(error)
    assert len(str(error)) < 200
    for step, alone in zip(steps, Twin.from_settings(SHORT, settings).steps(spared), strict=True):
        assert np.array_equal(step.prediction.speed, alone.prediction.speed)
        assert step.adaptation == alone.adaptation
    monkeypatch.setattr(PhysicsModel, "predict", pytest.fail)
    with pytest.raises(ExperimentError):
        Twin(SHORT, model="physics").step(sent[BAD - 1])


class FailsOnce(Threshold):
    """A detector of the user's own that cannot divide by zero."""

    name = "fails_once"

    def update(self, residual, deviation=None):
        """Fail at the third experiment."""
        self.count = getattr(self, "count", 0) + 1
        if self.count == BAD:
            raise ZeroDivisionError("division by zero")
        super().update(residual, deviation)


def test_a_detector_that_fails_costs_one_experiment():
    """It is refused with the reason, recorded, told of; the run goes on."""
    twin = Twin(SHORT, model="linear", detector=FailsOnce(threshold=1.0))
    steps = list(twin.steps(made(), pytest.fail))
    assert [s.number for s in steps] == list(range(1, COUNT + 1))
    failed = steps[BAD - 1]
    assert failed.signal.level.word == "warning"
    assert failed.signal.state == "learning"
    assert failed.adaptation.action is Action.REFUSED
    assert failed.adaptation.details[FAILED] == 1
    assert "the detector failed" in failed.adaptation.reason
    assert all(FAILED not in s.adaptation.details for s in steps if s is not failed)
    assert failed.experiment not in twin.adaptor.memory.recent


def test_an_adaptor_that_fails_costs_one_experiment(tmp_path, monkeypatch):
    """The model stays; the recording has the step, and a run that goes on passes over it."""
    given = resolve({"model": "linear", "detector": "threshold", "threshold": 0.1, "gate": "none"})
    twin = Twin.from_settings(SHORT, given)
    learn = type(twin.adaptor)._learn

    def fail(self, experiment):
        if experiment.number == BAD:
            raise ValueError("a nan\nfrom nowhere")
        return learn(self, experiment)

    monkeypatch.setattr(type(twin.adaptor), "_learn", fail)
    steps = list(twin.steps(made(), pytest.fail))
    told = steps[BAD - 1].adaptation
    assert told.reason.startswith("nothing is learned: ValueError: a nan from nowhere; version ")
    assert told.model_version == steps[BAD - 2].adaptation.model_version
    assert steps[BAD].adaptation.action is Action.ADAPTED
    summary = offline.run(SHORT, given, made(), tmp_path / "run")
    assert any("ValueError: a nan from nowhere" in note for note in summary.notes)
    bag = read_bag(tmp_path / "run")
    assert [s.number for s in complete_steps(bag, SHORT)] == list(range(1, COUNT + 1))
    resumed = {**given, "resume": str(tmp_path / "run")}
    again = offline.run(SHORT, resumed, made(COUNT + 1), tmp_path / "run")
    assert again.experiments == COUNT + 1


@pytest.fixture
def failing(monkeypatch):
    """The physics fails at an experiment, and not at those that nobody has sent."""
    predict = PhysicsModel.predict

    def fail(self, experiment):
        if experiment.number == BAD and len(experiment) > 3:
            raise OverflowError("too large")
        return predict(self, experiment)

    monkeypatch.setattr(PhysicsModel, "predict", fail)


def test_a_model_that_fails_leaves_one_experiment_unanswered(failing):
    """That is told as what it is, a failure of the work, and the run goes on."""
    settings = resolve({"model": "physics"})
    summary = offline.run(SHORT, settings, made(), None)
    assert summary.experiments == COUNT - 1
    assert summary.failures == [f"experiment {BAD} is not answered: OverflowError: too large"]
    refused: list[Exception] = []
    list(Twin.from_settings(SHORT, settings).steps(made(), refused.append))
    assert [type(e) for e in refused] == [UnansweredExperiment]


def test_an_experiment_without_an_answer_is_the_exit_code(failing, capsys):
    """1, after the table, with a sentence that says which."""
    arguments = ["run", "--model", "physics", "--experiments", "4", "--no-bag"]
    assert invoke(ldt, arguments) == 1
    told = capsys.readouterr()
    assert "experiments" in told.out
    words = f"rotor: experiment {BAD} is not answered: OverflowError: too large"
    assert told.err == f"ldt: {words}\n"


@pytest.mark.parametrize("seed", [-1, 2**70])
def test_a_seed_that_is_none_is_refused(seed, capsys):
    """As by all other commands, and from Python."""
    assert invoke(ldt, ["diagnose", str(SAMPLE), "--seed", str(seed), "--out", "none"]) == 2
    assert capsys.readouterr().err.startswith("ldt: --seed: expected 0 to 4294967295")


def test_a_pace_beyond_all_clocks_waits():
    """An experiment of 2 s at a rate of 1e-300, or the next one in a thousand years."""

    waits = []

    class Stop(threading.Event):
        def wait(self, timeout=None):
            waits.append(timeout)
            return super().wait(0 * timeout)

    later = [replace(e, start=e.start + 1e9 * e.number) for e in made(2)]
    assert list(paced(later, 1e-300, Stop())) == later
    assert max(waits) == threading.TIMEOUT_MAX


def test_a_name_of_any_length_is_not_repeated_in_every_sentence():
    """5000 characters came back with each."""
    text = machine_text("rotor").replace("name: rotor", "name: " + "x" * 5000)
    with pytest.raises(MachineFileError, match="name: expected at most 200 characters, got 5000"):
        machine_from_dict(yaml.safe_load(text), "mine.yaml")


@pytest.mark.parametrize("size", [0.0, 1e-30, 1e-299, 5e-324])
def test_signals_of_no_size_are_diagnosed_as_a_machine_at_rest(size):
    """Of what is no volt no effect's size can be made."""
    sound = [replace(e, voltage=size * e.voltage, speed=size * e.speed) for e in made(3)]
    assert diagnose(sound, SHORT).verdict.kind in ("none", "unknown")


@pytest.mark.parametrize("bad", [(BAD,), range(1, COUNT + 1)])
def test_what_is_refused_is_not_answered_and_the_exit_code_of_a_replay(bad, tmp_path, capsys):
    """1, with the sentence that says which and why; all of them, as of another machine, too."""
    with BagWriter(tmp_path / "sent", "rotor") as writer:
        for e in made():
            sent = replace(e, period=10.0) if e.number in bad else e
            writer.write("experiment", sent, sent.end)
    arguments = ["replay", tmp_path / "sent", "--model", "physics", "--out", tmp_path / "run"]
    assert invoke(ldt, [str(a) for a in arguments]) == 1
    told = capsys.readouterr().err
    assert told.startswith(f"ldt: rotor: not answered: experiment {bad[0]}, sample period: ")
    assert told.endswith("; and 3 more\n") is (len(bad) == COUNT)


def damaged(experiment: Experiment) -> bytes:
    """Its message, with a speed that is none."""
    data = bytearray(samples_cdr(experiment))
    data[-8:] = np.float64(np.nan).tobytes()
    return bytes(data)


@pytest.mark.parametrize("command", ["run", "replay"])
def test_a_message_that_is_no_experiment_does_not_end_what_plays_it(command, tmp_path, capsys):
    """The others are answered; the one is the exit code. It ended the run, with those behind it."""
    sent = tmp_path / "sent"
    with BagWriter(sent, "rotor") as writer:
        for e in made():
            data = damaged(e) if e.number == BAD else samples_cdr(e)
            writer.write_raw("/experiment", MULTI_ARRAY, data, round(e.end * 1e9))
    arguments = {"run": ["run", "--play", sent], "replay": ["replay", sent]}[command]
    out = ["--model", "physics", "--out", tmp_path / "run"]
    assert invoke(ldt, [str(a) for a in [*arguments, *out]]) == 1
    assert f"not answered: {sent}, /experiment, message {BAD}, " in capsys.readouterr().err
    recorded = complete_steps(read_bag(tmp_path / "run"), load_machine("rotor"))
    assert [s.number for s in recorded] == [n for n in range(1, COUNT + 1) if n != BAD]


def test_where_no_message_is_an_experiment_the_recording_is_refused(tmp_path, capsys):
    """As bad input: nothing of it could be played."""
    with BagWriter(tmp_path / "sent", "rotor") as writer:
        for e in made():
            writer.write_raw("/experiment", MULTI_ARRAY, damaged(e), round(e.end * 1e9))
    arguments = ["replay", tmp_path / "sent", "--model", "physics", "--out", tmp_path / "run"]
    assert invoke(ldt, [str(a) for a in arguments]) == 2
    assert "/experiment, message 1, " in capsys.readouterr().err


def test_a_run_that_fails_throughout_says_so_in_bounded_words():
    """Of 100,000 experiments a sentence each would be found again in none of them."""
    summary = Summary()
    for number in range(1, 100_001):
        summary.reject(UnansweredExperiment(number, "ZeroDivisionError"))
    assert (len(summary.failures), summary.further_failures) == (100, 99_900)
    assert summary.as_dict()["notes"][-1] == "99900 more experiments not answered"


def test_a_machine_heavier_than_any_is_diagnosed_within_memory():
    """Its motor remembers 10^15 s: as many samples of the past were asked for."""
    heavy = replace(SHORT, parameters={**SHORT.parameters, "J": 1e15})
    found = diagnose(made(3), heavy)
    assert found.verdict.kind in ("effect", "ambiguous", "unknown")


def test_fragments_among_experiments_are_left_out_of_a_diagnosis():
    """A sequence that is cut short now and then; the gradient of one sample was asked for."""
    cut = [e.part(0, e.number // 2 + 1) if e.number % 2 else e for e in made()]
    found = diagnose(cut, SHORT)
    assert "3 experiments of fewer than 10 samples left out" in found.notes
    assert {*found.experiments["fit"], *found.experiments["held_out"]} == {2, 4, 6}


HIDDEN = {
    "masked": (np.ma.masked_greater([1.0, 2.0, 9.0], 8.0), "finite samples, got nan at sample 2"),
    "dates": (np.zeros(3, "M8[s]"), "a row of numbers"),
    "durations": (np.zeros(3, "m8[s]"), "a row of numbers"),
}


@pytest.mark.parametrize("name", HIDDEN)
def test_what_numpy_makes_numbers_of_and_is_none_is_refused(name):
    """What stands under a mask was learned from, and times as seconds since 1970."""
    values, words = HIDDEN[name]
    with pytest.raises(ExperimentError, match=f"voltage: expected {words}"):
        Experiment(1, 1e9, 0.1, values, [0.0, 0.0, 0.0])
