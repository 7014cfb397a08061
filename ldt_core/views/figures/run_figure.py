"""Pictures of a run, drawn from its recording alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ldt_core.base.errors import OptionError
from ldt_core.base.experiment import (
    Action,
    Adaptation,
    Experiment,
    Level,
    Prediction,
    Signal,
    Step,
)
from ldt_core.base.result_files import check_target
from ldt_core.recording.bag import read_twin_run
from ldt_core.twin.stage import RecordedStep
from ldt_core.views.page import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito's colours, which colour-blind people can tell apart.
MEASURED, TWIN, ORIGINAL, POSITIVE = "#000000", "#0072B2", "#E69F00", "#D55E00"
SIZE = (9.0, 6.5)  # inches; readable at the width of a README
DPI = 120


@dataclass
class RunRecords:
    """What a picture of a run needs, by experiment number."""

    max_error: dict[int, float]
    original: dict[int, float]
    signals: dict[int, Signal]
    adaptations: dict[int, Adaptation]
    shown: tuple[Experiment, Prediction, Prediction | None]


def load_run(recording: str | Path, namespace: str = "", number: int | None = None) -> RunRecords:
    """Read a run, one experiment in memory at a time.

    Args:
        recording: of `ldt up`, `run` or `replay`.
        namespace: of the machine, when there are several.
        number: experiment to show; None takes the one in which the twin gained most on the
            original model.

    Raises:
        RecordingError: no recording of a run.
        OptionError: no such experiment in it.
    """
    bag = read_twin_run(recording, namespace)
    signals = {s.experiment: s for s in bag.records("signal")}
    adaptations = {a.experiment: a for a in bag.records("adaptation")}
    errors = {n: s.max_error for n, s in signals.items()}
    predictions = {p.number: p for p in bag.records("prediction")}
    originals = {p.number: p for p in bag.records("original_prediction")}
    original_errors: dict[int, float] = {}
    best, shown = -np.inf, None
    for experiment in bag.experiments():
        prediction = predictions.get(experiment.number)
        if prediction is None:
            continue
        original = originals.get(experiment.number)
        gain = 0.0
        if original is not None:
            original_errors[experiment.number] = original.max_error(experiment)
            gain = original_errors[experiment.number] - prediction.max_error(experiment)
        if number == experiment.number or (number is None and gain > best):
            best, shown = gain, (experiment, prediction, original)
    if shown is None:
        known = f"one of the experiments {min(errors)} to {max(errors)}" if errors else "a run"
        raise OptionError("experiment", f"{known} of {recording}", number)
    return RunRecords(errors, original_errors, signals, adaptations, shown)


def records_of(steps: Sequence[Step | RecordedStep], number: int | None = None) -> RunRecords:
    """Of steps in memory; `number` as of `load_run`.

    Raises:
        OptionError: no such experiment among them.
    """
    shown = [s for s in steps if number is None or s.number == number]
    if not shown:
        known = [s.number for s in steps]
        expected = f"one of the experiments {min(known)} to {max(known)}" if known else "steps"
        raise OptionError("experiment", expected, number)
    best = max(shown, key=_gain)
    return RunRecords(
        {s.number: s.signal.max_error for s in steps},
        {s.number: s.original.max_error(s.experiment) for s in steps if s.original},
        {s.number: s.signal for s in steps},
        {s.number: s.adaptation for s in steps},
        (best.experiment, best.prediction, best.original),
    )


def _gain(step: Step | RecordedStep) -> float:
    """By how much the twin's maximum error is less than the original model's [rad/s]."""
    original = step.original.max_error(step.experiment) if step.original else 0.0
    return original - step.signal.max_error


def plot_run(run: RunRecords, out: str | Path, title: str = "") -> None:
    """Draw one experiment over time, and the errors over the run.

    Raises:
        OptionError: a file ending other than png, svg or pdf, or in no folder.
        LdtError: matplotlib is not installed.
    """
    check_target(out, endings=style.PICTURES)
    run_figure(run, title).savefig(out, dpi=DPI)


def run_figure(run: RunRecords, title: str = "") -> Figure:
    """The same as a figure.

    Raises:
        LdtError: matplotlib is not installed.
    """
    style.require("a picture")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=SIZE, layout="constrained")
    FigureCanvasAgg(figure)
    upper, lower = figure.subplots(2, 1)
    _experiment(upper, run.shown, run.signals[run.shown[0].number])
    _errors(lower, run)
    if title:
        figure.suptitle(title)
    return figure


def _experiment(axes: Axes, shown: tuple[Experiment, Prediction, Any], signal: Signal) -> None:
    experiment, prediction, original = shown
    time = experiment.time
    axes.plot(time, experiment.speed, color=MEASURED, lw=1.0, label="measured")
    if original is not None:
        axes.plot(time, original.speed, color=ORIGINAL, lw=1.4, label="original model")
    label = f"learning twin, model {prediction.model_version}"
    axes.plot(time, prediction.speed, color=TWIN, lw=1.4, label=label)
    if prediction.speed_std is not None:
        low = prediction.speed - 2 * prediction.speed_std
        high = prediction.speed + 2 * prediction.speed_std
        axes.fill_between(time, low, high, color=TWIN, alpha=0.2, lw=0, label="± 2 deviations")
    axes.set_xlabel("time [s]")
    axes.set_ylabel("speed [rad/s]")
    axes.set_title(
        f"experiment {experiment.number}: max error {signal.max_error:.2f} rad/s, "
        f"{signal.level.word}",
        loc="left",
        fontsize="medium",
    )
    axes.legend(loc="best", fontsize="small", framealpha=0.9)
    axes.grid(alpha=0.25)


def _errors(axes: Axes, run: RunRecords) -> None:
    numbers = sorted(run.max_error)
    if run.original:
        known = sorted(run.original)
        values = [run.original[n] for n in known]
        axes.plot(known, values, "o", ms=3, color=ORIGINAL, alpha=0.6, label="original model")
    twin = [run.max_error[n] for n in numbers]
    axes.plot(numbers, twin, "-o", ms=3, lw=0.7, color=TWIN, label="learning twin")
    positive = [n for n in numbers if run.signals[n].level is Level.POSITIVE]
    axes.plot(
        positive,
        [run.max_error[n] for n in positive],
        "o",
        ms=7,
        mfc="none",
        color=POSITIVE,
        label=f"positive ({len(positive)})",
    )
    adapted = [n for n, a in run.adaptations.items() if a.action is Action.ADAPTED]
    for index, n in enumerate(adapted):
        label = f"new model ({len(adapted)})" if index == 0 else None
        axes.axvline(n + 0.5, color="0.6", lw=0.8, zorder=0, label=label)
    axes.set_xlabel("experiment")
    axes.set_ylabel("max error [rad/s]")
    axes.set_ylim(bottom=0)
    axes.grid(alpha=0.25)
    # Above the axes: small runs have points wherever a legend could lie.
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), fontsize="small", ncols=4, frameon=False)
