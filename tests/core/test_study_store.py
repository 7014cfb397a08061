"""Results that survive an interruption, and files that are not to be trusted."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial

import pytest
from study_results import made_up

from ldt_core.lab.study.engine import study_folder
from ldt_core.lab.study.study_case import RunResult
from ldt_core.machine.machine_file import load_machine

STAMP = {"ldt": "1", "code": "abc"}
ROTOR = load_machine("rotor")


def result():
    made = made_up([0.0, 0.0, 0.001, 0.001], [3], region=[None, None, 0.1, 1 / 3])
    case = replace(made.case, keep=(2,))
    series = {"time": [0.0, 0.01], "speed": [1.0, 1.1]}
    return replace(made, case=case, max_error=[0.1, 1e-17, 1 / 3, 7.0], kept={2: series})


@pytest.fixture
def folder(tmp_path):
    """Of a study, with one result."""
    there = study_folder(tmp_path, STAMP, ROTOR)
    there.write(f"runs/{result().case.key}", result().to_dict())
    return there


def read(folder, case):
    return folder.read(f"runs/{case.key}", partial(RunResult.from_dict, case))


def only_file(folder):
    (file,) = (folder.out / "runs").iterdir()
    return file


def test_a_result_comes_back_to_the_last_bit(folder):
    """From plain JSON."""
    assert json.loads(only_file(folder).read_text())["origin"]["code"] == "abc"
    assert read(folder, result().case) == result()


def test_a_case_that_was_not_run_is_not_there(folder):
    """Any difference makes another case."""
    for change in ({"seed": 1}, {"settings": {"threshold": 2.5}}, {"alarms": (1,)}):
        assert read(folder, replace(result().case, **change)) is None
    assert not folder.damaged


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: text[: len(text) // 2],
        lambda text: "",
        lambda text: "[1, 2]",
        lambda text: text.replace('"max_error":[0.1,', '"max_error":['),
        lambda text: text.replace('"level"', '"lvl"'),
        lambda text: text.replace("ldt-study-1", "another-format"),
    ],
)
def test_a_damaged_file_is_no_result(folder, damage):
    """It is computed anew, and the study says so."""
    file = only_file(folder)
    file.write_text(damage(file.read_text()))
    assert read(folder, result().case) is None
    assert folder.damaged == [str(file)]


def test_a_file_under_another_name_is_no_result(folder):
    """The name says which run, the content has to agree."""
    other = replace(result().case, seed=9)
    only_file(folder).rename(folder.out / "runs" / f"{other.key}.json")
    assert read(folder, other) is None
    assert folder.damaged


@pytest.mark.parametrize(
    ("stamp", "machine"),
    [({**STAMP, "code": "abd"}, ROTOR), (STAMP, ROTOR.with_parameters(J=0.021))],
)
def test_a_result_of_another_version_or_machine_is_not_used(folder, stamp, machine):
    """It is computed anew, and the study says so."""
    other = study_folder(folder.out, stamp, machine)
    assert read(other, result().case) is None
    assert other.foreign == 1
