"""Messages, QoS profiles and ROS parameters, made from the declarations in `msgs_config`."""

from __future__ import annotations

from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    ParameterType,
)
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64MultiArray, String

import msgs_config
from ldt_core.settings import resolve

MESSAGES = {
    "std_msgs/msg/Float64MultiArray": Float64MultiArray,
    "std_msgs/msg/String": String,
    "diagnostic_msgs/msg/DiagnosticArray": DiagnosticArray,
}
_TYPES = {
    "bool": ParameterType.PARAMETER_BOOL,
    "integer": ParameterType.PARAMETER_INTEGER,
    "double": ParameterType.PARAMETER_DOUBLE,
    "string": ParameterType.PARAMETER_STRING,
    "string_array": ParameterType.PARAMETER_STRING_ARRAY,
}


def message_type(topic: str) -> type:
    """Message class of a declared topic."""
    return MESSAGES[msgs_config.topics()[topic]["type"]]


def qos(topic: str) -> QoSProfile:
    """QoS profile of a declared topic."""
    profile = msgs_config.qos_profiles()[msgs_config.topics()[topic]["qos"]]
    return QoSProfile(
        reliability=ReliabilityPolicy[profile["reliability"].upper()],
        durability=DurabilityPolicy[profile["durability"].upper()],
        history=HistoryPolicy[profile["history"].upper()],
        depth=profile["depth"],
    )


def declare(node: Node, *groups: str) -> dict[str, Any]:
    """Declare the parameters of the groups on a node and return their checked values.

    They are read-only: a run's numbers follow from the parameters that its recording begins with.

    Raises:
        OptionError: a value outside its declared type, range or choices.
    """
    values = {}
    for name, declaration in msgs_config.parameters(*groups).items():
        default = declaration["default"]
        descriptor = _descriptor(declaration)
        value = node.declare_parameter(name, default, descriptor).value
        values[name] = default if value is None else value
    return resolve({n: list(v) if _is_array(v) else v for n, v in values.items()}, *groups)


def _is_array(value: Any) -> bool:
    return not isinstance(value, str) and hasattr(value, "__iter__")


def _descriptor(declaration: dict[str, Any]) -> ParameterDescriptor:
    unit = declaration.get("unit", "")
    descriptor = ParameterDescriptor(
        description=declaration["description"] + (f" [{unit}]" if unit else ""),
        type=_TYPES[declaration["type"]],
        read_only=True,
        # A string array of no entries arrives from a parameter file without a type.
        dynamic_typing=declaration["type"] == "string_array",
    )
    choices = [c for c in declaration.get("choices", ()) if c]
    if choices:
        descriptor.additional_constraints = "one of " + ", ".join(choices)
    if "range" in declaration:
        low, high = declaration["range"]
        if declaration["type"] == "integer":
            descriptor.integer_range = [IntegerRange(from_value=low, to_value=high, step=0)]
        else:
            descriptor.floating_point_range = [
                FloatingPointRange(from_value=float(low), to_value=float(high), step=0.0)
            ]
    return descriptor
