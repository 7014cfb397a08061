"""The messages that LDT sends are the standard ones, and no others are loaded for them."""

from __future__ import annotations

import subprocess
import sys

import pytest
from rosbags.typesys import Stores, get_typestore

import msgs_config
from ldt_core.recording.messages import DIAGNOSTICS, MULTI_ARRAY, STRING, schema, typestore

ODOMETRY = "nav_msgs/msg/Odometry"


@pytest.mark.parametrize("kind", msgs_config.messages())
def test_a_message_is_declared_as_ros_declares_it(kind):
    """Definition, hash and constants, by the library's own tables of Jazzy."""
    jazzy = get_typestore(Stores.ROS2_JAZZY)
    assert typestore(kind).fielddefs[kind] == jazzy.fielddefs[kind]
    assert schema(kind) == (
        jazzy.generate_msgdef(kind, ros_version=2)[0],
        jazzy.hash_rihs01(kind),
    )


def test_every_declared_topic_has_a_declared_message():
    """Whoever reads a recording of LDT needs none of the others."""
    kinds = {topic["type"] for topic in msgs_config.topics().values()}
    assert {MULTI_ARRAY, STRING, DIAGNOSTICS} <= kinds <= set(msgs_config.messages())


def test_all_others_are_loaded_when_one_is_asked_for():
    """They take as long as everything else that reading a recording needs."""
    assert ODOMETRY in typestore(ODOMETRY).fielddefs
    use = (
        "import sys; from ldt_core.recording.messages import schema, standard;"
        f"standard(); schema({DIAGNOSTICS!r});"
        "loaded = 'rosbags.typesys.stores.ros2_jazzy' in sys.modules;"
        f"schema({ODOMETRY!r});"
        "print(loaded, 'rosbags.typesys.stores.ros2_jazzy' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", use], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "True"]
