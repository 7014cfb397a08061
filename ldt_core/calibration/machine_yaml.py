"""The text of a machine file that was found from data: complete, with units, readable again."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from ldt_core.base import result_files
from ldt_core.base.errors import OptionError
from ldt_core.base.plain_yaml import PlainDumper
from ldt_core.base.sentences import counted
from ldt_core.calibration.calibration import Calibration
from ldt_core.calibration.identify import EquivalentMotor
from ldt_core.machine.machine_file import Machine
from ldt_core.physics.parameter import own_name

COMMENT_COLUMN = 16  # at which the comments on parameters begin


def write_machine_file(
    found: Calibration | EquivalentMotor, file: str | Path, force: bool = False
) -> None:
    """Write the machine that was found, whole or not at all.

    Args:
        found: by a calibration or an identification.
        file: where to; the folder must exist.
        force: overwrite what is there.

    Raises:
        OptionError: the file exists and is not to be overwritten, or its folder does not exist.
        OSError: it cannot be written.
    """
    check_new(file, force)
    text = machine_file_text(found) if isinstance(found, Calibration) else equivalent_text(found)
    result_files.write(Path(file), text)


def check_new(file: str | Path, force: bool) -> None:
    """Refuse a file that exists or cannot be made, as `write_machine_file` would."""
    result_files.check_target(file)
    if Path(file).exists() and not force:
        expected = "a new file, or --force to overwrite it"
        raise OptionError("--out", expected, f"{file}, which exists")


def machine_file_text(calibration: Calibration) -> str:
    """The machine file as YAML with a comment on each parameter."""
    machine = calibration.machine
    after = calibration.errors["fit"][1]
    head = [
        f"Machine {machine.name!r}, calibrated from {_measured(calibration)} by `ldt calibrate`",
        f"(free-run error {after.rmse:.4g} rad/s); how far to trust each value is under "
        "`calibration`. SI units.",
    ]
    estimates = {e.name: e for e in calibration.estimates}
    comments = {}
    withheld = calibration.lacking != []
    for p in machine.model.parameters:
        comments[p.name] = f"{p.unit}, {p.description}".strip(", ")
        if p.name in estimates and withheld:
            comments[p.name] += "; calibrated, without interval: the physics lacks something"
        elif p.name in estimates:
            ci95 = estimates[p.name].ci95
            comments[p.name] += (
                "; not determined by itself"
                if ci95 is None
                else f"; calibrated, 95 % within {ci95[0]:.4g} to {ci95[1]:.4g}"
            )
    return _text(machine, head, comments, calibration.as_dict())


def equivalent_text(found: EquivalentMotor) -> str:
    """The machine file of an equivalent motor as YAML, with what its values mean."""
    machine, form = found.machine, found.form
    head = [
        f"Machine {machine.name!r}, identified from {_measured(found)} by `ldt identify`",
        f"(free-run error {found.errors['fit'].rmse:.4g} rad/s): a motor that answers the voltage "
        "as that machine does.",
        f"Measured are its gain, {form.gain:.5g} rad/s per V, and "
        f"{'its time constant' if form.order == 1 else 'tau_m and tau_e'}, "
        f"{' and '.join(f'{t:.4g}' for t in (form.tau_m, form.tau_e)[: form.order])} s.",
        "R and b are convention: torques and currents are on the scale of this motor, not of the",
        "machine, and only their ratios count. SI units.",
    ]
    comments = {
        "J": "kg m^2, tau_m K_t^2 / R",
        "K_t": "N m/A, 1 / gain",
        "R": "Ohm, by convention",
        "L": "H, R tau_e" + (", which no sample shows" if form.order == 1 else ""),
        "b": "N m s, by convention",
    }
    return _text(machine, head, comments, found.as_dict())


def _measured(found: Calibration | EquivalentMotor) -> str:
    return counted(len(found.experiments["fit"]), "measured experiment")


def _text(
    machine: Machine, head: list[str], comments: Mapping[str, str], record: dict[str, Any]
) -> str:
    stated = machine.as_dict()
    entries = {name: f"  {name}: {_flow(value)}" for name, value in stated["parameters"].items()}
    lines = [
        *(f"# {line}" for line in head),
        *_entries({"name": machine.name, "physics": machine.physics}),
        "parameters:",
        *(f"{entry:<{COMMENT_COLUMN}}  # {comments[name]}" for name, entry in entries.items()),
        *_entries({k: v for k, v in stated.items() if k == "own_effects"}),
        *_effects(stated.get("effects", []), comments),
        "limits:",
        f"  voltage: {_flow(list(machine.voltage_limits))}    # V",
        "experiment:",
        f"  duration: {_flow(machine.duration)}          # s",
        f"  sample_period: {_flow(machine.sample_period)}   # s",
    ]
    if machine.simulation:
        lines.append("simulation:             # how the simulated machine is excited and worn")
        lines += [f"  {line}" for line in _entries(machine.simulation)]
    lines += ["calibration:", *(f"  {line}" for line in _calibration(record))]
    return "\n".join(lines) + "\n"


def _effects(effects: list[dict[str, Any]], comments: Mapping[str, str]) -> list[str]:
    lines = ["effects:                # known to act on this machine"] if effects else []
    for effect in effects:
        lines += [f"- name: {effect['name']}", "  parameters:"]
        for name, value in effect["parameters"].items():
            comment = comments.get(own_name(effect["name"], name), "")
            lines.append(f"    {name}: {_flow(value)}  # {comment}".rstrip(" #"))
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
    style = {"default_flow_style": True, "sort_keys": False, "allow_unicode": True}
    text: str = yaml.dump(value, Dumper=PlainDumper, width=10**9, **style)
    return text.removesuffix("\n").removesuffix("\n...")
