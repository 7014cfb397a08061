"""A graph runs secured, or it does not start: never open without a word."""

from __future__ import annotations

import os
from fnmatch import fnmatchcase
from pathlib import Path

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("cryptography")

from stranger import written

from ldt_core.base.errors import BadInput
from ldt_core.cli import invoke
from ldt_core.doctor.check import Grade
from ldt_core.security.keystore import make_keystore
from ldt_core.security.permissions import NODES, enclaves
from ldt_core.views.watch.fleet import Fleet
from ldt_ros import doctor
from ldt_ros.graph import middleware_trials, secure
from ldt_ros.graph.environment import prepare
from ldt_ros.graph.process import ROLES, node_class
from ldt_ros.nodes.watch_node import WatchNode
from ldt_ros.up import command, launch

ALONE = {"secure": "", "machines": 1, "namespace": ""}
GRAPH = ["recorder", "adaptor", "detector", "twin", "plant"]
CAUSE = {"model": "diagnosed", "cause": "auto"}  # then the adaptor publishes diagnoses


@pytest.fixture
def keystore(domain, tmp_path) -> str:
    """For the domain of the test."""
    make_keystore(tmp_path / "keys", domain=domain)
    return str(tmp_path / "keys")


# ---- what the permissions are worth


@pytest.mark.parametrize("role", [*NODES, "watch"])
def test_no_node_needs_more_than_its_enclave_may(role, stranger, tmp_path):
    """Every topic and service that it really has in the graph; the adaptor with its diagnoses."""
    settings = {
        "recorder": {"bag": str(tmp_path / "bag")},
        "player": {"play": written(tmp_path / "played", 1)},
        "twin": {"model": "physics"},
        "adaptor": CAUSE,
    }.get(role, {})
    if role == "watch":
        node = WatchNode(Fleet(True), "press", context=stranger.context)
        stranger.nodes.append(node)
        node.close = lambda: None
    else:
        node = stranger.start(node_class(role), namespace="press", **settings)
    mine = {e.name: e for e in enclaves(["press", "mill"], ["/press/a"])}
    of = mine["/watch" if role == "watch" else f"/press/{role}"]
    space = node.get_namespace()
    got = {}
    for what in ("publisher", "subscriber", "service", "client"):
        ask = getattr(stranger.node, f"get_{what}_names_and_types_by_node")
        stranger.until(lambda: (node.get_name(), space) in _nodes(stranger.node))
        got[what] = [name for name, _ in ask(node.get_name(), space)]
    if role != "watch":
        stranger.until(lambda: stranger.node.count_publishers("/diagnostics"))
    sends = [f"rt{t}" for t in got["publisher"]] + [f"rr{s}Reply" for s in got["service"]]
    hears = [f"rt{t}" for t in got["subscriber"]] + [f"rq{s}Request" for s in got["service"]]
    assert got["client"] == []
    assert "rt/diagnostics" in sends + hears
    for names, allowed in ((sends, of.publishes), (hears, of.hears)):
        beyond = [n for n in names if not any(fnmatchcase(n, pattern) for pattern in allowed)]
        assert beyond == []


def _nodes(node) -> list[tuple[str, str]]:
    return [(name, space) for name, space in node.get_node_names_and_namespaces()]


def test_the_monitor_needs_no_more_than_its_enclave_may(monitor, stranger):
    """It hears signals, adaptations and health of each machine."""
    node, _ = monitor
    of = next(e for e in enclaves([""], []) if e.name == "/monitor")
    stranger.until(lambda: (node.get_name(), "/") in _nodes(stranger.node))
    hears = [n for n, _ in stranger.node.get_subscriber_names_and_types_by_node("monitor", "/")]
    assert {f"rt{n}" for n in hears} <= set(of.hears)
    assert {"/signal", "/adaptation", "/diagnostics"} <= set(hears)


def test_every_process_has_an_enclave():
    """Of each role that a process can host."""
    assert set(ROLES) == set(NODES)


# ---- starting


def test_what_cannot_be_secured_does_not_start(keystore, monkeypatch, capfd, tmp_path):
    """One sentence, exit code 2, nothing recorded, no process; the environment is as it was."""
    if secure.has_security(middleware_trials.dds_library()):
        pytest.skip("this Fast DDS is built with DDS-Security")
    monkeypatch.setattr("ldt_ros.up.Supervisor", lambda *_: pytest.fail("it started"))
    before = dict(os.environ)
    options = ["--experiments", "1", "--bag", str(tmp_path / "run"), "--secure", keystore]
    assert invoke(command, options) == 2
    told = capfd.readouterr()
    assert told.out == ""
    assert told.err == (
        "ldt: --secure: expected a middleware that enforces DDS-Security; nothing has been "
        "started, got a Fast DDS that is built without it\n"
    )
    assert not (tmp_path / "run").exists()
    assert dict(os.environ) == before


