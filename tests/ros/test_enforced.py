"""What a keystore promises, on a middleware that has DDS-Security; the wheels' has not."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("cryptography")

from disturbed import PATIENCE, RUN, differences, finished, killed

from ldt_core.recording.bag import read_bag
from ldt_core.restart.recorded_run import LOOP
from ldt_core.security.keystore import make_keystore
from ldt_ros.graph import middleware_trials, secure

pytestmark = pytest.mark.skipif(
    not secure.has_security(middleware_trials.dds_library()),
    reason="this Fast DDS is built without DDS-Security",
)

HERE = Path(__file__).parent
EAR = (sys.executable, str(HERE / "eavesdropper.py"))
PACED = (*RUN, "--rate", "50")  # 8 s, so that there is time to meet
LONG = ("--experiments", "100000", "--rate", "100", "--model", "physics")


@pytest.fixture
def keystore(domain, tmp_path) -> Path:
    """For the domain of the test."""
    return make_keystore(tmp_path / "keys", domain=domain).folder


@pytest.fixture
def insider(domain, programs):
    """Starts somebody who tries everything, in an enclave or without any."""

    def started(name: str, seconds: float, keys: Path | None = None) -> subprocess.Popen[str]:
        environment = {**os.environ}
        if keys:
            environment |= {**secure.ENFORCED, secure.KEYSTORE: str(keys)}
            environment[secure.OVERRIDE] = f"/{name}"
        return programs.start(
            [sys.executable, str(HERE / "insider.py"), name, str(seconds)],
            env=environment,
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )

    return started


def told(process) -> dict:
    output, _ = process.communicate(timeout=PATIENCE)
    return json.loads(output.splitlines()[-1])


def begun(recording: Path) -> None:
    """Wait for the first experiment."""
    deadline = time.monotonic() + PATIENCE
    while not any(f.stat().st_size > 20_000 for f in recording.glob("*.mcap")):
        assert time.monotonic() < deadline
        time.sleep(0.05)


def test_a_secured_run_gives_the_same_numbers(ldt, keystore, undisturbed, tmp_path):
    """With nodes that are killed and find back into their enclaves."""
    process = ldt("up", *PACED, "--secure", str(keystore), "--bag", "run", "--json")
    begun(tmp_path / "run")
    roles = ("detector", "recorder", "twin", "plant", "adaptor")
    victims = Counter(killed(process, 5, 1.0, 1, roles))
    notes = finished(process)["notes"]
    assert victims == Counter(roles)
    assert set(notes) >= {f"{role} crashed once and was started again" for role in roles}
    assert differences(undisturbed, tmp_path / "run") == {}
    assert read_bag(tmp_path / "run").notes == []


def test_whoever_has_no_key_or_another_keystore_s_stays_outside(
    ldt, insider, keystore, undisturbed, domain, tmp_path
):
    """Meets nobody, hears nothing, is not heard; the run knows nothing of it."""
    others = make_keystore(tmp_path / "others", domain=domain).folder
    process = ldt("up", *PACED, "--secure", str(keystore), "--bag", "run", "--json")
    begun(tmp_path / "run")
    for one in [insider("nobody", 4.0), insider("adaptor", 4.0, others)]:
        found = told(one)
        assert (found["reached"], found["met"], found["heard"]) == ([], [], [])
    assert finished(process)["notes"] == []
    assert differences(undisturbed, tmp_path / "run") == {}


def test_the_same_stranger_gets_into_an_open_graph(ldt, insider, tmp_path):
    """Else the test before would show nothing."""
    process = ldt("up", *PACED, "--bag", "run", "--json")
    begun(tmp_path / "run")
    found = told(insider("nobody", 4.0))
    assert {"model", "experiment"} <= set(found["reached"])
    assert "plant" in found["met"]
    assert "experiment" in found["heard"]
    output, errors = process.communicate(timeout=PATIENCE)  # which it ends, if it comes early
    assert "publisher" in output + errors


@pytest.mark.parametrize(
    ("role", "publishes", "hears"),
    [
        ("detector", {"signal"}, {"experiment", "prediction"}),
        ("recorder", set(), set(LOOP)),
        ("watch", set(), set(LOOP)),
        ("adaptor", {"adaptation", "model"}, {"experiment", "signal"}),
    ],
)
def test_a_key_opens_what_is_its_role_s(insider, keystore, role, publishes, hears):
    """A node that was taken over cannot publish a model, if it is not the adaptor."""
    found = told(insider(role, 0.1, keystore))
    assert set(LOOP) - set(found["publishes"]) == publishes
    assert hears <= set(LOOP) - set(found["hears"])


def test_the_operator_s_key_alone_switches_learning(ldt, keystore, tmp_path):
    """Not the recorder's, nor nobody."""
    process = ldt("up", *LONG, "--secure", str(keystore), "--bag", "run")
    begun(tmp_path / "run")
    keys = {**secure.ENFORCED, secure.KEYSTORE: str(keystore)}
    for environment in ({}, {**keys, secure.OVERRIDE: "/recorder"}):
        asked = ldt("learning", "off", **environment)
        assert "learning is" not in asked.communicate(timeout=PATIENCE)[0]
        assert asked.returncode == 2
    asked = ldt("learning", "off", **keys)
    assert asked.communicate(timeout=PATIENCE) == ("learning is off\n", "")
    assert process.poll() is None


@pytest.mark.parametrize("secured", [True, False])
def test_what_is_on_the_wire_can_be_read_by_nobody(ldt, programs, keystore, tmp_path, secured):
    """No measurement; in an open graph they are there. What a key opens is said in the clear."""
    if os.geteuid() != 0:
        pytest.skip("only root hears an interface")
    heard = tmp_path / "heard"
    with heard.open("w") as out:
        ear = programs.start([*EAR, "hear", "lo", "60"], stdout=out)
    while not heard.stat().st_size:
        time.sleep(0.05)
    keys = ["--secure", str(keystore)] if secured else []
    finished(ldt("up", *RUN, *keys, "--bag", "run", "--json"))
    ear.terminate()
    ear.wait(PATIENCE)
    lines = heard.read_text().splitlines()[1:-1]
    spoken = b"".join(bytes.fromhex(json.loads(line)["data"]) for line in lines)
    assert len(spoken) > 40 * 1000 * 8
    said = next(read_bag(tmp_path / "run").messages("experiment")).data
    parts = [said[k : k + 48] for k in range(1000, 15_000, 1000)]
    assert [part in spoken for part in parts] == [not secured] * len(parts)


def test_a_secured_run_is_taken_up_secured(ldt, keystore, undisturbed, tmp_path):
    """After the end of every process at once; without the key it is not begun."""
    process = ldt("up", *PACED, "--secure", str(keystore), "--bag", "run")
    begun(tmp_path / "run")
    process.kill()
    process.communicate()
    again = ("up", "--resume", "run", "--rate", "max", "--json")
    open_ = ldt(*again)
    _, errors = open_.communicate(timeout=PATIENCE)
    assert errors == "ldt: --secure: expected a keystore, since run began secured, got none\n"
    assert open_.returncode == 2
    finished(ldt(*again, "--secure", str(keystore)))
    assert differences(undisturbed, tmp_path / "run") == {}
