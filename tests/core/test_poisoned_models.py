"""A recorded model that is well-formed and absurd: refused by its version, and the run goes on."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from ldt_core.base.errors import ModelError
from ldt_core.base.experiment import ModelRecord
from ldt_core.base.settings import resolve
from ldt_core.cli import invoke, ldt
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine
from ldt_core.models import build_model, restore_model
from ldt_core.recording.bag import read_bag
from ldt_core.recording.writer import KEY, BagWriter
from ldt_core.runs.offline import run
from ldt_core.twin.adaptor import ROLLED_BACK

MOTOR = load_machine("dc_motor")
COUNT, ENDED = 8, 6
GIVEN = resolve(
    {
        **{"machine": "dc_motor", "model": "linear", "order": 2, "gate": "none"},
        **{"detector": "threshold", "threshold": 0.2, "data": "warning-set", "seed": 2},
        **{"experiments": COUNT, "start_time": 1e9, "degradation": "none"},
        "effect": ["coulomb_friction:torque=.05"],
    }
)
#: What is wrong with a linear model, each well-formed JSON of finite numbers.
WRONG = {
    "grows": {"A": [[1e300, 1e300], [-1e300, 1.0]]},
    "offset": {"offset": 1e300},
    "far": {"offset": 1e7},
    "noise": {"noise_std": 1e300},
    "negative": {"noise_std": -1.0},
    "word": {"A": "x"},
    "empty": None,
}


@pytest.fixture(scope="module")
def experiments():
    plant = Plant.from_settings(MOTOR, GIVEN)
    return [plant.experiment(n).part(0, 200) for n in range(1, COUNT + 1)]


@pytest.fixture(scope="module")
def sound(tmp_path_factory, experiments):
    bag = tmp_path_factory.mktemp("sound") / "run"
    run(MOTOR, GIVEN, experiments[:ENDED], bag)
    return bag


def poisoned(sound, bag, *versions, wrong="offset"):
    """The recording with other parameters in some versions."""
    there = read_bag(sound)
    with BagWriter(bag, MOTOR.name, settings=GIVEN, key=there.custom(KEY)) as writer:
        for raw, record in there.usable(there.messages()):
            if isinstance(record, ModelRecord) and record.version in versions:
                change = WRONG[wrong]
                parameters = {} if change is None else {**record.parameters, **change}
                writer.write("model", replace(record, parameters=parameters), raw.time_ns / 1e9)
            else:
                writer.write_raw(raw.topic, raw.kind, raw.data, raw.time_ns)
    return bag


def versions(bag):
    """Those that came into force, in their order."""
    return [a.model_version for a in read_bag(bag).records("adaptation") if a.action == "adapted"]


def resumed(bag, experiments):
    return run(MOTOR, {**GIVEN, "resume": str(bag)}, experiments, bag)


@pytest.mark.parametrize("wrong", WRONG)
def test_a_run_leaves_the_poisoned_version_in_force(sound, tmp_path, experiments, wrong):
    """It names version and file, goes on with the one before, and answers every experiment."""
    newest = max(versions(sound))
    assert newest > 2
    bag = poisoned(sound, tmp_path / "run", newest, wrong=wrong)
    summary = resumed(bag, experiments)
    assert summary.experiments == COUNT
    assert not summary.failures
    told = [note for note in summary.notes if f"model version {newest}" in note]
    assert len(told) == 1
    assert str(bag) in told[0]
    assert f"version {newest + 1} is version {newest - 1} again" in told[0]
    after = [p for p in read_bag(bag).records("prediction") if p.number > ENDED]
    assert after[0].model_version == newest + 1
    assert len(after) == COUNT - ENDED
    rolled = [a for a in read_bag(bag).records("adaptation") if ROLLED_BACK in a.details]
    assert [a.details[ROLLED_BACK] for a in rolled] == [newest - 1]


def test_with_no_sound_version_left_the_original_goes_on(sound, tmp_path, experiments):
    """Even the recorded original is not needed."""
    bag = poisoned(sound, tmp_path / "run", *range(max(versions(sound)) + 1))
    summary = resumed(bag, experiments)
    assert summary.experiments == COUNT
    assert any("is version 0 again" in note for note in summary.notes)


def test_a_poisoned_version_of_the_past_is_left_out_and_told(sound, tmp_path, experiments):
    """The one in force goes on as it is."""
    newest = max(versions(sound))
    bag = poisoned(sound, tmp_path / "run", 1)
    summary = resumed(bag, experiments)
    assert summary.experiments == COUNT
    assert [n for n in summary.notes if f"{bag}, model version 1: " in n]
    after = [p for p in read_bag(bag).records("prediction") if p.number > ENDED]
    assert after[0].model_version == newest


def test_whatever_is_wrong_with_an_effect_is_told_with_the_version():
    """A model learned by causes names them, each within its bounds."""
    record = build_model("auto", MOTOR, resolve({})).record()
    for torque in (1e300, -1.0):
        effects = {"coulomb_friction": {"torque": torque}}
        wrong = replace(record, version=3, parameters={**record.parameters, "effects": effects})
        with pytest.raises(ModelError, match=r"model version 3: .*coulomb_friction, torque"):
            restore_model(wrong, MOTOR, {"model": "auto"})


def rollback(capsys, *arguments):
    code = invoke(ldt, ["rollback", *map(str, arguments)])
    printed = capsys.readouterr()
    return code, printed.out, printed.err


@pytest.mark.parametrize("wrong", WRONG)
def test_rollback_refuses_the_poisoned_and_takes_the_sound(
    sound, tmp_path, experiments, capsys, wrong
):
    """A version is listed, and refused, with what is wrong with it; the others are there."""
    newest = max(versions(sound))
    bag = poisoned(sound, tmp_path / "run", 1, newest, wrong=wrong)
    code, out, _ = rollback(capsys, bag)
    assert (code, out.count("cannot be used: ")) == (0, 2)
    found = json.loads(rollback(capsys, bag, "--json")[1])["versions"]
    assert [v["version"] for v in found if v["unusable"]] == [1, newest]
    code, _, error = rollback(capsys, bag, "--to", 1)
    assert code == 2
    assert f"1, which cannot be used ({bag}, model version 1: " in error
    assert invoke(ldt, ["doctor", str(bag)]) == 0
    named = [t for t in capsys.readouterr().out.splitlines() if t.startswith("warning  models")]
    assert [t.partition("version ")[2].split(":")[0] for t in named] == ["1", str(newest)]
    assert rollback(capsys, bag, "--to", 2)[0] == 0
    summary = resumed(bag, experiments)
    assert summary.experiments == COUNT
    assert not any(f"model version {newest}" in note for note in summary.notes)
