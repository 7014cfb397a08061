"""An operator switches learning off and on while the graph runs."""

from __future__ import annotations

import json
import signal
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import pytest

rclpy = pytest.importorskip("rclpy")

from disturbed import (  # noqa: E402
    MODEL,
    PATIENCE,
    adaptations,
    nodes,
    recorded,
    until,
    wait_for,
)
from lifecycle_msgs.msg import Transition  # noqa: E402
from lifecycle_msgs.srv import ChangeState, GetState  # noqa: E402
from stranger import answer, experiment  # noqa: E402

from ldt_core.base.experiment import PAUSED, Action, Adaptation, Level  # noqa: E402
from ldt_core.cli import invoke  # noqa: E402
from ldt_core.cli import ldt as commands  # noqa: E402
from ldt_core.recording.bag import read_bag  # noqa: E402
from ldt_core.recording.writer import BagWriter  # noqa: E402
from ldt_core.restart.learning_switch import NAME  # noqa: E402
from ldt_ros.nodes.adaptor_node import AdaptorNode  # noqa: E402

LINEAR = {"model": "linear", "order": 1}


def asked(stranger, kind, name, request):
    client = stranger.node.create_client(kind, name)
    stranger.until(client.service_is_ready, name)
    future = client.call_async(request)
    stranger.until(future.done, name)
    stranger.node.destroy_client(client)
    return future.result()


def state(stranger) -> str:
    got = asked(stranger, GetState, "adaptor/get_state", GetState.Request())
    return got.current_state.label


def change(stranger, label: str = "", number: int = 0) -> bool:
    request = ChangeState.Request(transition=Transition(label=label, id=number))
    return asked(stranger, ChangeState, "adaptor/change_state", request).success


def test_an_inactive_adaptor_answers_and_learns_nothing(stranger):
    """The model in force stays; activated it learns, and not from what came meanwhile."""
    node = stranger.start(AdaptorNode, **LINEAR)
    stranger.listen("adaptation", "model", "/diagnostics")
    assert state(stranger) == "active"
    assert change(stranger, "deactivate")
    assert state(stranger) == "inactive"
    for number, level in ((1, Level.POSITIVE), (2, Level.WARNING), (3, Level.NEGATIVE)):
        stranger.send("experiment", experiment(number))
        stranger.send("signal", answer(number, level))
    stranger.until(lambda: stranger.numbers("adaptation") == [1, 2, 3])
    for told in stranger.heard["adaptation"]:
        assert (told.action, told.details[PAUSED], told.model_version) == (Action.KEPT, 1, 0)
        assert told.reason == "nothing is learned: switched off; version 0 stays"
    stranger.until(lambda: stranger.health("adaptor").get("learning") == "off")
    assert change(stranger, "activate")
    stranger.send("experiment", experiment(4))
    stranger.send("signal", answer(4, Level.WARNING))
    stranger.until(lambda: stranger.numbers("adaptation") == [1, 2, 3, 4])
    assert stranger.heard["adaptation"][-1].action is Action.STORED
    assert [e.number for e in node.adaptor.memory.recent] == [4]


def test_what_its_state_does_not_have_is_refused(stranger):
    """The node goes on, whatever it is asked for."""
    stranger.start(AdaptorNode, **LINEAR)
    assert not change(stranger, "activate")
    assert not change(stranger, "no such thing")
    assert not change(stranger, number=255)
    assert state(stranger) == "active"
    assert change(stranger, "deactivate")
    assert not change(stranger, "cleanup")
    assert state(stranger) == "inactive"
    assert change(stranger, "shutdown")
    assert not change(stranger, "activate")
    stranger.listen("adaptation")
    stranger.send("experiment", experiment(1))
    stranger.send("signal", answer(1, Level.POSITIVE))
    stranger.until(lambda: stranger.numbers("adaptation") == [1])
    assert PAUSED in stranger.heard["adaptation"][0].details


