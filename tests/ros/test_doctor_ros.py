"""What `ldt doctor` says of ROS 2, the domain and the middleware, over real DDS."""

from __future__ import annotations

import errno
import os
import shutil
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from ldt_core.base.errors import BadInput
from ldt_core.doctor.check import Grade
from ldt_ros import doctor
from ldt_ros.graph import shared_memory
from ldt_ros.graph.environment import require_ros
from ldt_ros.graph.shared_memory import require_room

OK, WARNING, PROBLEM = Grade.OK, Grade.WARNING, Grade.PROBLEM


def named(found) -> dict:
    """Findings by name; each has a remedy where it is not well."""
    for finding in found:
        assert bool(finding.remedy) == (finding.grade is not OK), finding
    return {f.name: f for f in found}


def test_a_full_shared_memory_is_a_sentence(domain, monkeypatch):
    """The library behind rclpy was killed by SIGBUS, and with it the command, without a word."""

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    require_room()
    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(BadInput, match=r"/dev/shm: expected room for .*, got No space left"):
        require_ros()
    found = named(doctor.ros())
    assert "remove what nobody uses in /dev/shm" in found["DDS"].remedy
    monkeypatch.setattr(shared_memory, "SHARED", Path("/nowhere"))
    require_room()  # without it, nothing is mapped


def test_a_message_goes_across_in_a_domain_of_one_s_own(domain):
    """By the profile that `ldt up` uses, and nobody else is seen."""
    pytest.importorskip("rclpy")
    before = shared_memory.middleware_files()
    found = named(doctor.ros())
    assert found["DDS"].grade is OK
    assert "rmw_fastrtps_cpp" in found["DDS"].message
    assert found["domain"].grade is OK
    assert f"ROS_DOMAIN_ID {domain}, nobody else" in found["domain"].message
    assert found["security"].grade is OK
    assert shared_memory.middleware_files() <= before


def test_a_foreign_node_is_a_warning_and_a_graph_a_problem(stranger):
    """The second is what `ldt up` would refuse to start beside; in a namespace it would not."""
    found = named(doctor.ros())
    assert found["domain"].grade is WARNING
    assert "/stranger" in found["domain"].message
    assert "ROS_DOMAIN_ID" in found["domain"].remedy
    from std_msgs.msg import Float64MultiArray

    away = stranger.node.create_publisher(Float64MultiArray, "/press/experiment", 1)
    assert named(doctor.ros())["domain"].grade is WARNING
    here = stranger.node.create_publisher(Float64MultiArray, "/experiment", 1)
    found = named(doctor.ros())
    assert found["domain"].grade is PROBLEM
    assert "publisher of /experiment already" in found["domain"].message
    assert "--namespace" in found["domain"].remedy
    for publisher in (away, here):
        stranger.node.destroy_publisher(publisher)


@pytest.mark.parametrize("value", ["233", "abc"])
def test_a_domain_that_cannot_be_is_a_problem(value, monkeypatch):
    """Said before the middleware ends a process over it."""
    pytest.importorskip("rclpy")
    monkeypatch.setenv("ROS_DOMAIN_ID", value)
    assert named(doctor.ros())["domain"].grade is PROBLEM


def test_a_middleware_that_is_not_there_is_a_problem(domain, monkeypatch):
    """In the words of ROS, one line."""
    pytest.importorskip("rclpy")
    monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_nothing_cpp")
    found = named(doctor.ros())["DDS"]
    assert found.grade is PROBLEM
    assert found.message.startswith("Expected RMW implementation identifier")
    assert "RMW_IMPLEMENTATION" in found.remedy


def test_two_processes_that_do_not_meet_are_a_problem(domain, tmp_path, monkeypatch):
    """A profile that lets each see its own interface alone, which does not exist."""
    pytest.importorskip("rclpy")
    from importlib import resources

    text = (resources.files("msgs_config") / "fastdds.xml").read_text()
    deaf = tmp_path / "deaf.xml"
    deaf.write_text(text.replace("127.0.0.1", "192.0.2.1"))
    monkeypatch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", str(deaf))
    began = time.monotonic()
    found = named(doctor.ros())
    assert time.monotonic() - began < 12
    assert found["DDS"].grade is PROBLEM
    assert f"yours, {deaf}" in found["DDS profile"].message


def test_a_process_that_does_not_end_is_ended(domain, monkeypatch):
    """Within the time given."""
    pytest.importorskip("rclpy")
    exchange = doctor.exchange
    monkeypatch.setattr(doctor, "exchange", lambda: exchange(0.05))
    found = named(doctor.ros())["DDS"]
    assert (found.grade, found.message) == (PROBLEM, "no answer within 0.05 s")


