"""The machine file: what is known of a machine beforehand (CONTRACT, "Machine file")."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import msgs_config
from ldt_core.base.bounded_file import nothing_there, read_bounded
from ldt_core.base.errors import (
    ArgumentTypeError,
    ExperimentError,
    MachineFileError,
    OptionError,
    described,
    did_you_mean,
    reason_of,
)
from ldt_core.base.plain_yaml import NO_YAML, load_yaml
from ldt_core.effects import EFFECTS, get_effect
from ldt_core.machine.experiment_limits import (
    MOST_SAMPLES,
    Declared,
    refuse_impossible,
    refuse_too_fast,
)
from ldt_core.machine.file_values import (
    check_keys,
    mapping_of,
    own_effects,
    real_number,
    stated_effects,
    stated_parameters,
)
from ldt_core.physics import PHYSICS
from ldt_core.physics.known_effects import PhysicsWithEffects, changed_numbers
from ldt_core.physics.own_physics import named_physics, refuse_faulty
from ldt_core.physics.parameter import own_name

if TYPE_CHECKING:
    from ldt_core.base.experiment import Experiment
    from ldt_core.physics.base import Physics
    from ldt_core.physics.effect import Effect

LONGEST_NAME = 200  # characters: it stands in every message and sentence
REQUIRED = ("name", "physics", "parameters", "limits", "experiment")
OPTIONAL = ("own_effects", "effects", "simulation", "calibration")
OTHER_CHANNELS = ("inputs", "outputs")  # of machines that are no driven shaft
MAX_BYTES = 1_000_000  # a machine file is a page of text; more is a mistake or an attack
EFFECTS_REMEMBERED = 64  # each keeps its compiled term: more than a library and a file hold


@dataclass(frozen=True, init=False, repr=False)
class Machine:
    """A machine as the twin knows it.

    `Machine("rotor")` reads one that ships with LDT, `Machine("my_motor.yaml")` a machine file, and
    a mapping stands for the keys of such a file. Attributes are read-only.

    Args:
        name: of the machine.
        physics: name in the physics registry.
        parameters: name → value in SI units, complete for that physics; those of known effects
            are named `effect.parameter`.
        voltage_limits: (lowest, highest) [V].
        duration: of an experiment [s].
        sample_period: [s].
        simulation: how the simulated machine is excited and worn (see `ldt_core.machine`).
        calibration: how `ldt calibrate` found the parameters, verbatim; empty when it did not.
        deviations: standard deviation of each parameter that the file states one of, in its unit.
        acting: names of the effects that are known to act, in their order.
        own_effects: file.py:NAME of effects that are not in the library and that this machine may
            have, whether they are known to act or not.
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
    deviations: Mapping[str, float] = field(default_factory=dict)
    acting: tuple[str, ...] = ()
    own_effects: tuple[str, ...] = ()
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
        deviations: Mapping[str, float] = ...,
        acting: tuple[str, ...] = ...,
        own_effects: tuple[str, ...] = ...,
        source: str = ...,
    ) -> None: ...
    def __init__(self, *file: Any, **fields: Any) -> None:
        if file or not fields:
            fields = vars(_machine_of(*file, **fields))
        optional = {"simulation": {}, "calibration": {}, "source": "machine"}
        optional |= {"deviations": {}, "acting": (), "own_effects": ()}
        known = {f.name for f in dataclasses.fields(self)}
        lacking = known.difference(optional, fields)
        if lacking or not fields.keys() <= known:
            expected = "Machine({...}) with the keys of a machine file, or every field"
            got = f"no {', '.join(sorted(lacking))}" if lacking else f"{sorted({*fields} - known)}"
            raise ArgumentTypeError("machine", expected, got)
        vars(self).update({**optional, **fields})

    def __repr__(self) -> str:
        length = f"{self.samples} samples at {self.sample_period:g} s"
        return f"Machine({self.name!r}, {self.physics}, {length})"

    @property
    def model(self) -> Physics:
        """The equations of this machine, with the effects that are known to act on it."""
        bare = PHYSICS.get(self.physics)
        return PhysicsWithEffects(bare, self.effects) if self.acting else bare

    @property
    def effects(self) -> tuple[tuple[Effect, Mapping[str, float]], ...]:
        """The effects that are known to act, each with all its values."""
        found = []
        for law in map(self.law, self.acting):
            known = {p.name: own_name(law.name, p.name) for p in law.all_parameters}
            own = {n: self.parameters[o] for n, o in known.items() if o in self.parameters}
            found.append((law.in_detail(own), own))  # they say in which detail it acts
        return tuple(found)

    @property
    def effect_names(self) -> list[str]:
        """Names of the library's effects and of the file's own ones."""
        return [*EFFECTS.names(), *(effect.name for effect in self.own_laws)]

    @property
    def own_laws(self) -> list[Effect]:
        """The effects of `own_effects`."""
        return [get_effect(name) for name in self.own_effects]

    def law(self, name: str) -> Effect:
        """An effect by its name, as it is defined: of the library, or one of the file's own.

        Raises:
            OptionError: nothing of that name.
        """
        return next((own for own in self.own_laws if own.name == name), None) or _effect(name)

    def effect(self, name: str) -> Effect:
        """An effect as a change of this machine: of a known one, what is known is neutral.

        Raises:
            OptionError: nothing of that name.
        """
        law = self.law(name)
        known = next((given for effect, given in self.effects if effect.name == name), None)
        return law if known is None else _about(law, tuple(known.items()))

    def possible_effects(self) -> list[Effect]:
        """The effects of the library, and its own, that it can have, as changes of it.

        Raises:
            OptionError: an installed one that cannot be loaded.
        """
        found = []
        for effect in map(self.effect, self.effect_names):
            with contextlib.suppress(OptionError):
                effect.require(self.model)
                found.append(effect)
        return found

    @property
    def tolerances(self) -> dict[str, float]:
        """Relative standard deviation of each parameter; those that are missing are exact.

        The file's, else the usual one but for what an effect changes that is not exact itself.
        """
        physics = self.model
        own = {n: s / abs(self.parameters[n]) for n, s in self.deviations.items()}
        changed = changed_numbers(physics, self.parameters, self.deviations.keys())
        return {**{n: s for n, s in physics.tolerances.items() if n not in changed}, **own}

    @property
    def samples(self) -> int:
        """Samples of an experiment, L."""
        return round(self.duration / self.sample_period)

    def with_parameters(self, **values: float) -> Machine:
        """The same machine with other parameter values.

        Raises:
            MachineFileError: an unknown name or a value outside its bounds.
        """
        stated = stated_parameters(self.source, self.model, {**self.parameters, **values})
        kept = {n: s for n, s in self.deviations.items() if stated.values[n] != 0}
        return replace(self, parameters=stated.values, deviations=kept)

    def with_deviations(self, deviations: Mapping[str, float]) -> Machine:
        """The same machine with other standard deviations, in the parameters' units."""
        return replace(self, deviations={**self.deviations, **deviations})

    def with_effects(self, acting: Sequence[tuple[Effect, Mapping[str, float]]]) -> Machine:
        """The same machine with more effects known to act; one known before gets these values.

        Raises:
            MachineFileError: an effect that no machine file can name or this machine cannot have.
        """
        record = self.as_dict()
        new = [{"name": e.name, "parameters": dict(given)} for e, given in acting]
        names = [e.name for e, _ in acting]
        record["effects"] = [e for e in record.get("effects", []) if e["name"] not in names] + new
        return machine_from_dict(record, self.source)

    def check(self, experiment: Experiment) -> None:
        """Refuse (ExperimentError) what it cannot have made, see `experiment_limits`."""
        told = self.name, self.voltage_limits, self.sample_period, self.duration, self.parameters
        refuse_impossible(Declared(*told), experiment)

    def may_have_made(self, experiment: Experiment) -> bool:
        """Whether `check` lets the experiment pass."""
        try:
            self.check(experiment)
        except ExperimentError:
            return False
        return True

    def as_dict(self) -> dict[str, Any]:
        """The machine file's keys, ready for YAML or JSON."""
        stated: dict[str, Any] = {
            n: {"value": v, "std": self.deviations[n]} if n in self.deviations else v
            for n, v in self.parameters.items()
        }
        effects = [
            {"name": e.name, "parameters": {n: stated.pop(own_name(e.name, n)) for n in given}}
            for e, given in self.effects
        ]
        record = {
            "name": self.name,
            "physics": self.physics,
            "parameters": stated,
            **({"own_effects": list(self.own_effects)} if self.own_effects else {}),
            **({"effects": effects} if effects else {}),
            "limits": {"voltage": list(self.voltage_limits)},
            "experiment": {"duration": self.duration, "sample_period": self.sample_period},
        }
        if self.simulation:
            record["simulation"] = dict(self.simulation)
        if self.calibration:
            record["calibration"] = dict(self.calibration)
        return record


