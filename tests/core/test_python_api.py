"""`import ldt_core as ldt`: what a person in a notebook uses, with the numbers of the commands."""

from __future__ import annotations

import copy
import dataclasses
import html
import json
import os
import pickle
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import ldt_core as ldt
from ldt_core.cli import invoke
from ldt_core.cli import ldt as command
from ldt_core.detectors.threshold import Threshold
from ldt_core.effects import get_effect
from ldt_core.models.linear import LinearModel

FEW = ["--machine", "dc_motor", "--experiments", "6", "--seed", "3"]
FRICTION = {"coulomb_friction": {"torque": 0.01}}
LINEAR = {"model": "linear", "order": 1, "detector": "threshold", "threshold": 0.5}
AS_OPTIONS = ["--model", "linear", "--order", "1", "--detector", "threshold", "--threshold", "0.5"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Has `worn`, a recording of a motor with friction, and `learned`, a run of a twin on it."""
    place = tmp_path_factory.mktemp("recordings")
    worn, learned = str(place / "worn"), str(place / "learned")
    effect = ["--effect", "coulomb_friction:torque=0.01"]
    assert invoke(command, ["simulate", *FEW, *effect, "--out", worn]) == 0
    machine = ["--machine", "dc_motor"]
    assert invoke(command, ["replay", worn, *machine, *AS_OPTIONS, "--out", learned]) == 0
    return place


@pytest.fixture(scope="module")
def worn(folder) -> ldt.Recording:
    """Of a machine alone."""
    return ldt.read(folder / "worn")


@pytest.fixture(scope="module")
def learned(folder) -> ldt.Recording:
    """Of a twin."""
    return ldt.read(folder / "learned")


@pytest.fixture(scope="module")
def run(worn) -> ldt.TwinRun:
    """The same as in `learned`, by Python."""
    return ldt.run(worn, "dc_motor", **LINEAR)


def plain(step) -> list:
    """All that a step holds, bit by bit."""
    predicted = [p and p.speed.tobytes() for p in (step.prediction, step.original)]
    told, done = step.signal, step.adaptation
    return [
        *(step.experiment.number, step.experiment.speed.tobytes(), predicted),
        *(told.level, told.max_error, dict(told.statistics), done.action, done.reason),
        *(done.model_version, step.model and dict(step.model.parameters)),
    ]


def test_the_import_loads_nothing_that_takes_time():
    """Neither ROS nor numpy, before a name is used."""
    code = "import sys, ldt_core; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {name.partition(".")[0] for name in done.stdout.split()}
    assert not loaded & {"numpy", "scipy", "numba", "sklearn", "pandas", "yaml", "rclpy"}


def test_every_public_name_is_there_and_listed():
    """Also to completion, and none hides a module."""
    assert set(ldt.__all__) < set(dir(ldt))
    assert [name for name in ldt.__all__ if not getattr(ldt, name)] == []
    modules = {p.stem for p in Path(ldt.__file__).parent.iterdir()}
    assert not modules & set(ldt.__all__)
    assert re.fullmatch(r"\d+\.\d+\.\d+", ldt.__version__)
    with pytest.raises(AttributeError, match="has no attribute 'reed'"):
        ldt.reed  # noqa: B018


def test_a_recording_is_a_sequence_of_experiments(worn):
    """As often as one likes, in recorded order; nothing of a twin in it."""
    assert [e.number for e in worn] == [e.number for e in worn] == [1, 2, 3, 4, 5, 6]
    assert (len(worn), worn[-1].number, len(worn[:2])) == (6, 6, 2)
    assert (worn.machine, worn.steps, worn.notes) == ("dc_motor", [], [])
    assert repr(worn).endswith("worn', dc_motor, 6 experiments, machine alone)")


def test_a_machine_is_made_from_its_name_file_or_keys(tmp_path):
    """And from a machine, which it then equals."""
    rotor = ldt.Machine("rotor")
    file = tmp_path / "mine.yaml"
    file.write_text(json.dumps(rotor.as_dict()))
    again = [ldt.Machine(m).as_dict() for m in (rotor, file, str(file), rotor.as_dict())]
    assert again == [rotor.as_dict()] * 4
    assert isinstance(rotor.with_parameters(e=0.005), ldt.Machine)
    assert repr(rotor) == "Machine('rotor', dc_motor_rotor, 2000 samples at 0.01 s)"


def test_simulating_gives_the_experiments_of_the_command(worn):
    """To the last bit, however the effect is named."""
    from ldt_core.effects import get_effect

    friction = get_effect("coulomb_friction")
    for effects in (FRICTION, {friction: {"torque": 0.01}}, ["coulomb_friction:torque=0.01"]):
        made = ldt.simulate("dc_motor", experiments=6, effects=effects, seed=3)
        assert [e.speed.tobytes() for e in made] == [e.speed.tobytes() for e in worn]
        assert [e.voltage.tobytes() for e in made] == [e.voltage.tobytes() for e in worn]
    typical = ldt.simulate("dc_motor", 1, friction, noise=0, measure_current=True)
    assert typical[0].current is not None


def test_a_run_gives_the_numbers_of_the_command(run, learned):
    """Predictions, signals, models and errors to the last bit."""
    assert len(learned.steps) == len(run.steps) == 6
    assert any(step.model for step in run.steps)
    assert [plain(step) for step in run.steps] == [plain(step) for step in learned.steps]


def test_a_run_s_figures_are_those_of_the_command(run, folder, tmp_path, capsys):
    """`--json` of `ldt replay`, and of `ldt run` on the same simulated machine."""
    replayed = ["replay", str(folder / "worn"), "--machine", "dc_motor", *AS_OPTIONS]
    assert invoke(command, [*replayed, "--out", str(tmp_path / "o"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["runs"][0]
    assert {n: told[n] for n in run.summary.as_dict()} == run.summary.as_dict()
    assert (run.mme, run.mme_original) == (told["mme"], told["mme_original"])
    once = ["run", *FEW, *AS_OPTIONS, "--degradation", "none", "--no-bag", "--json"]
    assert invoke(command, [*once, "--effect", "coulomb_friction:torque=0.01"]) == 0
    told = json.loads(capsys.readouterr().out)["runs"][0]
    assert told["mme"] == run.mme


def test_models_and_detectors_may_be_names_classes_or_objects(worn, run):
    """They give the same; an object that is passed stays as it was."""

    class Above:
        """River's convention."""

        drift_detected = False
        seen = 0

        def update(self, x):
            self.seen += 1
            self.drift_detected = x > 0.5

    machine, own = ldt.Machine("dc_motor"), Above()
    for model, detector in (
        (LinearModel, Threshold(0.5)),
        (LinearModel(machine, order=1), Threshold),
        ("linear", own),
    ):
        other = ldt.run(worn, machine, model, detector, order=1, threshold=0.5)
        assert other.mme == run.mme, detector
    assert own.seen == 0
    assert {s.signal.detector for s in other.steps} == {"Above"}


def test_a_detector_of_one_s_own_decides(worn):
    """A subclass of `ldt.Detector`; its name stands in the signals."""

    class EveryOther(ldt.Detector):
        name = "every_other"

        def __init__(self):
            self.reset()

        def reset(self):
            super().reset()
            self.count = 0

        def judge(self, residual, deviation):
            self.count += 1
            return ldt.Level.POSITIVE if self.count == 2 else ldt.Level.NEGATIVE

    steps = ldt.run(worn, "dc_motor", model="physics", detector=EveryOther()).steps
    assert [s.signal.level.word for s in steps] == ["negative", "positive"] * 3
    assert steps[0].signal.detector == "every_other"


def test_a_detector_object_of_river_is_fed_with_the_largest_errors(worn):
    """Those that are made for yes and no are refused, with the way to use them."""
    drift = pytest.importorskip("river.drift")
    given = drift.PageHinkley(min_instances=2, threshold=0.5)
    steps = ldt.run(worn, "dc_motor", "physics", given).steps
    assert [s.signal.statistics["input"] for s in steps] == [s.signal.max_error for s in steps]
    with pytest.raises(ldt.BadInput, match="river_detector=DDM and input=errors"):
        ldt.Twin("dc_motor", detector=drift.binary.DDM())


def test_arrays_are_written_as_a_recording_that_commands_read(worn, tmp_path, capsys):
    """What is read is what was written, current included; no folder is replaced."""
    arrays = np.linspace(0.0, 1.0, 300)
    made = ldt.Experiment(1, 2.0, 0.01, voltage=arrays, speed=arrays**2, current=arrays**3)
    ldt.write([made], tmp_path / "made", "dc_motor")
    again = ldt.read(tmp_path / "made")
    assert (len(again), again.machine, again.notes) == (1, "dc_motor", [])
    assert dataclasses.asdict(again[0]).keys() == dataclasses.asdict(made).keys()
    for channel in ("voltage", "speed", "current"):
        assert np.array_equal(getattr(again[0], channel), getattr(made, channel))
    ldt.write(worn[2:4], str(tmp_path / "some"))
    assert invoke(command, ["info", str(tmp_path / "some")]) == 0
    assert "experiments  2, numbers 3" in capsys.readouterr().out
    for wrong, words in (
        (lambda: ldt.write([made], tmp_path / "made"), "a folder that does not exist yet"),
        (lambda: ldt.write(made, tmp_path / "new"), "then the folder to make"),
        (
            lambda: ldt.write("new", [made]),
            "expected first experiments .* got 'new', then",
        ),
        (lambda: ldt.write([], tmp_path / "new"), "recording: expected experiments, got none"),
        (lambda: ldt.write([arrays], tmp_path / "new"), "item 0: expected an ldt.Experiment"),
        (lambda: ldt.write([made], tmp_path / "new", "no_such"), "machine: expected"),
    ):
        with pytest.raises(ldt.BadInput, match=words):
            wrong()
    assert not (tmp_path / "new").exists()


def test_the_cause_may_be_an_effect_of_ones_own(worn):
    """It learns what the library's learns, under its own name; a model can be kept."""
    mine = dataclasses.replace(get_effect("coulomb_friction"), name="my_friction")
    chosen = {"model": "diagnosed", "detector": "threshold", "threshold": 0.5}
    own = ldt.run(worn[:3], "dc_motor", cause=mine, **chosen)
    named = ldt.run(worn[:3], "dc_motor", cause="coulomb_friction", **chosen)
    assert own.mme == pytest.approx(named.mme, rel=1e-9)
    assert own.mme < 0.8 * own.mme_original
    model = own.twin.model
    assert model.parameters["cause"]["effect"] == "my_friction"
    assert type(model).from_record(model.record(), model.machine, cause=mine).version > 0
    assert copy.deepcopy(model).effect is mine
    with pytest.raises(ldt.BadInput, match="cause: expected a word"):
        ldt.run(worn, "dc_motor", cause=7, **chosen)


def test_a_twin_steps_by_hand(worn, run):
    """The same as a run; each record says of which experiment it is."""
    twin = ldt.Twin("dc_motor", **LINEAR)
    assert repr(twin) == "Twin('dc_motor', linear version 0, threshold)"
    step = twin.step(worn[0])
    assert plain(step) == plain(run.steps[0])
    records = (step.experiment, step.prediction, step.signal, step.adaptation, step)
    assert {record.number for record in records} == {1}
    assert step.prediction.experiment == step.signal.experiment == 1


def test_the_model_auto_is_there_for_commands_too(worn, tmp_path, capsys):
    """With the detector that goes with it, unless another is asked for."""
    twin = ldt.Twin("dc_motor")
    assert (twin.model.kind, twin.detector.name) == ("grey_box", "adequacy")
    assert ldt.Twin("dc_motor", detector="never").detector.name == "never"
    options = ["--machine", "dc_motor", "--experiments", "1", "--model", "auto", "--no-bag"]
    assert invoke(command, ["run", *options]) == 0
    assert "adequacy" in capsys.readouterr().out


def test_what_is_printed_is_short(run, learned):
    """No arrays in a notebook's output."""
    step = run.steps[0]
    shown = [
        repr(x)
        for x in (
            *(run, learned, step, learned.steps[0]),
            *(step.experiment, step.prediction, step.signal, step.adaptation),
        )
    ]
    assert max(map(len, shown)) < 150 + len(learned.path)
    assert repr(step.experiment) == "Experiment(1, 1000 samples at 0.01 s, 10 s)"
    assert repr(run).startswith("TwinRun(6 experiments, MME ")


def test_what_was_rejected_is_printed():
    beyond = ldt.Experiment(1, 0.0, 0.01, voltage=np.full(100, 90.0), speed=np.zeros(100))
    rejected = ldt.run([beyond], "rotor")
    assert repr(rejected) == "TwinRun(no experiments, 1 rejected: see its notes)"
    assert "90 V" in rejected.notes[0]


@pytest.mark.slow
def without() -> list[str]:
    """Effects that are not tried: all of them take a minute."""
    from ldt_core.effects import EFFECTS

    few = ("coulomb_friction", "viscous_friction", "inertia")
    return [name for name in EFFECTS.names() if name not in few]


def test_a_notebook_shows_outcome_and_verdict(run, worn):
    """Text of a file or a machine is escaped."""
    shown = run._repr_html_()
    assert shown.startswith(f"<p><b>{html.escape(run.summary.outcome)}</b></p><table><tr>")
    assert shown.count("<tr>") == len(run.summary.rows())
    found = ldt.diagnose(worn[:3], "dc_motor", without=without())
    hostile = dataclasses.replace(found, notes=("<script>alert(1)</script>",))
    text = hostile._repr_html_()
    assert html.escape(found.verdict.sentence) in text
    assert "<script>" not in text
    assert "&lt;script&gt;" in text


def test_tables_have_one_row_an_experiment(run, learned, worn):
    """Of a run and of its recording the same ones."""
    table = run.to_frame()
    assert list(table["experiment"]) == [1, 2, 3, 4, 5, 6]
    assert table["max_error"].mean() == pytest.approx(run.mme)
    assert set(table["signal"]) <= {"negative", "warning", "positive"}
    assert list(table.columns) == list(learned.to_frame().columns)
    times = ["start"]  # of simulated experiments
    assert table.drop(columns=times).equals(learned.to_frame().drop(columns=times))
    few = ["experiment", "start", "duration", "sample_period", "samples"]
    assert list(worn.to_frame().columns) == few


def test_without_pandas_a_sentence_says_what_to_install(run, monkeypatch):
    """And nothing else needs it."""
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ldt.LdtError, match="pip install pandas"):
        run.to_frame()


