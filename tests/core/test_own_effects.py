"""Effects of the user's own in a machine file: read, tried, written again, and told where wrong."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

import ldt_core as ldt
from ldt_core.base.errors import MachineFileError
from ldt_core.machine.machine_file import Machine
from ldt_core.models.diagnosed import DiagnosedModel
from ldt_core.restart.run_key import own_files
from tests.motors import all_but

FAN = """
import math

from ldt_core.effects.base import Effect
from ldt_core.physics.parameter import Parameter


def torque(t, theta, omega, current, voltage, p):
    over = max(abs(omega) - p[1], 0.0)
    return -p[0] * over * over * math.tanh(omega / 0.5)


FAN = Effect(
    name="threshold_fan",
    description="a fan whose flaps open above a threshold speed",
    equation="torque = -c max(|omega| - w0, 0)^2 sign(omega)",
    parameters=(
        Parameter("c", "N m s^2", low=0.0, default=0.0, description="coefficient"),
        Parameter("w0", "rad/s", low=0.0, default=50.0, description="threshold speed"),
    ),
    typical={"c": 1e-5, "w0": 50.0},
    torque=torque,
)
"""
MOTOR = {
    "name": "conveyor",
    "physics": "dc_motor",
    "parameters": {"J": 0.001, "K_t": 0.055, "R": 1.0, "L": 0.001, "b": 0.0001},
    "limits": {"voltage": [-24, 24]},
    "experiment": {"duration": 3.0, "sample_period": 0.01},
}
TRUE = {"c": 1.5e-5, "w0": 70.0}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch) -> Path:
    """The present one, with the effect's file."""
    monkeypatch.chdir(tmp_path)
    Path("mine.py").write_text(FAN)
    return tmp_path


def conveyor(**keys) -> Machine:
    """The machine with other keys in its file."""
    return Machine({**MOTOR, "own_effects": ["mine.py:FAN"], **keys})


def worn(count: int = 4) -> list[ldt.Experiment]:
    """Experiments of the conveyor with the fan, by steps of its own, not by LDT."""
    random, found = np.random.default_rng(3), []
    for number in range(1, count + 1):
        volts = np.repeat(random.uniform(-12, 12, 4).round(1), 75)
        speed, omega, step = np.zeros(volts.size), 0.0, 1e-4
        for k, level in enumerate(volts):
            speed[k] = omega
            for _ in range(100):
                drive = 0.055 * (level - 0.055 * omega)  # the winding is ten times as fast
                fan = TRUE["c"] * max(abs(omega) - TRUE["w0"], 0.0) ** 2 * np.sign(omega)
                omega += step / 0.001 * (drive - 1e-4 * omega - fan)
        noisy = speed + random.normal(0.0, 0.1, speed.size)
        found.append(ldt.Experiment(number, 10.0 * number, 0.01, voltage=volts, speed=noisy))
    return found


def test_an_own_effect_of_the_machine_file_is_tried_calibrated_and_known():
    """Without being installed: the diagnosis names it, and the fitted file has it."""
    machine = Machine({**conveyor().as_dict(), "parameters": {**MOTOR["parameters"], "L": 0.0}})
    others = all_but("quadratic_drag", "viscous_friction", "threshold_fan")
    experiments = worn()
    diagnosis = ldt.diagnose(experiments, machine, without=others)
    assert diagnosis.verdict.effects == ["threshold_fan"]
    ldt.calibrate(experiments, machine, with_=diagnosis).save("known.yaml")
    known = ldt.Machine("known.yaml")
    assert known.own_effects == ("mine.py:FAN",)
    assert known.acting == ("threshold_fan",)
    assert known.parameters["threshold_fan.c"] == pytest.approx(TRUE["c"], rel=0.1)
    assert known.parameters["threshold_fan.w0"] == pytest.approx(TRUE["w0"], rel=0.05)


def test_an_own_effect_that_acts_is_written_as_it_was_read():
    """By its own name, beside the file that it is from."""
    drag = {"name": "quadratic_drag", "parameters": {"c": 1e-6}}
    keys = {"effects": [drag, {"name": "threshold_fan", "parameters": TRUE}]}
    machine = conveyor(**keys)
    assert machine.effects[1][1] == TRUE
    assert {**machine.as_dict()} == {**MOTOR, "own_effects": ["mine.py:FAN"], **keys}
    assert Machine(yaml.safe_load(yaml.safe_dump(machine.as_dict()))).as_dict() == machine.as_dict()


def test_a_simulation_takes_an_own_effect_by_its_name():
    """As it takes one of the library."""
    plain, fanned = (
        ldt.simulate(conveyor(), 1, effects=e, voltage="constant")[0].speed
        for e in ((), {"threshold_fan": {"c": 1e-4}})
    )
    assert np.abs(plain).max() > 1.2 * np.abs(fanned).max() > 50


