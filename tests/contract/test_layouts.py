"""What the layouts for stock tools name is what the graph publishes."""

from __future__ import annotations

import itertools
import json
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

import msgs_config
from ldt_core.base.model_state import NOT_JUDGED, STATES
from ldt_core.base.settings import resolve
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine
from ldt_core.recording.bag import read_bag
from ldt_core.recording.messages import deserialize, standard, typestore
from ldt_core.recording.storage import Storage
from ldt_core.runs.offline import run
from ldt_core.views.export.predicted_runs import predicted_runs
from ldt_core.views.export.sample_messages import sample_messages

LAYOUTS = Path(msgs_config.__file__).parent / "layouts"
FOXGLOVE = json.loads((LAYOUTS / "foxglove.json").read_text())
# As Lichtblick's grammar of message paths has it: fields, slices, and a filter by a word.
STEP = re.compile(r'\.(\w+)(?:\[(\d*)(:?)(\d*)\])?(?:\{(\w+)=="(\w+)"\})?')
PANELS = {
    "Plot",
    "StateTransitions",
    "Indicator",
    "RawMessages",
    "DiagnosticSummary",
}


@pytest.fixture(scope="module")
def messages(tmp_path_factory, short_rotor) -> dict[str, list]:
    """Topic → messages of a short run with all that may be published, as a stock tool sees them."""
    bag = tmp_path_factory.mktemp("run") / "bag"
    settings = resolve({"model": "physics", "detector": "adequacy", "experiments": 2})
    machine = load_machine(short_rotor)
    plant = Plant.from_settings(machine, settings)
    run(machine, settings, map(plant.experiment, (1, 2)), bag)
    found: dict[str, list] = {}
    for raw in Storage(bag).messages():
        found.setdefault(raw.topic, []).append(deserialize(raw.data, raw.kind, raw.topic))
    make, joint_state = standard(), "sensor_msgs/msg/JointState"
    header = make.Header(stamp=make.Time(sec=0, nanosec=0), frame_id="")
    joint = typestore(joint_state).types[joint_state](header, ["rotor"], [], [1.0], [2.0])
    for topic, declared in msgs_config.topics().items():
        if declared["type"] == joint_state:
            found[f"/{topic}"] = [joint]
    # As `ldt serve` and `ldt export` send it: with what was predicted.
    run_of = next(predicted_runs(read_bag(bag)))
    sent = next(sample_messages(run_of, "rotor"))
    found["/joint_states"] = [deserialize(sent.data, joint_state, "the samples")]
    # A diagnosis takes minutes; its status is like the others'.
    status = make.DiagnosticStatus(0, "diagnoser", "because", "", [])
    found["/diagnosis"] = [make.DiagnosticArray(header, [status])]
    return found


def resolved(message, path: str) -> list:
    """What a message path leads to."""
    values, rest = [message], path
    while rest:
        step = STEP.match(rest)
        assert step, f"{path}: {rest}"
        name, begin, colon, end, key, word = step.groups()
        values = [getattr(value, name) for value in values]
        if begin is not None:
            first = int(begin or 0)
            last = (int(end) + 1 if end else None) if colon else first + 1
            values = [v for value in values for v in value[first:last]]
        if key:
            values = [v for v in values if getattr(v, key) == word]
        rest = rest[step.end() :]
    return values


def paths() -> list[str]:
    """Every message path of the Foxglove layout."""
    found = []
    for panel in FOXGLOVE["configById"].values():
        found += [one["value"] for one in panel.get("paths", [])]
        found += [panel[key] for key in ("path", "topicPath", "topicToRender") if key in panel]
    return found


@pytest.mark.parametrize("path", paths())
def test_every_path_of_the_foxglove_layout_leads_to_something(path, messages):
    """A declared topic, and a field, element or key of its messages."""
    topic, dot, fields = path.partition(".")
    declared = msgs_config.topics()
    assert topic in declared or topic.removeprefix("/") in declared
    if topic != "/diagnostics":
        assert any(resolved(message, dot + fields) for message in messages[topic])
        kind = declared[topic.removeprefix("/")]["type"]
        names = [name for name, _ in typestore().fielddefs[kind][1]]
        assert STEP.match(dot + fields)[1] in names


