"""Parts of the user's own; what the pages show of them, `test_docs.py` runs."""

from __future__ import annotations

import json
import re
import tomllib
from importlib.metadata import EntryPoint

from ldt_core import docs
from ldt_core.base import registry
from ldt_core.cli import invoke, ldt
from ldt_core.machine.machine_file import Machine, load_machine


def test_the_page_s_effect_is_installed_as_it_says(tmp_path, monkeypatch):
    """Its entry point makes it an effect that a machine file names, and that a twin tries."""
    page = docs.text("effect")
    (code,), (block,) = (
        re.findall(rf"```{kind}\n(.*?)```", page, re.S) for kind in ("python", "toml")
    )
    (tmp_path / "cubic_drag.py").write_text(code)
    monkeypatch.syspath_prepend(str(tmp_path))
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
