"""Swapped columns: the speed's says what the voltage's will be, and not the other way round."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest

import ldt_core as ldt
from ldt_core.base.experiment import Experiment
from ldt_core.calibration.calibrate import calibrate
from ldt_core.cli import invoke
from ldt_core.cli import ldt as program
from ldt_core.machine.direction_check import QUESTION, swapped
from ldt_core.machine.machine_file import load_machine
from ldt_core.recording.writer import BagWriter
from tests.motors import all_but

MOTOR = load_machine("dc_motor")


def exchanged(experiments, size=0.1):
    """With the columns swapped, the speed's as voltages within the limits."""
    return [
        replace(e, voltage=np.clip(size * e.speed, -24, 24), speed=e.voltage) for e in experiments
    ]


def controlled(noise, gain, count=2000, period=0.01, seed=0):
    """A motor whose voltage a controller sets by the speed that it measures."""
    random = np.random.default_rng(seed)
    speed, summed, rows = 0.0, 0.0, []
    for k in range(count):
        measured = speed + noise * random.standard_normal()
        left = (60.0 if (k * period) // 2 % 2 else 100.0) - measured
        summed += left * period
        volts = float(np.clip(gain * left + 4 * gain * summed, -24, 24))
        rows.append((volts, measured))
        pole = np.exp(-2.6 * period)
        speed = pole * speed + (1 - pole) * volts / 0.052
    return [Experiment(1, 1e9, period, *np.array(rows).T)]


@pytest.mark.parametrize("machine", ["dc_motor", "rotor"])
@pytest.mark.parametrize("noise", [0.0, 0.1, 1.0])
def test_swapped_columns_are_asked_about_and_right_ones_are_not(machine, noise):
    """Whatever the motor, and the noise of its sensor."""
    asked = 0
    for seed in range(8):
        made = ldt.simulate(machine, 2, seed=seed, noise=noise)
        assert swapped(made) == ""
        asked += swapped(exchanged(made)) == QUESTION
    assert asked >= 5  # a regular pattern of steps may be foreseen a little by its own answer


@pytest.mark.parametrize("effect", ["coulomb_friction", "input_delay", "backlash", "open_circuit"])
def test_no_effect_is_taken_for_swapped_columns(effect):
    assert swapped(ldt.simulate("dc_motor", 3, effects=[effect], seed=1, noise=0.1)) == ""


@pytest.mark.parametrize("noise", [0.01, 0.1, 1.0, 5.0])
@pytest.mark.parametrize("gain", [0.01, 0.05, 0.5])
def test_a_controller_s_voltage_is_no_swapped_column(noise, gain):
    """It follows the speed, and moves it."""
    assert swapped(controlled(noise, gain)) == ""


@pytest.mark.parametrize("length", [1, 4, 5, 12])
def test_little_or_nothing_tells_nothing(length):
    """Constant, at rest, or too short."""
    rest = np.zeros(length)
    for voltage, speed in ((rest, rest), (rest + 12, rest), (rest, rest + 5)):
        assert swapped([Experiment(1, 0.0, 0.01, voltage, speed)]) == ""
    assert swapped([]) == ""


@pytest.mark.parametrize("volts", [5.0, 0.1, 12.0])
def test_a_constant_voltage_is_no_swapped_column(volts):
    """Nothing moves it, whatever rounding leaves; a real speed is beside it."""
    made = ldt.simulate("dc_motor", 4, seed=2, noise=0.1)
    assert swapped([replace(e, voltage=np.full(len(e), volts)) for e in made]) == ""


def test_commands_ask(tmp_path, monkeypatch, capsys):
    """Import, calibrate, diagnose and identify; each error names its recording."""
    monkeypatch.chdir(tmp_path)
    made = ldt.simulate("dc_motor", 4, seed=3, noise=0.1)
    with BagWriter("bag", machine="dc_motor") as writer:
        for e in exchanged(made):
            writer.write("experiment", e, e.end)
    assert swapped(exchanged(made)) == QUESTION
    asked = calibrate(MOTOR, exchanged(made)).notes
    assert f"Do not trust these values: {QUESTION}" in asked
    few = [word for name in all_but("inertia") for word in ("--without", name)]
    invoke(program, ["diagnose", "bag", *few, "--out", "why"])
    assert QUESTION in capsys.readouterr().out.replace("\n", " ")
    assert invoke(program, ["identify", "bag", "--out", "motor.yaml"]) == 1
    told = capsys.readouterr().err
    assert told.startswith("ldt: bag: ")
    assert QUESTION in told
    with open("log.csv", "w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["volts", "speed"])
        for e in exchanged(made):
            rows.writerows(zip(e.voltage, e.speed, strict=True))
    given = ["--voltage", "volts", "--speed", "speed", "--sample-period", "0.01", "--out", "made"]
    assert invoke(program, ["import", "log.csv", *given]) == 0
    assert QUESTION in capsys.readouterr().out


def test_an_error_of_a_calibration_names_the_recording(tmp_path, monkeypatch, capsys):
    """Of several, the first ones."""
    monkeypatch.chdir(tmp_path)
    for name, start in (("one", 1e9), ("two", 1.1e9)):
        with BagWriter(name, machine="dc_motor") as writer:
            rest = np.zeros(3)
            writer.write("experiment", Experiment(1, start, 0.01, rest + start / 1e9, rest), 1e9)
    assert invoke(program, ["calibrate", "one", "two", "--out", "made.yaml"]) == 2
    told = capsys.readouterr().err
    assert told.startswith("ldt: one and two, experiment 1: expected 10 samples or more")
