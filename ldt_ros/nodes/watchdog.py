"""A sign of life to systemd, which ends and restarts a service that gives none (`WatchdogSec`)."""

from __future__ import annotations

import contextlib
import os
import socket

#: Environment variable set by systemd (sd_notify(3)).
VARIABLE = "NOTIFY_SOCKET"


def alive() -> None:
    """Say that this process does its work; nothing where nobody asks for it."""
    address = os.environ.get(VARIABLE, "")
    if not address.startswith(("/", "@")):
        return
    name = f"\0{address[1:]}" if address.startswith("@") else address
    # systemd that cannot be reached is no reason to stop.
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as there:
        there.setblocking(False)
        there.sendto(b"WATCHDOG=1", name)
