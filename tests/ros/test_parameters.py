"""Parameters: declared once, the same on ROS's command line, in a file, and as an option."""

from __future__ import annotations

import subprocess
import sys

import click
import pytest
import yaml

import msgs_config
from ldt_core.base.errors import BadInput, OptionError
from ldt_core.cli import invoke
from ldt_core.cli.options import parameters
from ldt_core.recording.bag import read_bag
from ldt_core.recording.writer import BagWriter

rclpy = pytest.importorskip("rclpy")

from rcl_interfaces.msg import ParameterType  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from rclpy.parameter_client import AsyncParameterClient  # noqa: E402
from stranger import experiment  # noqa: E402

from ldt_ros.graph.process import main  # noqa: E402
from ldt_ros.nodes.detector_node import DetectorNode  # noqa: E402
from ldt_ros.nodes.experiment_source import PlantNode, PlayerNode  # noqa: E402
from ldt_ros.nodes.interfaces import declare  # noqa: E402
from ldt_ros.nodes.recorder_node import RecorderNode  # noqa: E402
from ldt_ros.nodes.twin_node import TwinNode  # noqa: E402

RANGED = {n: d for n, d in msgs_config.parameters().items() if "range" in d}
CHOSEN = {n: d for n, d in msgs_config.parameters().items() if "choices" in d}


def declared(stranger, *arguments: str, file: str | None = None) -> dict:
    """What a node with all parameters makes of `--ros-args -p … --params-file …`."""
    ros = ["--ros-args", *(part for a in arguments for part in ("-p", a))]
    if file is not None:
        ros += ["--params-file", file]
    node = rclpy.create_node("any", context=stranger.context, cli_args=ros)
    try:
        return declare(node)
    finally:
        node.destroy_node()


def as_option(capsys, *arguments: str) -> tuple[int, dict, str]:
    """(exit code, settings, stderr) of a command with all parameters."""
    settings: dict = {}

    @click.command("all")
    @parameters()
    def command(settings: dict, **_: object) -> None:
        seen.update(settings)

    seen = settings
    code = invoke(command, list(arguments))
    return code, settings, capsys.readouterr().err


# ---- the same values


def test_without_any_every_way_gives_the_declared_defaults(stranger, capsys):
    """Nodes and commands read the same table."""
    defaults = {n: d["default"] for n, d in msgs_config.parameters().items()}
    assert declared(stranger) == defaults
    code, settings, _ = as_option(capsys)
    assert (code, settings) == (0, defaults)


@pytest.mark.parametrize(
    ("name", "ros", "option", "value"),
    [
        ("threshold", "1.5", ["1.5"], 1.5),
        ("threshold", "2", ["2"], 2.0),  # YAML reads an integer
        ("noise", "1.0e-3", ["1e-3"], 0.001),
        ("window", "5", ["5"], 5),
        ("rate", "20", ["20"], "20"),  # a word that YAML reads as a number
        ("rate", "max", ["max"], "max"),
        ("machine", "dc_motor", ["dc_motor"], "dc_motor"),
        ("effect", "unbalance:e=0.005", ["unbalance:e=0.005"], ["unbalance:e=0.005"]),
        ("effect", "['a', 'b:c=1']", ["a", "b:c=1"], ["a", "b:c=1"]),
        ("literal", "true", [], True),
        ("seed", "4294967295", ["4294967295"], 4294967295),
    ],
)
def test_a_value_means_the_same_on_both_command_lines_and_in_a_file(
    name, ros, option, value, stranger, capsys, tmp_path
):
    """`-p threshold:=2`, `--params-file` with `threshold: 2`, and `--threshold 2`."""
    assert declared(stranger, f"{name}:={ros}")[name] == value
    file = tmp_path / "parameters.yaml"
    file.write_text(f"/**:\n  ros__parameters:\n    {name}: {ros}\n")
    assert declared(stranger, file=str(file))[name] == value
    flag = f"--{name.replace('_', '-')}"
    arguments = [part for word in option for part in (flag, word)] or [flag]
    # An option of another detector would be refused.
    served = msgs_config.parameters()[name].get("only_with", {})
    arguments += [part for other, known in served.items() for part in (f"--{other}", known[0])]
    code, settings, _ = as_option(capsys, *arguments)
    assert (code, settings[name]) == (0, value)
    assert type(declared(stranger, f"{name}:={ros}")[name]) is type(settings[name])


