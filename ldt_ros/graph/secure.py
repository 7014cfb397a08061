"""`ldt up --secure`: each process in its enclave, enforced by the middleware, or no start at all.

ROS 2 has a second strategy, Permissive, under which a process without an enclave runs open and says
nothing of it. It is never used.
"""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from ldt_core.base.errors import BadInput
from ldt_core.security.keystore import check_keystore
from ldt_core.security.permissions import enclave_name
from ldt_ros.graph.environment import ros_message
from ldt_ros.graph.middleware_trials import trial

ENABLE, STRATEGY = "ROS_SECURITY_ENABLE", "ROS_SECURITY_STRATEGY"
KEYSTORE, OVERRIDE = "ROS_SECURITY_KEYSTORE", "ROS_SECURITY_ENCLAVE_OVERRIDE"
ENFORCED = {ENABLE: "true", STRATEGY: "Enforce"}
MONITOR = enclave_name("monitor", "")  # the launching process's own
NOT_BUILT_IN = "doesn't have the security libraries"  # what Fast DDS says of itself
TRIAL_TIMEOUT = 20.0  # s for the trial; it takes 2


def secured(
    settings: Mapping[str, Any], roles: Iterable[str], environment: Mapping[str, str]
) -> dict[str, str]:
    """The environment of a graph's processes; this process's own is brought to the same.

    Raises:
        BadInput: secured it cannot run, or open it would although the environment asks for more;
            one sentence that says why.
    """
    if not settings["secure"]:
        _refuse_permissive(environment)
        return dict(environment)
    if settings["machines"] > 1:
        expected = "one machine a graph (a process has one enclave): one --namespace each"
        raise BadInput("--secure", expected, f"{settings['machines']} machines")
    names = [enclave_name(role, settings["namespace"]) for role in roles]
    domain = int(environment.get("ROS_DOMAIN_ID") or 0)
    keystore = check_keystore(settings["secure"], [*names, MONITOR], domain)
    children = {**environment, **ENFORCED, KEYSTORE: str(keystore)}
    children.pop(OVERRIDE, None)  # it would put all into one enclave
    own = {**children, OVERRIDE: MONITOR}
    if reason := unable(own):
        expected = "a middleware that enforces DDS-Security; nothing has been started"
        raise BadInput("--secure", expected, reason)
    os.environ.update(own)
    return children


def enclave_arguments(settings: Mapping[str, Any], namespace: str, role: str) -> list[str]:
    """What puts a role's process into its enclave, after `--ros-args`."""
    return ["--enclave", enclave_name(role, namespace)] if settings["secure"] else []


def unable(environment: Mapping[str, str], patience: float = TRIAL_TIMEOUT) -> str:
    """Why a process of this environment would not be protected; "" where it is.

    It is tried, in a process of its own: one participant in the enclave, and one without security,
    which must not see the first.
    """
    with trial("enclave", environment=environment) as done:
        try:
            output, _ = done.communicate(timeout=patience)
        except subprocess.TimeoutExpired:
            return f"no answer within {patience:g} s"
    try:
        told = json.loads(output.strip().splitlines()[-1])
    except (ValueError, IndexError):
        return f"a trial that ended with code {done.returncode}"
    if NOT_BUILT_IN in told["failure"]:
        return "a Fast DDS that is built without it"
    if told["failure"]:
        return ros_message(told["failure"])
    if told["seen"]:
        return f"{told['rmw']}, in which a participant without a key sees one that has one"
    return ""


def _refuse_permissive(environment: Mapping[str, str]) -> None:
    asked = environment.get(ENABLE, "").lower() == "true"
    if asked and environment.get(STRATEGY) != ENFORCED[STRATEGY]:
        expected = f"{STRATEGY}=Enforce with it, ldt up --secure, or that it is not set"
        got = "the strategy Permissive, under which what has no enclave runs open"
        raise BadInput(ENABLE, expected, got)


def has_security(library: Path | str | None) -> bool:
    """Whether a Fast DDS library has been built with DDS-Security."""
    return library is not None and b"dds.sec.auth" in Path(library).read_bytes()
