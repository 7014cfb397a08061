"""The machine as it is taken to be now: its file, and what a model or a diagnosis has learned."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from ldt_core.base.errors import ModelError
from ldt_core.base.experiment import DiagnosisRecord, ModelRecord
from ldt_core.machine.machine_file import Machine
from ldt_core.physics.base import Effects
from ldt_core.physics.effect import Effect

Amounts = Mapping[str, Mapping[str, float]]  # effect → parameter → value


@dataclass(frozen=True)
class MachineEstimate:
    """The parameters that an advice goes by.

    Args:
        values: of the machine's physics, with the effects that change parameters.
        left_out: effects that act as well, on something else than parameters.
        beside: those of them that the machine file does not know, with all their values.
        foreign: those that nothing here can simulate.
    """

    values: Mapping[str, float]
    source: str
    left_out: tuple[str, ...] = ()
    beside: Effects = ()
    foreign: tuple[str, ...] = ()


def estimate_machine(
    machine: Machine, model: ModelRecord | None = None, diagnosis: DiagnosisRecord | None = None
) -> MachineEstimate:
    """What is known best: a model that has learned a cause, else a diagnosis, else the file.

    Raises:
        ModelError: a model that has learned causes, without them.
        OptionError: amounts that the machine cannot have.
        MachineFileError: parameters that it cannot have.
    """
    if model is not None and model.kind in LEARNERS and model.version > 0:
        amounts, own = LEARNERS[model.kind](model)
        if amounts:
            return _with(machine.with_parameters(**own), amounts, f"model {model.version}")
    if diagnosis is not None and diagnosis.effects:
        return _with(machine, diagnosis.amounts, f"the diagnosis at {diagnosis.experiment}")
    return with_effects(machine, ())


def _diagnosed(model: ModelRecord) -> tuple[Amounts, dict[str, float]]:
    try:
        cause = model.parameters["cause"]
        name, given = cause["effect"], cause["parameters"]
        return ({str(name): _numbers(given)} if name else {}), {}
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        where = f"model version {model.version}, parameters.cause"
        raise ModelError(where, "an effect and its parameters", repr(error)) from None


def _grey_box(model: ModelRecord) -> tuple[Amounts, dict[str, float]]:
    try:
        found = {str(n): _numbers(given) for n, given in model.parameters["effects"].items()}
        return found, _numbers(model.parameters["machine"])
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        where = f"model version {model.version}, parameters"
        raise ModelError(where, "effects and a machine with numbers", repr(error)) from None


def _numbers(given: Mapping[str, float]) -> dict[str, float]:
    return {str(k): float(v) for k, v in given.items()}


#: Kind of a model that learns causes → what it has learned: effects' values, and the machine's own.
LEARNERS = {"diagnosed": _diagnosed, "grey_box": _grey_box}


def with_effects(
    machine: Machine, acting: Sequence[tuple[Effect, Mapping[str, float]]]
) -> MachineEstimate:
    """The machine with effects that somebody names.

    Raises:
        OptionError: an effect that this machine cannot have.
    """
    values: Mapping[str, float] = machine.parameters
    names = {effect.name for effect, _ in acting}
    left_out = [
        effect.name
        for effect, _ in machine.effects
        if effect.name not in names and not effect.is_folded
    ]
    beside = []
    for effect, given in acting:
        effect.require(machine.model)
        if effect.is_folded:
            values = effect.change_parameters(machine.model, values, given)
        else:
            left_out.append(effect.name)
            beside.append((effect, given))
    source = "the effects given" if acting else "the machine file"
    return MachineEstimate(machine.model.folded(values), source, tuple(left_out), tuple(beside))


def _with(machine: Machine, amounts: Amounts, source: str) -> MachineEstimate:
    known = {n: g for n, g in amounts.items() if n in machine.effect_names}
    acting = [machine.law(n).used(g) for n, g in known.items()]
    found = with_effects(machine, acting)
    foreign = tuple(n for n in amounts if n not in known)  # a record names no files to run
    return replace(found, source=source, left_out=found.left_out + foreign, foreign=foreign)
