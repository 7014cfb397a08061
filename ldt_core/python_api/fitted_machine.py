"""A machine file that fits what was measured: `calibrate`."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ldt_core.base.errors import ArgumentTypeError, OptionError, described
from ldt_core.base.settings import check
from ldt_core.calibration import calibrate as fit_machine
from ldt_core.calibration.calibration import Calibration
from ldt_core.calibration.machine_yaml import write_machine_file
from ldt_core.diagnosis.diagnosis import Diagnosis, read_diagnosis
from ldt_core.diagnosis.fitted_along import Used, acting_and_along
from ldt_core.machine.machine_file import Machine
from ldt_core.python_api.recorded_experiments import ExperimentsLike, MachineLike, possible


class FittedMachine(Calibration):
    """What `calibrate` found.

    Attributes:
        machine: the machine with the fitted parameters; `nominal` is the one before.
        estimates: the fitted parameters, each with `name`, `value`, `unit` and `ci95`.
        fixed: parameters that kept their values → the reason.
        errors: "fit" and, if experiments were held out, "held_out" → errors of free runs
            (before, after) [rad/s].
        notes: what a person should know, one sentence each.
    """

    def __repr__(self) -> str:
        fitted = ", ".join(f"{e.name} = {e.value:.4g} {e.unit}" for e in self.estimates)
        before, after = self.errors["fit"]
        errors = f"free-run error {before.rmse:.3g} before, {after.rmse:.3g} rad/s after"
        return f"FittedMachine({self.machine.name!r}, {fitted}; {errors})"

    def to_dict(self) -> dict[str, Any]:
        """What `ldt calibrate --json` prints of the fit."""
        return self.as_dict()

    def save(self, file: str | os.PathLike[str], overwrite: bool = False) -> None:
        """Write the machine file.

        Raises:
            OptionError: the file exists and is not to be overwritten, or its folder does not.
        """
        if Path(file).exists() and not overwrite:
            raise OptionError("file", "a new file, or overwrite=True", f"{file}, which exists")
        write_machine_file(self, Path(file), force=True)


def calibrate(
    recording: ExperimentsLike,
    machine: MachineLike,
    *,
    free: Iterable[str] = (),
    fixed: Iterable[str] = (),
    holdout: float | None = None,
    with_: Diagnosis | str | os.PathLike[str] | None = None,
) -> FittedMachine:
    """Fit a machine's parameters to experiments in separate free runs, like `ldt calibrate`.

    Args:
        recording: a `Recording`, its folder or file, or experiments.
        machine: where the fit starts, its name or file.
        free: names of parameters to fit; by default as many as the experiments determine.
        fixed: names of parameters that keep their values; not together with `free`.
        holdout: share of experiments held out; None is a quarter if there are at least 4.
        with_: a diagnosis, or its file; its effects are added to the machine and fitted too.

    Returns:
        The fitted machine, its estimates and errors.

    Raises:
        BadInput: an argument that cannot be used.
        LdtError: the experiments determine nothing, or the fit failed.
    """
    experiments, known = possible(recording, machine)
    acting, along = ([], []) if with_ is None else _named(with_, known)
    found = fit_machine(
        known,
        list(experiments),
        free=check("free", free, {"type": "string_array"}),
        fixed=check("fixed", fixed, {"type": "string_array"}),
        holdout=None if holdout is None else check("holdout", holdout, {"type": "double"}),
        acting=acting,
        along=along,
    )
    named = found.with_recordings([experiments.path] if experiments.path else [])
    return FittedMachine(**vars(named))


def _named(diagnosis: object, machine: Machine) -> tuple[list[Used], list[Used]]:
    if isinstance(diagnosis, Diagnosis):
        return acting_and_along("with_", diagnosis.as_dict(), machine)
    if isinstance(diagnosis, str | os.PathLike):
        file = Path(diagnosis)
        return acting_and_along(str(file), read_diagnosis(file, machine), machine)
    raise ArgumentTypeError("with_", "a diagnosis or its file", described(diagnosis))
