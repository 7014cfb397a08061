"""Why a machine differs from its file: `diagnose`."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ldt_core.base.errors import ArgumentTypeError, OptionError, described
from ldt_core.base.settings import check, resolve
from ldt_core.diagnosis.diagnose import diagnose as find_cause
from ldt_core.diagnosis.diagnosis import Diagnosis
from ldt_core.diagnosis.library import library
from ldt_core.notebook.recorded_experiments import ExperimentsLike, MachineLike, possible
from ldt_core.physics.effect import Effect
from ldt_core.views.diagnosis_page.diagnosis_page import diagnosis_figure, write_files

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

        Raises:
            OptionError: there is a file of that name.
            LdtError: matplotlib is not installed.
        """
        place = Path(folder)
        if place.exists() and not place.is_dir():
            raise OptionError("folder", "a folder", f"the file {place}")
        place.mkdir(parents=True, exist_ok=True)
        write_files(self, place)


def names_and_effects(given: object) -> tuple[list[str], list[Effect]]:
    """Effects by name, and those that came as objects."""
    listed = list(given) if isinstance(given, Iterable) and not isinstance(given, str) else [given]
    for one in listed:
        if not isinstance(one, str | Effect):
            raise ArgumentTypeError("effects", "names or ldt.Effect objects", described(one))
    return (
        [one for one in listed if isinstance(one, str)],
        [one for one in listed if isinstance(one, Effect)],
    )


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
    """Say where the gap to the machine file lies, what causes it, and how much that explains.

    The answer is that of `ldt diagnose`. It takes a few seconds and uses all processors.

    Args:
        recording: a `Recording`, its folder or file, or experiments.
        machine: the machine as known beforehand, its name or its file.
        holdout: share of experiments held out to measure the closure.
        seed: of all random numbers.
        effects: additional ones to try: names, `path/to/file.py:NAME`, or `Effect` objects.
        without: names of effects not to try.
        refit: parameters of the machine to fit along and never to name; None takes those that the
            file says were calibrated.

    Raises:
        BadInput: an argument that cannot be used, or too few data.
    """
    experiments, known = possible(recording, machine)
    more, own = names_and_effects(effects)
    tried = library(known, more, check("without", without, {"type": "string_array"}))
    for effect in own:
        effect.require(known.model)
    replaced = [e.name for e in own]
    found = find_cause(
        known,
        list(experiments),
        recordings=[experiments.path] if experiments.path else [],
        effects=[*(e for e in tried if e.name not in replaced), *own],
        refit=None if refit is None else check("refit", refit, {"type": "string_array"}),
        holdout=check("holdout", holdout, {"type": "double"}),
        seed=resolve({"seed": seed}, "plant")["seed"],
    )
    return GapDiagnosis(**vars(found))
