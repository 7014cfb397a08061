"""Measured machines, from their files to a diagnosis, by the commands of `ldt docs real`."""

from __future__ import annotations

import gzip
import json

import numpy as np
import pytest

import ldt_core as ldt
from ldt_core.cli import calibrate, diagnose, identify, import_file, invoke, predict
from ldt_core.effects import EFFECTS

pytestmark = pytest.mark.usefixtures("undrawn", "one_core")


def call(command, *arguments):
    assert invoke(command.command, [str(a) for a in arguments]) == 0


def without(*kept):
    """The library is long: options that leave all effects out but these."""
    return [a for name in EFFECTS.names() if name not in kept for a in ("--without", name)]


def error(capsys, *arguments):
    """What `ldt predict` prints as the root mean square error."""
    capsys.readouterr()
    call(predict, *arguments, "--json")
    return json.loads(capsys.readouterr().out)["rmse"]


@pytest.fixture
def generator(measured, tmp_path):
    """Ten times thinned: 50 s of the first half as experiments of 12.5 s, 50 s of the second."""
    with gzip.open(measured / "motor_generator" / "motor_generator.csv.gz", "rt") as file:
        head, *rows = file.read().splitlines()[:300_001]
    bags = []
    for name, part, length in (("first", rows[:50_000], 12.5), ("second", rows[250_000:], 50)):
        source, bag = tmp_path / f"{name}.csv", str(tmp_path / name)
        source.write_text("\n".join([head, *part[::10]]) + "\n")
        fields = ["--voltage", "drive", "--speed", "speed", "--sample-period", 0.01]
        call(import_file, source, *fields, "--length", length, "--out", bag)
        bags.append(bag)
    return bags


def test_the_motor_generator_s_drive_does_not_brake(generator, tmp_path, capsys):
    """Named with the sensor's lag, and the error on what was never seen falls to a third."""
    first, second = generator
    machine, out = tmp_path / "machine.yaml", tmp_path / "diagnosis"
    call(identify, first, "--no-offset", "--limits", "0,5", "--out", machine)
    tried = without("no_regeneration", "sensor_lag", "brush_drop")
    call(diagnose, first, "--machine", machine, *tried, "--out", out)
    found = json.loads((out / "diagnosis.json").read_text())
    assert set(found["verdict"]["effects"]) >= {"no_regeneration", "sensor_lag"}
    shares = {c["effect"]: c["shapley_share"] for c in found["candidates"]}
    assert shares["no_regeneration"] > 0.8
    before = error(capsys, second, "--machine", machine, "--out", tmp_path / "before")
    with_it = ["--with", out / "diagnosis.json", "--out", tmp_path / "after"]
    assert error(capsys, second, "--machine", machine, *with_it) < before / 3


def test_the_rig_s_step_shows_a_lag(measured, tmp_path, capsys):
    """Which end of the machine it is at, the step does not tell; it says so, and draws it."""
    pytest.importorskip("matplotlib")
    source, bag = measured / "rtl_dcmotor" / "open_loop_5_15V.csv", tmp_path / "rig"
    fields = ["--voltage", "voltage_V", "--speed", "speed_rpm:rpm", "--time", "time_s"]
    call(import_file, source, *fields, "--out", bag)
    machine, out, figure = tmp_path / "rig.yaml", tmp_path / "diagnosis", tmp_path / "rig.png"
    call(calibrate, bag, "--machine", "dc_motor", "--out", machine)
    tried = without("input_delay", "sensor_lag", "coulomb_friction", "viscous_friction")
    call(diagnose, bag, "--machine", machine, *tried, "--out", out, "--figure", figure)
    found = json.loads((out / "diagnosis.json").read_text())
    assert found["verdict"]["kind"] == "ambiguous"
    assert any({"input_delay", "sensor_lag"} <= set(group) for group in found["ambiguities"])
    assert figure.stat().st_size > 10_000
    before = error(capsys, bag, "--machine", machine, "--out", tmp_path / "before")
    with_it = ["--with", out / "diagnosis.json", "--out", tmp_path / "after"]
    assert error(capsys, bag, "--machine", machine, *with_it) < before / 3


def test_the_default_learns_on_a_measured_motor(measured):
    """A speed controller's record in pieces of two seconds, of a motor that no cause explains.

    The first teaches it for those after the second.
    """

    def record(name):
        table = np.genfromtxt(
            measured / "rtl_dcmotor" / f"{name}.csv", delimiter=",", names=True, encoding="utf-8"
        )
        return table["time_s"], table["voltage_V"], table["speed_rpm"] * 2 * np.pi / 60

    time, volts, speed = record("open_loop_5_15V")
    period = float(np.median(np.diff(time)))
    step = ldt.Experiment(1, 0.0, period, voltage=volts, speed=speed)
    rig = ldt.calibrate([step], "dc_motor").machine
    _, volts, speed = record("closed_loop_20_25_b")
    length = round(2.0 / period)
    whole = range(0, len(volts) - length + 1, length)
    pieces = [
        ldt.Experiment(
            k, 10.0 * k, period, voltage=volts[i : i + length], speed=speed[i : i + length]
        )
        for k, i in enumerate(whole[3:7], start=1)
    ]
    last = ldt.run(pieces, rig).steps[2:]
    mine, original = (
        sum(p.max_error(s.experiment) for s, p in both)
        for both in ([(s, s.prediction) for s in last], [(s, s.original) for s in last])
    )
    assert mine < 0.5 * original
