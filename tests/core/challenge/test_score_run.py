"""`ldt challenge score`: seals, keys that do not fit, and one whole run."""

from __future__ import annotations

import hashlib
import importlib
import json
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner
from fake_answers import answer

from ldt_core.base.errors import BadInput
from ldt_core.cli import main
from ldt_core.cli.challenge import command
from ldt_core.effects import get_effect
from ldt_core.lab.challenge.comparators import COMPARATORS
from ldt_core.lab.challenge.make import make_challenge
from ldt_core.lab.challenge.score import score, sealed
from ldt_core.lab.challenge.score.answer import Answers
from ldt_core.lab.challenge.score.key import left_out, read_keys

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """(folder of two cases, their key): motors, as a shaft that shakes takes four times as long."""
    out = tmp_path_factory.mktemp("score") / "cases"
    return out, make_challenge(2, 5, out, samples=400, jobs=1)


@pytest.fixture
def counted(monkeypatch):
    """Cases whose diagnosis was asked for; it says that there is no gap."""
    asked = []

    def fake(task):
        asked.append((task.name, task.who, task.left_out))
        seen = sealed.read_sealed(task.folder).seen()
        return [
            type(a)(a.who, a.found, seen=seen)
            for a in (answer("none", who=who) for who in task.who)
        ]

    monkeypatch.setattr(score, "answer", fake)
    return asked


def edited(key: Path, to: Path, **changes) -> Path:
    """The key with other entries for its first case; None removes one."""
    entries = json.loads(key.read_text())
    entries[0] = {k: v for k, v in (entries[0] | changes).items() if v is not ...}
    to.write_text(json.dumps(entries))
    return to


def test_what_is_answered_is_not_asked_again_unless_the_case_changes(made, tmp_path, counted):
    """An interrupted score goes on where it was; a damaged answer is made anew."""
    out, key = made
    cases = shutil.copytree(out, tmp_path / "cases")
    for _ in range(2):
        score.score_challenge(cases, [key], tmp_path / "score", jobs=1)
    assert [name for name, _, _ in counted] == ["case_0001", "case_0002"]
    (tmp_path / "score" / "case_0001" / "diagnosis.json").write_text("{}")
    machine = cases / "case_0002" / "machine.yaml"
    machine.write_text(machine.read_text() + "\n")
    score.score_challenge(cases, [key], tmp_path / "score", jobs=1)
    assert [name for name, _, _ in counted[2:]] == ["case_0001", "case_0002"]


def test_before_the_answers_are_written_the_key_tells_only_what_to_leave_out(
    made, tmp_path, counted, monkeypatch
):
    """The whole of it is read when every diagnosis is on disk."""
    out, key = made
    name = json.loads(key.read_text())[0]["case"]
    sealed = edited(key, tmp_path / "key", left_out="inertia", kind="single", effects=["inertia"])
    assert left_out([sealed])[name] == "inertia"
    there = []

    def spied(files):
        there.extend((tmp_path / "score").glob("*/diagnosis.json"))
        return read_keys(files)

    monkeypatch.setattr(score, "read_keys", spied)
    score.score_challenge(out, [sealed], tmp_path / "score", jobs=1)
    assert len(there) == 2
    assert [left for _, _, left in counted] == ["inertia", None]


def test_comparators_answer_a_subset_and_are_set_beside_the_diagnosis_on_it(
    made, tmp_path, counted
):
    """A note says so."""
    out, key = made
    options = {"comparators": True, "subset": 1, "jobs": 1}
    found = score.score_challenge(out, [key], tmp_path / "score", **options)
    assert len(found.judged["diagnosis"]) == 2
    assert len(found.judged["greedy"]) == len(found.judged[score.SAME_CASES]) == 1
    assert "first 1 of 2 cases" in found.notes[0]
    assert counted[2][0] == "case_0001"
    assert set(counted[2][1]) <= set(COMPARATORS)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"case": "case_0009"}, "case_0001: expected an entry for it in a key, got none"),
        ({"case": "case_0002"}, "one entry for each case, got case_0002 again"),
        ({"case": ...}, "expected a list of entries, each with its case"),
        ({"kind": "duo"}, "kind: expected one of none, single"),
        ({"kind": "single", "effects": ["inertai"]}, "did you mean 'inertia'"),
        ({"kind": "pair", "effects": ["inertia"]}, "expected 2 of a pair case, got 1"),
        ({"left_out": "nothing"}, "left_out: expected one of"),
        ({"physics": "steam"}, "expected the machine of the key, steam"),
        ({"noise": "much"}, "noise: expected a number of 0 or more, got 'much'"),
        ({"further_noise": {"11": "much"}}, "further_noise: expected numbers of experiments"),
        ({"place": {"from": 1}}, "place: expected a quantity with from and to"),
    ],
)
def test_a_key_that_does_not_match_is_refused(made, tmp_path, counted, changes, sentence):
    """In one sentence."""
    out, key = made
    with pytest.raises(BadInput, match=sentence):
        score.score_challenge(
            out, [edited(key, tmp_path / "key", **changes)], tmp_path / "score", jobs=1
        )


