"""Parts, files and machines that do what none should: a sentence, or one experiment, each."""

from __future__ import annotations

import json
import os
import re
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

import msgs_config
from ldt_core.base.bounded_file import read_bounded
from ldt_core.base.errors import LdtError, MachineFileError, OptionError, did_you_mean
from ldt_core.base.experiment import FAILED, Action, Experiment, Level, Signal
from ldt_core.base.plain_yaml import load_yaml
from ldt_core.base.registry import Registry
from ldt_core.base.settings import resolve
from ldt_core.cli import invoke, ldt
from ldt_core.cli.options import read_settings
from ldt_core.detectors.threshold import Threshold
from ldt_core.effects.base import Effect
from ldt_core.machine import Plant
from ldt_core.machine.experiment_limits import LONGEST_LEARNED
from ldt_core.machine.machine_file import load_machine, parse_machine
from ldt_core.models.physics import PhysicsModel
from ldt_core.physics.parameter import Parameter
from ldt_core.recording.bag import read_bag
from ldt_core.recording.csv_table import CsvTable
from ldt_core.recording.writer import BagWriter
from ldt_core.runs.offline import write_step
from ldt_core.twin.adaptor import TOO_LONG
from ldt_core.twin.diagnoser import Diagnoser
from ldt_core.twin.loop import Twin

SHORT = replace(load_machine("rotor"), duration=2.0)
COUNT = 3


def made() -> list[Experiment]:
    """Sound experiments of the short rotor."""
    plant = Plant.from_settings(SHORT, resolve({"seed": 3, "start_time": 1e9}))
    return [plant.experiment(number) for number in range(1, COUNT + 1)]


def ends(*_, **__):
    """As `sys.exit` in a part of the user's own."""
    raise SystemExit(7)


def cancels(*_, **__):
    """What is no Exception, as asyncio's own."""
    raise BaseException("on no account")


DETECTORS = {
    "that ends the program": {"judge": ends},
    "that raises what is no exception": {"judge": cancels},
    "of figures that are none": {"statistics": property(lambda self: {"a": "x"})},
    "of figures without a name": {"statistics": property(lambda self: {3: 1.0})},
    "of a figure by a name in use": {"statistics": property(lambda self: {"experiment": 1.0})},
    "whose figures fail": {"statistics": property(ends)},
}


@pytest.mark.parametrize("name", DETECTORS)
def test_a_hostile_detector_costs_its_signals(name, tmp_path):
    """Each step is recorded, with a warning and the reason."""
    detector = type("Mine", (Threshold,), {"name": "mine", **DETECTORS[name]})
    twin = Twin(SHORT, model="physics", detector=detector)
    steps = list(twin.steps(made(), pytest.fail))
    assert [s.signal.statistics for s in steps] == [{FAILED: 1.0}] * COUNT
    assert {"the detector failed" in s.adaptation.reason for s in steps} == {True}
    with BagWriter(tmp_path / "run", "rotor") as writer:
        for step in steps:
            write_step(writer, step)
    assert [s.statistics for s in read_bag(tmp_path / "run").records("signal")] == [{FAILED: 1}] * 3


def times(factor):
    """A prediction so many times the physics' speed, which is 1 rad/s at least."""

    def predict(self, experiment):
        found = PhysicsModel(self.machine).predict(experiment)
        return replace(found, speed=np.maximum(found.speed, 1.0) * factor)

    return predict


MODELS = {
    "that ends the program": (ends, "SystemExit: 7"),
    "that raises what is no exception": (cancels, "BaseException: on no account"),
    "that says nothing": (lambda self, e: None, "AttributeError"),
    "of too few samples": (
        lambda self, e: PhysicsModel(self.machine).predict(e.part(0, 9)),
        "with 200 samples, got 9",
    ),
    "of another experiment": (
        lambda self, e: PhysicsModel(self.machine).predict(replace(e, number=77)),
        "prediction 77: expected experiment",
    ),
    "beyond floating point": (times(1e300), "samples whose squares can be summed, got"),
    "of complex numbers": (times(1j), "a row of numbers"),
}


