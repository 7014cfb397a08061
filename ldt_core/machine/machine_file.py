"""The machine file: what is known of a machine beforehand (CONTRACT, "Machine file")."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np
import yaml

import msgs_config
from ldt_core.base.errors import (
    ArgumentTypeError,
    ExperimentError,
    MachineFileError,
    OptionError,
    described,
    did_you_mean,
)
from ldt_core.physics import PHYSICS

if TYPE_CHECKING:
    from ldt_core.base.experiment import Experiment
    from ldt_core.physics.base import Physics

REQUIRED = ("name", "physics", "parameters", "limits", "experiment")
OPTIONAL = ("simulation", "calibration")
MAX_BYTES = 1_000_000  # a machine file is a page of text; more is a mistake or an attack
VOLTAGE_SLACK = 1e-6  # of the range: measured voltages are rounded when they are written to text


@dataclass(frozen=True, init=False, repr=False)
class Machine:
    """A machine as the twin knows it.

    `Machine("rotor")` reads one that ships with LDT, `Machine("my_motor.yaml")` a machine file, and
    a mapping stands for the keys of such a file. Attributes are read-only.

    Args:
        name: of the machine.
        physics: name in the physics registry.
        parameters: name → value in SI units, complete for that physics.
        voltage_limits: (lowest, highest) [V].
        duration: of an experiment [s].
        sample_period: [s].
        simulation: how the simulated machine is excited and worn (see `ldt_core.machine`).
        calibration: how `ldt calibrate` found the parameters, verbatim; empty when it did not.
        source: the file it came from, for messages.

    Raises:
        MachineFileError: as `load_machine`.
        ArgumentTypeError: neither a name nor a file nor the keys of one.
    """

    name: str
    physics: str
    parameters: Mapping[str, float]
    voltage_limits: tuple[float, float]
    duration: float
    sample_period: float
    simulation: Mapping[str, Any] = field(default_factory=dict)
    calibration: Mapping[str, Any] = field(default_factory=dict)
    source: str = "machine"

    @overload
    def __init__(self, file: str | os.PathLike[str] | Mapping[str, Any] | Machine, /) -> None: ...
    @overload
    def __init__(
        self,
        *,
        name: str,
        physics: str,
        parameters: Mapping[str, float],
        voltage_limits: tuple[float, float],
        duration: float,
        sample_period: float,
        simulation: Mapping[str, Any] = ...,
        calibration: Mapping[str, Any] = ...,
        source: str = ...,
    ) -> None: ...
    def __init__(self, *file: Any, **fields: Any) -> None:
        if file or not fields:
            fields = vars(_machine_of(*file, **fields))
        optional = {"simulation": {}, "calibration": {}, "source": "machine"}
        vars(self).update({**optional, **fields})

    def __repr__(self) -> str:
        count, period = self.samples, self.sample_period
        return f"Machine({self.name!r}, {self.physics}, {count} samples at {period:g} s)"

    @property
    def model(self) -> Physics:
        """The equations of this machine."""
        return PHYSICS.get(self.physics)

    @property
    def tolerances(self) -> dict[str, float]:
        """Relative standard deviation of each parameter; those that are missing are exact."""
        return dict(self.model.tolerances)

    @property
    def samples(self) -> int:
        """Samples of an experiment, L."""
        return round(self.duration / self.sample_period)

    def with_parameters(self, **values: float) -> Machine:
        """The same machine with other parameter values.

        Raises:
            MachineFileError: an unknown name or a value outside its bounds.
        """
        merged = {**self.parameters, **values}
        return replace(self, parameters=_parameters(self.source, self.model, merged))

    def check(self, experiment: Experiment) -> None:
        """Refuse (ExperimentError) a voltage outside the machine's limits."""
        low, high = self.voltage_limits
        slack = VOLTAGE_SLACK * (high - low)
        outside = (experiment.voltage < low - slack) | (experiment.voltage > high + slack)
        if outside.any():
            at = int(np.argmax(outside))
            raise ExperimentError(
                f"experiment {experiment.number}, voltage",
                f"{low:g} to {high:g} V (limits of machine {self.name!r})",
                f"{experiment.voltage[at]:g} V at sample {at} ({int(outside.sum())} in all)",
            )

    def may_have_made(self, experiment: Experiment) -> bool:
        """Whether `check` lets the experiment pass."""
        try:
            self.check(experiment)
        except ExperimentError:
            return False
        return True

    def as_dict(self) -> dict[str, Any]:
        """The machine file's keys, ready for YAML or JSON."""
        record = {
            "name": self.name,
            "physics": self.physics,
            "parameters": dict(self.parameters),
            "limits": {"voltage": list(self.voltage_limits)},
            "experiment": {"duration": self.duration, "sample_period": self.sample_period},
        }
        if self.simulation:
            record["simulation"] = dict(self.simulation)
        if self.calibration:
            record["calibration"] = dict(self.calibration)
        return record


def _machine_of(given: object) -> Machine:
    if isinstance(given, Machine):
        return given
    if isinstance(given, Mapping):
        return machine_from_dict(given, "machine")
    if isinstance(given, str | os.PathLike):
        return load_machine(given if isinstance(given, str) else Path(given))
    expected = "a Machine, the name of one such as 'rotor', or a machine file"
    raise ArgumentTypeError("machine", expected, described(given))


