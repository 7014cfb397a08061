"""With which settings a run goes on, whichever command began it."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import msgs_config
from ldt_core.base.errors import BadInput, RecordingError
from ldt_core.base.experiment import Experiment
from ldt_core.base.settings import resolve
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine
from ldt_core.recording.bag import read_bag
from ldt_core.recording.writer import BagWriter
from ldt_core.restart import checkpoint, rollback, run_key
from ldt_core.restart.run_key import resumed
from ldt_core.runs import offline


def of_run(**given):
    """Settings as `ldt run` has them, which are not all."""
    graphs = {n for n, d in msgs_config.parameters().items() if d["group"] in ("stream", "pace")}
    return {n: v for n, v in resolve(given).items() if n not in graphs}


def recording(path, **given):
    with BagWriter(path, "rotor", settings=resolve(given)) as writer:
        rest = np.zeros(3)
        writer.write("experiment", Experiment(1, 1e9, 0.01, rest, rest), 1e9)
    return str(path)


def test_a_run_of_the_graph_goes_on_without_it(tmp_path):
    """What a run without the graph has no word for makes no difference at its default."""
    bag = recording(tmp_path / "run", seed=7, rate="20")
    found = resumed(of_run(resume=bag))
    assert (found["seed"], found["bag"], found["resume"]) == (7, bag, bag)


def test_what_needs_the_graph_is_not_gone_on_with_without_it(tmp_path):
    """A run that also published samples cannot be made whole by one that cannot."""
    bag = recording(tmp_path / "run", stream="beside")
    with pytest.raises(BadInput, match=r"run, stream: expected .*use ldt up --resume"):
        resumed(of_run(resume=bag))
    assert resumed(resolve({"resume": bag}))["stream"] == "beside"


def test_a_run_that_began_secured_does_not_go_on_open(tmp_path):
    """Without a word; by whichever keys it is secured then, and where there is no graph it is."""
    bag = recording(tmp_path / "run", secure="some/keys")
    assert read_bag(bag).settings()["secure"] is True
    assert "some/keys" not in (tmp_path / "run" / "metadata.yaml").read_text()
    with pytest.raises(BadInput, match=r"^--secure: expected a keystore, since .* began secured"):
        resumed(resolve({"resume": bag}))
    assert resumed(resolve({"resume": bag, "secure": "other"}))["secure"] == "other"
    without = {n: v for n, v in of_run(resume=bag).items() if n != "secure"}
    assert "secure" not in resumed(without)


@pytest.mark.parametrize(("began", "goes_on"), [("", "keys"), ("keys", "others"), ("keys", "")])
def test_a_recorder_goes_on_whoever_secures_it(tmp_path, began, goes_on):
    """The keys are no part of the run: who may go on is asked once, when it is taken up."""
    bag = recording(tmp_path / "run", secure=began)
    with BagWriter(bag, "rotor", settings=resolve({"secure": goes_on}), resume=True):
        pass
    assert read_bag(bag).settings().get("secure", False) == bool(began)


def test_a_run_goes_on_after_an_update_and_says_so_in_one_sentence(tmp_path, monkeypatch):
    """With other code, another library, and without a parameter that there was."""
    machine, bag = load_machine("rotor"), tmp_path / "run"
    given = resolve({"model": "physics", "checkpoint_every": 1, "experiments": 3})
    made = list(map(Plant.from_settings(machine, given).experiment, (1, 2, 3)))
    older = lambda: {"ldt": "0.0", "code": "0123456789ab"}  # noqa: E731
    with monkeypatch.context() as then:
        for module in (run_key, checkpoint):
            then.setattr(module, "code_version", older)
        offline.run(machine, {**given, "old_option": 7}, made[:2], bag)
    then = {f: f.read_bytes() for f in bag.glob("*.mcap")}
    key = read_bag(bag).custom("key")
    assert rollback.history(bag).last.number == 2
    summary = offline.run(machine, resumed({**given, "resume": str(bag)}), made, bag)
    assert summary.experiments == 3
    told = [note for note in summary.notes if "version" in note or "checkpoint" in note]
    assert len(told) == 1
    assert told[0].startswith(f"{bag} began with another version, which may give other numbers: ")
    for words in (
        ": ldt '",
        ", was '0.0'; numba '",
        "numpy '",
        "no parameter 'old_option' any more",
    ):
        assert words in told[0]
    assert {f: f.read_bytes() for f in then} == then
    assert read_bag(bag).custom("key") == key


def test_a_run_of_0_2_0_is_refused_with_what_to_do(tmp_path):
    """It named an edited machine file, which nobody had edited."""
    began = load_machine("rotor")
    key = json.dumps({"machine": "1ba141d960cb", "physics": began.physics, "ldt": "0.2.0"})
    with BagWriter(tmp_path / "run", "rotor", key=key) as writer:
        writer.write("experiment", Experiment(1, 1e9, 0.01, np.zeros(3), np.zeros(3)), 1e9)
    anew = rf"got one of that version \(ldt run --play {tmp_path / 'run'} begins anew on it\)"
    with pytest.raises(RecordingError, match=anew):
        run_key.check_key(read_bag(tmp_path / "run"), began, {})


def test_an_edited_machine_file_is_refused_by_the_numbers_that_differ(tmp_path):
    """The first three of them."""
    began = load_machine("rotor")
    with BagWriter(tmp_path / "run", "rotor", key=run_key.key_text(began, {})) as writer:
        writer.write("experiment", Experiment(1, 1e9, 0.01, np.zeros(3), np.zeros(3)), 1e9)
    bag = read_bag(tmp_path / "run")
    run_key.check_machine(bag, load_machine("rotor"))
    edited = began.with_parameters(m=4.8, R=2.1)
    with pytest.raises(
        RecordingError, match=r"in which m is 4\.8, was 4\.9; R is 2\.1, was 1\.0 \("
    ):
        run_key.check_machine(bag, edited)
    other = replace(edited, voltage_limits=(0.0, 24.0), simulation={})
    with pytest.raises(RecordingError, match=r"voltage\[0\] is 0\.0, was -24\.0; \d+ more \(take"):
        run_key.check_machine(bag, other)
