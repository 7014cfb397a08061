"""`ldt effects`: the list, and the check of an effect of one's own."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml

from ldt_core.cli import invoke
from ldt_core.cli.effects import command
from ldt_core.effects import EFFECTS, get_effect
from ldt_core.machine.machine_file import load_machine

HEAD = """
import math
from ldt_core.physics.effect import Effect
from ldt_core.physics.parameter import Parameter

C = (Parameter("c", "N m", 0.0, default=0.0, description="amount", scale=0.05),)

def effect(**more):
    about = {"name": "mine", "description": "d", "equation": "e", "parameters": C}
    return Effect(**{**about, "typical": {"c": 0.05}, **more})
"""


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """A function that writes mine.py with an effect MINE, made of this text."""
    monkeypatch.chdir(tmp_path)

    def write(text: str) -> str:
        (tmp_path / "mine.py").write_text(HEAD + text)
        return "mine.py:MINE"

    return write


def test_the_list_has_every_effect_with_all_that_a_user_needs(capsys):
    """Name, equation, parameters with unit and bounds, reference."""
    assert invoke(command, []) == 0
    shown = capsys.readouterr().out
    for name in EFFECTS.names():
        assert f"{name}: {EFFECTS.get(name).description}" in shown
        assert EFFECTS.get(name).equation in shown
        assert EFFECTS.get(name).reference in shown
    assert "at least 0 and at most 0.95" in shown
    assert "at least 0 N m, 0 is neutral, 0.05 is typical" in shown


def test_the_list_as_json(capsys):
    """One object an effect; a bound that is none is null."""
    assert invoke(command, ["--json"]) == 0
    listed = {e["name"]: e for e in json.loads(capsys.readouterr().out)}
    assert sorted(listed) == EFFECTS.names()
    assert listed["brush_drop"]["parameters"] == [
        {
            "name": "voltage",
            "unit": "V",
            "low": 0.0,
            "high": 10.0,
            "low_is_excluded": False,
            "neutral": 0.0,
            "typical": 1.0,
            "description": "at both brushes together, V_b",
        }
    ]
    assert listed["quadratic_drag"]["parameters"][0]["high"] is None


def test_an_effect_that_keeps_its_promises_is_told_so(mine, capsys):
    """It says what was checked, as text and as JSON."""
    name = mine("MINE = effect(torque=lambda t, a, w, i, u, p: -p[0] * math.tanh(w))")
    assert invoke(command, [name]) == 0
    shown = capsys.readouterr().out
    assert "reads no further than its parameters" in shown
    assert "the neutral values change nothing" in shown
    assert invoke(command, [name, "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["checked"]) == 6


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("MINE = effect(torque=lambda t, a, w, i, u, p: -p[1] * w)", "reads numbers beyond the 1"),
        ("MINE = effect(torque=lambda t, a, w, i, u, p: -p[0] * w / abs(w))", "gives nan at"),
        (
            "MINE = effect(torque=lambda t, a, w, i, u, p: -20 * p[0] * math.tanh(1e6 * w))",
            "a quarter of the integration step changes the speed by",
        ),
        (
            "MINE = effect(torque=lambda t, a, w, i, u, p: -0.1 - p[0])",
            "the neutral values change the speed by",
        ),
        ("MINE = effect(torque=lambda t, a, w, i, u, p: u.size)", "a function that numba compiles"),
        ("MINE = effect(on_measurement=lambda speed, c: speed)", "TypeError"),
        ("MINE = effect(on_measurement=lambda w, dt, c: w[1:] + c)", "600 measured speeds, got"),
        ("MINE = effect(on_parameters=lambda v, c: {**v, 'J': v['J'] - c})", "J of the machine"),
        (
            "MINE = effect(on_parameters=lambda v, c: {})",
            "parameters, m among them",
        ),
        (
            "MINE = effect(torque=lambda t, a, w, i, u, p: -p[0], needs=('Jay',))",
            "needs Jay of a machine, which rotor and dc_motor lack; --machine",
        ),
        (
            "MINE = effect(torque=lambda w, p: -p[0] * w)",
            "(t, theta, omega, current, voltage, p), got <lambda>(w, p)",
        ),
        (
            "MINE = effect(torque=lambda t, a, w, i, u, p: p['c'] * w)",
            "found for signature: getitem(float64*, Literal[str](c)) (line ",
        ),
        ("MINE = effect(torque=lambda t, a, w, i, u, p: print(w) or -p[0])", "which prints"),
        ("MINE = effect(equation='', torque=lambda t, a, w, i, u, p: -p[0])", "no equation"),
        ("MINE = effect(typical={}, torque=lambda t, a, w, i, u, p: -p[0])", "typical values"),
        ("MINE = effect()", "one function among"),
        ("C = (Parameter('c', 0.0),)", "parameter c, unit: expected a text, as in Parameter("),
        (
            "C = (Parameter('c', '', scale=-1.0),)",
            "parameter c, scale: expected a size, at least 0",
        ),
        ("MINE = effect(name='my fan', on_voltage=max)", "letters, digits and _, as in cubic_drag"),
        ("MINE = effect(parameters=Parameter('c', ''), on_voltage=max)", "a tuple of Parameter"),
        ("MINE = effect(parameters=2 * C, on_voltage=max)", "a name each, got c and c"),
        (
            "MINE = effect(torque=lambda t, a, w, i, u, p: 10 * p[0] * w)",
            "look for a wrong sign, unit or size",
        ),
        (
            "MINE = effect(on_measurement=lambda w, dt, c: w * math.nan)",
            "its neutral values give speeds that are not finite",
        ),
        ("MINE = 3", "an object of class Effect"),
        ("YOURS = 3", "'MINE'"),
    ],
)
def test_an_effect_that_does_not_is_told_in_a_sentence(mine, capsys, text, words):
    """Exit code 2 and the first promise that is not kept."""
    name = mine(text)
    assert invoke(command, [name]) == 2
    shown = capsys.readouterr()
    assert words in shown.err
    assert shown.err.count("\n") == 1
    assert shown.out == ""


@pytest.mark.parametrize("body", ["raise ValueError('no')", "assert w < 5"])
def test_an_effect_that_raises_is_refused(mine, capsys, body):
    """Machine code has nobody to raise to: it went on with a torque of 0, and passed the check."""
    text = f"def torque(t, a, w, i, u, p):\n    if w > 5:\n        {body}\n    return -p[0] * w\n"
    assert invoke(command, [mine(text + "MINE = effect(torque=torque)")]) == 2
    said = "without raise, assert and print, got torque, which raises (line "
    assert said in capsys.readouterr().err


def test_what_an_effect_calls_is_compiled_and_looked_at_too(mine, capsys):
    """A plain helper was "an untyped global name"; one that raised was a torque of 0."""
    text = (
        "def slope(w):\n    return w / 0.5\n\n\n"
        "def sign(w):\n    {}\n    return math.tanh(slope(w))\n\n\n"
        "MINE = effect(torque=lambda t, a, w, i, u, p: -p[0] * sign(w))"
    )
    assert invoke(command, [mine(text.format("pass"))]) == 0
    capsys.readouterr()
    assert invoke(command, [mine(text.format("assert w < 50"))]) == 2
    assert "got sign, which raises (line " in capsys.readouterr().err


def test_an_effect_that_writes_into_the_machine_s_parameters_changes_no_machine(mine):
    """They were changed a bit more by each run of a diagnosis."""
    text = (
        "def heavier(values, c):\n    values['J'] *= 1 + c\n    return values\n\n\n"
        "MINE = effect(on_parameters=heavier)"
    )
    effect, motor = get_effect(mine(text)), load_machine("dc_motor")
    before = dict(motor.parameters)
    effect.change_parameters(motor.model, motor.parameters, {"c": 0.1})
    assert motor.parameters == before


def test_a_file_without_the_effect_s_name_is_told_what_lacks(mine, capsys):
    """It was answered by the names of all effects of the library."""
    mine("MINE = effect(on_voltage=max)")
    assert invoke(command, ["mine.py"]) == 2
    assert "expected mine.py:NAME" in capsys.readouterr().err


def test_an_effect_that_needs_a_parameter_of_an_own_physics_is_checked_on_its_machine(
    mine, capsys, tmp_path
):
    """The machines that ship with LDT have no such parameter: it could not be checked at all."""
    (tmp_path / "geared.py").write_text(
        "from ldt_core.physics.motor import Motor\n"
        "from ldt_core.physics.parameter import Parameter\n"
        "class Geared(Motor):\n"
        "    name = 'geared'\n"
        "    parameters = (*Motor.parameters, Parameter('ratio', '', 0.0, open_low=True,\n"
        "                                               description='turns of the motor'))\n"
        "GEARED = Geared()\n"
    )
    record = {**load_machine("dc_motor").as_dict(), "physics": f"{tmp_path / 'geared.py'}:GEARED"}
    record["parameters"]["ratio"] = 4.0
    for effects in ([], [{"name": "quadratic_drag", "parameters": {"c": 1e-6}}]):
        (tmp_path / "geared.yaml").write_text(json.dumps({**record, "effects": effects}))
        law = "lambda t, a, w, i, u, p: -p[0] * math.tanh(w / p[1])"
        name = mine(f"MINE = effect(torque={law}, needs=('ratio',))")
        assert invoke(command, [name, "--machine", str(tmp_path / "geared.yaml")]) == 0
        assert "a quarter of the step" in capsys.readouterr().out


def test_a_name_that_is_taken_is_told(mine, capsys):
    """The check passed, and `ldt diagnose` refused the effect."""
    law = "lambda t, a, w, i, u, p: -p[0] * math.tanh(w)"
    assert invoke(command, [mine(f"MINE = effect(name='inertia', torque={law})")]) == 2
    assert "a name that no other has, got 'inertia'" in capsys.readouterr().err


def test_a_machine_without_an_effect_is_refused(capsys):
    """The list is of all effects, whatever the machine."""
    assert invoke(command, ["--machine", "rotor"]) == 2
    assert "--machine: expected an EFFECT to check on it, got none" in capsys.readouterr().err


def test_an_effect_that_a_machine_file_lists_is_checked_by_its_name(mine, capsys):
    """As every other command takes it."""
    listed = [mine("MINE = effect(torque=lambda t, a, w, i, u, p: -p[0] * math.tanh(w))")]
    machine = load_machine("dc_motor").as_dict() | {"own_effects": listed}
    Path("machine.yaml").write_text(yaml.safe_dump(machine))
    assert invoke(command, ["mine", "--machine", "machine.yaml"]) == 0
    assert "on dc_motor: the neutral values change nothing" in capsys.readouterr().out
