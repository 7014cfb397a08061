"""What the pages show of own parts does what they say; `test_docs.py` runs the pages themselves."""

from __future__ import annotations

import json
import re
import tomllib
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest

from ldt_core import docs
from ldt_core.base import registry
from ldt_core.base.registry import Registry
from ldt_core.checks import check_detector
from ldt_core.cli import effects, invoke, ldt, simulate
from ldt_core.effects import parse_effect
from ldt_core.machine.machine_file import Machine, load_machine
from ldt_core.recording.bag import read_bag

PAGES = docs.text("detector") + docs.text("effect")


@pytest.fixture
def mine(tmp_path, monkeypatch) -> Path:
    """The detector of the pages in a file of its own."""
    return written("mine.py", tmp_path, monkeypatch)


def written(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A Python file of the pages, in the folder that is the present one from now on."""
    monkeypatch.chdir(folder)
    block = next(b for b in re.findall(r"```python\n(.*?)```", PAGES, re.S) if f"# {name}" in b)
    Path(name).write_text(block)
    return folder / name


def fewer(command: str, experiments: int) -> str:
    """A command with another number of experiments."""
    return re.sub(r"--experiments \d+", f"--experiments {experiments}", command)


def test_the_page_s_detector_runs(mine, capsys):
    """By the command that stands below it, with fewer experiments."""
    command = next(c for c in PAGES.splitlines() if "mine.py:RootMeanSquare" in c)
    arguments = fewer(command, 3).split()[1:]
    assert invoke(ldt, [*arguments, "--model", "physics", "--no-bag"]) == 0
    assert "mine.py:RootMeanSquare detector" in capsys.readouterr().out


def test_the_page_s_detector_keeps_the_protocol(mine):
    """As the line below it says."""
    check_detector(Registry("detector", {}, "none").get(f"{mine}:RootMeanSquare")())


def test_the_page_s_effect_is_checked_and_acts(tmp_path, monkeypatch, capsys):
    """By the commands that stand below it, with fewer experiments; that it is found from a
    recording as well, `test_diagnose.py` holds."""
    written("cubic_drag.py", tmp_path, monkeypatch)
    check, use, _ = (c for c in PAGES.splitlines() if c.startswith("ldt") and "cubic_drag.py:" in c)
    assert invoke(effects.command, check.split()[2:]) == 0
    assert "the neutral values change nothing" in capsys.readouterr().out
    arguments = fewer(use, 1).split()[2:]
    assert invoke(simulate.command, [*arguments, "--noise", "0"]) == 0
    assert "cubic_drag:c=2e-06" in capsys.readouterr().out
    machine, (effect, given) = load_machine("rotor"), parse_effect(arguments[3])
    experiment = next(read_bag("dragged").experiments())
    state = machine.model.initial_state(machine.parameters, 0.0)
    about = (machine.parameters, experiment.voltage, experiment.period, state)
    dragged = machine.model.simulate(*about, [(effect, given)])[:, 1]
    np.testing.assert_allclose(experiment.speed, dragged, atol=1e-9)
    assert np.abs(experiment.speed - machine.model.simulate(*about)[:, 1]).max() > 0.1


def test_the_page_s_effect_is_installed_as_it_says(tmp_path, monkeypatch):
    """Its entry point makes it an effect that a machine file names, and that a twin tries."""
    written("cubic_drag.py", tmp_path, monkeypatch)
    monkeypatch.syspath_prepend(str(tmp_path))
    (block,) = re.findall(r"```toml\n(.*?)```", PAGES, re.S)
    (entry,) = tomllib.loads(block)["project"]["entry-points"]["ldt.effect"].items()
    point = EntryPoint(*entry, "ldt.effect")
    monkeypatch.setattr(registry, "entry_points", lambda group: [point])
    known = [{"name": "cubic_drag", "parameters": {"c": 1e-6}}]
    machine = Machine({**load_machine("dc_motor").as_dict(), "effects": known})
    assert machine.acting == ("cubic_drag",)
    assert "cubic_drag" in [effect.name for effect in machine.possible_effects()]


def test_what_a_part_prints_is_not_among_the_results(tmp_path, monkeypatch, capsys):
    """With --json, standard output is for programs."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.py").write_text(
        "from ldt_core.detectors.threshold import Threshold\n"
        "class Mine(Threshold):\n"
        "    def judge(self, residual, deviation):\n"
        "        print('judged')\n"
        "        return super().judge(residual, deviation)\n"
    )
    given = ["--experiments", "2", "--model", "physics", "--detector", "own.py:Mine", "--no-bag"]
    assert invoke(ldt, ["run", *given, "--json"]) == 0
    printed, beside = capsys.readouterr()
    assert json.loads(printed)["runs"][0]["experiments"] == 2
    assert beside.count("judged") == 2
