"""`ldt watch` as a user starts and ends it."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest

from ldt_core.cli import invoke
from ldt_core.cli.watch import command

pytest.importorskip("aiohttp")

SAMPLE = str(Path(__file__).resolve().parents[2] / "bags" / "rotor_drift")
PATIENCE = 60  # s; a stalled machine is not what is tested


@pytest.fixture
def start(programs):
    """Starts the command."""

    def started(*arguments: str) -> subprocess.Popen[str]:
        code = "from ldt_core.cli import main; main()"
        return programs.start(
            [sys.executable, "-c", code, "watch", *arguments],
            text=True,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )

    return started


def finish(process: subprocess.Popen[str], number: int) -> tuple[int, str]:
    process.send_signal(number)
    _, errors = process.communicate(timeout=PATIENCE)
    return process.returncode, errors


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_serves_a_recording_until_it_is_told_to_end(start, number):
    """It says where; ended while it plays and a browser listens, it exits with 0."""
    process = start(SAMPLE, "--port", "0", "--json")
    told = json.loads(process.stdout.readline())
    assert told["address"].startswith("http://127.0.0.1:")
    assert told["watched"] == "rotor_drift, played at 1 times real time"
    with urllib.request.urlopen(f"{told['address']}events", timeout=PATIENCE) as stream:
        assert stream.readline().startswith(b"retry")
        assert finish(process, number) == (0, "")


def test_open_to_others_it_says_so_loudly(start):
    """On standard error, and with the address in words on standard output."""
    process = start(SAMPLE, "--rate", "max", "--port", "0", "--host", "0.0.0.0")
    assert "http://127.0.0.1:" in process.stdout.readline()
    code, errors = finish(process, signal.SIGINT)
    assert code == 0
    assert "WARNING: bound to 0.0.0.0: everybody on this network can see" in errors


def test_a_port_that_is_taken_is_one_sentence(capsys):
    """With exit code 2 and the option that mends it."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        assert invoke(command, [SAMPLE, "--port", port]) == 2
    said = capsys.readouterr().err
    assert said == f"ldt: port {port}: expected one that is free (--port), got one that is taken\n"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["no_such_bag"], "no_such_bag: expected a recording"),
        ([SAMPLE, "--rate", "fast"], "rate: expected max or a number above 0"),
        ([SAMPLE, "--namespace", "other"], "a machine under /other"),
        ([SAMPLE, "--host", "192.0.2.1"], "host '192.0.2.1': expected an address of this machine"),
        ([SAMPLE, "--host", "no such host"], "expected an address of this machine (--host)"),
        ([SAMPLE, "--port", "70000"], "--port"),
    ],
)
def test_what_cannot_be_done_is_one_sentence(arguments, words, one_sentence):
    """With exit code 2."""
    assert invoke(command, [*arguments]) == 2
    assert words in one_sentence()