@functools.lru_cache(maxsize=EFFECTS_REMEMBERED)
def _effect(name: str) -> Effect:
    return get_effect(name)


@functools.lru_cache(maxsize=EFFECTS_REMEMBERED)
def _about(effect: Effect, known: tuple[tuple[str, float], ...]) -> Effect:
    return effect.in_detail(dict(known)).about(dict(known))


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
        text = read_bounded(path, MAX_BYTES).decode()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "text that is not UTF-8"
        if isinstance(error, FileNotFoundError):
            reason = nothing_there(path)
        expected = "a readable machine file (ldt docs machine)"
        raise MachineFileError(path, expected, reason) from error
    return parse_machine(text, str(path))


def parse_machine(text: str, source: str) -> Machine:
    """A machine from the text of a machine file; `source` is what messages call it."""
    try:
        data = load_yaml(text)
    except NO_YAML as error:
        mark = getattr(error, "problem_mark", None)
        line = f"line {mark.line + 1}: " if mark else ""
        got = line + (getattr(error, "problem", None) or reason_of(error))
        raise MachineFileError(source, "YAML", got) from error
    return machine_from_dict(data, source)


def machine_from_dict(data: Any, source: str) -> Machine:
    """A machine from the keys of a machine file."""
    top = mapping_of(source, data)
    if "verdict" in top:
        expected = "a machine file; a diagnosis follows --with"
        raise MachineFileError(source, expected, "the result of a diagnosis")
    for key in OTHER_CHANNELS:
        if key in top:
            expected = "a machine with voltage in, speed and current out (ldt docs machine)"
            raise MachineFileError(f"{source}, {key}", expected, described(top[key]))
    check_keys(source, top, REQUIRED, OPTIONAL)
    name = top["name"]
    if not isinstance(name, str) or not name:
        raise MachineFileError(f"{source}, name", "a name", repr(name))
    if len(name) > LONGEST_NAME:
        expected = f"at most {LONGEST_NAME} characters"
        raise MachineFileError(f"{source}, name", expected, f"{len(name)}")
    physics = named_physics(source, top["physics"])
    limits = mapping_of(f"{source}, limits", top["limits"])
    check_keys(f"{source}, limits", limits, ("voltage",), ())
    experiment = mapping_of(f"{source}, experiment", top["experiment"])
    check_keys(f"{source}, experiment", experiment, ("duration", "sample_period"), ())
    duration = _positive(f"{source}, experiment.duration", experiment["duration"])
    period = _positive(f"{source}, experiment.sample_period", experiment["sample_period"])
    if duration / period > MOST_SAMPLES:
        expected = f"at most {MOST_SAMPLES} sample periods ({period:g} s)"
        raise MachineFileError(f"{source}, experiment.duration", expected, duration)
    if round(duration / period) < 2:
        raise MachineFileError(
            f"{source}, experiment.duration", f"two sample periods ({period:g} s) or more", duration
        )
    parameters = mapping_of(f"{source}, parameters", top["parameters"])
    stated = stated_parameters(source, physics, parameters)
    voltage = _limits(f"{source}, limits.voltage", limits["voltage"])
    refuse_faulty(source, top["physics"], physics, stated.values, max(map(abs, voltage)))
    refuse_too_fast(source, physics, stated.values)
    own = own_effects(source, physics, top.get("own_effects", []))
    listed = top.get("effects", [])
    effects, beside = stated_effects(source, physics, stated.values, listed, own)
    return Machine(
        name=name,
        physics=top["physics"],
        parameters={**stated.values, **beside.values},
        deviations={**stated.deviations, **beside.deviations},
        acting=tuple(effect.name for effect in effects),
        own_effects=tuple(top.get("own_effects", [])),
        voltage_limits=voltage,
        duration=duration,
        sample_period=period,
        simulation=mapping_of(f"{source}, simulation", top.get("simulation") or {}),
        calibration=mapping_of(f"{source}, calibration", top.get("calibration") or {}),
        source=source,
    )


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