def test_a_recording_with_current_is_not_that_of_a_key_without(made, tmp_path, counted):
    """A case of the same name may be another challenge's."""
    out, key = made
    noise = None if json.loads(key.read_text())[0]["current_noise"] else 0.02
    other = edited(key, tmp_path / "key", current_noise=noise)
    with pytest.raises(BadInput, match="current, as the key says"):
        score.score_challenge(out, [other], tmp_path / "score", jobs=1)


@pytest.mark.parametrize("what", ["no folder", "none", "missing case", "half a case", "no key"])
def test_what_is_no_challenge_is_refused_by_the_command(made, tmp_path, what, capsys):
    """Exit code 2, before anything is computed."""
    out, key = made
    cases = tmp_path / "cases"
    if what == "none":
        cases.mkdir()
    elif what != "no folder":
        shutil.copytree(out, cases)
    if what == "missing case":
        shutil.rmtree(cases / "case_0002")
    if what == "half a case":
        (cases / "case_0002" / "machine.yaml").unlink()
    given = tmp_path / "nothing" if what == "no key" else key
    with pytest.raises(SystemExit, match="2"):
        main(["challenge", "score", str(cases), str(given)])
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "cases.score").exists()


def test_a_crash_is_an_answer_and_the_others_are_kept(made, tmp_path, monkeypatch):
    """It counts as wrong, and the score says why."""

    def crash(*_, **__):
        raise ZeroDivisionError("division by zero")

    monkeypatch.setattr(sealed, "diagnose", crash)
    out, key = made
    found = score.score_challenge(out, [key], tmp_path / "score", jobs=1)
    assert [j.outcome for j in found.judged["diagnosis"]] == ["failed"] * 2
    assert found.judged["diagnosis"][0].answer.error == "ZeroDivisionError: division by zero"
    assert found.table.get("diagnosis", "failed").value == 1.0


@pytest.mark.timeout(120)
def test_the_command_diagnoses_scores_and_prints_the_hash_first(made, tmp_path, monkeypatch):
    """Two cases from end to end; what is kept is what `ldt predict --with` takes."""
    few = [get_effect(name) for name in ("coulomb_friction", "inertia", "sensor_gain")]
    monkeypatch.setattr(sealed, "library", lambda machine, without: few)
    out, key = made
    options = ["score", out, key, "--out", tmp_path / "score", "--jobs", "1"]
    done = CliRunner().invoke(command, [str(o) for o in options], catch_exceptions=False)
    digest = hashlib.sha256(key.read_bytes()).hexdigest()
    assert done.stdout.splitlines()[0] == f"SHA-256 of {key}: {digest}"
    assert "score.md" in done.stdout
    plain = json.loads((tmp_path / "score" / "score.json").read_text())
    assert [c["case"] for c in plain["cases"]] == ["case_0001", "case_0002"]
    assert all(c["verdict"] in ("none", "effect", "ambiguous", "unknown") for c in plain["cases"])
    kept = Answers(tmp_path / "score")
    for case in ("case_0001", "case_0002"):
        found = json.loads((tmp_path / "score" / case / "diagnosis.json").read_text())
        assert {"verdict", "gap", "where", "candidates", "effects"} < set(found)
        about = {"case": score.file_digest(out / case), "left_out": None}
        assert kept.read(case, "diagnosis", {**sealed.answer_stamp(), **about}).seconds > 0


def test_a_command_works_after_the_command_run_was_imported(capsys):
    """Whose file has the name of what once invoked commands, and took its place."""
    importlib.import_module("ldt_core.cli.run")
    with pytest.raises(SystemExit) as stopped:
        main(["challenge", "--help"])
    assert stopped.value.code == 0
    assert "sealed" in capsys.readouterr().out
