"""What the functions of the package take: machines and experiments."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import Any, TypeAlias

from ldt_core.base.errors import ArgumentTypeError, described
from ldt_core.base.experiment import Experiment
from ldt_core.machine.machine_file import Machine
from ldt_core.notebook.recorded_experiments import Recording, read

#: A machine, the name of one that ships with LDT, a machine file, or the keys of one.
MachineLike: TypeAlias = Machine | str | os.PathLike[str] | Mapping[str, Any]
#: A recording, its folder or file, or experiments.
ExperimentsLike: TypeAlias = Recording | str | os.PathLike[str] | Iterable[Experiment]


def measured(recording: ExperimentsLike, machine: MachineLike) -> tuple[Recording, Machine]:
    """The experiments and the machine that are meant.

    Raises:
        ArgumentTypeError: something else, or the one in the other's place.
        RecordingError, ExperimentError: as `read`; or no experiments at all.
        MachineFileError: no such machine, or a file that cannot be used.
    """
    order = "first a recording (ldt.read), its folder, or experiments, then a machine"
    if isinstance(recording, Experiment | Machine | Mapping) or isinstance(machine, Recording):
        got = f"{described(recording)}, then {described(machine)}"
        raise ArgumentTypeError("arguments", order, got)
    known = Machine(machine)
    if isinstance(recording, Recording):
        return recording, known
    if isinstance(recording, str | os.PathLike):
        return read(recording), known
    if not isinstance(recording, Iterable):
        raise ArgumentTypeError("arguments", order, f"first {described(recording)}")
    found = list(recording)
    for place, one in enumerate(found):
        if not isinstance(one, Experiment):
            where = f"recording, item {place}"
            raise ArgumentTypeError(where, "an ldt.Experiment", described(one))
    return Recording(found), known


def possible(recording: ExperimentsLike, machine: MachineLike) -> tuple[Recording, Machine]:
    """As `measured`, of experiments that the machine can have made.

    Raises:
        ExperimentError: one that it cannot have made.
    """
    found, known = measured(recording, machine)
    for experiment in found:
        known.check(experiment)
    return found, known