@pytest.mark.slow
def test_a_run_is_drawn(run, tmp_path):
    """As a figure of matplotlib, of any experiment."""
    pytest.importorskip("matplotlib")
    run.plot(experiment=2).savefig(tmp_path / "run.png")
    with pytest.raises(ldt.BadInput, match="one of the experiments 1 to 6"):
        run.plot(experiment=7)


@pytest.mark.slow
def test_a_diagnosis_is_that_of_the_command(folder, worn, tmp_path, capsys, undrawn):
    """Key by key; drawn and saved, a page without its figures."""
    pytest.importorskip("matplotlib")
    recording, out = str(folder / "worn"), str(tmp_path / "by_command")
    options = ["--machine", "dc_motor", "--seed", "1"]
    options += [word for name in without() for word in ("--without", name)]
    assert invoke(command, ["diagnose", recording, *options, "--out", out, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    found = ldt.diagnose(recording, "dc_motor", without=without(), seed=1)
    assert found.to_dict() == told
    assert "coulomb_friction" in found.verdict.effects
    assert (found.candidates[0].effect, found.gap.noise_std > 0) == ("coulomb_friction", True)
    assert repr(found) == f"GapDiagnosis({found.verdict.kind}: {found.verdict.sentence})"
    found.plot().savefig(tmp_path / "diagnosis.png")
    found.save(tmp_path / "by_python")
    assert json.loads((tmp_path / "by_python" / "diagnosis.json").read_text()) == told


def test_a_calibration_is_that_of_the_command(folder, worn, tmp_path):
    """The same machine file, and none is overwritten by mistake."""
    given, out = ["--machine", "dc_motor", "--free", "K_t,R"], str(tmp_path / "command.yaml")
    assert invoke(command, ["calibrate", str(folder / "worn"), *given, "--out", out]) == 0
    found = ldt.calibrate(ldt.read(str(folder / "worn")), "dc_motor", free=["K_t", "R"])
    found.save(tmp_path / "python.yaml")
    assert (tmp_path / "python.yaml").read_text() == Path(out).read_text()
    assert found.machine.parameters["K_t"] == ldt.Machine(out).parameters["K_t"]
    assert found.notes
    assert repr(found).startswith("FittedMachine('dc_motor', K_t = ")
    with pytest.raises(ldt.BadInput, match="overwrite=True"):
        found.save(tmp_path / "python.yaml")


ROTOR = {"machine": "rotor"}
ROW = np.zeros(3)
#: What was written → what the sentence names.
WRONG = {
    "swapped": (lambda r: ldt.run(ldt.Machine("dc_motor"), r), "first a recording .* then a mach"),
    "swapped names": (lambda r: ldt.run("dc_motor", r.path), "expected a readable machine file"),
    "two machines": (lambda r: ldt.run(ldt.Machine("rotor"), "rotor"), "first a recording"),
    "one experiment": (lambda r: ldt.run(r[0], "dc_motor"), "first a recording"),
    "steps": (lambda r: ldt.run([1, 2], "dc_motor"), "item 0: expected an ldt.Experiment, got 1"),
    "number": (lambda r: ldt.diagnose(3, "dc_motor"), "first a recording .* got first 3"),
    "no machine": (lambda r: ldt.Machine(3), "the name of one .* or a machine file, got 3"),
    "a slip": (lambda r: ldt.Machine("roter"), "did you mean 'rotor'"),
    "no recording": (lambda r: ldt.read("nowhere"), "nowhere"),
    "no path": (lambda r: ldt.read(r), "expected the folder or file of a recording"),
    "namespace": (lambda r: ldt.read(r.path, namespace=1), "namespace: expected the name"),
    "setting": (lambda r: ldt.Twin("rotor", treshold=3), "did you mean 'threshold'"),
    "range": (lambda r: ldt.Twin("rotor", gate="no"), "gate: expected one of 'holdout', 'none'"),
    "abstract": (lambda r: ldt.Twin("rotor", model=ldt.Model), "expected a subclass of"),
    "model": (lambda r: ldt.run(r, "dc_motor", "lineer"), "did you mean 'linear'"),
    "detector": (lambda r: ldt.Twin("rotor", detector=3), "update.x. and drift_detected, got 3"),
    "word": (lambda r: ldt.Twin("rotor", threshold="a"), "threshold: expected a finite number"),
    "list": (lambda r: ldt.Twin("rotor", gp_inputs=3), "gp_inputs: expected a list of words"),
    "to step": (lambda r: ldt.Twin("rotor").step(ROW), "expected an ldt.Experiment, got an arr"),
    "text": (lambda r: ldt.Experiment(1, 0, 1, "abc", ROW), "voltage: expected a row of numbers"),
    "shape": (lambda r: ldt.Experiment(1, 0, 1, ROW, np.zeros((3, 1))), r"speed: .*\(3, 1\)"),
    "length": (lambda r: ldt.Experiment(1, 0, 1, ROW, [0.0]), "speed: expected 3 samples, got 1"),
    "nan": (lambda r: ldt.Experiment(1, 0, 1, [np.nan], [0.0]), "expected finite samples, got nan"),
    "order": (lambda r: ldt.Experiment(ROW, ROW, 1, 0.0, 0.1), "experiment number: expected a wh"),
    "period": (lambda r: ldt.Experiment(1, 0.0, ROW, ROW, ROW), "sample period: .* an array of sh"),
    "effect": (lambda r: ldt.simulate("rotor", effects={"unbalanced": {}}), "mean 'unbalance'"),
    "amount": (lambda r: ldt.simulate("rotor", effects={"unbalance": 1}), "values of e by name"),
    "amounts": (lambda r: ldt.simulate("rotor", effects={"unbalance": {"e": "x"}}), "e: expected"),
    "effects": (lambda r: ldt.simulate("rotor", effects=3), "expected effects with their param"),
    "many": (lambda r: ldt.simulate("rotor", experiments="all"), "experiments: expected a finite"),
    "holdout": (lambda r: ldt.diagnose(r, "dc_motor", holdout="half"), "holdout: expected a finit"),
    "seed": (lambda r: ldt.diagnose(r, "dc_motor", seed=-1), "seed: expected 0 to"),
    "tried": (lambda r: ldt.diagnose(r, "dc_motor", effects=3), "names or ldt.Effect objects"),
    "free": (lambda r: ldt.calibrate(r, "dc_motor", free="K_t"), "free: expected a list of words"),
    "another": (lambda r: ldt.diagnose(r, {"name": "x"}), "expected the key 'physics'"),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_a_wrong_argument_is_named(worn, wrong):
    """By a TypeError or ValueError that is an LdtError: what was expected, and what came."""
    call, sentence = WRONG[wrong]
    with pytest.raises((TypeError, ValueError), match=sentence) as told:
        call(worn)
    assert isinstance(told.value, ldt.LdtError)
    assert len(str(told.value)) < 800


def test_swapped_arguments_are_a_type_error(worn):
    """As Python's own functions say it."""
    with pytest.raises(TypeError):
        ldt.run(ldt.Machine("dc_motor"), worn)


@pytest.mark.slow
def test_types_hold_in_a_user_s_script(tmp_path):
    """The names have types, for mypy and for editors."""
    mypy = Path(sys.executable).parent / "mypy"
    if not mypy.exists():
        pytest.skip("mypy is not installed")
    script = tmp_path / "script.py"
    script.write_text(
        "import ldt_core as ldt\n"
        'recording = ldt.read("my_run")\n'
        'machine = ldt.Machine("rotor")\n'
        'run = ldt.run(recording, machine, model="linear", threshold=2)\n'
        "error: float | None = run.mme\n"
        "word: str = run.steps[0].signal.level.word\n"
        "kind: str = ldt.diagnose(recording, machine).verdict.kind\n"
        'made: list[ldt.Experiment] = ldt.simulate(machine, effects={"unbalance": {"e": 0.005}})\n'
        "ldt.run(machine, recording)\n"
        "ldt.Machine(3)\n"
        "ldt.reed\n"
    )
    repository = Path(ldt.__file__).parents[1]
    paths = {**os.environ, "MYPYPATH": str(repository)}
    # With the options of `pyproject.toml` alone: what mypy has found there is not sought again.
    given = [str(mypy), str(script)]
    done = subprocess.run(
        given, capture_output=True, text=True, cwd=repository, env=paths, check=False
    )
    lines = {int(m) for m in re.findall(r"script\.py:(\d+): error", done.stdout)}
    assert lines == {9, 10, 11}, done.stdout


@pytest.mark.parametrize("model", ["linear", "hybrid", "grey_box", "remainder"])
def test_a_learned_model_is_kept_by_pickle(model, worn):
    """What compiled code a model holds could not be pickled, nor copied."""
    learned = ldt.run(worn[:3], "dc_motor", model=model, detector="threshold", threshold=0.5)
    kept = learned.twin.model
    assert kept.version > 0
    loaded = pickle.loads(pickle.dumps(kept))  # noqa: S301 # our own
    for again in (loaded, copy.deepcopy(kept)):
        assert again.predict(worn[4]).speed.tobytes() == kept.predict(worn[4]).speed.tobytes()
        assert (again.record(), repr(again)) == (kept.record(), repr(kept))
    assert ldt.Twin("dc_motor", model=again).model.version == kept.version


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"name": "x", "physics": "dc_motor"}, "got no duration, parameters"),
        ({**vars(ldt.Machine("dc_motor")), "limits": [-1, 1]}, "got ['limits']"),
    ],
)
def test_a_machine_of_other_fields_is_refused(fields, said):
    """It was made, and failed at the first look at it."""
    with pytest.raises(ldt.BadInput, match="keys of a machine file") as told:
        ldt.Machine(**fields)
    assert said in str(told.value)
