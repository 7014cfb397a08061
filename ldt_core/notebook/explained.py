"""Why a machine differs from its file: `diagnose`; and a file that fits it: `calibrate`."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ldt_core.base.errors import OptionError
from ldt_core.calibration import calibrate as fit_machine
from ldt_core.calibration.calibration import Calibration
from ldt_core.calibration.machine_yaml import write_machine_file
from ldt_core.diagnosis.diagnose import diagnose as find_cause
from ldt_core.diagnosis.diagnosis import Diagnosis
from ldt_core.diagnosis.library import library
from ldt_core.notebook.arguments import ExperimentsLike, MachineLike, names, number, possible
from ldt_core.physics.effect import Effect
from ldt_core.views.diagnosis_page import diagnosis_figure
from ldt_core.views.diagnosis_page.diagnosis_files import write_files

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class GapDiagnosis(Diagnosis):
    """What `diagnose` found: `verdict`, `gap`, `candidates`, `where`, `notes` and more."""

    def __repr__(self) -> str:
        return f"GapDiagnosis({self.verdict.kind}: {self.verdict.sentence})"

    def to_dict(self) -> dict[str, Any]:
        """The content of `diagnosis.json`."""
        return self.as_dict()

    def plot(self) -> Figure:
        """Before and after, where the gap lies, and the shares of effects that act together.

        Raises:
            LdtError: matplotlib is not installed.
        """
        return diagnosis_figure(self)

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Write `diagnosis.json` and `diagnosis.html`.

        Args:
            folder: made if need be.

        Raises:
            OptionError: there is a file of that name.
            LdtError: matplotlib is not installed.
        """
        place = Path(folder)
        if place.exists() and not place.is_dir():
            raise OptionError("folder", "a folder", f"the file {place}")
        place.mkdir(parents=True, exist_ok=True)
        write_files(self, place)


class FittedMachine(Calibration):
    """What `calibrate` found: `machine`, `estimates`, `errors`, `notes` and more."""

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


def diagnose(
    recording: ExperimentsLike,
    machine: MachineLike,
    *,
    holdout: float = 0.25,
    seed: int = 0,
    effects: Iterable[str | Effect] = (),
    without: Iterable[str] = (),
    refit: Sequence[str] | None = None,
) -> GapDiagnosis:
    """Where the gap between a machine and its file lies, what causes it, how far that closes it.

    The answer is that of `ldt diagnose`. It takes some seconds, and uses all processors.

    Args:
        recording: of `read`, its folder or file, or experiments.
        machine: as its file knows it; its name or file.
        holdout: share of the experiments that closure is measured on, not fitted.
        seed: of what is drawn at random.
        effects: further ones to try: names, `path/to/file.py:NAME`, or `Effect` objects.
        without: names of effects not to try.
        refit: parameters of the machine to fit along and never to name; None takes those that the
            file says were calibrated.

    Raises:
        BadInput: an argument that cannot be used, or too little to go by.
    """
    experiments, known = possible(recording, machine)
    own = [] if isinstance(effects, str) else [e for e in effects if isinstance(e, Effect)]
    more = effects if isinstance(effects, str) else [e for e in effects if e not in own]
    tried = library(known, names("effects", more), names("without", without))
    for effect in own:
        effect.require(known.model)
    replaced = [e.name for e in own]
    found = find_cause(
        known,
        list(experiments),
        recordings=[experiments.path] if experiments.path else [],
        effects=[*(e for e in tried if e.name not in replaced), *own],
        refit=None if refit is None else names("refit", refit),
        holdout=number("holdout", holdout),
        seed=number("seed", seed, "integer"),
    )
    return GapDiagnosis(**vars(found))


def calibrate(
    recording: ExperimentsLike,
    machine: MachineLike,
    *,
    free: Iterable[str] = (),
    fixed: Iterable[str] = (),
    holdout: float | None = None,
) -> FittedMachine:
    """Fit a machine's parameters to experiments, each a free run of its own, as `ldt calibrate`.

    Args:
        recording: of `read`, its folder or file, or experiments.
        machine: to begin with; its name or file.
        free: names of parameters to fit; none takes as many as the experiments determine.
        fixed: names that keep their values; not together with `free`.
        holdout: share of the experiments to judge by; None for a quarter when there are at least 4.

    Raises:
        BadInput: an argument that cannot be used.
        LdtError: the experiments determine nothing, or the fit failed.
    """
    experiments, known = possible(recording, machine)
    found = fit_machine(
        known,
        list(experiments),
        free=names("free", free),
        fixed=names("fixed", fixed),
        holdout=None if holdout is None else number("holdout", holdout),
    )
    named = found.with_recordings([experiments.path] if experiments.path else [])
    return FittedMachine(**vars(named))
