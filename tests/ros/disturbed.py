"""A run of the graph whose nodes are killed, and what it must be equal to."""

from __future__ import annotations

import contextlib
import json
import os
import random
import re
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from ldt_core.base.experiment import Adaptation
from ldt_core.cli import invoke, ldt
from ldt_core.recording.bag import read_bag

LDT = str(Path(sys.executable).with_name("ldt"))
PATIENCE = 240  # s; a stalled machine is not what is tested
# An order is given since choosing one is most of the work, and nothing that a crash could disturb.
MODEL = ("--model", "linear", "--order", "1")
# The motor's experiments are half as long as the rotor's, and four times as quick to learn from.
RUN = ("--machine", "dc_motor", "--experiments", "40", "--seed", "3", *MODEL, "--start-time", "1e9")
LOOP = ("experiment", "prediction", "original_prediction", "signal", "model", "adaptation")


def nodes(launcher: int) -> dict[str, psutil.Process]:
    """The graph's processes that live, by role (of a fleet's process, its first)."""
    found = {}
    with contextlib.suppress(psutil.Error):
        for process in psutil.Process(launcher).children():
            with contextlib.suppress(psutil.Error, ValueError, IndexError):
                line = process.cmdline()
                if "ldt_ros.graph.process" in line and process.status() != psutil.STATUS_ZOMBIE:
                    found[line[line.index("--node") + 1]] = process
    return found


def end_at_once(launcher: Any) -> None:
    """Kill `ldt up` and all that it has started, without any noticing the end of another.

    A node that is just being started has no command line of its own yet.
    """
    os.killpg(launcher.pid, signal.SIGSTOP)
    for process in psutil.Process(launcher.pid).children(recursive=True):
        process.kill()
    launcher.kill()
    launcher.communicate()


def killed(
    launcher: Any, count: int, within: float, seed: int, roles: tuple[str, ...] = ()
) -> Iterator[str]:
    """Kill nodes at random moments, whatever they are doing; the role of each.

    Args:
        launcher: process of `ldt up`; the killing ends with it.
        count: of kills.
        within: longest time between two [s].
        seed: of the choice and of the moments.
        roles: in this order, over and over; any at random if there are none.
    """
    chance, done = random.Random(seed), 0
    while done < count and launcher.poll() is None:
        time.sleep(chance.uniform(0.05, within))
        if role := kill(launcher.pid, chance, roles[done % len(roles)] if roles else ""):
            done += 1
            yield role


def kill(launcher: int, chance: random.Random, role: str = "") -> str:
    """Kill the node of a role, or any at random; its role, or "" where there is none to kill."""
    there = nodes(launcher)
    wanted = role or chance.choice(sorted(there) or [""])
    if wanted in there:
        with contextlib.suppress(psutil.Error):
            there[wanted].kill()
            return wanted
    return ""


def stall(launcher: int, chance: random.Random, longest: float) -> str:
    """Stop a node at random for a while, as a machine that swaps or is suspended does; its role."""
    there = nodes(launcher)
    if not there:
        return ""
    role = chance.choice(sorted(there))
    with contextlib.suppress(psutil.Error):
        there[role].suspend()
        time.sleep(chance.uniform(0.0, longest))
        there[role].resume()
        return role
    return ""


def adaptations(recording: Path) -> list[Adaptation]:
    """Of the experiments that have gone all the way, in what is still being written."""
    try:
        return list(read_bag(recording).records("adaptation"))
    except Exception:
        return []


def recorded(recording: Path) -> int:
    """How many experiments have gone all the way."""
    return len(adaptations(recording))


def until(holds: Callable[[], object], says: Callable[[], str] = str) -> None:
    """Wait for what a recording says: it may lie far behind the nodes on a busy machine."""
    deadline = time.monotonic() + PATIENCE
    while not holds():
        assert time.monotonic() < deadline, says()
        time.sleep(0.1)  # it is read from its beginning each time


def wait_for(recording: Path, experiments: int) -> None:
    """Until so many have gone all the way."""
    until(
        lambda: recorded(recording) >= experiments,
        lambda: f"{recording} holds {recorded(recording)}",
    )


def complaints(errors: str) -> str:
    """What a program said on standard error, without how far a run is: a slow one says that."""
    return re.sub(r"^\S+: experiment \d+.*\n", "", errors, flags=re.MULTILINE)


def finished(process: Any) -> dict[str, Any]:
    """What a run with `--json` says of itself, of one that ended as it should."""
    output, errors = process.communicate(timeout=PATIENCE)
    assert (process.returncode, complaints(errors)) == (0, "")
    run: dict[str, Any] = json.loads(output)["runs"][0]
    return run


def ran(folder: Path, *arguments: str, refused: str = "") -> dict[str, Any]:
    """The same of a command that ends by itself: in this process, which spares it the start.

    With an experiment that is to be refused it ends with 1, and these words.
    """
    with (
        tempfile.TemporaryFile("w+") as output,  # nodes are started with a file's number
        tempfile.TemporaryFile("w+") as errors,
        contextlib.chdir(folder),
        contextlib.redirect_stdout(output),
        contextlib.redirect_stderr(errors),
    ):
        code = invoke(ldt, [*arguments, "--json"])
        printed, told = (file.seek(0) or file.read() for file in (output, errors))
    assert code == bool(refused), told
    assert refused in told if refused else complaints(told) == ""
    run: dict[str, Any] = json.loads(printed)["runs"][0]
    return run


def differences(undisturbed: Path, disturbed: Path) -> dict[str, str]:
    """Topic → what two recordings do not have in common, in a few words; empty if all is the same.

    Every record counts, to the last bit; their order in the file does not.
    """
    one, other = (
        {topic: Counter(map(repr, told)) for topic, told in records(path).items()}
        for path in (undisturbed, disturbed)
    )
    found = {}
    for topic in LOOP:
        lost, more = one[topic] - other[topic], other[topic] - one[topic]
        if lost or more:
            found[topic] = f"{lost.total()} lost, {more.total()} more or other"
    return found


def records(
    path: Path, topics: Iterable[str] = LOOP, namespace: str = ""
) -> dict[str, list[dict[str, Any]]]:
    """Topic → its records in a recording, as plain values that are the same to the last bit."""
    bag = read_bag(path, namespace)
    return {topic: [_plain(record) for record in bag.records(topic)] for topic in topics}


def _plain(record: Any) -> dict[str, Any]:
    values = vars(record).items()
    return {n: v.tobytes() if isinstance(v, np.ndarray) else v for n, v in values}