def test_a_threshold_reaches_the_detector_by_all_three_ways(stranger, tmp_path):
    """What counts is what the signals say that they were compared with."""
    from ldt_ros.up import launch

    file = tmp_path / "parameters.yaml"
    file.write_text(
        yaml.safe_dump({"/**": {"ros__parameters": {"detector": "threshold", "threshold": 1.5}}})
    )
    for way in (
        ["-p", "detector:=threshold", "-p", "threshold:=1.5"],
        ["--params-file", str(file)],
    ):
        node = DetectorNode(context=stranger.context, cli_args=["--ros-args", *way])
        assert node.detector.detector.threshold == 1.5
        node.destroy_node()
    with BagWriter(tmp_path / "played", machine="rotor") as writer:
        for number in (1, 2):
            writer.write("experiment", experiment(number), experiment(number).end)
    given = {"play": str(tmp_path / "played"), "model": "physics"}
    given |= {"detector": "threshold", "threshold": 1.5}
    launch({**given, "bag": str(tmp_path / "bag")})
    signals = list(read_bag(tmp_path / "bag").records("signal"))
    assert [s.statistics["drift_limit"] for s in signals] == [1.5, 1.5]


# ---- the same refusals


@pytest.mark.parametrize("name", RANGED)
def test_the_range_is_the_same_everywhere(name, stranger, capsys):
    """One sentence that names the parameter, the range and the value; exit code 2 for a command."""
    low, high = RANGED[name]["range"]
    whole = RANGED[name]["type"] == "integer"
    for value in (low - 1, high + 1 if whole else high * 2.0 + 1.0):
        text = repr(value if whole else float(value))
        with pytest.raises(OptionError) as refused:
            declared(stranger, f"{name}:={text}")
        sentence = str(refused.value)
        assert sentence.startswith(f"{name}: expected {low:g} to {high:g}")
        flag = f"--{name.replace('_', '-')}"
        code, _, errors = as_option(capsys, f"{flag}={text}")
        assert (code, errors) == (2, f"ldt: {sentence.replace(name, flag, 1)}\n")


@pytest.mark.parametrize("name", CHOSEN)
def test_the_choices_are_the_same_everywhere(name, stranger, capsys):
    """A word that is none of them is refused with all of them."""
    with pytest.raises(OptionError) as refused:
        declared(stranger, f"{name}:=nonsuch")
    for choice in filter(None, CHOSEN[name]["choices"]):
        assert repr(choice) in str(refused.value)
    flag = f"--{name.replace('_', '-')}"
    code, _, errors = as_option(capsys, f"{flag}=nonsuch")
    assert (code, errors) == (2, f"ldt: {str(refused.value).replace(name, flag, 1)}\n")


