"""Fixtures of the tests of the nodes."""

from __future__ import annotations

from typing import Any

import pytest
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
    from ldt_ros.monitor import Monitor
    from ldt_ros.statements import hear

    steps: list[Any] = []
    node = Monitor("", lambda *step: steps.append(step), context=stranger.context)
    hear(node, {"": node.hear})
    stranger.executor.add_node(node)
    yield node, steps
    node.destroy_node()


@pytest.fixture
def hosts():
    """What to put before a command to run it on either of two hosts."""
    with two_hosts() as prefixes:
        yield prefixes
