"""On one machine a graph keeps to the loopback interface: nothing leaves, nothing enters."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys
import textwrap
import time
from importlib import resources
from pathlib import Path

import pytest
from disturbed import recorded
from network import HOSTS

from ldt_core.recording.bag import read_bag

pytest.importorskip("rclpy")

HERE = Path(__file__).parent
PATIENCE = 60  # s
OWN_GROUP, USUAL_GROUP = "239.255.76.68", "239.255.0.1"
ROLES = ("recorder", "adaptor", "detector", "twin", "plant")
UNKNOWN = "_NODE_NAME_UNKNOWN_"  # of whom has been met before it has told its name
NULL = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
# Publishes `experiment` and `model` and listens to both; says whom it met and what it heard.
INTRUDER = """
    import json, os, sys, time
    name, seconds = sys.argv[1], float(sys.argv[2])
    from ldt_ros.graph.environment import prepare
    prepare()
    import rclpy
    from std_msgs.msg import Float64MultiArray, String

    rclpy.init()
    node, heard, met = rclpy.create_node(name), set(), set()
    model = node.create_publisher(String, "model", 10)
    experiment = node.create_publisher(Float64MultiArray, "experiment", 10)
    node.create_subscription(String, "model", lambda m: heard.add(m.data[:20]), 10)
    node.create_subscription(Float64MultiArray, "experiment", lambda m: heard.add("array"), 10)
    print("there", flush=True)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        model.publish(String(data=name))
        experiment.publish(Float64MultiArray(data=[1.0]))
        for topic in ("model", "experiment", "prediction"):
            met |= {i.node_name for i in node.get_publishers_info_by_topic(topic)}
        time.sleep(0.03)
        rclpy.spin_once(node, timeout_sec=0)
    heard -= {name} | ({"array"} if met <= {name} else set())
    print(json.dumps({"met": sorted(met - {name}), "heard": sorted(heard)}), flush=True)
    os._exit(0)
