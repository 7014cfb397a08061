"""Two hosts with an interface each, in network namespaces of this computer."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
from collections.abc import Iterator

import pytest

HOSTS = ("192.168.7.1", "192.168.7.2")  # as on the page on other hosts
QUIET = "echo 1 > /proc/sys/net/ipv6/conf/all/disable_ipv6"  # it looks for neighbours by itself


@contextlib.contextmanager
def two_hosts() -> Iterator[list[list[str]]]:
    """What to put before a command to run it on either host; skips where that is not allowed."""
    if not shutil.which("ip") or os.geteuid() != 0:
        pytest.skip("two hosts need the command ip and root")
    names = [f"ldt{os.getpid()}{k}" for k in "ab"]
    ends = [f"l{os.getpid()}{k}" for k in "ab"]
    try:
        done = [_ip("netns", "add", name) for name in names]
        done.append(_ip("link", "add", ends[0], "type", "veth", "peer", "name", ends[1]))
        if any(done):
            pytest.skip("no right to make network namespaces")
        for name, end, address in zip(names, ends, HOSTS, strict=True):
            _ip("netns", "exec", name, "sh", "-c", QUIET)
            _ip("link", "set", end, "netns", name)
            _ip("-n", name, "addr", "add", f"{address}/24", "dev", end)
            for device in ("lo", end):
                _ip("-n", name, "link", "set", device, "up")
            _ip("-n", name, "route", "add", "default", "dev", end)
        yield [["ip", "netns", "exec", name] for name in names]
    finally:
        for name in names:
            _ip("netns", "del", name)


@contextlib.contextmanager
def parted(host: list[str]) -> Iterator[None]:
    """Pull the plug of a host of `two_hosts`, and put it in again at the end."""
    name = host[3]
    end = f"l{name.removeprefix('ldt')}"
    if _ip("-n", name, "link", "set", end, "down"):
        raise OSError(f"{end} cannot be taken down")
    try:
        yield
    finally:
        _ip("-n", name, "link", "set", end, "up")
        _ip("-n", name, "route", "add", "default", "dev", end)


def _ip(*arguments: str) -> int:
    return subprocess.run(["ip", *arguments], capture_output=True, check=False).returncode
