"""What commands are fed by mistake: one clear sentence, or the right answer."""

from __future__ import annotations

import io
import os
import signal
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from ldt_core.base.errors import BadInput, OptionError
from ldt_core.base.experiment import Experiment
from ldt_core.base.metrics import FreeRunError
from ldt_core.base.stopping import interrupted_by_signals
from ldt_core.calibration.calibration import Calibration
from ldt_core.cli import invoke, ldt, main
from ldt_core.cli.outputs import no_empty_folder
from ldt_core.cli.recorded_machine import machine_of
from ldt_core.diagnosis.library import library
from ldt_core.estimation.grey_box_problem import GreyBoxProblem
from ldt_core.machine.machine_file import load_machine
from ldt_core.recording.writer import BagWriter

OWN = """
from ldt_core.physics.effect import Effect
from ldt_core.physics.parameter import Parameter


def torque(t, theta, omega, current, voltage, p):
    return {returned}


MINE = Effect(
    name="{name}",
    description="a test",
    equation="torque = 0",
    parameters=(Parameter("c", "N m", low=0.0, default=0.0, description="c", scale=1e-3),),
    typical={{"c": 1e-3}},
    torque=torque,
)
"""


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("predict bag --machine dc_motor --with '' --out x", "--with: expected a name"),
        ("diagnose bag --machine dc_motor --out ''", "--out: expected a name"),
        ("run --play= --no-bag", "--play: expected a name"),
        ("calibrate bag --machine dc_motor --free , --out x.yaml", "--free: expected names"),
        ("calibrate bag --machine dc_motor --fixed '' --out x.yaml", "--fixed: expected names"),
        ("tune bag --adaptations nan --out x", "--adaptations: expected a whole number"),
    ],
)
def test_a_variable_that_nobody_has_set_is_named(line, words, tmp_path, monkeypatch, capsys):
    """An empty name or list counted as none given: the run simulated what it was to play."""
    monkeypatch.chdir(tmp_path)
    arguments = ["" if a == "''" else a for a in line.split()]
    assert invoke(ldt, arguments) == 2
    assert words in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_name_that_begins_with_a_dash_can_be_copied_from_what_is_told(
    tmp_path, monkeypatch, capsys
):
    """`ldt report -x` has been told, which is an option."""
    monkeypatch.chdir(tmp_path)
    line = "run --machine dc_motor --experiments 1 --model physics --out -x"
    assert invoke(ldt, line.split()) == 0
    assert "ldt report ./-x -o run.html" in capsys.readouterr().out
    assert invoke(ldt, ["info", "./-x"]) == 0
    assert "ldt report ./-x " in " ".join(capsys.readouterr().out.split()) + " "


def test_the_file_within_a_recording_is_told_its_folder():
    """It was taken for a machine file."""
    with pytest.raises(BadInput, match=r"expected the recording's folder, my/bag"):
        machine_of("rotor", ["my/bag/metadata.yaml"], "")


def ended_while_it_works(folder: Path) -> None:
    """What a service manager does to a command that has made its folder."""
    with no_empty_folder(folder):
        folder.mkdir()
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(5.0)


def test_sigterm_leaves_no_empty_folder(tmp_path):
    """As Ctrl-C; `ldt diagnose` left one when a service manager ended it."""
    before = signal.signal(signal.SIGTERM, signal.SIG_DFL)
    try:
        interrupted_by_signals()
        with pytest.raises(KeyboardInterrupt):
            ended_while_it_works(tmp_path / "why")
        assert not (tmp_path / "why").exists()
    finally:
        signal.signal(signal.SIGTERM, before)


def test_every_command_heeds_it():
    """And `nohup`, which ignores SIGHUP, is left its way."""
    kept = {n: signal.getsignal(n) for n in (signal.SIGTERM, signal.SIGHUP)}
    try:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        with pytest.raises(SystemExit):
            main(["--version"])
        assert signal.getsignal(signal.SIGTERM) != signal.SIG_DFL
        assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    finally:
        for number, handler in kept.items():
            signal.signal(number, handler)