@pytest.mark.parametrize("name", MODELS)
def test_a_hostile_model_leaves_experiments_unanswered(name):
    """That is what makes the run fail, with the reason, and without a warning of numpy's."""
    predict, words = MODELS[name]
    model = type("Mine", (PhysicsModel,), {"kind": "mine", "predict": predict})
    refused: list[LdtError] = []
    assert not list(Twin(SHORT, model=model).steps(made(), refused.append))
    assert [words in str(e) for e in refused] == [True] * COUNT


LEARNED = {
    "that is not finite": ({"a": float("nan")}, 1, "not JSON compliant"),
    "that is no JSON": ({"a": {1, 2}}, 1, "TypeError"),
    "of a version below 0": ({}, -5, "version: expected 0 or more"),
}


@pytest.mark.parametrize("name", LEARNED)
def test_a_model_that_nobody_could_be_told_of_is_not_adopted(name, tmp_path):
    """The adaptation says why; the recording is whole."""
    parameters, version, words = LEARNED[name]

    def fit(self, experiments):
        return type(self)(self.machine, parameters, version, [1])

    body = {"kind": "mine", "adaptive": True, "fit": fit, "build": lambda self: None}
    body["predict"] = lambda self, e: PhysicsModel(self.machine).predict(e)
    body["effects"] = ()
    model = type("Mine", (PhysicsModel,), body)
    settings = {"detector": "threshold", "threshold": 1e-6, "gate": "none"}
    twin = Twin(SHORT, model=model, **settings)
    for step in twin.steps(made(), pytest.fail):
        assert step.adaptation.action is Action.REFUSED
        assert words in step.adaptation.reason
        assert step.model is None


@pytest.mark.parametrize("kind", ["model", "detector"])
def test_a_part_that_cannot_be_made_is_a_sentence(kind):
    """It ended in a traceback, by whatever its constructor raised."""
    bodies = {"model": (PhysicsModel, {"build": ends}), "detector": (Threshold, {"__init__": ends})}
    base, body = bodies[kind]
    with pytest.raises(OptionError, match="one that can be made, got SystemExit: 7"):
        Twin(SHORT, **{kind: type("Mine", (base,), {"kind": "mine", **body})})


def test_a_file_that_ends_the_program_is_refused(tmp_path):
    """As one that cannot be imported."""
    (tmp_path / "mine.py").write_text("raise SystemExit(5)")
    with pytest.raises(OptionError, match="got SystemExit: 5"):
        Registry("detector", {}, "none").get(f"{tmp_path / 'mine.py'}:Mine")


@pytest.mark.parametrize(
    "command",
    [
        ["run", "--experiments", "1", "--no-bag", "--machine"],
        ["run", "--experiments", "1", "--no-bag", "--settings"],
        ["import", "--voltage", "1", "--speed", "2", "--sample-period", "1", "--out", "none"],
        ["info"],
        ["predict", "none", "--machine", "rotor", "--out", "none.mcap", "--with"],
    ],
)
@pytest.mark.parametrize("kind", ["pipe", "device"])
def test_what_never_ends_is_not_read(command, kind, tmp_path, capsys):
    """A pipe into which nobody writes, a device that gives zeros for ever."""
    source = "/dev/zero"
    if kind == "pipe":
        os.mkfifo(source := str(tmp_path / "pipe"))
    assert invoke(ldt, [*command, source]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert len(told) < 300


def test_a_file_is_read_up_to_its_limit(tmp_path):
    """One byte more is too much."""
    (tmp_path / "file").write_bytes(b"12345")
    assert read_bounded(tmp_path / "file", 5) == b"12345"
    with pytest.raises(OSError, match="at most 4 bytes are read"):
        read_bounded(tmp_path / "file", 4)


@pytest.mark.parametrize(
    "text", ["[" * 100_000, "- " * 100_000, "{a: " * 5000, "? " * 5000], ids=lambda t: t[:3]
)
def test_yaml_nested_without_end_is_refused(text):
    """libyaml would end the process by it, without a word."""
    with pytest.raises(Exception, match="nesting deeper than"):
        load_yaml(text)
    assert load_yaml("[" * 20 + "]" * 20)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("  K_t: 0.3\n  K_t: 0.4\n", "the key K_t a second time"),
        ("  K_t: 20:00\n", "got '20:00'"),
        ("  K_t: 0x10\n", "got '0x10'"),
        ("  K_t: 0.3\n  1: 2\n", "got the name 1"),
        ("  K_t: 0.3\n  on: 2\n", "got the name True"),
        (f"  K_t: {'9' * 5000}\n", "Exceeds the limit (4300 digits)"),
    ],
)
def test_a_machine_file_s_number_is_one_that_people_write(change, words):
    """YAML takes the second of two without a word, and minutes for a number."""
    lines = msgs_config.machine_text("rotor").splitlines(keepends=True)
    text = "".join(change if line.startswith("  K_t:") else line for line in lines)
    with pytest.raises(MachineFileError, match=re.escape(words)):
        parse_machine(text, "mine")


