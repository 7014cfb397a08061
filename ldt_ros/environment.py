"""What a process needs in its environment before rclpy is imported."""

from __future__ import annotations

import importlib.util
import os
import sys
from importlib import resources
from pathlib import Path

from ldt_core.errors import BadInput

#: How the ROS 2 wheels mark an interpreter that they have prepared; it must not be inherited by
#: another environment's Python.
WHEEL_MARK = "_ROS_WHEELS_BOOTSTRAP_COMPLETE"


def require_ros() -> None:
    """Refuse to go on where there is no rclpy.

    Raises:
        BadInput: no ROS 2 in this Python.
    """
    if importlib.util.find_spec("rclpy") is None:
        raise BadInput(
            "ldt up",
            "ROS 2 Jazzy in this Python (pip install 'ldt[ros]', or source a ROS 2 workspace)",
            "no module rclpy; `ldt run` does the same without ROS",
        )


def prepare(log_folder: Path | str | None = None) -> dict[str, str]:
    """Set what is missing in this process's environment, for itself and its children.

    What the user has set stays. Without a DDS profile of the user's, ours is taken: UDP on the
    loopback interface only, so that nothing leaves the machine, no shared-memory file is left
    behind, and a killed peer is noticed within seconds.
    """
    wanted = {
        # Our own profile whitelists 127.0.0.1; LOCALHOST would put other transports in its place.
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
        "FASTRTPS_DEFAULT_PROFILES_FILE": str(resources.files("msgs_config") / "fastdds.xml"),
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
        "AMENT_PREFIX_PATH": sys.prefix,  # the wheels do not set it
        # One thread per process: results are bit-equal then, and the nodes share the cores anyway.
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }
    if log_folder is not None:
        wanted["ROS_LOG_DIR"] = str(log_folder)
    if "FASTDDS_DEFAULT_PROFILES_FILE" in os.environ:
        del wanted["FASTRTPS_DEFAULT_PROFILES_FILE"]
    for name, value in wanted.items():
        os.environ.setdefault(name, value)
    return dict(os.environ)
