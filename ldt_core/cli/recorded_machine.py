"""Which machine file goes with the recordings that a command is given."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import click
from click.core import ParameterSource

import msgs_config
from ldt_core.base.errors import BadInput, LdtError
from ldt_core.base.printable import as_argument
from ldt_core.cli.terminal import warn


def machine_of(machine: str, recordings: Iterable[str], namespace: str) -> str:
    """The machine file of recordings: the one given, or else the one that they name.

    A file of another machine shows in nothing else than large errors. So it is refused where a
    machine that ships with LDT is one of the two, and told of where both are the user's. A file
    that a recording merely names is not looked for: nothing that was recorded is followed.

    Args:
        machine: value of --machine.
        recordings: folders or files; those that cannot be read are left to the command.
        namespace: whose topics are meant.

    Raises:
        MachineFileError: a file is given that cannot be read.
        BadInput: it is of another machine than a recording, or no file is given and a recording
            does not say its machine or one that does not ship with LDT.
    """
    for recording in recordings:
        if Path(recording).name == "metadata.yaml":
            raise BadInput(recording, f"the recording's folder, {Path(recording).parent}", "a file")
        if recording.endswith((".yaml", ".yml")):
            told = f"a recording; a machine file follows --machine, as in: --machine {recording}"
            raise BadInput(recording, told, "a machine file")
    named = {recording: recorded_machine(recording, namespace) for recording in recordings}
    if named and not given("machine"):
        recording, there = next(iter(named.items()))
        if there in msgs_config.machine_names():
            machine = there
        elif there:
            raise BadInput("--machine", f"the file of {_of(there, recording)}", "none")
        elif there is not None:
            made = f"ldt identify {as_argument(recording)} --out FILE.yaml makes one"
            told = f"a machine file, since {recording} does not say of which machine it is ({made})"
            raise BadInput("--machine", told, "none")
    if not any(named.values()):
        return machine
    from ldt_core.machine.machine_file import load_machine

    here, shipped = load_machine(machine).name, msgs_config.machine_names()
    for recording, there in named.items():
        if not there or there == here:
            continue
        if there not in shipped and here not in shipped:  # an own file may have got a better name
            warn(f"{recording}: recorded of the machine {there!r}, while the file is of {here!r}")
            continue
        other = f"write `name: {there}` into the file if it is the same machine"
        if there in shipped and given("machine"):
            other = f"leave --machine out, or {other}"
        raise BadInput("--machine", f"the file of {_of(there, recording)} ({other})", repr(here))
    return machine


def given(name: str) -> bool:
    """Whether a parameter comes from the command line or a file of settings."""
    context = click.get_current_context(silent=True)
    source = context.get_parameter_source(name) if context else None
    return source is not None and source is not ParameterSource.DEFAULT


def recorded_machine(recording: str, namespace: str) -> str | None:
    """Name of a recording's machine; "" where it does not say, None where it cannot be read."""
    from ldt_core.recording.bag import read_bag

    try:
        return read_bag(recording, namespace, listed=True).machine
    except (LdtError, OSError):
        return None


def _of(machine: str, recording: str) -> str:
    return f"{machine!r}, of which {recording} was recorded"
