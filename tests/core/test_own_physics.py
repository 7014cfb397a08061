"""A mistake in somebody else's physics is told in a sentence, where the file names it."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import pytest

from ldt_core.base.errors import MachineFileError
from ldt_core.checks import check_physics
from ldt_core.cli import invoke, ldt
from ldt_core.machine.machine_file import Machine
from ldt_core.physics import PHYSICS

FAN = """
from ldt_core.physics.motor import Motor
from ldt_core.physics.parameter import Parameter
class Fan(Motor):
    name = "fan"
    parameters = (*Motor.parameters, Parameter("J_fan", "kg m^2", 0.0, description="of the fan"))
    def felt(self, v):
        return {**v, "J": v["J"] + v["J_fan"]}
    def constants(self, v):
        return super().constants(self.felt(v))
    def rate(self, v, voltage):
        return super().rate(self.felt(v), voltage)
    def system(self, v):
        return super().system(self.felt(v))
    def state_space(self, v):
        return super().state_space(self.felt(v))
FAN = Fan()
"""
FELT = '{**v, "J": v["J"] + v["J_fan"]}'


def fan(folder: Path, text: str = FAN, effects: tuple[dict, ...] = ()) -> Machine:
    """The machine of a physics whose file says this."""
    file = folder / "fan.py"
    file.write_text(text)
    return Machine(
        {
            "name": "fan",
            "physics": f"{file}:FAN",
            "parameters": {"J": 2e-4, "K_t": 0.06, "R": 0.8, "L": 1e-3, "b": 1e-4, "J_fan": 7e-4},
            "effects": list(effects),
            "limits": {"voltage": [-24, 24]},
            "experiment": {"duration": 2, "sample_period": 0.01},
        }
    )


@pytest.mark.parametrize(
    ("right", "wrong", "said"),
    [
        ("FAN = Fan()", "FAN = Fan", "expected an object, as in FAN = Fan(), got <class"),
        ("FAN = Fan()", "FAN = 3", "expected an object whose class is a Physics"),
        ("FAN = Fan()", "FAN = 1 / 0", "ZeroDivisionError: division by zero (line 17)"),
        ('v["J_fan"]}', 'v["Jfan"]}', "got KeyError: 'Jfan' (line 8)"),
        (FELT, '{**v, "J": float("nan")}', "state_space: expected finite numbers"),
        (f"return {FELT}", 'v["J"] += v["J_fan"]; return v', "the parameters left as they are"),
        (FELT, '{**v, "J": -v["J"]}', "torque constant above 0, got -0.0002, 0.8 and 0.06"),
        ("constants(self, v):", "constants(self):", "constants: expected numbers, got TypeError"),
    ],
)
def test_a_mistake_in_an_own_physics_is_told_with_its_place(right, wrong, said, tmp_path):
    """It was a traceback from inside LDT, or a wrong simulation without a word."""
    assert FAN.count(right) == 1
    with pytest.raises(MachineFileError, match=re.escape(said)) as told:
        fan(tmp_path, FAN.replace(right, wrong))
    assert f"physics {tmp_path / 'fan.py'}:FAN" in str(told.value)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("forgotten", ["constants", "system", "state_space", "rate"])
def test_a_function_that_was_forgotten_is_refused(forgotten, tmp_path):
    """The others tell of a heavier motor: it was simulated as another with effects or without."""
    felt = "rate(self.felt(v), voltage)" if forgotten == "rate" else f"{forgotten}(self.felt(v))"
    light = felt.replace("self.felt(v)", '{**v, "J": 2 * v["J"]}')
    assert felt in FAN
    with pytest.raises(MachineFileError, match="of `constants`"):
        fan(tmp_path, FAN.replace(felt, light))


def test_an_own_physics_without_an_inductance_is_taken(tmp_path):
    """What is solved in its place is the same in all functions."""
    record = fan(tmp_path).as_dict()
    assert Machine({**record, "parameters": {**record["parameters"], "L": 0.0}}).model.name == "fan"


def test_known_effects_leave_the_check_of_the_equations_whole(tmp_path):
    """With an effect in the file, neither `system` nor `rate` was looked at."""
    drag = ({"name": "quadratic_drag", "parameters": {"c": 4e-6}},)
    checked = check_physics(fan(tmp_path, FAN, drag))
    assert checked == check_physics(fan(tmp_path))
    assert "the speeds agree" in " ".join(checked)


def test_a_file_is_run_once_until_it_changes(tmp_path):
    """An engine was made anew at each look at it: slowly, and no check saw what it remembers."""
    machine = fan(tmp_path)
    first = PHYSICS.get(machine.physics)
    assert PHYSICS.get(machine.physics) is first
    assert machine.model is first
    fan(tmp_path, FAN.replace("of the fan", "of the blades"))
    assert PHYSICS.get(machine.physics).parameters[-1].description == "of the blades"


def test_an_engine_that_remembers_is_noticed(tmp_path):
    """Its second run differs from the first."""
    text = """
from ldt_core.physics.motor import Motor
from ldt_core.physics.parameter import Parameter
from ldt_core.physics.simulator import Simulator
class Fan(Simulator):
    name = "fan"
    parameters = (*Motor.parameters, Parameter("J_fan", "kg m^2", 0.0, description="unused"))
    seen = 0
    def advance(self, values, state, voltage, torque, duration):
        self.seen += 1
        return state[0], voltage + 1e-6 * self.seen, state[2]
FAN = Fan()
"""
    with pytest.raises(AssertionError, match="two runs differ"):
        check_physics(fan(tmp_path, text))


def test_a_mistake_that_comes_up_in_a_fit_is_told_with_its_place(tmp_path, capsys):
    """At values that only a fit comes by: a traceback through all of LDT."""
    felt = "    def felt(self, v):\n"
    machine = fan(tmp_path, FAN.replace(felt, felt + "        1 / (v['J_fan'] < 8e-4)\n"))
    (tmp_path / "fan.yaml").write_text(json.dumps(machine.as_dict()))
    bag, file, out = (str(tmp_path / name) for name in ("bag", "fan.yaml", "out.yaml"))
    given = ["--machine", file, "--experiments", "2", "--effect", "inertia:factor=4", "--out", bag]
    assert invoke(ldt, ["simulate", *given]) == 0
    capsys.readouterr()
    assert invoke(ldt, ["calibrate", bag, "--machine", file, "--free", "J_fan", "--out", out]) == 2
    told = capsys.readouterr().err
    assert f"ldt: {tmp_path / 'fan.py'}, line 8: ZeroDivisionError: division by zero\n" in told
    assert "Traceback" not in told


def test_a_file_finds_its_neighbours(tmp_path):
    """One physics builds on another beside it; the command's folder is not where Python looks."""
    (tmp_path / "beside_fan.py").write_text("NAME = 'blower'\n")
    before = list(sys.path)
    text = "from beside_fan import NAME\n" + FAN.replace('name = "fan"', "name = NAME")
    assert fan(tmp_path, text).model.name == "blower"
    assert sys.path == before
