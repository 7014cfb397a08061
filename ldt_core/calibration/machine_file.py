"""The text of a calibrated machine file: complete, with units, readable by `load_machine`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import yaml

from ldt_core.calibration.result import Calibration
from ldt_core.errors import OptionError
from ldt_core.machine import Machine

COMMENT = 16  # column at which the comments begin


def write_machine_file(calibration: Calibration, file: str | Path, force: bool = False) -> None:
    """Write the calibrated machine.

    Args:
        calibration: its machine goes into the file.
        file: where to; the folder must exist.
        force: overwrite what is there.

    Raises:
        OptionError: the file exists and is not to be overwritten, or its folder does not exist.
        OSError: it cannot be written.
    """
    path = Path(file)
    check_target(path, force)
    draft = path.with_name(f".{path.name}.part")
    draft.write_text(machine_text(calibration), encoding="utf-8")
    os.replace(draft, path)  # whole or not at all


def check_target(path: str | Path, force: bool, option: str = "--out") -> None:
    """Refuse a file that exists or cannot be made, before any work is done.

    Raises:
        OptionError: as `write_machine_file`.
    """
    path = Path(path)
    if path.is_dir():
        raise OptionError(option, "a file", f"the folder {path}")
    if path.exists() and not force:
        raise OptionError(option, "a new file, or --force to overwrite it", f"{path}, which exists")
    if not path.parent.is_dir():
        raise OptionError(option, "a file in a folder that exists", str(path))


def machine_text(calibration: Calibration) -> str:
    """The machine file as YAML with a comment on each parameter."""
    machine = calibration.machine
    after = calibration.errors["fit"][1]
    count = len(calibration.experiments["fit"])
    measured = f"{count} measured experiment{'s' if count > 1 else ''}"
    lines = [
        f"# Machine {machine.name!r}, calibrated from {measured} by `ldt calibrate`",
        f"# (free-run error {after.rmse:.4g} rad/s); how far to trust each value is under "
        "`calibration`. SI units.",
        *_entries({"name": machine.name, "physics": machine.physics}),
        "parameters:",
        *_parameters(calibration, machine),
        "limits:",
        f"  voltage: {_flow(list(machine.voltage_limits))}    # V",
        "experiment:",
        f"  duration: {_flow(machine.duration)}          # s",
        f"  sample_period: {_flow(machine.sample_period)}   # s",
    ]
    if machine.simulation:
        lines.append("simulation:             # how the simulated machine is excited and worn")
        lines += [f"  {line}" for line in _entries(machine.simulation)]
    lines += ["calibration:", *(f"  {line}" for line in _calibration(calibration.as_dict()))]
    return "\n".join(lines) + "\n"


def _parameters(calibration: Calibration, machine: Machine) -> list[str]:
    estimates = {e.name: e for e in calibration.estimates}
    lines = []
    for parameter in machine.model.parameters:
        name = parameter.name
        entry = f"  {name}: {_flow(machine.parameters[name])}"
        comment = f"{parameter.unit}, {parameter.description}".strip(", ")
        if name in estimates and estimates[name].ci95 is not None:
            low, high = estimates[name].ci95 or (0.0, 0.0)
            comment += f"; calibrated, 95 % within {low:.4g} to {high:.4g}"
        elif name in estimates:
            comment += "; not determined by itself"
        lines.append(f"{entry:<{COMMENT}}  # {comment}")
    return lines


def _calibration(record: dict[str, Any]) -> list[str]:
    lines = []
    for key, value in record.items():
        if key == "free":
            lines += ["free:", *(f"  {line}" for line in _entries(value))]
        elif key == "notes":
            lines += ["notes:" if value else "notes: []", *(f"- {_flow(note)}" for note in value)]
        else:
            lines += _entries({key: value})
    return lines


def _entries(mapping: Any) -> list[str]:
    return [f"{_flow(key)}: {_flow(value)}" for key, value in mapping.items()]


def _flow(value: Any) -> str:
    """A value on one line of YAML."""
    text = yaml.safe_dump(
        value, default_flow_style=True, sort_keys=False, width=10**9, allow_unicode=True
    )
    return text.removesuffix("\n").removesuffix("\n...")