def test_a_profile_that_is_none_is_a_warning(monkeypatch, tmp_path):
    """Fast DDS would go on without it and say nothing that a person sees."""
    for name in doctor.PROFILES:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE", raising=False)
    assert [f.grade for f in doctor.profile()] == [OK]
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    assert [f.grade for f in doctor.profile()] == [OK, WARNING]
    monkeypatch.setenv(doctor.PROFILES[0], str(tmp_path / "nowhere.xml"))
    (found,) = doctor.profile()
    assert found.grade is WARNING
    assert "No such file" in found.message
    (tmp_path / "nowhere.xml").write_text("<dds>")
    assert "it is no XML" in doctor.profile()[0].message


def test_another_distribution_that_is_sourced_is_a_warning(monkeypatch):
    """The wheels and a sourced installation get in each other's way."""
    pytest.importorskip("rclpy")
    monkeypatch.setenv("ROS_DISTRO", "humble")
    assert doctor.distribution().grade is WARNING
    monkeypatch.delenv("ROS_DISTRO")
    assert doctor.distribution().grade is OK


def test_security_that_the_middleware_cannot_give_is_told(monkeypatch, tmp_path):
    """Permissive goes on unsecured, Enforce does not start; a library that can is believed."""
    plain, able = tmp_path / "plain", tmp_path / "able"
    plain.write_bytes(b"nothing")
    able.write_bytes(b"..dds.sec.auth.plugin..")
    (found,) = doctor.security(str(plain))
    assert (found.grade, "DDS-Security: not in this build" in found.message) == (OK, True)
    monkeypatch.setenv("ROS_SECURITY_ENABLE", "true")
    (found,) = doctor.security(str(plain))
    assert (found.grade, "nothing is secured" in found.message) == (WARNING, True)
    assert doctor.security(str(able))[0].grade is OK
    monkeypatch.setenv("ROS_SECURITY_STRATEGY", "Enforce")
    (found,) = doctor.security(str(plain))
    assert (found.grade, "no node starts" in found.message) == (PROBLEM, True)


def test_multicast_that_does_not_work_is_a_warning(monkeypatch):
    """It explains why two processes do not meet."""
    assert doctor.multicast()[0].grade is OK
    monkeypatch.setattr(doctor, "DATAGRAM_TIMEOUT", 0.1)
    monkeypatch.setattr(socket.socket, "sendto", lambda *_: 0)
    (found,) = doctor.multicast()
    assert (found.grade, "does not come back" in found.message) == (WARNING, True)


def test_a_small_receive_buffer_is_a_warning(tmp_path):
    """The usual one holds six experiments."""
    limit = tmp_path / "rmem_max"
    limit.write_text("212992\n")
    (found,) = doctor.buffer(limit)
    assert (found.grade, "net.core.rmem_max=4194304" in found.remedy) == (WARNING, True)
    limit.write_text("4194304\n")
    assert doctor.buffer(limit)[0].grade is OK
    assert doctor.buffer(tmp_path / "nowhere")[0].grade is OK


def test_leftovers_in_shared_memory_are_told_while_nobody_uses_them(
    monkeypatch, programs, tmp_path
):
    """A file that a live process has mapped is its own; little room is told as well."""
    monkeypatch.setattr(doctor, "SHARED", tmp_path)
    monkeypatch.setattr(shared_memory, "SHARED", tmp_path)
    assert doctor.shared_memory()[0].grade is OK
    for name in ("fastrtps_1234", "fastrtps_5678", "somebody_else"):
        (tmp_path / name).write_bytes(b"x" * 5000)
    (found,) = doctor.shared_memory()
    assert (found.grade, found.message.startswith("2 file(s)")) == (WARNING, True)
    code = (
        "import mmap, sys; f = open(sys.argv[1], 'r+b'); m = mmap.mmap(f.fileno(), 0);"
        "print('mapped', flush=True); sys.stdin.read()"
    )
    user = programs.start(
        [sys.executable, "-c", code, tmp_path / "fastrtps_1234"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    assert user.stdout is not None
    user.stdout.readline()
    (found,) = doctor.shared_memory()
    assert "fastrtps_5678" in found.message
    assert "fastrtps_1234" not in found.message
    user.communicate(b"")
    usage = shutil.disk_usage(tmp_path)._replace(free=10**6)
    monkeypatch.setattr(doctor.shutil, "disk_usage", lambda _: usage)
    assert "0 MiB free" in doctor.shared_memory()[0].message
    monkeypatch.setattr(doctor, "SHARED", tmp_path / "nowhere")
    assert doctor.shared_memory()[0].grade is WARNING
    assert os.listdir(tmp_path)
