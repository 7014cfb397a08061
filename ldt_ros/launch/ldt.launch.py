"""The node graph for a full ROS 2 installation.

    ros2 launch ldt ldt.launch.py machine:=press.yaml model:=linear experiments:=40

Every declared parameter is a launch argument of the same name; lists are written as in YAML,
`gp_inputs:="[speed, voltage]"`, and a single entry as itself. The launch ends when the source of
the experiments has no more of them, or when any node ends.
"""

from collections.abc import Mapping
from typing import Any

import yaml
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

import msgs_config
from ldt_core.recording.run_settings import settings_text
from ldt_core.runs.fleet_members import new_recording, roles

_FOR_UP_ALONE = ("graph", "machines", "processes", "run_settings", "secure")


def _parameters() -> dict[str, Any]:
    return {n: d for n, d in msgs_config.parameters().items() if n not in _FOR_UP_ALONE}


def _value(text: str, declaration: Mapping[str, Any]) -> Any:
    """What the text means; the nodes check it, and say what is wrong with it."""
    kind = declaration["type"]
    if kind == "string" or (kind == "string_array" and text and not text.startswith("[")):
        return text
    return yaml.safe_load(text)


def _text(default: Any) -> str:
    if isinstance(default, str):
        return default
    return str(yaml.safe_dump(default, default_flow_style=True))


def _nodes(context: LaunchContext) -> list[Node]:
    values = {
        name: _value(LaunchConfiguration(name).perform(context), declaration)
        for name, declaration in _parameters().items()
    }
    values["graph"] = roles(values)
    values["bag"] = values["resume"] or values["bag"] or str(new_recording(values["machine"]))
    # An empty list has no type in a parameter file; the declared default is empty as well.
    given = {name: value for name, value in values.items() if value not in ([], None)}
    given["run_settings"] = settings_text(given)
    return [
        Node(
            package="ldt",
            executable=f"ldt_{role}",
            namespace=values["namespace"],
            parameters=[given],
            output="screen",
            on_exit=[Shutdown(reason=f"{role} has ended")],
        )
        for role in values["graph"]
    ]


def generate_launch_description() -> LaunchDescription:
    """All nodes of one machine."""
    arguments = [
        DeclareLaunchArgument(
            name,
            default_value=_text(declaration["default"]).removesuffix("\n...\n").strip(),
            description=declaration["description"],
        )
        for name, declaration in _parameters().items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=_nodes)])
