"""What a run was started with: kept in its recording, checked when read, shown as text."""

from __future__ import annotations

import json
from html import unescape
from pathlib import Path

import pytest
import yaml
from fake_run import fake_run
from hypothesis import given
from hypothesis import strategies as st

import msgs_config
from ldt_core.base.errors import RecordingError
from ldt_core.base.settings import as_options, resolve
from ldt_core.cli import invoke, ldt
from ldt_core.doctor.check import Grade
from ldt_core.doctor.recording_checks import findings
from ldt_core.recording.bag import read_bag
from ldt_core.recording.health import inspect
from ldt_core.recording.run_settings import FORMAT, MAX_CHARACTERS, parse_settings, settings_text
from ldt_core.recording.writer import BagWriter
from ldt_core.views.report.report_page import page, read_run

LINE = st.text(st.characters(categories=["L", "N", "P", "S"]), max_size=20)
NUMBER = st.floats(allow_nan=False, allow_infinity=False) | st.integers(-(2**63) + 1, 2**63 - 1)
VALUE = st.booleans() | NUMBER | LINE | st.lists(LINE, max_size=3)
HOSTILE = "</script><img src=x onerror=alert(1)>\"' {{ 7*7 }}"


def text(**settings: object) -> str:
    return json.dumps({"format": FORMAT, **settings})


def with_settings(bag, value: object):
    """The recording with something else in the place of its settings; None for nothing."""
    file = bag / "metadata.yaml"
    data = yaml.safe_load(file.read_text())
    custom = data["rosbag2_bagfile_information"]["custom_data"]
    custom.pop("settings", None)
    custom |= {} if value is None else {"settings": value}
    file.write_text(yaml.safe_dump(data))
    return bag


def told(bag) -> list[tuple[Grade, str]]:
    """What is found about the recording's settings."""
    return [(f.grade, f.message) for f in findings(inspect(read_bag(bag))) if f.name == "settings"]


@given(st.dictionaries(st.from_regex(r"[a-z][a-z0-9_]{0,9}", fullmatch=True), VALUE, max_size=5))
def test_settings_come_back_as_they_were(settings):
    """Apart from where the recording lies and who was in the graph."""
    settings.pop("format", None)
    found = parse_settings("here", settings_text({**settings, "bag": "x", "graph": ["twin"]}))
    assert found == {n: v for n, v in settings.items() if n not in ("bag", "graph")}


def test_all_declared_parameters_can_be_kept():
    """At their defaults."""
    found = parse_settings("here", settings_text(resolve({})))
    left_out = set(msgs_config.parameters()) - set(found)
    assert left_out == {"bag", "graph", "resume", "run_settings", "secure", "split_size"}


@pytest.mark.parametrize(
    ("given_", "words"),
    [
        (7, "a text of at most"),
        ("x" * (MAX_CHARACTERS + 1), "a text of at most"),
        ("__import__('os').system('true')", "settings in JSON"),
        ("[" * 50_000, "settings in JSON"),
        ("[]", "names with values"),
        ('{"seed": 3}', "and their format"),
        ('{"format": "ldt-settings-2", "seed": 3}', "another version"),
        (text(Seed=3), "names in small letters, got 'Seed'"),
        (text(seed={"a": 1}), "here, seed: expected true or false"),
        (text(seed=None), "here, seed"),
        (text(seed=10**30), "here, seed"),
        (text(effect=["a", 1]), "here, effect"),
        (text(model="a\x1b[2J"), "here, model"),
        ('{"format": "ldt-settings-1", "noise": 1e999}', "here, noise"),
        ('{"format": "ldt-settings-1", "noise": NaN}', "here, noise"),
    ],
)
def test_what_is_no_such_text_is_refused_in_a_sentence(given_, words):
    """As a whole, and nothing in it is evaluated."""
    with pytest.raises(RecordingError) as refused:
        parse_settings("here", given_)
    assert words in str(refused.value)
    assert len(str(refused.value)) < 300
    assert "\x1b" not in str(refused.value)


def test_a_run_and_its_replay_keep_what_they_were_started_with(tmp_path, capsys, short_rotor):
    """The metadata holds texts alone, as rosbag2 wants; the replay names what it played."""
    run, again = tmp_path / "run", tmp_path / "again"
    common = ["--machine", short_rotor, "--model", "physics"]
    options = [*common, "--experiments", "2", "--seed", "3", "--effect", "unbalance:e=0.005"]
    assert invoke(ldt, ["run", *options, "--bag", str(run)]) == 0
    assert (
        invoke(ldt, ["replay", str(run), *common, "--detector", "lddm", "--out", str(again)]) == 0
    )
    capsys.readouterr()
    custom = read_bag(run).storage.metadata["custom_data"]
    assert {type(v) for v in custom.values()} == {str}
    settings = read_bag(run).settings()
    kept = {"seed": 3, "experiments": 2, "model": "physics", "gate": "holdout", "threshold": 3.0}
    assert kept.items() <= settings.items()
    assert settings["effect"] == ["unbalance:e=0.005"]
    assert not {"bag", "graph"} & set(settings)
    replayed = read_bag(again).settings()
    assert (replayed["detector"], replayed["play"]) == ("lddm", str(run))
    assert "seed" not in replayed
    # What it says is what starts the same run.
    assert invoke(ldt, ["run", *as_options(settings).split(), "--bag", str(tmp_path / "b")]) == 0
    first, second = (list(read_bag(b).experiments()) for b in (run, tmp_path / "b"))
    assert [e.speed.tobytes() for e in first] == [e.speed.tobytes() for e in second]
    assert invoke(ldt, ["doctor", str(run)]) == 0
    shown = capsys.readouterr().out
    assert "--experiments 2 --seed 3 --effect unbalance:e=0.005" in shown


