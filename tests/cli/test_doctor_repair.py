"""`ldt doctor BAG --repair` as a command: what it says, what it leaves, how it exits."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from ldt_core.base.experiment import Experiment
from ldt_core.base.settings import ENDLESS
from ldt_core.cli import invoke, ldt
from ldt_core.recording.bag import experiments, read_bag
from ldt_core.recording.writer import BagWriter

RUN = Path(__file__).resolve().parents[2] / "bags" / "rotor_drift"
FILE = "rotor_drift_0.mcap"


@pytest.fixture
def bag(tmp_path) -> Path:
    """A recording with damage in its middle and without an end."""
    folder = tmp_path / "bag"
    shutil.copytree(RUN, folder)
    data = bytearray((folder / FILE).read_bytes()[:-300_000])
    data[800_000:900_000] = bytes(100_000)
    (folder / FILE).write_bytes(data)
    return folder


def doctor(capsys, *arguments: str) -> tuple[int, str, str]:
    code = invoke(ldt, ["doctor", *arguments])
    shown = capsys.readouterr()
    return code, shown.out, shown.err


def test_a_damaged_recording_is_mended_and_said_to_be(bag, capsys):
    """Exit 0: what was recovered, which numbers are missing, where the damaged file is now."""
    damaged = (bag / FILE).read_bytes()
    before = [e.number for e in experiments(bag).experiments]
    code, shown, _ = doctor(capsys, str(bag))
    assert code == 1
    assert "-> commands use what is there; ldt doctor --repair puts it into sound files" in shown
    code, shown, errors = doctor(capsys, str(bag), "--repair")
    assert (code, errors) == (0, "")
    lines = shown.splitlines()
    assert lines[0].startswith(f"ok       repair       {FILE} rewritten, ")
    assert f"/experiment {len(before)}" in lines[0]
    assert f"kept as {FILE}.damaged" in lines[0]
    assert lines[1] == (
        "ok       repair       metadata.yaml rewritten: it did not count what the files hold"
    )
    missing = next(line for line in lines if " missing " in line)
    assert missing.startswith("warning  experiments  number")
    assert (bag / f"{FILE}.damaged").read_bytes() == damaged
    assert [e.number for e in experiments(bag).experiments] == before
    assert read_bag(bag).machine == "rotor"


def test_a_sound_recording_is_left_as_it_is(tmp_path, capsys):
    """Exit 0 and said so, in JSON too."""
    folder = tmp_path / "bag"
    shutil.copytree(RUN, folder)
    before = {f.name: (f.read_bytes(), f.stat().st_mtime_ns) for f in folder.iterdir()}
    code, shown, _ = doctor(capsys, str(folder), "--repair", "--json")
    assert code == 0
    said = json.loads(shown)
    assert said["ok"] is True
    assert said["checks"][0] == {
        "name": "repair",
        "grade": "ok",
        "message": "nothing to repair; left unchanged",
        "remedy": "",
    }
    assert {f.name: (f.read_bytes(), f.stat().st_mtime_ns) for f in folder.iterdir()} == before


def test_what_cannot_be_mended_is_a_problem(bag, capsys):
    """Exit 1: a file that is listed and gone; the other is mended all the same."""
    text = (bag / "metadata.yaml").read_text()
    listed = text.replace(f"  - {FILE}\n", f"  - {FILE}\n  - gone_1.mcap\n")
    (bag / "metadata.yaml").write_text(listed)
    code, shown, _ = doctor(capsys, str(bag), "--repair")
    assert code == 1
    assert f"repair       {bag}: metadata.yaml lists gone_1.mcap, which is missing -> " in shown
    assert (bag / f"{FILE}.damaged").exists()
    assert (bag / "metadata.yaml").read_text() == listed  # the file may be put back


def test_a_recording_of_nothing_stays_one(tmp_path, capsys):
    """Killed before the first message: sound files, no experiments, exit 1 and no traceback."""
    with BagWriter(tmp_path / "bag", "rotor") as writer:
        assert writer.counts == {}
    file = tmp_path / "bag" / "bag_0.mcap"
    file.write_bytes(file.read_bytes()[:40])
    code, shown, errors = doctor(capsys, str(tmp_path / "bag"), "--repair")
    assert (code, errors) == (1, "")
    assert "bag_0.mcap rewritten, 0 messages recovered" in shown
    assert shown.splitlines()[-1].startswith("problem  recording")


def test_the_files_of_several_machines_are_mended_without_naming_one(tmp_path, capsys):
    """Exit 0; the findings are on one machine, chosen by --namespace."""
    folder, rest = tmp_path / "bag", np.zeros(9)
    with BagWriter(folder, "rotor") as writer:
        for name in ("press", "mill"):
            writer.write(f"/{name}/experiment", Experiment(1, 5.0, 0.1, rest, rest), 5.0)
    file = folder / "bag_0.mcap"
    file.write_bytes(file.read_bytes()[:-9])
    code, shown, _ = doctor(capsys, str(folder), "--repair")
    assert code == 0
    assert "2 messages (/mill/experiment 1, /press/experiment 1) recovered" in shown
    assert "warning  recording" in shown
    assert doctor(capsys, str(folder), "--repair", "--namespace", "mill")[0] == 0


def test_a_recording_that_is_being_written_is_no_damage(tmp_path, capsys):
    """Its last file has no end yet: exit 0, and no command speaks of a writer that was killed."""
    rest = np.zeros(9)
    bag = str(tmp_path / "bag")
    with BagWriter(bag, "rotor") as writer:
        writer.write("experiment", Experiment(1, 5.0, 0.1, rest, rest), 5.0)
        writer.flush()
        code, shown, _ = doctor(capsys, bag)
        assert code == 0
        assert shown.startswith("ok       files        being written now: 1 file, ")
        for command in (["info", bag], ["export", bag, "-o", str(tmp_path / "table.csv")]):
            assert invoke(ldt, command) == 0
            told = capsys.readouterr()
            assert "killed" not in told.out + told.err


def test_info_names_the_command_that_goes_on_with_a_run(tmp_path, short_rotor, capsys):
    """With the machine file, which has to be given again; a stream has no end to be short of."""
    began = {"machine": short_rotor, "source": "stream", "experiments": ENDLESS}
    with BagWriter(tmp_path / "bag", "rotor", settings=began) as writer:
        rest = np.zeros(9)
        writer.write("experiment", Experiment(1, 5.0, 0.1, rest, rest), 5.0)
    assert invoke(ldt, ["info", str(tmp_path / "bag")]) == 0
    again = f"ldt up --resume {tmp_path / 'bag'} --machine {short_rotor}"
    assert f"stopped after 1 experiment; continue with {again}" in capsys.readouterr().out


def test_what_is_no_recording_is_refused(tmp_path, capsys):
    """Exit 2 and one sentence: nothing given, nothing there, one that is being written."""
    code, _, errors = doctor(capsys, "--repair")
    assert code == 2
    assert errors == "ldt: --repair: expected a RECORDING to repair, got none\n"
    assert doctor(capsys, str(tmp_path / "nowhere"), "--repair")[0] == 2
    with BagWriter(tmp_path / "bag", "rotor"):
        code, _, errors = doctor(capsys, str(tmp_path / "bag"), "--repair")
    assert code == 2
    wanted = "expected a recording that nobody is writing, got one that is being written"
    assert errors == f"ldt: {tmp_path / 'bag'}: {wanted}\n"