"""


def profile(folder: Path, address: str) -> dict[str, str]:
    """The environment for our profile on another interface."""
    text = (resources.files("msgs_config") / "fastdds.xml").read_text()
    file = folder / f"{address}.xml"
    file.write_text(text.replace("127.0.0.1", address))
    return {"FASTRTPS_DEFAULT_PROFILES_FILE": str(file)}


def usual(folder: Path) -> dict[str, str]:
    """The environment for Fast DDS as it is without any profile, but for shared memory.

    A process that is killed leaves it behind, and a host in a namespace shares it with the other.
    """
    file = folder / "empty.xml"
    file.write_text('<dds xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles"/>')
    both = {"FASTRTPS_DEFAULT_PROFILES_FILE": str(file), "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}
    return both


@pytest.fixture
def start(programs):
    """Starts Python on a host and waits for its first line, if it is to have one."""

    def started(host, *arguments: str, environment=None, says: str = "") -> subprocess.Popen[str]:
        process = programs.start(
            [*host, sys.executable, *arguments],
            env={**os.environ, **(environment or {})},
            stdout=subprocess.PIPE,
            text=True,
        )
        if says:
            assert process.stdout.readline().strip() == says
        return process

    return started


@pytest.fixture
def intruder(start):
    """An intruder on a host."""

    def started(host, name: str, seconds: float, environment) -> subprocess.Popen[str]:
        code = ["-c", textwrap.dedent(INTRUDER), name, str(seconds)]
        return start(host, *code, environment=environment, says="there")

    return started


def said(process: subprocess.Popen[str]) -> dict:
    return json.loads(process.communicate(timeout=PATIENCE)[0].splitlines()[-1])


def named(told: dict) -> dict:
    """What was said without those whose name was not yet known."""
    return {**told, "met": [name for name in told["met"] if name != UNKNOWN]}


def datagrams(process: subprocess.Popen[str]) -> list[dict]:
    *lines, last = process.communicate(timeout=PATIENCE)[0].splitlines()
    assert last == "end"
    return [json.loads(line) for line in lines]


def sockets(text: str) -> list[tuple[str, int]]:
    """(address, state) of the IPv4 sockets in a table of /proc/net."""
    rows = [line.split() for line in text.splitlines()[1:]]
    return [
        (socket.inet_ntoa(bytes.fromhex(row[1].split(":")[0])[::-1]), int(row[3], 16))
        for row in rows
    ]


def test_no_socket_of_a_node_is_open_to_another_interface(stranger):
    """Each is bound to 127.0.0.1, or to a group that only the loopback interface has joined."""
    own = {os.readlink(f) for f in Path("/proc/self/fd").iterdir() if f.is_symlink()}
    bound = []
    for table in ("udp", "tcp", "udp6", "tcp6"):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            if f"socket:[{line.split()[9]}]" in own:
                assert not table.endswith("6"), line
                bound += sockets(f"head\n{line}")
    addresses = {address for address, _ in bound}
    assert addresses == {"127.0.0.1", OWN_GROUP}
    assert {d for d, groups in joined().items() if OWN_GROUP in groups} == {"lo"}


def joined(host: list[str] | None = None) -> dict[str, set[str]]:
    """Device → IPv4 groups that it has joined."""
    table = subprocess.check_output([*(host or []), "cat", "/proc/net/igmp"], text=True)
    found: dict[str, set[str]] = {}
    for line in table.splitlines()[1:]:
        words = line.split()
        if words[0].isdigit():
            device = words[1]
        else:
            group = socket.inet_ntoa(bytes.fromhex(words[0])[::-1])
            found.setdefault(device, set()).add(group)
    return found


def test_a_graph_sends_nothing_out_and_lets_nothing_in(
    hosts, domain, start, intruder, programs, tmp_path
):
    """A whole run beside an interface on which somebody else calls into the same domain."""
    home, away = hosts
    ear = start(
        home,
        str(HERE / "eavesdropper.py"),
        "hear",
        f"l{os.getpid()}a",
        str(PATIENCE),
        says="hearing",
    )
    halves = [graph_of(home, programs, tmp_path, h) for h in (ROLES[:3], ROLES[3:])]
    try:
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline and not recorded(tmp_path / "run"):
            time.sleep(0.1)
        assert recorded(tmp_path / "run")
        stranger = intruder(away, "intruder", 2, usual(tmp_path))
        for table in ("udp", "tcp", "udp6", "tcp6"):
            text = subprocess.check_output([*home, "cat", f"/proc/net/{table}"], text=True)
            bound = {a for a, _ in sockets(text)} if table == "udp" else set(text.splitlines()[1:])
            assert bound == ({"127.0.0.1", OWN_GROUP} if table == "udp" else set()), table
        groups = joined(home)
        assert OWN_GROUP in groups["lo"]
        assert groups[f"l{os.getpid()}a"] == {"224.0.0.1"}  # which every interface is in
        for half in halves:
            maps = Path(f"/proc/{half.pid}/maps").read_text()
            shared = set(re.findall(r"/dev/shm/(\S+)", maps))
            # By which the tracing library is woken, and which holds nothing else.
            assert all(name.startswith("lttng-ust-wait-") for name in shared)
        assert said(stranger) == {"met": [], "heard": []}
        ear.terminate()
        assert {d["from"] for d in datagrams(ear) if d["from"]} == {HOSTS[1]}
        assert [half.poll() for half in halves] == [None, None]
    finally:
        for half in halves:
            half.send_signal(signal.SIGINT)
            half.wait(PATIENCE)
    bag = read_bag(tmp_path / "run")
    numbers = [e.number for e in bag.experiments()]
    assert numbers == list(range(1, len(numbers) + 1))
    assert {m.kind for m in bag.records("model")} == {"physics"}


def graph_of(host, programs, folder: Path, roles: tuple[str, ...]) -> subprocess.Popen[bytes]:
    """A process with some nodes of one graph."""
    graph = f"graph:=[{','.join(ROLES)}]"
    given = ("bag:=run", "model:=physics", "rate:='200'", "experiments:=100000", graph)
    nodes = [word for role in roles for word in ("--node", role)]
    ros = ["--ros-args", *(word for text in given for word in ("-p", text))]
    command = [*host, sys.executable, "-m", "ldt_ros.graph.process", *nodes, *ros]
    return programs.start(command, cwd=folder, **NULL)


def test_whoever_joins_by_another_interface_meets_nobody(hosts, domain, intruder, tmp_path):
    """A process on this machine, in the same domain and group, by the interface that leads out.

    One that has no profile at all, as stock tools have none, meets the graph.
    """
    home, _ = hosts
    ours = intruder(home, "ours", 8, {})
    tool = intruder(home, "tool", 6, usual(tmp_path))
    outside = intruder(home, "outside", 3, profile(tmp_path, HOSTS[0]))
    told = said(outside)
    assert "ours" not in told["met"] + told["heard"]
    assert named(said(ours)) == {"met": ["tool"], "heard": ["array", "tool"]}
    assert "ours" in said(tool)["met"]


def test_announcements_from_outside_are_not_heard(hosts, domain, start, intruder, tmp_path):
    """Real ones, sent from another host, while another program listens for such on the outside.

    Linux gives a socket what any program on its machine has joined its group for. Whoever hears an
    announcement answers it: to the ports that stand in it, which are those of this machine.
    """
    home, away = hosts
    # What a participant that the victim could reach says of itself.
    ear = start(away, str(HERE / "eavesdropper.py"), "hear", "lo", "2.5", says="hearing")
    intruder(away, "intruder", 3, {})
    said_of_itself = {
        d["data"] for d in datagrams(ear) if d["port"] and d["data"][:8] == "52545053"
    }
    assert said_of_itself
    port = 7400 + 250 * domain  # of the groups, by the DDS standard
    forged = tmp_path / "forged.json"
    targets = [[a, p] for a in (USUAL_GROUP, OWN_GROUP, HOSTS[0]) for p in range(port, port + 16)]
    forged.write_text(json.dumps({"payloads": sorted(said_of_itself)[:20], "targets": targets}))

    start(home, str(HERE / "eavesdropper.py"), "join", HOSTS[0], USUAL_GROUP, "20", says="joined")
    ours = intruder(home, "ours", 5, {})
    lo = start(home, str(HERE / "eavesdropper.py"), "hear", "lo", "3", says="hearing")
    device = f"l{os.getpid()}a"
    door = start(home, str(HERE / "eavesdropper.py"), "hear", device, "3", says="hearing")
    start(away, str(HERE / "eavesdropper.py"), "forge", HOSTS[1], "2", str(forged))
    came = {d["data"] for d in datagrams(door)} & said_of_itself
    assert came  # to the interface
    answered = {(d["to"], d["port"]) for d in datagrams(lo) if d["port"]}
    assert answered == {(OWN_GROUP, port), (USUAL_GROUP, port)}  # its own announcements alone
    assert said(ours) == {"met": [], "heard": []}