def test_what_is_plotted_are_numbers(messages):
    """Or texts of numbers, which the panel reads as such."""
    plots = [p for name, p in FOXGLOVE["configById"].items() if name.startswith("Plot!")]
    for one in itertools.chain.from_iterable(plot["paths"] for plot in plots):
        topic, dot, fields = one["value"].partition(".")
        assert all(float(v) == float(v) for v in resolved(messages[topic][-1], dot + fields))


def test_every_panel_of_the_foxglove_layout_has_its_place():
    """Each once, and of a kind that there is."""

    def leaves(node) -> list[str]:
        return [node] if isinstance(node, str) else leaves(node["first"]) + leaves(node["second"])

    placed = leaves(FOXGLOVE["layout"])
    assert sorted(placed) == sorted(FOXGLOVE["configById"])
    assert {name.partition("!")[0] for name in placed} == PANELS


def test_the_indicator_knows_every_state_of_machine_and_model():
    """By the words that all views have, green for a model that holds alone; the rest is grey."""
    panel = FOXGLOVE["configById"]["Indicator!state"]
    assert {rule["rawValue"]: rule["label"] for rule in panel["rules"]} == {
        name: state.words for name, state in STATES.items()
    }
    green = "#009e73"
    assert [r["rawValue"] for r in panel["rules"] if r["color"] == green] == ["holds"]
    assert panel["fallbackLabel"] == NOT_JUDGED.words


def series(topic: str, message) -> set[str]:
    """Names that PlotJuggler gives to what is in a message."""
    if hasattr(message, "velocity"):
        return {f"{topic}/{n}/{f}" for n in message.name for f in ("velocity", "effort")}
    names = set()
    for status in getattr(message, "status", ()):
        hardware = getattr(status, "hardware_id", "")
        stem = "/".join(part for part in (topic, hardware, status.name) if part)
        names |= {f"{stem}/{key}" for key in ("level", *(v.key for v in status.values))}
    return names


def test_every_curve_of_the_plotjuggler_layout_is_there(messages):
    """By PlotJuggler's names, for the machine that the layout was made for."""
    from ldt_ros.graph.process import ROLES

    known = {n for topic, all_ in messages.items() for m in all_ for n in series(topic, m)}
    known |= {f"/diagnostics/rotor/{role}/level" for role in ROLES}
    root = ElementTree.parse(LAYOUTS / "plotjuggler.xml").getroot()
    curves = [curve.get("name") for curve in root.iter("curve")]
    assert curves
    assert set(curves) <= known
    for splitter in root.iter("DockSplitter"):
        areas = splitter.findall("DockArea")
        assert int(splitter.get("count")) == len(areas) == splitter.get("sizes").count(";") + 1


def analyzers() -> dict[str, dict]:
    text = (LAYOUTS / "diagnostic_aggregator.yaml").read_text()
    own = yaml.safe_load(text)["analyzers"]["ros__parameters"]
    return {name: one for name, one in own.items() if isinstance(one, dict)}


@pytest.mark.parametrize("namespace", ["", "machine_1/", "hall/press/"])
def test_every_node_s_health_has_its_place_in_the_aggregator(namespace):
    """One analyzer each, in whatever namespace; nobody else's status is taken."""
    from ldt_ros.graph.process import ROLES

    def takers(name: str) -> list[str]:
        rules = ((n, r) for n, one in analyzers().items() for r in one["regex"])
        return [n for n, rule in rules if re.fullmatch(rule, name)]

    for role in ROLES:
        assert len(takers(namespace + role)) == 1, role
    assert takers("camera_driver: status") == []
    assert takers("twin_arm") == []


def test_the_aggregator_s_analyzers_are_of_a_kind_that_there_is():
    """With a path and a rule, without which it refuses them."""
    for one in analyzers().values():
        assert one["type"] == "diagnostic_aggregator/GenericAnalyzer"
        assert one["path"]
        assert one["regex"]
        assert isinstance(one["timeout"], float)