def test_it_stays_off_over_a_crash_and_the_end_of_the_run(ldt, environment, capsys, tmp_path):
    """Until it is switched on; then the twin learns again, from what came since alone."""

    def says(*arguments: str) -> str:
        assert invoke(commands, ["learning", *arguments]) == 0
        return capsys.readouterr().out.strip()

    def told() -> dict[int, Adaptation]:
        return {a.experiment: a for a in adaptations(bag)}

    def paused(after: int = 0) -> set[int]:
        return {n for n, a in told().items() if n > after and PAUSED in a.details}

    bag = tmp_path / "run"
    model = (*MODEL, "--machine", "dc_motor", "--degradation", "ramp", "--seed", "3")
    paced = ("--experiments", "100000", "--rate", "50", "--bag", "run")
    graph = ldt("up", *model, *paced)
    wait_for(bag, 2)
    assert says() == "learning is on"
    assert says("off") == "learning is off"
    until(paused)
    nodes(graph.pid)["adaptor"].kill()
    wait_for(bag, recorded(bag) + 3)
    assert json.loads(says("--json")) == {"learning": "off"}
    graph.send_signal(signal.SIGINT)
    graph.communicate(timeout=PATIENCE)
    graph = ldt("up", "--resume", "run")
    ended = recorded(bag)
    until(lambda: len(paused(ended)) > 2)
    assert says("on") == "learning is on"
    until(lambda: max(told()) > max(paused()) + 3)
    graph.send_signal(signal.SIGINT)
    graph.communicate(timeout=PATIENCE)
    answers, off = told(), sorted(paused())
    assert off == list(range(off[0], off[-1] + 1))
    assert off[0] < ended < off[-1] < max(answers)
    assert len({answers[n].model_version for n in off}) == 1
    models = [m for m in read_bag(bag).records("model") if m.version]
    assert not any(set(off) & set(m.trained_on) for m in models)
    assert answers[off[-1]].model_version <= answers[max(answers)].model_version
    assert not (bag / NAME).exists()


# ---- the command


def test_where_nobody_answers_it_says_what_to_look_at(environment, capsys, monkeypatch):
    """In a sentence."""
    monkeypatch.setattr("ldt_ros.learning.MEETING_TIMEOUT", 0.2)
    assert invoke(commands, ["learning", "off", "--namespace", "press"]) == 2
    err = capsys.readouterr().err
    assert err.startswith("ldt: /press/adaptor/get_state: expected an adaptor")
    assert err.count("\n") == 1
    assert invoke(commands, ["learning", "off", "--namespace", "a b"]) == 2
    assert capsys.readouterr().err.startswith("ldt: namespace: expected words of letters")
    assert invoke(commands, ["learning", "of"]) == 2


def test_a_busy_adaptor_is_asked_until_it_answers(stranger, environment, capsys, monkeypatch):
    """An answer may be lost, and a busy computer takes its time."""
    monkeypatch.setattr("ldt_ros.learning.ASK_AGAIN", 0.1)
    node = stranger.start(AdaptorNode, **LINEAR)
    requests = []
    service = next(s for s in node.services if s.srv_name.endswith("/change_state"))
    late = partial(_late, service.callback, requests)
    monkeypatch.setattr(service, "callback", late)
    with ThreadPoolExecutor(1) as beside:
        switched = beside.submit(invoke, commands, ["learning", "off"])
        stranger.until(switched.done)
    assert (switched.result(), capsys.readouterr().out) == (0, "learning is off\n")
    assert len(requests) > 1


def _late(do, requests, request, response):
    """The answer to the first request comes when nobody waits for it any more."""
    requests.append(request)
    if len(requests) == 1:
        time.sleep(0.5)
    return do(request, response)


def test_a_run_that_has_ended_is_switched_by_its_recording(tmp_path, capsys):
    """A run that goes on with it begins so, with or without a graph."""
    own = ["--experiments", "3", "--model", "linear", "--order", "1", "--degradation", "abrupt"]
    run = str(tmp_path / "run")
    assert invoke(commands, ["run", *own, "--start-time", "1e9", "--bag", run]) == 0
    capsys.readouterr()
    assert invoke(commands, ["learning", "off", "--bag", run]) == 0
    assert invoke(commands, ["learning", "--bag", run, "--json"]) == 0
    assert capsys.readouterr().out == 'learning is off\n{"learning": "off"}\n'
    assert invoke(commands, ["learning", "on", "--bag", run]) == 0
    assert invoke(commands, ["learning", "--bag", str(tmp_path / "nothing")]) == 2
    capsys.readouterr()
    with BagWriter(run, "rotor", resume=True):
        assert invoke(commands, ["learning", "off", "--bag", run]) == 2
    assert "one that is being written" in capsys.readouterr().err
