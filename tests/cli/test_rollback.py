"""Claims about `ldt rollback`: which models there were, and going on with an earlier one."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from ldt_core.base.experiment import Action
from ldt_core.base.settings import resolve
from ldt_core.cli import invoke, ldt
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine
from ldt_core.models import restore_model
from ldt_core.recording.bag import read_bag
from ldt_core.recording.writer import BagWriter
from ldt_core.runs.offline import run
from ldt_core.twin.adaptor import ROLLED_BACK

ROTOR = load_machine("rotor")
COUNT, ENDED = 12, 8
GIVEN = resolve(
    {
        **{"model": "linear", "order": 1, "gate": "none", "data": "warning-set"},
        "detector": "threshold",
        **{"experiments": COUNT, "seed": 3, "start_time": 1e9, "degradation": "none"},
        "effect": ["unbalance:e=0.006"],
    }
)


@pytest.fixture
def experiments():
    plant = Plant.from_settings(ROTOR, GIVEN)
    return [plant.experiment(n).part(0, 200) for n in range(1, COUNT + 1)]


@pytest.fixture
def bag(tmp_path, experiments):
    """A run that has ended after some experiments, and has learned at several of them."""
    run(ROTOR, GIVEN, experiments[:ENDED], tmp_path / "run")
    return tmp_path / "run"


def rollback(capsys, *arguments):
    code = invoke(ldt, ["rollback", *map(str, arguments)])
    printed = capsys.readouterr()
    return code, printed.out, printed.err


def listed(capsys, bag):
    code, out, _ = rollback(capsys, bag, "--json")
    assert code == 0
    return json.loads(out)


def test_the_versions_are_listed_with_what_is_known_of_them(bag, capsys):
    """When each came, how often it predicted and how well; the last one is in force."""
    found = listed(capsys, bag)
    adopted = [a for a in read_bag(bag).records("adaptation") if a.action is Action.ADAPTED]
    assert len(adopted) > 2
    versions = found["versions"]
    assert [v["version"] for v in versions] == [0, *(a.model_version for a in adopted)]
    assert [v["adopted"] for v in versions] == [0, *(a.experiment for a in adopted)]
    assert sum(v["experiments"] for v in versions) == ENDED
    errors = [s.max_error for s in read_bag(bag).records("signal")]
    total = sum(v["mean_max_error"] * v["experiments"] for v in versions if v["experiments"])
    assert total == pytest.approx(sum(errors))
    code, out, _ = rollback(capsys, bag)
    assert code == 0
    assert f"version {found['in_force']} is in use" in out


def test_the_run_goes_on_with_the_earlier_model_and_nothing_is_deleted(bag, experiments, capsys):
    """It predicts the next experiment, and later versions count on from it."""
    before = [raw.data for raw in read_bag(bag).messages()]
    newest = listed(capsys, bag)["in_force"]
    code, out, _ = rollback(capsys, bag, "--to", 1)
    assert code == 0
    assert "rolled back by hand" in out
    assert [raw.data for raw in read_bag(bag).messages()][: len(before)] == before
    found = listed(capsys, bag)
    assert found["in_force"] == newest + 1
    assert "by hand" in found["versions"][-1]["reason"]
    run(ROTOR, {**GIVEN, "resume": str(bag)}, experiments, bag)
    whole = read_bag(bag)
    models = {m.version: m for m in whole.records("model")}
    assert models[newest + 1].parameters == models[1].parameters
    predictions = {p.number: p for p in whole.records("prediction")}
    assert sorted(predictions) == list(range(1, COUNT + 1))
    following = predictions[ENDED + 1]
    assert following.model_version == newest + 1
    earlier = restore_model(models[1], ROTOR, GIVEN).predict(experiments[ENDED])
    assert np.array_equal(following.speed, earlier.speed)
    told = list(whole.records("adaptation"))
    assert sum(ROLLED_BACK in a.details for a in told) == 1
    assert all(a.model_version > newest for a in told[-(COUNT - ENDED) :])
    learned = [models[a.model_version] for a in told[ENDED + 1 :] if a.action is Action.ADAPTED]
    assert all(min(m.trained_on) > ENDED for m in learned)  # nothing kept from before


def test_a_run_can_be_rolled_back_twice_and_resumed_in_between(bag, experiments, capsys):
    """Each is one more version, and the recording stays one that a run goes on with."""
    newest = listed(capsys, bag)["in_force"]
    assert rollback(capsys, bag, "--to", 0)[0] == 0
    assert rollback(capsys, bag, "--to", 1)[0] == 0
    assert listed(capsys, bag)["in_force"] == newest + 2
    run(ROTOR, {**GIVEN, "resume": str(bag)}, experiments[: COUNT - 1], bag)
    assert rollback(capsys, bag, "--to", 0)[0] == 0
    run(ROTOR, {**GIVEN, "resume": str(bag)}, experiments, bag)
    last = {p.number: p for p in read_bag(bag).records("prediction")}[COUNT]
    models = {m.version: m for m in read_bag(bag).records("model")}
    assert models[last.model_version].parameters == models[0].parameters


def test_what_cannot_be_is_refused_in_a_sentence(bag, capsys, tmp_path):
    """And the recording is as it was."""
    before = sorted(p.name for p in bag.iterdir())
    newest = listed(capsys, bag)["in_force"]
    for version in (99, -1, newest):
        code, _, err = rollback(capsys, bag, "--to", version)
        assert code == 2
        assert "--to: expected a version that was in use before" in err
    code, _, err = rollback(capsys, bag, "--to", 1, "--machine", "dc_motor")
    assert (code, "machine" in err) == (2, True)
    with BagWriter(tmp_path / "other", "rotor") as writer:
        writer.write("experiment", next(read_bag(bag).records("experiment")), 1e9)
    code, _, err = rollback(capsys, tmp_path / "other")
    assert (code, "expected the recording of a run" in err) == (2, True)
    assert rollback(capsys, tmp_path / "nothing")[0] == 2
    assert sorted(p.name for p in bag.iterdir()) == before


def test_a_recording_that_is_written_or_ends_in_the_middle_of_a_step_is_left_alone(bag, capsys):
    """What a run has predicted by another model already must not be mixed with the earlier one."""
    last = list(read_bag(bag).records("prediction"))[-1]
    with BagWriter(bag, "rotor", resume=True) as writer:
        code, _, err = rollback(capsys, bag, "--to", 1)
        assert (code, "ldt:" in err) == (2, True)
        following = replace(last, number=ENDED + 1, start=last.start + 20)
        writer.write("prediction", following, last.start + 30)
    code, _, err = rollback(capsys, bag, "--to", 1)
    assert code == 2
    assert f"ends with experiment {ENDED}" in err
