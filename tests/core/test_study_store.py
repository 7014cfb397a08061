"""Results that survive an interruption, and files that are not to be trusted."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from study_results import made_up

from ldt_core.lab.study.engine import StudyStore
from ldt_core.machine.machine_file import load_machine

STAMP = {"ldt": "1", "code": "abc"}
ROTOR = load_machine("rotor")


def result():
    made = made_up([0.0, 0.0, 0.001, 0.001], [3], region=[None, None, 0.1, 1 / 3])
    case = replace(made.case, keep=(2,))
    series = {"time": [0.0, 0.01], "speed": [1.0, 1.1]}
    return replace(made, case=case, max_error=[0.1, 1e-17, 1 / 3, 7.0], kept={2: series})


@pytest.fixture
def store(tmp_path) -> StudyStore:
    return StudyStore(tmp_path, STAMP, ROTOR)


def only_file(tmp_path):
    (file,) = (tmp_path / "runs").iterdir()
    return file


def test_a_result_comes_back_to_the_last_bit(store, tmp_path):
    """Written, and read by another store."""
    store.keep(result().case, result())
    assert StudyStore(tmp_path, STAMP, ROTOR).result(result().case) == result()


def test_a_case_that_was_not_run_is_not_there(store):
    """Any difference makes another case."""
    store.keep(result().case, result())
    case = result().case
    for other in (
        replace(case, seed=1),
        replace(case, settings={"threshold": 2.5}),
        replace(case, alarms=(1,)),
    ):
        assert store.result(other) is None
    assert store.notes == []


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
def test_a_damaged_file_is_no_result(store, tmp_path, damage):
    """It is computed anew, and the study says so."""
    store.keep(result().case, result())
    file = only_file(tmp_path)
    file.write_text(damage(file.read_text()))
    assert store.result(result().case) is None
    assert file.name in store.notes[0]


def test_a_file_under_another_name_is_no_result(store, tmp_path):
    """The name says which run, the content has to agree."""
    store.keep(result().case, result())
    other = replace(result().case, seed=9)
    only_file(tmp_path).rename(tmp_path / "runs" / f"{other.key}.json")
    assert store.result(other) is None
    assert "could not be read" in store.notes[0]


@pytest.mark.parametrize(
    ("stamp", "machine"),
    [({**STAMP, "code": "abd"}, ROTOR), (STAMP, ROTOR.with_parameters(J=0.021))],
)
def test_a_result_of_another_version_or_machine_is_not_used(store, tmp_path, stamp, machine):
    """It is computed anew, and the study says so."""
    store.keep(result().case, result())
    other = StudyStore(tmp_path, stamp, machine)
    assert other.result(result().case) is None
    assert "another version" in other.notes[0]


def test_half_a_file_is_never_seen(store, tmp_path, monkeypatch):
    """What was there before stays when writing fails, and nothing is left beside it."""
    store.keep(result().case, result())
    before = only_file(tmp_path).read_text()
    monkeypatch.setattr(
        "pathlib.Path.replace", lambda *_: (_ for _ in ()).throw(OSError(28, "full"))
    )
    with pytest.raises(OSError, match="full"):
        store.keep(result().case, replace(result(), seconds=9.0))
    assert only_file(tmp_path).read_text() == before


def test_files_are_plain_json(store, tmp_path):
    """With what was run in words, for other programs."""
    store.keep(result().case, result())
    record = json.loads(only_file(tmp_path).read_text())
    assert record["case"]["model"] == "hybrid"
    assert record["origin"]["code"] == "abc"