def load_machine(file: str | Path) -> Machine:
    """Read a machine file, or one that ships with LDT by its bare name ("rotor").

    Raises:
        MachineFileError: the file is missing, is no YAML, or has a wrong key, type or value.
    """
    path = Path(file)
    if not path.exists() and path.suffix == "" and path.parent == Path("."):
        shipped = msgs_config.machine_names()
        if str(file) not in shipped:
            raise MachineFileError(
                "machine", f"a file or {did_you_mean(str(file), shipped)}", f"{str(file)!r}"
            )
        return parse_machine(msgs_config.machine_text(str(file)), f"{file}.yaml")
    try:
        if path.stat().st_size > MAX_BYTES:
            raise MachineFileError(path, f"at most {MAX_BYTES} bytes", path.stat().st_size)
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "text that is not UTF-8"
        raise MachineFileError(path, "a readable machine file", reason) from error
    return parse_machine(text, str(path))


def parse_machine(text: str, source: str) -> Machine:
    """A machine from the text of a machine file; `source` is what messages call it."""
    try:
        data = yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        line = f"line {mark.line + 1}: " if mark else ""
        got = line + (getattr(error, "problem", None) or type(error).__name__)
        raise MachineFileError(source, "YAML", got) from error
    return machine_from_dict(data, source)


def machine_from_dict(data: Any, source: str) -> Machine:
    """A machine from the keys of a machine file."""
    top = mapping_of(source, data)
    check_keys(source, top, REQUIRED, OPTIONAL)
    name = top["name"]
    if not isinstance(name, str) or not name:
        raise MachineFileError(f"{source}, name", "a name", repr(name))
    try:
        physics = PHYSICS.get(top["physics"] if isinstance(top["physics"], str) else "?")
    except OptionError as error:
        raise MachineFileError(f"{source}, physics", error.expected, repr(top["physics"])) from None
    limits = mapping_of(f"{source}, limits", top["limits"])
    check_keys(f"{source}, limits", limits, ("voltage",), ())
    experiment = mapping_of(f"{source}, experiment", top["experiment"])
    check_keys(f"{source}, experiment", experiment, ("duration", "sample_period"), ())
    duration = _positive(f"{source}, experiment.duration", experiment["duration"])
    period = _positive(f"{source}, experiment.sample_period", experiment["sample_period"])
    if round(duration / period) < 2:
        raise MachineFileError(
            f"{source}, experiment.duration", f"two sample periods ({period:g} s) or more", duration
        )
    return Machine(
        name=name,
        physics=top["physics"],
        parameters=_parameters(
            source, physics, mapping_of(f"{source}, parameters", top["parameters"])
        ),
        voltage_limits=_limits(f"{source}, limits.voltage", limits["voltage"]),
        duration=duration,
        sample_period=period,
        simulation=mapping_of(f"{source}, simulation", top.get("simulation") or {}),
        calibration=mapping_of(f"{source}, calibration", top.get("calibration") or {}),
        source=source,
    )


def mapping_of(where: str, value: Any) -> dict[str, Any]:
    """A section of a machine file; a MachineFileError where it is no names with values."""
    if not isinstance(value, Mapping) or not all(isinstance(k, str) for k in value):
        raise MachineFileError(where, "names with values (a YAML mapping)", described(value))
    return dict(value)


def check_keys(
    where: str, data: Mapping[str, Any], required: tuple[str, ...], optional: tuple[str, ...]
) -> None:
    """Refuse a section that lacks a key, or has one that nobody knows (MachineFileError)."""
    for key in required:
        if key not in data:
            raise MachineFileError(where, f"the key {key!r}", f"only {sorted(data)}")
    for key in data:
        if key not in required + optional:
            raise MachineFileError(
                where, did_you_mean(key, required + optional), f"unknown key {key!r}"
            )


def real_number(where: str, value: Any) -> float:
    """A finite number; YAML 1.1 reads 1e-3 as text, which people write all the same."""
    if isinstance(value, str):
        try:
            value = float(value)
        except ValueError:
            raise MachineFileError(where, "a number in SI units", described(value)) from None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise MachineFileError(where, "a number in SI units", described(value))
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise MachineFileError(where, "a finite number", described(value))
    return number


def _positive(where: str, value: Any) -> float:
    number = real_number(where, value)
    if number <= 0:
        raise MachineFileError(where, "seconds above 0", number)
    return number


def _limits(where: str, value: Any) -> tuple[float, float]:
    if not isinstance(value, list) or len(value) != 2:
        raise MachineFileError(where, "[lowest, highest] in V", described(value))
    low, high = real_number(where, value[0]), real_number(where, value[1])
    if low >= high:
        raise MachineFileError(where, "[lowest, highest] in V", described(value))
    return low, high


def _parameters(source: str, physics: Physics, values: Mapping[str, Any]) -> dict[str, float]:
    where = f"{source}, parameters"
    known = {p.name: p for p in physics.parameters}
    needed = tuple(n for n, p in known.items() if p.default is None)
    check_keys(where, values, needed, tuple(n for n in known if n not in needed))
    result = {}
    for name, parameter in known.items():
        value = real_number(f"{where}.{name}", values.get(name, parameter.default))
        if not parameter.accepts(value):
            raise MachineFileError(f"{where}.{name}", parameter.range, f"{value:g}")
        result[name] = value
    return result
