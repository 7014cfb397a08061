"""Pictures of a run, drawn from its recording alone."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ldt_core.base.errors import OptionError, RecordingError
from ldt_core.base.experiment import Action, Experiment, Level, Prediction, Signal, Step, rms
from ldt_core.base.model_state import NOT_JUDGED, STATES, shown_state, times_noise
from ldt_core.recording.bag import read_twin_run
from ldt_core.recording.experiment_numbers import ExperimentNumbers
from ldt_core.views.page import style
from ldt_core.views.step_order import StepOrder
from ldt_core.views.step_view import LEVEL_WORDS, StepView, recorded_steps

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

HEIGHT = 7.8  # inches: three panels in the proportions of a README
MOST_CELLS = 500  # a pixel or two each; of more, those of one state in a row are drawn as one
STRIP = 0.05  # of an axes' height: the cells of the states
LEGEND = 0.14  # of the span of the speeds: room below the curves, which a legend would hide
#: Tone of a state → colour.
PAINTS = {
    "good": style.GREEN,
    "found": style.SKY,
    "bad": style.VERMILION,
    "vague": style.ORANGE,
    "open": style.FAINT,
}


class ShownStep(NamedTuple):
    """A step with its samples."""

    experiment: Experiment
    prediction: Prediction
    original: Prediction | None
    signal: Signal


@dataclass
class PlottedRun:
    """What a picture of a run needs."""

    steps: list[StepView]
    shown: ShownStep
    notes: Sequence[str] = ()


def load_run(recording: str | Path, namespace: str = "", number: int | None = None) -> PlottedRun:
    """Read a run, a few experiments in memory at a time.

    Args:
        number: experiment to show; None takes the one in which the twin gained most on the
            original model.

    Raises:
        RecordingError: no recording of a run, or no experiment in it was judged.
        OptionError: no such experiment in it.
    """
    bag = read_twin_run(recording, namespace)
    return _plotted(recorded_steps(bag), number, bag.path)


def plotted_run(steps: Sequence[Step], number: int | None = None) -> PlottedRun:
    """Of steps in memory; `number` as of `load_run`.

    Raises:
        RecordingError: there are none.
        OptionError: no such experiment among them.
    """
    views = (
        StepView(
            s.number,
            s.experiment,
            s.prediction,
            s.original,
            s.signal,
            s.adaptation,
            s.original.max_error(s.experiment),
        )
        for s in steps
    )
    return _plotted(views, number)


def _plotted(
    views: Iterable[StepView], number: int | None, path: str | Path = "the run"
) -> PlottedRun:
    order, numbers = StepOrder(), set[int]()
    best, shown = -np.inf, None
    for step in views:
        experiment, prediction, signal = step.experiment, step.prediction, step.signal
        if experiment is None or prediction is None or signal is None:
            continue
        gain = 0.0
        if step.original_error is not None:
            gain = step.original_error - prediction.max_error(experiment)
        if number == step.number or (number is None and gain > best):
            best, shown = gain, ShownStep(experiment, prediction, step.original, signal)
        order.put(step)
        step.settle(None)
        numbers.add(step.number)
    if not numbers:
        raise RecordingError(path, "an experiment with its prediction and its signal", "none")
    if shown is None:
        among = f"one of the experiments {min(numbers)} to {max(numbers)} of {path}"
        raise OptionError("experiment", among, number)
    return PlottedRun(order.steps(), shown, order.notes)


def plot_run(run: PlottedRun, out: str | Path, title: str = "") -> None:
    """Draw one experiment over time, and the errors over the run.

    Raises:
        OptionError: a file ending other than png, svg or pdf, or in no folder.
    """
    style.check_picture(out)
    style.save_picture(run_figure(run, title), out)


def run_figure(run: PlottedRun, title: str = "") -> Figure:
    """The same as a figure."""

    def draw(figure: Figure) -> None:
        upper, middle, lower = figure.subplots(3, 1, height_ratios=(2.6, 1.0, 2.6))
        _experiment(upper, run.shown)
        _residual(middle, run.shown)
        _errors(lower, run.steps)
        if run.notes:
            lower.set_xlabel(" ".join(["experiment.", *run.notes]))
        if title:
            figure.suptitle(title)

    return style.picture(style.WIDE.width, HEIGHT, draw)


def _experiment(axes: Axes, shown: ShownStep) -> None:
    experiment, prediction, original, signal = shown
    time = experiment.time
    if original is not None:
        axes.plot(time, original.speed, color=style.ORANGE, lw=1.4, label="original model")
    label = f"learning twin, model {prediction.model_version}"
    # Wide and pale below the measurement, so that both show where the twin is right.
    axes.plot(time, prediction.speed, color=style.SKY, lw=3.2, label=label)
    if prediction.speed_std is not None:
        low = prediction.speed - 2 * prediction.speed_std
        high = prediction.speed + 2 * prediction.speed_std
        label = "the twin's 95 % band"
        axes.fill_between(time, low, high, color=style.BLUE, alpha=0.2, lw=0, label=label)
    axes.plot(time, experiment.speed, color=style.INK, lw=0.8, label="measured")
    axes.set_ylabel("speed [rad/s]")
    axes.tick_params(labelbottom=False)
    beside = times_noise(signal.adequacy)
    said = [f"max error {signal.max_error:.2f} rad/s", f"detector: {LEVEL_WORDS[signal.level]}"]
    axes.set_title(
        f"experiment {experiment.number}: {shown_state(signal).words}"
        f"{f', error {beside}' if beside else ''}\n({', '.join(said)})"
    )
    bottom, top = axes.get_ylim()
    axes.set_ylim(bottom - LEGEND * (top - bottom), top)
    axes.legend(loc="lower left", ncols=4, frameon=False)


def _residual(axes: Axes, shown: ShownStep) -> None:
    """What the twin leaves of the measurement, and twice the noise where that is known."""
    experiment, prediction, _, signal = shown
    residual = experiment.speed - prediction.speed
    if signal.adequacy:
        noise = rms(residual) / signal.adequacy
        look: dict[str, Any] = {"color": style.SHADE, "lw": 0, "zorder": 0}
        axes.axhspan(-2 * noise, 2 * noise, **look)
    axes.plot(experiment.time, residual, color=style.BLUE, lw=0.7)
    shaded = "; shaded: the noise, 95 % band" if signal.adequacy else ""
    axes.set_title(f"measured − twin{shaded}")
    axes.set_xlabel("time [s]")
    axes.set_ylabel("error [rad/s]")
    axes.margins(x=0.05, y=0.25)


def _errors(axes: Axes, steps: list[StepView]) -> None:
    look: dict[str, Any]
    judged = [(s.number, s.signal) for s in steps if s.signal is not None]
    known = [(s.number, s.original_error) for s in steps if s.original_error is not None]
    if known:
        look = {"ms": 3, "color": style.ORANGE, "alpha": 0.6, "label": "original model"}
        axes.plot([n for n, _ in known], [error for _, error in known], "o", **look)
    look = {"ms": 3, "lw": 0.7, "color": style.BLUE, "label": "learning twin"}
    axes.plot([n for n, _ in judged], [signal.max_error for _, signal in judged], "-o", **look)
    positive = [(n, signal.max_error) for n, signal in judged if signal.level is Level.POSITIVE]
    look = {
        "ms": 7,
        "mfc": "none",
        "color": style.VERMILION,
        "label": f"alarm ({len(positive)})",
    }
    axes.plot([n for n, _ in positive], [error for _, error in positive], "o", **look)
    done = [(s.number, s.adaptation) for s in steps if s.adaptation is not None]
    adapted = [n for n, adaptation in done if adaptation.action is Action.ADAPTED]
    for index, n in enumerate(adapted):
        label = f"new model ({len(adapted)})" if index == 0 else None
        axes.axvline(n + 0.5, color=style.GREY, lw=0.8, zorder=0, label=label)
    _states(axes, [signal for _, signal in judged])
    axes.set_xlabel("experiment")
    axes.locator_params("x", integer=True)
    axes.set_ylabel("max error [rad/s]")
    axes.set_ylim(0, axes.get_ylim()[1] / (1 - STRIP))
    # Above the axes: small runs have points wherever a legend could lie.
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=4)


def _states(axes: Axes, signals: list[Signal]) -> None:
    """A cell an experiment along the upper edge, in the colour of its state."""
    for state in (*STATES.values(), NOT_JUDGED):
        found = [s.experiment for s in signals if shown_state(s) is state]
        if found:
            stretches = ExperimentNumbers((n, n) for n in found).spans
            cells = stretches if len(signals) > MOST_CELLS else [(n, n) for n in found]
            axes.broken_barh(
                [(first - 0.5, last - first + 1.0) for first, last in cells],
                (1 - STRIP, STRIP),
                transform=axes.get_xaxis_transform(),
                facecolors=PAINTS[state.tone],
                edgecolors=style.PAPER,
                lw=0.3,
                label=f"{state.brief} ({len(found)})",
            )