def test_a_number_with_a_leading_zero_is_decimal():
    """YAML takes 010 for 8."""
    assert load_yaml("[010, 0.5, -3, 1.5e3, 1e-3, .inf]")[1:] == [0.5, -3, 1500.0, 0.001, np.inf]
    text = msgs_config.machine_text("rotor").replace("K_x: 2000", "K_x: 010")
    assert parse_machine(text, "mine").parameters["K_x"] == 10.0


def test_a_file_of_settings_takes_numbers_as_json_writes_them(tmp_path):
    """A threshold of 0.00001 is 1e-05 in a tune.json, which was refused as no number."""
    (tmp_path / "tune.json").write_text(json.dumps({"settings": {"error_threshold": 1e-5}}))
    assert read_settings(str(tmp_path / "tune.json")) == {"error_threshold": 1e-5}


def test_a_sentence_lists_so_many_names():
    """A table may have 200,000 columns."""
    told = did_you_mean("v", [f"c{number}" for number in range(200_000)])
    assert len(told) < 1000
    assert "and 199940 more" in told


MACHINES = {
    "a million days": ("duration: 20 ", "duration: 1e11 "),
    "a period of a picosecond": ("sample_period: 0.01", "sample_period: 1e-12"),
    "the least period there is": ("sample_period: 0.01", "sample_period: 5e-324"),
}


@pytest.mark.parametrize("name", MACHINES)
def test_a_machine_s_experiments_have_so_many_samples(name):
    """What nobody could hold is refused with the file, not by a lack of memory."""
    text = msgs_config.machine_text("rotor").replace(*MACHINES[name])
    with pytest.raises(LdtError, match="duration: expected at most 4000000 sample periods"):
        parse_machine(text, "mine.yaml")


EFFECTS = {
    "that fails": ({"on_measurement": ends}, "SystemExit: 7"),
    "that raises what is no exception": ({"on_measurement": cancels}, "BaseException: on no acc"),
    "of another length": (
        {"on_measurement": lambda v, p, c: v[1:]},
        "200 measured speeds, got",
    ),
    "that says nothing": (
        {"on_measurement": lambda v, p, c: None},
        "200 measured speeds, got",
    ),
    "of disorder": ({"on_voltage": lambda t, u, c: (t[::-1], u)}, "expected times in order"),
    "of unequal rows": ({"on_voltage": lambda t, u, c: (t, u[1:])}, "expected times in order"),
    "without a parameter": (
        {"on_parameters": lambda v, c: {}},
        "all of the machine.s",
    ),
    "of parameters that are none": (
        {"on_parameters": lambda v, c: None},
        "all of the machine.s",
    ),
    "of arguments of its own": ({"on_parameters": lambda v: v}, "TypeError"),
}


@pytest.mark.parametrize("name", EFFECTS)
def test_a_hostile_effect_is_a_sentence(name):
    """It names the effect, wherever it is asked."""
    body, words = EFFECTS[name]
    c = Parameter("c", "1", low=0.0, default=0.0, description="amount")
    mine = Effect("mine", "it fails", "none", (c,), {"c": 1.0}, **body)
    with pytest.raises(LdtError, match=f"effect mine.*{words}"):
        Plant(SHORT, effects=[(mine, {"c": 1.0})]).experiment(1)


