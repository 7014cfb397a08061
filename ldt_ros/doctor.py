"""What the node graph needs of a machine: ROS 2, its domain, the message across, the surroundings.

Nothing here imports ROS: where it is missing, that is the finding.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import socket
import subprocess
import tempfile
import time
from functools import partial
from importlib import metadata, resources
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from ldt_core.base.errors import BadInput
from ldt_core.base.sentences import few
from ldt_core.doctor.check import Finding, Probe, ok, problem, warning
from ldt_ros.graph.environment import missing_modules, require_ros, ros_message
from ldt_ros.graph.middleware_trials import trial
from ldt_ros.graph.secure import has_security
from ldt_ros.graph.shared_memory import SHARED, leftovers, shared_memory_cleared

MIB = 1024**2
DISTRIBUTION = "jazzy"
WHEELS = ("ros-jazzy-rclpy", "ros-jazzy-common-interfaces")
PROFILES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
EXCHANGE_TIMEOUT = 10.0  # s for two processes to start, meet, and exchange a message
MULTICAST_GROUP = "239.255.76.68"  # where our DDS profile lets peers meet
MULTICAST_INTERFACE = "127.0.0.1"
DATAGRAM_TIMEOUT = 1.0  # s for a datagram to come back
LOW_SHARED_MEMORY = 16 * MIB  # tracing and numpy's workers take little
MAKE_ROOM = f"remove what nobody uses in {SHARED} (docker run --shm-size=256m)"
LOG_HEAD = re.compile(r"^(\[[\w.]+\] ?)+: ")  # level, time, and logger of a line of ROS's log
MAX_LISTED = 4  # names that a line shows
ANOTHER_DOMAIN = "if they are not yours, set ROS_DOMAIN_ID to another number from 0 to 101"


def ros() -> list[Finding]:
    """ROS 2 in this Python, and what follows from trying it."""
    if missing := missing_modules():
        remedy = "pip install 'ldt[ros]', or source a ROS 2 workspace; ldt run works without"
        return [problem("ROS 2", f"this Python has no module {missing[0]}", remedy)]
    found = [distribution(), *profile()]
    try:
        require_ros()
    except BadInput as error:
        name, remedy = "domain", "unset ROS_DOMAIN_ID, or set it to a number from 0 to 101"
        if error.where == str(SHARED):
            name, remedy = "DDS", MAKE_ROOM
        return [*found, problem(name, f"{error.where}: got {error.got}", remedy)]
    try:
        met = exchange()
    except BadInput as error:
        remedy = "see multicast and DDS profile in this list; unset RMW_IMPLEMENTATION"
        return [*found, problem("DDS", error.got, remedy), *security(None)]
    return [*found, _message(met), *_domain(met), *security(met["middleware"])]


def distribution() -> Finding:
    """Which ROS 2 it is, and whether another one is sourced."""
    name = "ROS 2"
    shown = []
    for wheel in WHEELS:
        with contextlib.suppress(metadata.PackageNotFoundError):
            shown.append(f"{wheel} {metadata.version(wheel)}")
    where = ", ".join(shown) or "from a ROS 2 installation"
    sourced = os.environ.get("ROS_DISTRO", "")
    if sourced and (shown or sourced != DISTRIBUTION):
        remedy = "start from a shell in which no setup.bash has been sourced"
        if shown:
            return warning(name, f"{where}, and {sourced} is sourced as well", remedy)
        return warning(name, f"{sourced} is sourced, LDT is made for {DISTRIBUTION}", remedy)
    return ok(name, where)


def profile() -> list[Finding]:
    """Whose DDS profile counts."""
    name = "DDS profile"
    found = []
    given = next((v for v in PROFILES if v in os.environ), None)
    if given is None:
        found.append(ok(name, "ours: UDP on the loopback interface, this machine alone"))
    else:
        file = os.environ[given]
        try:
            ElementTree.parse(file)
            found.append(ok(name, f"yours, {file} ({given})"))
        except (OSError, ElementTree.ParseError) as error:
            why = getattr(error, "strerror", None) or "it is no XML"
            remedy = f"correct or unset {given}"
            found.append(warning(name, f"{given}: {file}: {why}, so that none counts", remedy))
    reach = os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    if given is None and reach != "SUBNET":
        told = f"ROS_AUTOMATIC_DISCOVERY_RANGE={reach} puts other transports in the profile's place"
        found.append(warning(name, told, "unset ROS_AUTOMATIC_DISCOVERY_RANGE"))
    return found


def exchange(patience: float = EXCHANGE_TIMEOUT) -> dict[str, Any]:
    """What the ear of two processes met (see `ldt_ros.graph.middleware_trials`).

    Raises:
        BadInput: they did not start or did not end; `got` says what happened.
    """
    with shared_memory_cleared(), tempfile.TemporaryDirectory(prefix="ldt-") as logs:
        environment = {**os.environ, "ROS_LOG_DIR": logs}
        topic = f"/ldt_doctor_{os.getpid()}"
        begun = partial(trial, environment=environment)
        with begun("voice", topic), begun("ear", topic) as ear:
            try:
                output, errors = ear.communicate(timeout=patience)
            except subprocess.TimeoutExpired:
                raise BadInput("DDS", "an answer", f"no answer within {patience:g} s") from None
    lines = output.strip().splitlines()
    if ear.returncode or not lines:
        said = [line.strip() for line in errors.splitlines() if line.strip()]
        words = said[-1] if said else f"a node cannot be created (code {ear.returncode})"
        raise BadInput("DDS", "a node", ros_message(LOG_HEAD.sub("", words)))
    return json.loads(lines[-1])


def _message(met: dict[str, Any]) -> Finding:
    rmw = met["rmw"]
    if not met["received"]:
        remedy = "see multicast and DDS profile in this list, and let a firewall pass UDP on lo"
        return problem("DDS", f"two processes did not meet by {rmw}", remedy)
    took = f"{1e3 * met['delay_s']:.1f} ms"
    if rmw != "rmw_fastrtps_cpp":
        told = (
            f"a message went between two processes in {took}, by {rmw}, which ignores our profile"
        )
        return warning("DDS", told, "unset RMW_IMPLEMENTATION unless you mean it")
    return ok("DDS", f"a message went between two processes in {took}, by {rmw}")


def _domain(met: dict[str, Any]) -> list[Finding]:
    number = os.environ.get("ROS_DOMAIN_ID") or "0"
    where = f"ROS_DOMAIN_ID {number}"
    taken = [t for t in met["publishers"] if t.count("/") == 1]
    if taken:
        nodes = few(met["nodes"], MAX_LISTED)
        told = f"{where} has a publisher of {few(taken, MAX_LISTED)} already (nodes {nodes})"
        remedy = "end that graph, set another ROS_DOMAIN_ID, or give ldt up a --namespace"
        return [problem("domain", told, remedy)]
    if met["nodes"]:
        told = f"{where} has nodes {few(met['nodes'], MAX_LISTED)}"
        return [warning("domain", told, ANOTHER_DOMAIN)]
    return [ok("domain", f"{where}, nobody else is in it")]


def security(library: str | None) -> list[Finding]:
    """Whether the middleware can do what SROS 2 would ask of it."""
    name = "security"
    asked = os.environ.get("ROS_SECURITY_ENABLE", "").lower() == "true"
    able = has_security(library)
    if asked and not able:
        told = "ROS_SECURITY_ENABLE is set"
        told += ", and DDS-Security is not in this build of Fast DDS" if library else ""
        remedy = "unset ROS_SECURITY_ENABLE and keep to this machine, or install ROS 2 with SROS 2"
        if os.environ.get("ROS_SECURITY_STRATEGY") == "Enforce":
            return [problem(name, f"{told}, so that no node starts", remedy)]
        return [warning(name, f"{told}, so that nothing is secured", remedy)]
    if library is None:
        return []
    state = "DDS-Security: in this build" if able else "DDS-Security: not in this build of Fast DDS"
    if asked:
        return [ok(name, f"{state}, asked for")]
    state += "" if able else ", so that ldt up --secure starts nothing"
    reach = "by our profile nobody outside this machine is reached, but every user of it"
    return [ok(name, state if any(v in os.environ for v in PROFILES) else f"{state}; {reach}")]


def loopback(folder: Path = Path("/proc/sys/net/ipv4/conf")) -> list[Finding]:
    """Whether the kernel drops what comes from outside for 127.0.0.1, as it does by default."""
    name = "loopback"
    open_ = []
    for file in sorted(folder.glob("*/route_localnet")):
        with contextlib.suppress(OSError):
            if file.read_text().strip() != "0":
                open_.append(file.parent.name)
    if open_:
        told = f"packets for 127.0.0.1 are let in by {few(open_, MAX_LISTED)}"
        shown = open_[:MAX_LISTED]
        remedy = " ".join(f"net.ipv4.conf.{device}.route_localnet=0" for device in shown)
        return [warning(name, told, f"sysctl -w {remedy}")]
    return [ok(name, "nothing from outside reaches 127.0.0.1")]


def multicast() -> list[Finding]:
    """Whether a datagram to the group of our profile comes back on the loopback interface."""
    group, interface = MULTICAST_GROUP, MULTICAST_INTERFACE
    remedy = f"ip link set lo up, and let a firewall pass UDP to {group} on lo"
    try:
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
        ):
            receiver.bind(("", 0))
            member = socket.inet_aton(group) + socket.inet_aton(interface)
            receiver.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
            receiver.settimeout(DATAGRAM_TIMEOUT)
            sender.setsockopt(
                socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(interface)
            )
            word = f"ldt {os.getpid()} {time.monotonic()}".encode()
            sender.sendto(word, (group, receiver.getsockname()[1]))
            while receiver.recv(1024) != word:
                pass
    except OSError as error:
        why = "it does not come back" if isinstance(error, TimeoutError) else error.strerror
        told = f"a datagram to {group} on the loopback interface: {why}"
        return [warning("multicast", told, remedy)]
    return [ok("multicast", "works on the loopback interface")]


def buffer(limit: Path = Path("/proc/sys/net/core/rmem_max")) -> list[Finding]:
    """Whether the system grants the receive buffer that our DDS profile asks for."""
    name = "UDP buffer"
    text = (resources.files("msgs_config") / "fastdds.xml").read_text(encoding="utf-8")
    asked = next(
        int(e.text or 0)
        for e in ElementTree.fromstring(text).iter()
        if e.tag.endswith("receiveBufferSize")
    )
    try:
        granted = int(limit.read_text())
    except (OSError, ValueError):
        return [ok(name, f"{limit} is not there; {asked} bytes are asked for")]
    if granted < asked:
        told = f"{granted} bytes at most of {asked}; what does not fit is sent again, which delays"
        return [warning(name, told, f"sysctl -w net.core.rmem_max={asked}")]
    return [ok(name, f"{asked} bytes are granted")]


def shared_memory() -> list[Finding]:
    """Room, and files that killed processes have left."""
    name = "shared memory"
    if not SHARED.is_dir():
        remedy = f"mount it: mount -t tmpfs tmpfs {SHARED}"
        return [warning(name, f"there is no {SHARED}", remedy)]
    free = shutil.disk_usage(SHARED).free
    room = f"{free // MIB} MiB free in {SHARED}"
    found = []
    if free < LOW_SHARED_MEMORY:
        found.append(warning(name, room, MAKE_ROOM))
    if left := sorted(leftovers()):
        told = f"{len(left)} file(s) left by ended processes ({few(left, MAX_LISTED)})"
        remedy = f"rm {' '.join(str(SHARED / n) for n in left[:MAX_LISTED])}"
        found.append(warning(name, told, remedy + (" …" if len(left) > MAX_LISTED else "")))
    return found or [ok(name, room)]


PROBES = [
    Probe("ROS 2", ros),
    Probe("loopback", loopback),
    Probe("multicast", multicast),
    Probe("UDP buffer", buffer),
    Probe("shared memory", shared_memory),
]
