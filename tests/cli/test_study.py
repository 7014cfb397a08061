"""`ldt study` as a user meets it."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from ldt_core.cli import invoke, ldt
from ldt_core.lab.study import engine, study_page
from ldt_core.lab.study.study import Study
from ldt_core.machine.machine_file import load_machine

COLUMNS = "model,detector,seed,mme,mme_original,adaptations,precision,recall"


def small(machine: str, out: Path, *more: str) -> list[str]:
    # Processes of its own take longer to start than all these runs.
    size = ["--seeds", "2", "--experiments", "6", "--only", "paper", "--jobs", "1"]
    return ["study", "--out", str(out), "--machine", machine, *size, *more]


@pytest.fixture(scope="module")
def done(short_rotor, tmp_path_factory) -> Path:
    """Folder of a small study, its figures not drawn."""
    out = tmp_path_factory.mktemp("study") / "out"
    with pytest.MonkeyPatch.context() as patched:
        undrawn(patched)
        assert invoke(ldt, small(short_rotor, out)) == 0
    return out


def undrawn(patched: pytest.MonkeyPatch) -> None:
    """No drawings, which take seconds."""

    def write_page(study, out):
        return Path(out) / "study.html"

    patched.setattr(study_page, "write_figures", lambda study, out: [])
    patched.setattr(study_page, "write_study_page", write_page)


@pytest.fixture
def quick_page(monkeypatch):
    """Without drawings."""
    undrawn(monkeypatch)


def test_the_table_the_page_and_the_figures_are_made_without_computing_again(
    done, short_rotor, monkeypatch
):
    """One row a run; a page that needs no other file; figures as PNG and SVG."""
    monkeypatch.setattr(engine, "work", None)
    (done / "table.csv").unlink()
    assert invoke(ldt, small(short_rotor, done)) == 0
    text = (done / "table.csv").read_text()
    assert text.splitlines()[0] == COLUMNS
    rows = list(csv.DictReader(text.splitlines()))
    assert len(rows) == 12
    assert {(r["model"], r["detector"]) for r in rows} == {
        (m, d) for m in ("linear", "hybrid") for d in ("threshold", "lddm", "window")
    }
    assert all(float(r["mme"]) > 0 and float(r["mme_original"]) > 0 for r in rows)
    assert len(list(csv.DictReader((done / "runs.csv").read_text().splitlines()))) == 14
    text = (done / "study.html").read_text()
    assert "hybrid" in text
    assert "<svg" in text
    figures = {p.suffix for p in (done / "figures").iterdir()}
    assert figures == {".png", ".svg"}


def test_it_ends_with_the_papers_table_beside_ours(done, short_rotor, capsys, quick_page):
    """And with where the page is; on a pipe there is nothing else."""
    assert invoke(ldt, small(short_rotor, done)) == 0
    shown = capsys.readouterr()
    assert shown.err == ""
    assert "in the paper" in shown.out
    assert "8.86" in shown.out
    assert "6.86" in shown.out
    assert f"page: {done / 'study.html'}" in shown.out


def test_json_is_all_that_is_printed(done, short_rotor, capsys, quick_page):
    """Rows of the table, means with intervals, where the page is."""
    assert invoke(ldt, small(short_rotor, done, "--json")) == 0
    record = json.loads(capsys.readouterr().out)
    assert len(record["table"]) == record["runs"] == 12
    assert [list(r) for r in record["table"]] == [COLUMNS.split(",")] * 12
    assert record["summary"][0]["mme"]["count"] == 2
    assert record["page"] == str(done / "study.html")


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGKILL])
def test_an_interrupted_study_goes_on_where_it_was(
    done, short_rotor, tmp_path, quick_page, programs, end
):
    """After Ctrl-C and after kill -9: what was finished stays, and the table is the same."""
    out = tmp_path / "out"
    program = [sys.executable, "-c", "from ldt_core.cli import main; main()"]
    process = programs.start(
        [*program, *small(short_rotor, out, "--jobs", "1")],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 60
    while len(list(out.glob("runs/*.json"))) < 2 and time.monotonic() < deadline:
        time.sleep(0.005)
    os.killpg(process.pid, end)
    said = process.communicate(timeout=30)[1]
    assert process.returncode == (130 if end is signal.SIGINT else -signal.SIGKILL)
    if end is signal.SIGINT:
        assert f"which are kept in {out}" in said
        assert "Traceback" not in said
    kept = {p: p.stat().st_mtime_ns for p in out.glob("runs/*.json")}
    assert 2 <= len(kept) < 12
    assert invoke(ldt, small(short_rotor, out)) == 0
    assert {p: p.stat().st_mtime_ns for p in kept} == kept
    assert (out / "table.csv").read_text() == (done / "table.csv").read_text()


@pytest.mark.parametrize(
    ("given", "seeds", "experiments"),
    [
        ([], 20, 200),
        (["--quick"], 2, 40),
        (["--quick", "--seeds", "5"], 5, 40),
        (["--quick", "--experiments", "200"], 2, 200),
    ],
)
def test_quick_is_for_trying_out(monkeypatch, tmp_path, quick_page, given, seeds, experiments):
    """Unless seeds or experiments are said."""
    asked = []

    def conduct(plan, out, **_):
        asked.append(plan)
        return Study({}, ())

    monkeypatch.setattr(engine, "conduct", conduct)
    assert invoke(ldt, ["study", "--out", str(tmp_path), *given]) == 0
    assert (asked[0].seeds, asked[0].experiments) == (seeds, experiments)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("--seeds 0", "--seeds"),
        ("--seeds many", "--seeds"),
        ("--experiments 0", "experiments"),
        ("--only papers", "papers"),
        ("--only baseline", "paper or better"),
        ("--jobs -1", "--jobs"),
        ("--machine roter", "roter"),
        ("--quick --scheduler nonsense", "nonsense"),
        ("--quick --machine still.yaml", "still.yaml, simulation.degradation: expected effect"),
    ],
)
def test_bad_input_is_one_sentence(tmp_path, monkeypatch, capsys, arguments, words):
    """Exit code 2, and nothing is written."""
    monkeypatch.chdir(tmp_path)
    still = {k: v for k, v in load_machine("dc_motor").as_dict().items() if k != "simulation"}
    Path("still.yaml").write_text(json.dumps(still))
    out = tmp_path / "out"
    assert invoke(ldt, ["study", "--out", str(out), *arguments.split()]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert len(said.strip().splitlines()) == 1
    assert not out.exists()


@pytest.mark.parametrize("damage", ["{", '{"format": "other"}', "[]", '{"format": "ldt-study-1"}'])
def test_a_folder_that_is_no_studys_is_left_alone(tmp_path, capsys, damage):
    """Even when a file there is called as ours are."""
    (tmp_path / "study.json").write_text(damage)
    assert invoke(ldt, ["study", "--out", str(tmp_path), "--quick"]) == 2
    assert str(tmp_path) in capsys.readouterr().err
    assert [p.read_text() for p in tmp_path.iterdir()] == [damage]


@pytest.mark.parametrize("place", ["new", "runs", "robustness"])
def test_a_folder_that_cannot_be_written_to_is_refused_at_once(
    place, short_rotor, tmp_path, monkeypatch, one_sentence
):
    """Not when the first result is there, which may take minutes."""
    monkeypatch.setattr(engine, "_complete", pytest.fail)
    out = Path("/proc/study")
    if place != "new":
        out = tmp_path / "out"
        monkeypatch.setattr(engine, "_is_study", lambda out: True)
        out.mkdir()
        (out / place).symlink_to("/proc")
    assert invoke(ldt, small(short_rotor, out)) == 2
    assert one_sentence().startswith("ldt: --out: expected a folder that can be written to, got ")


def test_a_damaged_result_is_said(done, short_rotor, capsys, quick_page):
    """And computed anew."""
    file = next((done / "runs").iterdir())
    file.write_text("")
    assert invoke(ldt, small(short_rotor, done)) == 0
    assert f"could not be read and were computed again, the first being {file}" in (
        capsys.readouterr().out
    )
