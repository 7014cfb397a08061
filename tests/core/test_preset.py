"""The best is the default, and the paper's configuration is one word away."""

from __future__ import annotations

import json

import pytest

import ldt_core as ldt
from ldt_core.base.errors import OptionError
from ldt_core.base.settings import PRESETS, preset, resolve
from ldt_core.cli import invoke
from ldt_core.cli import ldt as command
from ldt_core.lab.study.study_plan import StudyPlan
from ldt_core.recording.bag import read_bag
from ldt_core.recording.run_settings import LEFT_OUT
from ldt_core.restart.run_key import resumed

PAPER = PRESETS["paper"]
EXPLICIT = (
    *("--model", "hybrid", "--detector", "threshold", "--threshold", "3", "--gate", "none"),
    *("--warning-threshold", "1.5", "--data", "warning-set", "--gp-inputs", "speed"),
    *("--no-offset", "--no-sensor-check"),
)
SHORT = ("--experiments", "8", "--seed", "3", "--start-time", "1e9", "--degradation", "abrupt")


def recorded(folder, machine, *options):
    """What a command run with these options has recorded, and its settings."""
    bag = str(folder / "run")
    assert invoke(command, ["run", "--machine", machine, *SHORT, "--bag", bag, *options]) == 0
    opened = read_bag(bag)
    names = ("experiment", "prediction", "signal", "model", "adaptation")
    messages = [(m.topic, m.data) for m in opened.messages(*names)]
    return messages, opened.settings()


def settings_of(tmp_path, machine, *options):
    return recorded(tmp_path, machine, *options)[1]


def test_the_best_is_the_default():
    """Of commands, nodes and in Python."""
    assert (resolve({})["model"], resolve({})["detector"]) == ("auto", "adequacy")
    assert ldt.Twin("rotor", model="hybrid").detector.name == "adequacy"


def test_the_preset_is_the_options_that_it_stands_for(tmp_path, short_rotor):
    """Every message bit for bit, and every setting."""
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
    one = recorded(tmp_path / "one", short_rotor, "--preset", "paper")
    other = recorded(tmp_path / "other", short_rotor, *EXPLICIT)
    assert one == other
    assert len([topic for topic, _ in one[0] if topic == "/model"]) > 1  # it has learned
    assert PAPER.items() <= one[1].items()


@pytest.mark.parametrize("preset_first", [True, False])
def test_options_and_files_win_over_it(preset_first, tmp_path, short_rotor):
    """Whatever comes first."""
    file = tmp_path / "own.yaml"
    file.write_text(json.dumps({"threshold": 2.0, "model": "physics"}))
    own = ["--settings", str(file), "--gate", "holdout"]
    word = ["--preset", "paper"]
    got = settings_of(tmp_path, short_rotor, *(word + own if preset_first else own + word))
    assert (got["threshold"], got["model"], got["gate"]) == (2.0, "physics", "holdout")
    assert (got["detector"], got["data"]) == ("threshold", "warning-set")


def test_replay_takes_it_too(tmp_path, short_rotor):
    """With a recording that was made by other settings."""
    bag, out = str(tmp_path / "run"), str(tmp_path / "again")
    settings_of(tmp_path, short_rotor, "--model", "physics", "--detector", "never")
    given = ["replay", bag, "--machine", short_rotor, "--preset", "paper", "--model", "linear"]
    assert invoke(command, [*given, "--order", "1", "--out", out]) == 0
    got = read_bag(out).settings()
    assert {**PAPER, "model": "linear"}.items() <= got.items()


@pytest.mark.parametrize("name", ["papper", "none"])
def test_an_unknown_one_is_refused_in_a_sentence(name, one_sentence):
    """Exit code 2, and what there is."""
    assert invoke(command, ["run", "--preset", name, "--no-bag"]) == 2
    assert one_sentence().startswith("ldt: preset: expected one of 'paper'")
    with pytest.raises(OptionError, match=f"got '{name}'"):
        ldt.Twin("rotor", preset=name)


def test_in_python():
    """Named settings and arguments win there too."""
    twin = ldt.Twin("rotor", preset="paper")
    assert PAPER.items() <= twin.settings.items()
    assert (twin.model.kind, twin.detector.name) == ("hybrid", "threshold")
    twin = ldt.Twin("rotor", model="linear", preset="paper", threshold=2.0)
    got = twin.settings
    assert (got["model"], got["threshold"], got["gate"]) == ("linear", 2.0, "none")
    experiments = ldt.simulate("rotor", experiments=1, seed=3)
    ran = ldt.run(experiments, "rotor", preset="paper", detector="never")
    assert (ran.twin.model.kind, ran.twin.detector.name) == ("hybrid", "never")


def test_a_model_of_a_users_own_is_no_contest():
    """The default model's name does not stand for one that was given as an object."""
    own = ldt.Twin("rotor", model="linear").model
    twin = ldt.Twin("rotor", model=own)
    assert twin.settings["model"] == "linear"
    assert type(twin.adaptor) is type(ldt.Twin("rotor", model="linear").adaptor)


def test_its_values_are_settings_that_exist():
    """Checked as any others, and none of those that say where a run is recorded."""
    assert {n: v for n, v in resolve(preset("paper")).items() if n in PAPER} == PAPER
    assert not PAPER.keys() & set(LEFT_OUT)
    assert preset("") == {}


def test_the_study_means_the_same_by_the_paper():
    """Its row of that model and detector is the preset."""
    cases = [p.case for p in StudyPlan(1, 10, groups=("paper",)).runs()]
    (own,) = [c for c in cases if (c.model, c.detector) == (PAPER["model"], PAPER["detector"])]
    assert PAPER.items() <= own.resolved.items()


def test_a_run_under_other_defaults_goes_on_under_its_own(tmp_path, short_rotor):
    """A recording states its settings, whatever the defaults are by now."""
    before = settings_of(tmp_path, short_rotor, *EXPLICIT)
    found = resumed(resolve({"resume": str(tmp_path / "run"), "machine": short_rotor}))
    assert before.items() <= found.items()