def test_a_middleware_that_takes_the_keys_and_stays_open_is_noticed(keystore):
    """As one does that knows nothing of security: a stranger sees who should be hidden."""
    open_ = {**prepare(), secure.ENABLE: "false", secure.KEYSTORE: keystore}
    assert "a participant without a key sees one that has one" in secure.unable(open_)


def test_a_trial_that_does_not_end_is_no_proof(domain):
    """Nor one that dies."""
    assert secure.unable(prepare(), patience=0.01) == "no answer within 0.01 s"
    broken = {**prepare(), "RMW_IMPLEMENTATION": "rmw_nothing_cpp"}
    assert "a trial that ended with code" in secure.unable(broken)


def test_where_it_is_enforced_each_process_gets_its_enclave(keystore, monkeypatch):
    """And none of them that of the launching process."""
    seen = []
    monkeypatch.setattr(secure, "unable", lambda environment: seen.append(environment) or "")
    for name in (secure.ENABLE, secure.STRATEGY, secure.KEYSTORE, secure.OVERRIDE):
        monkeypatch.setenv(name, "before")  # and put back after the test
    settings = {**ALONE, "secure": keystore}
    children = secure.secured(settings, GRAPH, dict(os.environ))
    wanted = {secure.ENABLE: "true", secure.STRATEGY: "Enforce", secure.KEYSTORE: keystore}
    assert {n: children[n] for n in wanted} == wanted
    assert secure.OVERRIDE not in children
    assert seen == [{**children, secure.OVERRIDE: "/monitor"}]
    assert {n: os.environ[n] for n in wanted} == wanted
    assert os.environ[secure.OVERRIDE] == "/monitor"
    assert secure.enclave_arguments(settings, "press", "twin") == ["--enclave", "/press/twin"]
    assert secure.enclave_arguments(ALONE, "press", "twin") == []


def test_permissive_is_never_used(domain, monkeypatch, tmp_path):
    """Asked for by the environment, it would run open whatever has no enclave."""
    monkeypatch.setenv(secure.ENABLE, "true")
    for strategy in ("Permissive", ""):
        monkeypatch.setenv(secure.STRATEGY, strategy)
        with pytest.raises(BadInput, match=r"^ROS_SECURITY_ENABLE: expected .*--secure"):
            launch({"experiments": 1, "bag": str(tmp_path / "run")})


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"machines": 2}, "one machine a graph"),
        ({"namespace": "press"}, "with the enclave /press/"),
        ({"secure": "nowhere"}, "a keystore .ldt security init makes one."),
    ],
)
def test_what_does_not_fit_the_keystore_is_refused(settings, words, keystore, tmp_path):
    """Before anything is tried."""
    given = {"secure": keystore, "bag": str(tmp_path / "run"), **settings}
    with pytest.raises(BadInput, match=words):
        launch(given)


def test_the_option_stands_alone_or_with_a_folder(monkeypatch, tmp_path, capsys):
    """Alone it means the folder that ldt security init makes by default."""
    monkeypatch.chdir(tmp_path)
    for words, folder in ((["--secure"], "ldt_keystore"), (["--secure", "other"], "other")):
        assert invoke(command, [*words, "--experiments", "1"]) == 2
        assert f"ldt: {folder}: expected a keystore" in capsys.readouterr().err


# ---- what the doctor says


def test_the_doctor_says_which_it_is(monkeypatch, tmp_path):
    """By the library, and what that means for --secure."""
    for name in doctor.PROFILES:
        monkeypatch.delenv(name, raising=False)
    plain = tmp_path / "plain"
    plain.write_bytes(b"nothing")
    (found,) = doctor.security(str(plain))
    assert found.message.startswith("DDS-Security: not in this build of Fast DDS, so that ldt up ")
    assert "every user" in found.message
    plain.write_bytes(b"..dds.sec.auth..")
    (found,) = doctor.security(str(plain))
    assert found.message.startswith("DDS-Security: in this build; by our profile")


def test_a_kernel_that_lets_packets_for_the_loopback_in_is_a_warning(tmp_path):
    """As container networks set it up at times."""
    for device, value in (("all", "0"), ("eth0", "1")):
        (tmp_path / device).mkdir()
        (tmp_path / device / "route_localnet").write_text(f"{value}\n")
    (found,) = doctor.loopback(tmp_path)
    assert (found.grade, found.message) == (
        Grade.WARNING,
        "packets for 127.0.0.1 are let in by eth0",
    )
    assert found.remedy == "sysctl -w net.ipv4.conf.eth0.route_localnet=0"
    Path(tmp_path / "eth0" / "route_localnet").write_text("0\n")
    assert doctor.loopback(tmp_path)[0].grade is Grade.OK