@pytest.mark.parametrize(
    ("argument", "sentence"),
    [
        ("threshold:=high", "threshold: expected a finite number, got 'high'"),
        ("threshold:=.nan", "threshold: expected a finite number, got nan"),
        ("threshold:=.inf", "threshold: expected a finite number, got inf"),
        ("threshold:=true", "threshold: expected a finite number, got True"),
        ("threshold:=[1.0, 2.0]", "threshold: expected a finite number, got [1.0, 2.0]"),
        ("window:=2.5", "window: expected a whole number, got 2.5"),
        ("literal:=1", "literal: expected true or false, got 1"),
        ("machine:=[a]", "machine: expected a word, got ['a']"),
        ("effect:=[1, 2]", "effect: expected a list of words, got [1, 2]"),
    ],
)
def test_a_wrong_type_is_refused_in_one_sentence(argument, sentence, stranger):
    """ROS's own words name no parameter."""
    with pytest.raises(OptionError) as refused:
        declared(stranger, argument)
    assert str(refused.value) == sentence


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--ros-args", "-p", "threshold:=-3.0"], "threshold: expected 0 to 1e+09 rad/s, got -3.0"),
        (["--ros-args", "-p", "detector:=lddmm"], "(did you mean 'lddm'?), got 'lddmm'"),
        (["--ros-args", "-p", "threshold:=["], "ROS arguments: expected what ROS 2 understands"),
        (["--ros-args", "-p", "graph:=[detektor]"], "(did you mean 'detector'?), got 'detektor'"),
        (["--ros-args", "--bogus"], "ROS arguments: expected what ROS 2 understands"),
        (["--ros-args", "-r", "__ns:=/1 a"], "ROS arguments: expected what ROS 2 understands"),
    ],
)
def test_a_node_process_that_cannot_start_says_why_and_exits_2(arguments, sentence, domain):
    """One sentence of ours, whatever ROS logs besides; no traceback."""
    done = subprocess.run(
        [sys.executable, "-m", "ldt_ros.graph.process", "--node", "detector", *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 2, done.stderr
    ours = [line for line in done.stderr.splitlines() if line.startswith("ldt detector: ")]
    assert len(ours) == 1, done.stderr
    assert sentence in ours[0]
    assert "Traceback" not in done.stderr


def test_a_node_alone_says_how_it_is_called(capsys):
    """It asked for --node, which it had."""
    for arguments, code in ((["--help"], 0), (["-p", "model:=linear"], 2)):
        with pytest.raises(SystemExit) as ended:
            main(arguments, "twin")
        assert ended.value.code == code
        said = "".join(capsys.readouterr())
        assert said.startswith("usage: ldt_twin [--ros-args -p NAME:=VALUE ...]")
        assert "--node" not in said


def test_a_player_of_nothing_names_its_parameter(stranger):
    """It spoke of files in the present folder."""
    with pytest.raises(OptionError, match="play: expected a recording, got none"):
        PlayerNode(context=stranger.context)


def test_a_recorder_whose_topic_is_renamed_says_what_to_rename(stranger, tmp_path):
    """It took "experiment" in another namespace, and that recording was two machines'."""
    for other in ("/bench/run", "/bench/experiment"):
        with pytest.raises(BadInput, match="experiment: expected /press/experiment, by which"):
            RecorderNode(
                context=stranger.context,
                namespace="press",
                cli_args=["--ros-args", "-r", f"experiment:={other}"],
                parameter_overrides=[Parameter("bag", value=str(tmp_path / "bag"))],
            )
    assert not (tmp_path / "bag").exists()


def test_a_slip_of_the_pen_is_warned_of(stranger, capfd):
    """A name of nobody's is not refused: a file of parameters may be shared with other nodes."""
    values = declared(stranger, "treshold:=1.5", "use_sim_time:=true", "other_node_gain:=3")
    assert values["threshold"] == 3.0
    said = capfd.readouterr().err
    assert "no parameter 'treshold', did you mean 'threshold'?" in said
    assert "use_sim_time" not in said  # the library's own


# ---- what other tools see


def test_descriptions_ranges_and_read_only_are_visible(stranger):
    """Over the parameter services, as `ros2 param describe` asks."""
    stranger.start(DetectorNode)
    client = AsyncParameterClient(stranger.node, "detector")
    stranger.until(client.services_are_ready, "parameter services")
    names = list(msgs_config.parameters("detector"))
    asked = client.describe_parameters(names)
    stranger.until(asked.done, "descriptions")
    for descriptor in asked.result().descriptors:
        declaration = msgs_config.parameters()[descriptor.name]
        assert descriptor.description.startswith(declaration["description"])
        assert descriptor.read_only
        if "unit" in declaration:
            assert f"[{declaration['unit']}]" in descriptor.description
        if declaration["type"] == "double":
            (limits,) = descriptor.floating_point_range
            assert [limits.from_value, limits.to_value] == declaration["range"]
        if declaration["type"] == "integer":
            (limits,) = descriptor.integer_range
            assert [limits.from_value, limits.to_value] == declaration["range"]
    kinds = {d.name: d.type for d in asked.result().descriptors}
    assert kinds["threshold"] == ParameterType.PARAMETER_DOUBLE
    changed = client.set_parameters([Parameter("threshold", value=9.0)])
    stranger.until(changed.done, "answer")
    assert not changed.result().results[0].successful


def test_choices_are_visible(stranger):
    """As additional constraints, for ROS has no other place."""
    stranger.start(PlantNode)
    client = AsyncParameterClient(stranger.node, "plant")
    stranger.until(client.services_are_ready, "parameter services")
    asked = client.describe_parameters(["voltage"])
    stranger.until(asked.done, "description")
    constraints = asked.result().descriptors[0].additional_constraints
    assert constraints == "one of steps, ramp, chirp, constant"


def test_machines_in_two_namespaces_do_not_hear_each_other(stranger):
    """All topics are relative; /diagnostics is shared, and names the machine."""
    for name in ("press", "mill"):
        stranger.start(TwinNode, namespace=name, model="physics")
    stranger.listen("press/prediction", "mill/prediction", "/diagnostics")
    stranger.send("press/experiment", experiment(1))
    stranger.until(lambda: stranger.numbers("press/prediction") == [1])
    stranger.spin(0.2)
    assert stranger.numbers("mill/prediction") == []
    stranger.until(lambda: stranger.health("press/twin") and stranger.health("mill/twin"))
    assert stranger.node.count_publishers("/prediction") == 0


def test_simulated_time_does_not_stop_a_node(stranger):
    """Nothing here waits for a /clock that nobody sends."""
    stranger.listen("/diagnostics")
    stranger.start(DetectorNode, use_sim_time=True)
    stranger.until(lambda: stranger.health("detector"))