def test_the_page_shows_them_without_paths_and_as_text(tmp_path):
    """Those that differ from the defaults as options, and all of them in a table."""
    own = f"/home/somebody/{HOSTILE.replace('/', '')}.py:Mine"
    bag = with_settings(
        fake_run(tmp_path / "run"),
        settings_text(resolve({"model": own, "seed": 3, "namespace": "hall/press"})),
    )
    shown = page(read_run(bag))
    plain = unescape(shown)
    assert "somebody" not in plain
    assert "<img" not in shown
    assert f"{HOSTILE.replace('/', '')}.py:Mine" in plain
    assert "--seed 3" in plain
    assert "--namespace hall/press" in plain
    assert "<td>3 rad/s</td>" in shown.replace("\n", "").replace("  ", "")


def test_recordings_without_settings_are_read_as_ever(tmp_path):
    """And the page says that they are not there."""
    bag = fake_run(tmp_path / "run")
    assert read_bag(bag).settings() == {}
    assert [grade for grade, _ in told(bag)] == [Grade.OK]
    assert "The recording holds no settings of the run." in page(read_run(bag))


@pytest.mark.parametrize("value", [HOSTILE, {"a": [1]}, '{"format": "ldt-settings-9"}', 3])
def test_settings_that_cannot_be_read_concern_nothing_else(value, tmp_path):
    """A warning of the doctor, and a remark on the page; the run is shown as it is."""
    bag = with_settings(fake_run(tmp_path / "run"), value)
    assert [grade for grade, _ in told(bag)] == [Grade.OK, Grade.WARNING]
    assert len(list(read_bag(bag).experiments())) == 6
    shown = page(read_run(bag))
    assert "Mind the health of the recording: 1 remark." in shown
    assert "<img" not in shown
    assert str(tmp_path) not in shown


@pytest.mark.slow
@pytest.mark.parametrize("command", ["predict", "replay", "run"])
def test_a_recording_is_taken_with_its_own_machine_alone(command, tmp_path, capsys, short_rotor):
    """Its own file, also a calibrated one; another's is refused with what to do about it.

    Without --machine it is the one that ships with LDT under the recorded name, and none is
    guessed where none is recorded.
    """
    data = yaml.safe_load(Path(short_rotor).read_text())
    calibrated, other = tmp_path / "calibrated.yaml", tmp_path / "press.yaml"
    data["parameters"]["K_t"] *= 1.01
    calibrated.write_text(yaml.safe_dump(data))
    other.write_text(yaml.safe_dump({**data, "name": "press"}))
    run, bare = tmp_path / "run", tmp_path / "bare"
    given = ["--machine", short_rotor, "--experiments", "2"]
    assert invoke(ldt, ["run", *given, "--model", "physics", "--bag", str(run)]) == 0
    assert invoke(ldt, ["simulate", *given, "--out", str(bare)]) == 0
    nameless = tmp_path / "nameless"
    with BagWriter(nameless) as writer:
        for experiment in read_bag(bare).experiments():
            writer.write("experiment", experiment, experiment.end)
    capsys.readouterr()
    pressed = tmp_path / "pressed"
    assert (
        invoke(ldt, ["simulate", "--machine", str(other), *given[2:], "--out", str(pressed)]) == 0
    )
    capsys.readouterr()
    refused = (
        "--machine: expected the file of 'rotor', of which {} was recorded (leave --machine out"
    )
    renamed = tmp_path / "renamed.yaml"
    renamed.write_text(yaml.safe_dump({**data, "name": "mill"}))
    told = "{}: recorded of the machine 'press', while the file is of 'mill'"
    refused_rotor = "--machine: expected the file of 'press', of which {} was recorded (write"
    asked = "--machine: expected the file of 'press', of which {} was recorded, got none"
    nothing_said = "--machine: expected a machine file, since {} does not say of which machine"
    for index, (bag, machine, words) in enumerate(
        (
            (run, short_rotor, ""),
            (bare, short_rotor, ""),
            (bare, calibrated, ""),
            (nameless, other, ""),
            (run, calibrated, ""),  # which is what a calibrated one is for
            (bare, None, ""),
            (nameless, None, nothing_said),
            (run, other, refused),
            (bare, other, refused),
            (pressed, None, asked),
            (pressed, short_rotor, refused_rotor),
            (pressed, renamed, told),
        )
    ):
        given = [str(bag), *(["--machine", str(machine)] if machine else [])]
        if command == "run":
            given = ["--play", *given, "--no-bag"]
        else:
            given += ["--out", str(tmp_path / f"out_{index}")]
        if command != "predict":
            given += ["--model", "physics"]
        code = 2 if words.startswith("--machine") else 0
        assert invoke(ldt, [command, *given]) == code
        said = capsys.readouterr().err
        assert (
            said.startswith(f"{'ldt: ' * (code == 2)}{words}".format(bag)) if words else said == ""
        ), said


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("seed", -1, "expected 0 to"),
        ("order", "x", "expected a finite number"),
        ("experiments", 10**15, "expected 1 to"),
        ("model", ["linear"], "expected a word"),
        ("offset", 1, "expected true or false"),
    ],
)
def test_a_recorded_parameter_that_no_run_can_have_is_refused(name, value, words):
    """By its name, before anything is made of it."""
    with pytest.raises(RecordingError, match=rf"run, settings, {name}: {words}"):
        parse_settings("run, settings", text(**{name: value}))
