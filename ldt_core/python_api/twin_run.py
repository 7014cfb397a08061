"""A twin taken along experiments: `run`."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

from ldt_core.base.experiment import Step
from ldt_core.base.metrics import Summary
from ldt_core.base.sentences import counted
from ldt_core.detectors.base import Detector
from ldt_core.models.base import Model
from ldt_core.python_api.recorded_experiments import (
    ExperimentsLike,
    MachineLike,
    described_step,
    frame,
    measured,
)
from ldt_core.runs.offline import run_unrecorded
from ldt_core.twin.loop import Twin
from ldt_core.views.figures.run_figure import plotted_run, run_figure

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

    from ldt_core.detectors.foreign import Updatable


@dataclass(frozen=True, repr=False, eq=False)
class TwinRun:
    """The result of `run`: what a twin said and did in each experiment.

    Attributes:
        twin: the twin as it is after the last experiment; `twin.step(experiment)` continues.
        steps: a `Step` for each experiment that could be used, in their order.
        summary: all figures; `summary.outcome` says whether learning helped.
    """

    twin: Twin
    steps: list[Step]
    summary: Summary

    def __len__(self) -> int:
        return len(self.steps)

    def _repr_html_(self) -> str:
        """The outcome and the figures, as a notebook shows them."""
        figures = "".join(
            f'<tr><th style="text-align: left">{escape(label)}</th><td>{escape(value)}</td></tr>'
            for label, value in self.summary.rows()
        )
        return f"<p><b>{escape(self.summary.outcome)}</b></p><table>{figures}</table>"

    def __repr__(self) -> str:
        rejected = self.summary.rejected
        told = f", {rejected} rejected: see its notes" if rejected else ""
        if self.mme is None:
            return f"TwinRun(no experiments{told})"
        errors = f"MME {self.mme:.4g} rad/s (original model {self.mme_original:.4g})"
        adapted = counted(self.summary.adaptations, "adaptation")
        return f"TwinRun({counted(len(self), 'experiment')}, {errors}, {adapted}{told})"

    @property
    def mme(self) -> float | None:
        """Mean over the experiments of each one's largest error [rad/s]; None without any."""
        return self.summary.mme

    @property
    def mme_original(self) -> float | None:
        """The same for the model that never learns [rad/s]."""
        return self.summary.mme_original

    @property
    def notes(self) -> list[str]:
        """What a person should know, one sentence each."""
        return list(self.summary.notes)

    def to_frame(self) -> pandas.DataFrame:
        """A table with one row per experiment.

        Raises:
            LdtError: pandas is not installed.
        """
        return frame(described_step(step) for step in self.steps)

    def plot(self, experiment: int | None = None) -> Figure:
        """One experiment over time, and the errors over the run.

        Args:
            experiment: number of the one to show; None selects that in which the twin gained most.

        Raises:
            OptionError: no such experiment.
            LdtError: matplotlib is not installed.
        """
        return run_figure(plotted_run(self.steps, experiment))


def run(
    recording: ExperimentsLike,
    machine: MachineLike,
    model: str | Model | type[Model] | None = None,
    detector: str | Detector | type[Detector] | Updatable | None = None,
    *,
    preset: str = "",
    **settings: Any,
) -> TwinRun:
    """Run a new twin over experiments, like `ldt run` and `ldt replay`.

    Args:
        recording: a `Recording`, its folder or file, or experiments in the order of their numbers.
        machine: the machine as known beforehand, its name or its file.
        model: see `Twin`.
        detector: see `Twin`.
        preset: see `Twin`.
        settings: see `Twin`.

    Returns:
        What the twin predicted, detected and learned, experiment by experiment.

    Raises:
        BadInput: an argument that cannot be used.
        LdtError: a simulation that diverges.
    """
    experiments, known = measured(recording, machine)
    twin = Twin(known, model, detector, preset=preset, **settings)
    steps: list[Step] = []
    summary = run_unrecorded(twin, experiments, steps.append)
    summary.note(*experiments.notes_about(known))
    return TwinRun(twin, steps, summary)