def test_a_recorded_model_finds_an_own_effect_by_the_machine_file_alone():
    """What is recorded names no file to run."""
    cause = {"effect": "threshold_fan", "parameters": TRUE, "std": None, "noise_std": None}
    record = {"machine": MOTOR["parameters"], "cause": cause}
    model = DiagnosedModel(conveyor(), record, cause="auto")
    assert model.effect is not None
    assert model.effect.name == "threshold_fan"
    with pytest.raises(ValueError, match="threshold_fan"):
        DiagnosedModel(Machine(MOTOR), record, cause="auto")


def test_settings_in_one_text_are_no_name_of_a_file():
    """`ldt up --cause mine.py:FAN` ended with "File name too long"."""
    said = '{"format": "ldt-settings-1", "cause": "mine.py:FAN"' + 300 * " " + "}"
    found = own_files(conveyor(), {"recorded": said, "effect": ["other.py:DRAG:c=1"]})
    assert set(found) == {"mine.py", "other.py"}


@pytest.mark.parametrize(
    ("own", "said"),
    [
        ("mine.py:FAN", "own_effects: expected a list of file.py:NAME"),
        (["threshold_fan"], "own_effects, entry 1: expected file.py:NAME"),
        (["none.py:FAN"], "a Python file at none.py"),
        (["mine.py:VAN"], "'FAN'"),
        (["mine.py:FAN", "mine.py:FAN"], "a name that no other effect has, got 'threshold_fan'"),
        (["bad.py:FAN"], "a name that no other effect has, got 'quadratic_drag'"),
        (["needs.py:FAN"], "a machine with parameter K_x"),
        (["list.py:FAN"], "a function that numba compiles"),
    ],
)
def test_a_wrong_own_effect_gets_a_sentence(own, said):
    """With the key, before anything is computed."""
    Path("bad.py").write_text(FAN.replace('"threshold_fan"', '"quadratic_drag"'))
    Path("needs.py").write_text(FAN.replace("torque=torque", 'torque=torque, needs=("K_x",)'))
    Path("list.py").write_text(FAN.replace("return -p[0]", "return -[p, omega]"))
    with pytest.raises(MachineFileError, match=re.escape(said)) as told:
        conveyor(own_effects=own)
    assert "\n" not in str(told.value)


def test_a_file_in_the_place_of_a_name_is_told_where_it_belongs():
    """`effects` names effects, `own_effects` their files."""
    with pytest.raises(MachineFileError, match=re.escape("`own_effects: [mine.py:FAN]`")):
        Machine({**MOTOR, "effects": [{"name": "mine.py:FAN", "parameters": TRUE}]})


def test_an_installed_effect_whose_helper_s_file_changes_is_compiled_anew(folder):
    """numba's cache looks at the file of the function alone: the old helper went on acting."""
    Path("drags.py").write_text(
        "from slopes import slope\n\n\ndef torque(t, a, w, i, u, p):\n    return -p[0] * slope(w)\n"
    )
    ask = (
        "import ctypes, drags, numpy as np\n"
        "from ldt_core.physics.terms import compile_term\n"
        "term, one = compile_term('drag', drags.torque, False), np.array([1.0])\n"
        "kind = ctypes.CFUNCTYPE(ctypes.c_double, *5 * [ctypes.c_double], ctypes.c_void_p)\n"
        "print(kind(term.address)(0, 0, 1, 0, 0, one.ctypes.data))\n"
    )
    told = []
    for factor in ("2.0", "3.0"):
        Path("slopes.py").write_text(f"def slope(w):\n    return {factor} * w\n")
        paths = os.pathsep.join([str(folder), *sys.path])
        ran = subprocess.run(
            [sys.executable, "-c", ask],
            env={**os.environ, "PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1"},
            capture_output=True,
            text=True,
            check=True,
        )
        told.append(float(ran.stdout))
    assert told == [-2.0, -3.0]


def test_an_effect_that_fails_at_its_typical_values_ends_no_file(folder):
    """Which numbers it changes is then not known: each keeps its own tolerance."""
    Path("magnet.py").write_text("""
from ldt_core.effects.base import Effect
from ldt_core.physics.parameter import Parameter


def change(values, part):
    assert part < 0.2, "no such magnet"
    return {**values, "K_t": values["K_t"] * (1 - part)}


MAGNET = Effect(
    name="magnet",
    description="a magnet that has lost a part",
    equation="K_t := (1 - part) K_t",
    parameters=(Parameter("part", "", 0.0, 0.9, 0.0, "that is lost", scale=0.1),),
    typical={"part": 0.3},
    on_parameters=change,
)
""")
    known = [{"name": "magnet", "parameters": {"part": {"value": 0.1, "std": 0.01}}}]
    machine = Machine({**MOTOR, "own_effects": ["magnet.py:MAGNET"], "effects": known})
    assert machine.tolerances["K_t"] > 0