def test_several_recordings_that_all_fail_leave_no_empty_folder(tmp_path, capsys):
    """With --each it is a table, and no exception."""
    with BagWriter(tmp_path / "short", machine="dc_motor") as writer:
        writer.write("experiment", Experiment(1, 0.0, 0.01, np.ones(9), np.arange(9.0)), 0.1)
    line = f"diagnose {tmp_path}/short --machine dc_motor --each --jobs 1 --out {tmp_path}/why"
    assert invoke(ldt, line.split()) == 2
    assert "at least 200 samples" in capsys.readouterr().err
    assert not (tmp_path / "why").exists()


def test_a_name_that_is_no_utf_8_is_kept_by_its_code():
    """A traceback of YAML's, when all was calculated."""
    blank = FreeRunError()
    blank.add(np.zeros(3))
    motor, errors, numbers = load_machine("dc_motor"), {"fit": (blank, blank)}, {"fit": [1]}
    bare = Calibration(motor, motor, (), {}, [], {"speed": 0.1}, "none", errors, numbers, ())
    found = bare.with_recordings([os.fsdecode(b"x\xff")])
    assert found.as_dict()["recordings"] == ["x\\udcff"]


def test_a_terminal_without_a_letter_gets_its_code(monkeypatch, tmp_path):
    """`ldt info` of a recording with a name in Chinese ended in a traceback on latin-1."""
    stream = io.TextIOWrapper(io.BytesIO(), encoding="latin-1", write_through=True)
    monkeypatch.setattr("sys.stdout", stream)
    with BagWriter(tmp_path / "试验", machine="dc_motor") as writer:
        writer.write("experiment", Experiment(1, 0.0, 0.01, np.ones(9), np.arange(9.0)), 0.1)
    assert invoke(ldt, ["info", str(tmp_path / "试验")]) == 0
    assert b"\\u8bd5" in stream.buffer.getvalue()


def own(folder: Path, name: str, returned: str = "-p[0]") -> str:
    """An effect of the user's own."""
    file = folder / f"{name}.py"
    file.write_text(OWN.format(name=name, returned=returned))
    return f"{file}:MINE"


def test_an_own_effect_does_not_vanish_behind_the_library_s(tmp_path):
    """One of the same name was left out in silence, and its answer was the library's."""
    machine = load_machine("dc_motor")
    mine = own(tmp_path, "coulomb_friction")
    with pytest.raises(OptionError, match="or --without coulomb_friction"):
        library(machine, [mine])
    found = library(machine, [mine], ["coulomb_friction"])
    assert [e.description for e in found if e.name == "coulomb_friction"] == ["a test"]
    assert library(machine, ["coulomb_friction"]) == library(machine)


@pytest.mark.parametrize(
    ("returned", "words"),
    [("-p", "No implementation of function"), ("q[0]", "NameError: name 'q' is not defined")],
)
def test_an_own_effect_that_does_not_compile_is_told_with_its_reason(returned, words, tmp_path):
    """A diagnosis said that it could not be simulated; elsewhere a line without a reason came."""
    with pytest.raises(OptionError, match=words) as error:
        library(load_machine("dc_motor"), [own(tmp_path, "mine", returned)])
    assert "\x1b" not in str(error.value)


def test_one_sample_is_simulated_whatever_the_motor_is():
    """One whose current follows at once is solved for, step by step; `ldt identify` failed."""
    machine = load_machine("dc_motor")
    values = {**machine.parameters, "L": 1e-9}
    friction = machine.effect("coulomb_friction")
    one = Experiment(1, 0.0, 0.01, np.array([5.0]), np.array([3.0]))
    start = machine.model.initial_state(values, 3.0)
    acting = [(friction, friction.check(friction.typical))]
    states = machine.model.simulate(values, one.voltage, one.period, start, acting)
    assert states.shape[0] == 1
    assert states[0, 1] == 3.0


def test_a_fit_with_every_coordinate_at_its_bound_stays_there():
    """A twin learned nothing at 0 V, for the reason of an array without entries."""
    box = SimpleNamespace(size=2, _longest=np.ones(2), _low=np.zeros(2), _high=np.ones(2))
    x, free = np.array([0.0, 1.0]), np.zeros(2, dtype=bool)
    stepped = GreyBoxProblem._stepped(box, x, np.eye(2), np.ones(2), free, 1e-3)
    assert stepped.tolist() == [0.0, 1.0]
