"""Why a machine differs from its file: `diagnose`."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ldt_core.base.errors import ArgumentTypeError, OptionError, described
from ldt_core.base.settings import HOLDOUT, check, resolve
from ldt_core.diagnosis.diagnose import diagnose as find_cause
from ldt_core.diagnosis.diagnosis import Diagnosis
from ldt_core.diagnosis.library import library
from ldt_core.physics.effect import Effect
from ldt_core.python_api.recorded_experiments import ExperimentsLike, MachineLike, possible
from ldt_core.views.diagnosis_page.diagnosis_page import diagnosis_figure, write_diagnosis

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class GapDiagnosis(Diagnosis):
    """What `diagnose` found.

    The gap is the part of the squared error of free runs that is more than noise.

    Attributes:
        verdict: `kind` ("none", "effect", "ambiguous" or "unknown"), `effects` by name,
            `confidence` (0 to 1) and `sentence`.
        gap: errors of free runs before and after the verdict's effects are added [rad/s], and
            `closed_fraction`, the share of the gap that they close.
        candidates: all effects and sets of effects that were tried, the best first.
        where: the speeds, voltages, times or frequencies at which the gap lies.
        experiments: numbers of the experiments under "fit" and "held_out".
        next_experiment: the experiment that would tell the most, or None.
        notes: what a person should know, one sentence each.
    """

    def _repr_html_(self) -> str:
        """Verdict, confidence and notes, as a notebook shows them."""
        told = f"{self.verdict.kind}, confidence {self.verdict.confidence:.0%}"
        notes = "".join(f"<li>{escape(note)}</li>" for note in self.notes)
        return (
            f"<p><b>{escape(told)}</b><br>{escape(self.verdict.sentence)}</p>"
            f"{f'<ul>{notes}</ul>' if notes else ''}"
        )

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
        write_diagnosis(self, place)


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
    holdout: float = HOLDOUT,
    seed: int = 0,
    effects: Iterable[str | Effect] = (),
    without: Iterable[str] = (),
    refit: Sequence[str] | None = None,
) -> GapDiagnosis:
    """Say how a machine differs from its file, and how much of the error that explains.

    The answer is that of `ldt diagnose`. It takes seconds to minutes and uses all processors.

    Args:
        recording: a `Recording`, its folder or file, or experiments.
        machine: the machine as known beforehand, its name or its file.
        holdout: share of experiments held out to measure the closure.
        seed: of all random numbers.
        effects: additional ones to try: names, `path/to/file.py:NAME`, or `Effect` objects.
        without: names of effects not to try.
        refit: parameters of the machine that are fitted as well, but are never named as a cause;
            None takes those that the file says were calibrated.

    Returns:
        The verdict, with all candidates that were tried.

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