def test_a_machine_that_takes_too_many_steps_is_not_simulated():
    """By their number, which is the same on every computer."""
    text = msgs_config.machine_text("rotor").replace("K_x: 2000 ", "K_x: 1e18 ")
    unbalanced = resolve({"effect": ["unbalance:e=0.005"], "degradation": "none"})
    with pytest.raises(LdtError, match="takes steps of"):
        Plant.from_settings(parse_machine(text, "mine.yaml"), unbalanced).experiment(1)


OWN = """
import os
from ldt_core.detectors.threshold import Threshold
os.chdir("/")

class Leaves(Threshold):
    def judge(self, *given):
        os.chdir("/")
        return super().judge(*given)
"""


def test_a_part_that_goes_into_another_folder_takes_nothing_with_it(tmp_path, monkeypatch):
    """At its import or later; the recording went there, or was called deleted."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.py").write_text(OWN)
    run = ["run", "--experiments", "2", "--model", "physics", "--bag", "here"]
    assert invoke(ldt, [*run, "--detector", "own.py:Leaves"]) == 0
    assert len(list(read_bag(tmp_path / "here").records("signal"))) == 2


def test_a_file_that_raises_what_is_no_exception_is_a_sentence(tmp_path, capsys):
    """A traceback came."""
    (tmp_path / "own.py").write_text("raise BaseException('on no account')")
    run = ["run", "--experiments", "2", "--model", "physics", "--bag", str(tmp_path / "a")]
    assert invoke(ldt, [*run, "--detector", f"{tmp_path / 'own.py'}:Mine"]) == 1
    words = "a part of your own raised what is no Exception: BaseException: on no account"
    assert words in capsys.readouterr().err


def test_what_is_too_long_to_learn_from_is_predicted_all_the_same():
    """The reason is recorded, and the next experiment is learned from."""
    period = SHORT.sample_period * 100
    count = int(LONGEST_LEARNED / period) + 2
    volts = np.full(count, 6.0)
    noise = np.random.default_rng(0).normal(0.0, 0.1, count)
    long = Experiment(1, 1e9, period, volts, 15.0 + noise)
    given = {"detector": "threshold", "threshold": 1e-6, "gate": "none", "sensor_check": False}
    twin = Twin(SHORT, model="linear", **given)
    refused, learned = (twin.step(e) for e in (long, replace(made()[1], start=1e9 + 9999)))
    assert refused.adaptation.details[TOO_LONG] == 1
    assert "2502 s are too long for it" in refused.adaptation.reason
    assert refused.experiment not in twin.adaptor.memory.recent
    assert learned.adaptation.action is Action.ADAPTED


def test_what_is_too_long_is_not_diagnosed_either():
    """Beside a model that has learned nothing from it; what it says of the machine is not known."""
    period = SHORT.sample_period * 100
    rest = np.full(int(LONGEST_LEARNED / period) + 2, 6.0)
    made_of: list[object] = []
    diagnoser = Diagnoser(SHORT, {}, make=lambda *a, **k: made_of.append(a))
    said = Signal(1, Level.POSITIVE, "threshold", 0, 9.0)
    assert diagnoser.step(Experiment(1, 1e9, period, rest, rest), said) is None
    assert "2502 s are too long for it" in diagnoser.trouble
    assert (made_of, diagnoser.state()["recent"]) == ([], [])


@pytest.mark.parametrize("change", ["J: 0.02 ", "b: 0.01 "])
def test_a_machine_too_fast_for_floating_point_is_refused(change):
    """With the file, by one sentence, before a library fails at it."""
    name, _, value = change.partition(" ")
    absurd = f"{name} {'1e-30' if name == 'J:' else '1e14'} "
    text = msgs_config.machine_text("rotor").replace(f"{name} {value}", absurd)
    with pytest.raises(MachineFileError, match=r"parameters: expected a machine whose speed"):
        parse_machine(text, "mine.yaml")


def test_a_machine_that_floating_point_does_not_let_settle_is_refused():
    """By the linear model, to which it looks unstable; it ended in a traceback."""
    text = msgs_config.machine_text("rotor").replace("L: 0.002 ", "L: 1e29 ")
    machine = parse_machine(text, "mine")
    with pytest.raises(MachineFileError, match="slowest rate"):
        Twin(machine, model="linear")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["run", "--seed", "9" * 400], "seed: expected a finite number"),
        (["info", "x" * 5000], "File name too long"),
    ],
)
def test_what_is_too_long_is_refused_in_a_short_sentence(arguments, words, capsys):
    """Numbers beyond floating point, names beyond the file system."""
    assert invoke(ldt, arguments) == 2
    told = capsys.readouterr().err
    assert words in told
    assert len(told) < 500


def test_a_lack_of_memory_is_a_sentence(tmp_path, monkeypatch, capsys):
    """And exit code 1: the work itself failed."""

    def lacks(*_):
        raise MemoryError("Unable to allocate 7 EiB")

    monkeypatch.setattr("ldt_core.machine.Plant.experiment", lacks)
    assert invoke(ldt, ["simulate", "--experiments", "1", "--out", str(tmp_path / "out")]) == 1
    assert capsys.readouterr().err == "ldt: out of memory (Unable to allocate 7 EiB)\n"


def test_a_lack_of_memory_in_a_detector_is_told_as_what_it_is(monkeypatch):
    """It costs this experiment; the next one is judged."""
    update, calls = Threshold.update, []

    def lacks(self, *arguments):
        calls.append(self)
        if len(calls) == 2:
            raise MemoryError
        return update(self, *arguments)

    monkeypatch.setattr(Threshold, "update", lacks)
    machine = load_machine("rotor")
    plant = Plant(machine, seed=1)
    twin = Twin.from_settings(machine, resolve({"model": "physics", "detector": "threshold"}))
    steps, told = [], []
    for number in (1, 2, 3):
        steps.append(twin.step(plant.experiment(number)))
        told.append(twin.detector.trouble)
    assert told == ["", "experiment 2: out of memory", ""]
    assert [bool(s.adaptation.details.get(FAILED)) for s in steps] == [False, True, False]
    assert "the detector failed, out of memory; version" in steps[1].adaptation.reason


def test_a_table_is_read_as_a_stream(tmp_path, monkeypatch):
    """In the memory of its numbers; what is wrong far down is told with its line."""
    block, rows = 500, 10_000
    monkeypatch.setattr("ldt_core.recording.csv_table.BLOCK", block)
    with (tmp_path / "table.csv").open("w") as file:
        file.write("time;volts;speed;beside\n")
        file.writelines(f"{n / 100};1,5;{n};{'x' * 40}\n".replace(".", ",") for n in range(rows))
    tracemalloc.start()
    table = CsvTable(tmp_path / "table.csv")
    lines, (time, volts) = table.read([0, 1])
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert lines[-1] == rows + 1
    assert np.array_equal(time, np.arange(rows) / 100)
    assert set(volts.tolist()) == {1.5}
    assert most < 8 * 3 * rows * 2 + block * 250 + 2e6, most  # twice the numbers, a block, a piece
    with (tmp_path / "table.csv").open("a") as file:
        file.write("9;2.5;1;x\n")
    with pytest.raises(LdtError, match=f"line {rows + 2}, column 'volts': expected decimal commas"):
        CsvTable(tmp_path / "table.csv").read([1])


@pytest.mark.parametrize("command", ["diagnose", "identify"])
@pytest.mark.parametrize("samples", [1, 2])
def test_experiments_that_show_nothing_are_refused(command, samples, tmp_path, capsys):
    """Of one sample or two, noise and gap cannot be told apart."""
    with BagWriter(tmp_path / "short", "rotor") as writer:
        for e in made():
            writer.write("experiment", e.part(0, samples), e.end)
    out = "mine.yaml" if command == "identify" else "why"
    assert invoke(ldt, [command, str(tmp_path / "short"), "--out", str(tmp_path / out)]) in (1, 2)
    told = capsys.readouterr().err
    assert told.splitlines()[-1].startswith("ldt: ")
    assert "Traceback" not in told
