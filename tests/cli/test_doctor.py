"""`ldt doctor` as a command: exit codes, JSON, no ROS, a disk that takes nothing."""

from __future__ import annotations

import ctypes
import json
import resource
import shutil
import subprocess
import sys
from pathlib import Path

from test_bad_surroundings import BLOCK, ldt_process

from ldt_core.cli import invoke, ldt
from ldt_core.machine.machine_file import load_machine

RUN = Path(__file__).resolve().parents[2] / "bags" / "rotor_drift"
PR_CAPBSET_DROP, CAP_DAC_OVERRIDE = 24, 1  # linux/prctl.h, linux/capability.h


def checks(output: str) -> dict[str, dict]:
    """Findings by name, from JSON."""
    return {c["name"]: c for c in json.loads(output)["checks"]}


def test_without_ros_it_says_so_and_looks_at_the_rest(tmp_path):
    """Exit code 1, since the graph cannot run; one line a check, each with grade and remedy."""
    code, shown, errors = ldt_process("doctor", "--bag", str(tmp_path / "run"), code=BLOCK)
    assert (code, errors) == (1, "")
    lines = {line[9:26].strip(): line for line in shown.splitlines()}
    assert lines["ROS 2"].startswith("problem ")
    assert "no module rclpy" in lines["ROS 2"]
    assert "-> pip install 'ldt[ros]'" in lines["ROS 2"]
    assert lines["clock"].startswith(("ok ", "warning "))
    assert "DDS" not in lines
    assert not any(tmp_path.iterdir())


def test_a_full_disk_is_a_problem_with_a_remedy(tmp_path):
    """Nothing can be written: exit code 1, the place and the reason in one line."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))

    bag = str(tmp_path / "run")
    arguments = ("doctor", "--json", "--bag", bag)
    code, shown, errors = ldt_process(*arguments, code=BLOCK, before=limit)
    assert (code, errors) == (1, "")
    found = checks(shown)["recordings"]
    assert found["grade"] == "problem"
    assert str(tmp_path) in found["message"]
    assert "File too large" in found["message"]
    assert "--bag" in found["remedy"]


def test_a_folder_without_the_right_to_write_is_a_problem(tmp_path):
    """Also for root, once it has given up the power to write everywhere."""

    def give_up() -> None:
        ctypes.CDLL(None).prctl(PR_CAPBSET_DROP, CAP_DAC_OVERRIDE)

    tmp_path.chmod(0o500)
    arguments = ("doctor", "--json", "--bag", str(tmp_path / "run"))
    code, shown, errors = ldt_process(*arguments, code=BLOCK, before=give_up)
    tmp_path.chmod(0o700)
    assert (code, errors) == (1, "")
    assert "Permission denied" in checks(shown)["recordings"]["message"]


def test_a_recording_s_health_decides_the_exit_code(tmp_path, capsys):
    """0 when it is whole, 1 when it is damaged, 2 when it is none."""
    assert invoke(ldt, ["doctor", str(RUN), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["ok"] is True
    bag = tmp_path / "cut"
    shutil.copytree(RUN, bag)
    file = next(bag.glob("*.mcap"))
    file.write_bytes(file.read_bytes()[:-500_000])
    assert invoke(ldt, ["doctor", str(bag)]) == 1
    shown = capsys.readouterr().out
    assert shown.startswith("problem  files ")
    assert "has no end" in shown
    assert invoke(ldt, ["doctor", str(tmp_path / "nowhere")]) == 2
    assert capsys.readouterr().err.startswith("ldt: ")


def test_the_core_looks_without_importing_ros():
    """`ldt_core.doctor` finds the checks of the graph by entry point alone."""
    code = (
        "import sys; from ldt_core.doctor import check, computer_checks, recording_checks;"
        "check.found_probes(); print('rclpy' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


def test_the_own_parts_of_a_machine_file_are_checked(tmp_path, monkeypatch, capsys):
    """Each in lines of its own; a fault of one was a traceback from Python."""
    monkeypatch.chdir(tmp_path)
    Path("engine.py").write_text(
        "from ldt_core.physics.motor import Motor\n"
        "from ldt_core.physics.simulator import Simulator\n"
        "class Engine(Simulator):\n"
        "    name, parameters = 'engine', Motor.parameters\n"
        "    def advance(self, values, state, voltage, torque, duration):\n"
        "        values['J'] *= 1.01\n"
        "        return state\n"
        "ENGINE = Engine()\n"
    )
    Path("drag.py").write_text(
        "from ldt_core.effects.base import Effect\n"
        "from ldt_core.physics.parameter import Parameter\n"
        "C = Parameter('c', 'N m s', 0.0, default=0.0, description='coefficient')\n"
        "DRAG = Effect('drag', 'd', 'e', (C,), {'c': 1e-3},\n"
        "              torque=lambda t, a, w, i, u, p: -p[0] * w)\n"
    )
    machine = load_machine("dc_motor").as_dict() | {"own_effects": ["drag.py:DRAG"]}
    Path("own.yaml").write_text(json.dumps(machine))
    assert invoke(ldt, ["doctor", "--machine", "own.yaml"]) == 0
    assert "ok       drag          the typical values change" in capsys.readouterr().out
    Path("own.yaml").write_text(json.dumps(machine | {"physics": "engine.py:ENGINE"}))
    assert invoke(ldt, ["doctor", "--machine", "own.yaml"]) == 1
    assert "problem  physics " in capsys.readouterr().out
