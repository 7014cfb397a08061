"""What the pages on deploying and on other hosts say, between two network namespaces of this."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import textwrap

import pytest
from cut_off import PROFILE, SERVED, run_cut, server
from disturbed import differences, ran
from programs import Programs

from ldt_core import docs

pytest.importorskip("rclpy")

PAGE = docs.text("deploy")
PATIENCE = 20  # s
TALK = f"""
    import sys, time
    from ldt_ros.graph.environment import prepare
    prepare()
    import rclpy
    from std_msgs.msg import String

    rclpy.init()
    node, heard = rclpy.create_node(sys.argv[1]), []
    end = time.monotonic() + {PATIENCE}
    if sys.argv[1] == "speaker":
        out = node.create_publisher(String, "x", 10)
        while not heard and time.monotonic() < end:
            heard = out.get_subscription_count() * ["matched"]
            time.sleep(0.05)
        out.publish(String(data="heard"))
        time.sleep(1)
    else:
        node.create_subscription(String, "x", lambda m: heard.append(m.data), 10)
        while not heard and time.monotonic() < end:
            rclpy.spin_once(node, timeout_sec=0.1)
    print(*heard)
    rclpy.try_shutdown()
"""


def heard(
    programs: Programs, hosts: list[list[str]], environment: dict[str, str]
) -> tuple[str, str]:
    """What the speaker on one host and the listener on the other have got."""
    talk = [sys.executable, "-c", textwrap.dedent(TALK)]
    env = {**os.environ, **environment}
    both = [
        programs.start([*host, *talk, role], env=env, stdout=subprocess.PIPE, text=True)
        for host, role in zip(hosts, ("speaker", "listener"), strict=True)
    ]
    said = [process.communicate(timeout=3 * PATIENCE)[0].strip() for process in both]
    return said[0], said[1]


def test_the_list_of_peers_joins_two_hosts(hosts, domain, programs, tmp_path):
    """By the profile as it stands on the page."""
    (tmp_path / "peers.xml").write_text(PROFILE)
    profile = {"FASTRTPS_DEFAULT_PROFILES_FILE": str(tmp_path / "peers.xml")}
    assert heard(programs, hosts, profile) == ("matched", "heard")


def test_the_discovery_server_joins_two_hosts(hosts, domain, programs, tmp_path):
    """By the command on the page, and the profile without its list."""
    assert "initialPeersList" not in SERVED
    (tmp_path / "served.xml").write_text(SERVED)
    profile = {"FASTRTPS_DEFAULT_PROFILES_FILE": str(tmp_path / "served.xml")}
    server_at = server(hosts[0], programs.start)
    assert heard(programs, hosts, profile | server_at) == ("matched", "heard")


def test_a_host_that_was_cut_off_misses_nothing(hosts, domain, programs, tmp_path):
    """For less, then for longer than after which the others have forgotten it: the same numbers."""
    forgotten = "<sec>2</sec></leaseDuration>"
    profile = PROFILE.replace("<sec>5</sec></leaseDuration>", forgotten)
    often = "<sec>0</sec><nanosec>300000000</nanosec></leaseAnnouncement>"
    profile = profile.replace("<sec>1</sec></leaseAnnouncement>", often)
    assert (forgotten in profile, often in profile) == (True, True)
    values = {"experiments": 48, "seed": 3, "model": "physics", "start_time": "1.0e9"}
    options = [w for n, v in values.items() for w in (f"--{n.replace('_', '-')}", str(v))]
    ran(tmp_path, "run", *options, "--bag", "calm")
    paced = {**values, "rate": "'80'"}  # four experiments a second
    run_cut(hosts, programs.start, tmp_path, profile, {}, paced, (3, 1.0), (9, 9.0))
    assert differences(tmp_path / "calm", tmp_path / "rough") == {}


def test_systemd_understands_the_units(tmp_path):
    """All of them, but for the programs, which are not where the page installs them."""
    if not shutil.which("systemd-analyze"):
        pytest.skip("no systemd here")
    units = dict(re.findall(r"```ini\n# (\S+)\n(.*?)```", PAGE, re.S))
    units["ldt@twin.service"] = units.pop("ldt@.service").replace(
        "/opt/ldt/bin/ldt_%i", "/bin/true"
    )
    units["ldt-tidy.service"] = units["ldt-tidy.service"].replace(
        "/opt/ldt/bin/python", "/bin/true"
    )
    names = [n for n in units if n.endswith((".service", ".timer"))]
    for name in names:
        (tmp_path / name).write_text(units[name])
    done = subprocess.run(
        ["systemd-analyze", "verify", *(str(tmp_path / n) for n in names)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "RuntimeMaxSec=1d" in units["recorder-day.conf"]


def test_all_that_the_page_shows_is_put_into_place():
    """Each file of the system is named by a command that installs it, as is what a unit runs."""
    shown = set(re.findall(r"^```(?:ini|yaml|python)\n# (\S+)$", PAGE, re.M))
    shown |= set(re.findall(r"/etc/ldt/([\w.]+)", PAGE))
    installed = {w for line in re.findall(r"sudo install (.*)", PAGE) for w in line.split()}
    assert {"ldt-tidy.timer", "tidy.py", "press.yaml"} <= shown
    assert shown - installed == set()
