"""Declarations: topics, messages, QoS profiles, parameters, and the machine files LDT ships with.

No logic and no ROS here: nodes, commands and the core read the same tables.
"""

from __future__ import annotations

import functools
from importlib import resources
from typing import Any

import yaml

_HERE = resources.files(__name__)


@functools.cache
def _table(name: str) -> dict[str, Any]:
    text = (_HERE / f"{name}.yaml").read_text(encoding="utf-8")
    # Every node and command reads them: libyaml's parser, where there is one, is ten times as fast.
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    return yaml.load(text, loader)  # noqa: S506 - both loaders are safe ones


def topics() -> dict[str, dict[str, Any]]:
    """Topic → {type, qos, recorded, publisher, subscriber, may_publish, may_listen}."""
    return _table("topics")


def qos_profiles() -> dict[str, dict[str, Any]]:
    """QoS profile → {reliability, durability, history, depth, lease [s], if any}."""
    return _table("qos")


def messages() -> dict[str, str]:
    """Message type → its `.msg` text, of those that LDT sends and what they consist of."""
    return _table("messages")


def parameters(*groups: str) -> dict[str, dict[str, Any]]:
    """Parameter → its declaration; those of the named groups, or all."""
    table = _table("parameters")
    return {n: d for n, d in table.items() if not groups or d["group"] in groups}


def machine_names() -> list[str]:
    """Machine files that ship with LDT, by bare name."""
    files = (_HERE / "machines").iterdir()
    return sorted(f.name.removesuffix(".yaml") for f in files if f.name.endswith(".yaml"))


def machine_text(name: str) -> str:
    """Text of a machine file that ships with LDT."""
    return (_HERE / "machines" / f"{name}.yaml").read_text(encoding="utf-8")
