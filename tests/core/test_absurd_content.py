"""Valid messages of absurd content, and parts that fail: each costs one experiment, never a run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ldt_core.base.errors import ExperimentError, UnansweredExperiment
from ldt_core.base.experiment import FAILED, Action, Experiment
from ldt_core.base.settings import resolve
from ldt_core.cli import invoke, ldt
from ldt_core.detectors.threshold import Threshold
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine
from ldt_core.models.physics import PhysicsModel
from ldt_core.notebook.gap_diagnosis import diagnose
from ldt_core.recording.bag import read_bag
from ldt_core.restart.recorded_run import complete_steps
from ldt_core.runs import offline
from ldt_core.twin.loop import Twin

SHORT = replace(load_machine("rotor"), duration=2.0)
COUNT, BAD = 6, 3  # experiments, the one among them that is absurd


def zigzag(e: Experiment, size: float) -> Experiment:
    """Alternating finite speeds."""
    return replace(e, speed=np.where(np.arange(len(e)) % 2, size, -size))


ABSURD = {
    "largest speeds": (lambda e: zigzag(e, 1e308), "speed: expected at most 8e+05 rad/s"),
    "squares overflow": (lambda e: zigzag(e, 1e200), "speed: expected"),
    "a unit a million too small": (lambda e: zigzag(e, 40e6), "speed: expected"),
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


def test_a_model_that_fails_leaves_one_experiment_unanswered(monkeypatch):
    """That is told as what it is, a failure of the work, and the run goes on."""
    predict = PhysicsModel.predict

    def fail(self, experiment):
        if experiment.number == BAD:
            raise OverflowError("too large")
        return predict(self, experiment)

    monkeypatch.setattr(PhysicsModel, "predict", fail)
    settings = resolve({"model": "physics"})
    summary = offline.run(SHORT, settings, made(), None)
    assert summary.experiments == COUNT - 1
    assert summary.failures == [f"experiment {BAD} is not answered: OverflowError: too large"]
    refused: list[Exception] = []
    list(Twin.from_settings(SHORT, settings).steps(made(), refused.append))
    assert [type(e) for e in refused] == [UnansweredExperiment]


def test_an_experiment_without_an_answer_is_the_exit_code(monkeypatch, capsys):
    """1, after the table, with a sentence that says which."""
    predict = PhysicsModel.predict

    def fail(self, experiment):
        if experiment.number == BAD and len(experiment) > 3:
            raise OverflowError("too large")
        return predict(self, experiment)

    monkeypatch.setattr(PhysicsModel, "predict", fail)
    arguments = ["run", "--model", "physics", "--experiments", "4", "--no-bag"]
    assert invoke(ldt, arguments) == 1
    told = capsys.readouterr()
    assert "experiments" in told.out
    words = f"rotor: experiment {BAD} is not answered: OverflowError: too large"
    assert told.err == f"ldt: {words}\n"


def test_a_machine_heavier_than_any_is_diagnosed_within_memory():
    """Its motor remembers 10^15 s: as many samples of the past were asked for."""
    heavy = replace(SHORT, parameters={**SHORT.parameters, "J": 1e15})
    found = diagnose(made(3), heavy)
    assert found.verdict.kind in ("effect", "ambiguous", "unknown")
