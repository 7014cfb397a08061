"""The node graph for a full ROS 2 installation: `ros2 launch ldt ldt.launch.py model:=linear`.

Every declared parameter is a launch argument of the same name.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, OpaqueFunction, RegisterEventHandler
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

import msgs_config
from ldt_core.session import new_recording

_FOR_UP_ALONE = ("graph", "machines")


def _given(context, name, declaration):
    text = LaunchConfiguration(name).perform(context)
    if declaration["type"] == "string_array":
        return [word for word in text.split(",") if word]
    casts = {"bool": lambda t: t.lower() == "true", "integer": int, "double": float, "string": str}
    return casts[declaration["type"]](text)


def _nodes(context):
    values = {
        name: _given(context, name, declaration)
        for name, declaration in msgs_config.parameters().items()
        if name not in _FOR_UP_ALONE
    }
    source = "player" if values["play"] else "plant"
    roles = ["recorder", "adaptor", "detector", "twin", source]
    values["graph"] = roles
    values["bag"] = values["bag"] or str(new_recording(values["machine"]))
    # An empty list has no type in a parameter file; the declared default is empty as well.
    given = {n: v for n, v in values.items() if v != []}
    nodes = [
        Node(
            package="ldt",
            executable=f"ldt_{role}",
            namespace=values["namespace"],
            parameters=[given],
            output="screen",
        )
        for role in roles
    ]
    end = RegisterEventHandler(
        OnProcessExit(target_action=nodes[-1], on_exit=[EmitEvent(event=Shutdown())])
    )
    return [*nodes, end]


def generate_launch_description():
    """All nodes of one machine."""
    arguments = [
        DeclareLaunchArgument(
            name,
            default_value=",".join(d["default"])
            if d["type"] == "string_array"
            else str(d["default"]).lower()
            if d["type"] == "bool"
            else str(d["default"]),
            description=d["description"],
        )
        for name, d in msgs_config.parameters().items()
        if name not in _FOR_UP_ALONE
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=_nodes)])
