"""Fixtures of the tests of the nodes."""

from __future__ import annotations

import os
import subprocess
from typing import Any

import pytest
from disturbed import LDT, RUN, ran
from network import two_hosts
from stranger import Stranger


@pytest.fixture
def stranger(domain):
    """A stranger in a domain of its own."""
    pytest.importorskip("rclpy")
    one = Stranger()
    yield one
    one.close()


@pytest.fixture
def monitor(stranger):
    """The launching process's ear, and the steps that it hears of."""
    from ldt_ros.graph.monitor import Monitor
    from ldt_ros.nodes.statements import hear

    steps: list[Any] = []
    node = Monitor("", lambda *step: steps.append(step), context=stranger.context)
    hear(node, {"": node.hear})
    stranger.executor.add_node(node)
    yield node, steps
    node.destroy_node()


@pytest.fixture
def environment(domain):
    """Of the processes; this one's is brought back afterwards."""
    from ldt_ros.graph.environment import prepare

    before = dict(os.environ)
    yield prepare()
    os.environ.clear()
    os.environ.update(before)


@pytest.fixture
def hosts():
    """What to put before a command to run it on either of two hosts."""
    with two_hosts() as prefixes:
        yield prefixes


@pytest.fixture
def ldt(domain, programs, tmp_path):
    """Starts a command in the test's folder and domain."""

    def started(*arguments: str, **environment: str) -> subprocess.Popen[str]:
        return programs.start(
            [LDT, *arguments],
            cwd=tmp_path,
            env={**os.environ, **environment},
            text=True,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )

    return started


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """The same run without the graph, and so without anything that could be killed."""
    folder = tmp_path_factory.mktemp("undisturbed")
    assert ran(folder, "run", *RUN, "--bag", "run")["adaptations"] > 5  # there is something to lose
    return folder / "run"
