"""A run of the loop without ROS: experiments in, steps recorded and summed up."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from ldt_core.base.bounded import forget_oldest
from ldt_core.base.errors import BadInput
from ldt_core.base.experiment import Experiment, Prediction, Signal, Step
from ldt_core.base.metrics import Summary
from ldt_core.machine.machine_file import Machine
from ldt_core.recording.bag import Bag, read_bag
from ldt_core.recording.message_subject import Subject, agree, said_of
from ldt_core.recording.writer import BagWriter
from ldt_core.restart.learning_switch import LearningSwitch
from ldt_core.restart.recorded_run import RecordedRun
from ldt_core.restart.rollback import withdraw
from ldt_core.restart.run_key import check_key, key_text
from ldt_core.restart.stage_restart import TwinRestart
from ldt_core.twin.adaptor import ROLLED_BACK
from ldt_core.twin.loop import Twin

#: Predictions that are read before their experiment comes; nodes are a few steps apart at most.
LOOK_AHEAD = 1000


def run(
    machine: Machine,
    settings: Mapping[str, Any],
    experiments: Iterable[Experiment] | Callable[[int], Iterable[Experiment]],
    bag: Path | str | None,
    on_step: Callable[[Step], None] = lambda step: None,
    namespace: str = "",
    pace: Callable[[Iterable[Experiment]], Iterable[Experiment]] = iter,
    summary: Summary | None = None,
    in_time: Callable[[Iterable[Step]], Iterable[Step]] = iter,
) -> Summary:
    """Take experiments through the twin, and record every message that the graph would send.

    Args:
        settings: parameters of the groups model, detector, adaptor, diagnosis and advice; with a
            `resume` that is not empty the run goes on where the recording in `bag` ends.
        experiments: all of the run, or those that follow a number (0: all of them), of a source
            that need not make those before once more.
        bag: folder of the recording, which must not exist unless the run goes on; None records
            nothing.
        namespace: of the machine's topics in the recording.
        pace: hands on the experiments that follow what is recorded, each when it is time.
        summary: to be filled, where something is known before the run; None for a new one.
        in_time: hands on the steps until it is time to end.

    Raises:
        BadInput: settings, machine or bag that cannot be used.
        LdtError: a recording that is damaged beyond mending.
    """
    goes_on = bool(settings.get("resume"))
    summary = summary or Summary()
    if bag is not None and goes_on:  # before a part of the user's own is run
        versions = check_key(read_bag(bag, namespace or "/", listed=True), machine, settings)
        summary.note(*versions, *withdraw(RecordedRun(bag, namespace, machine), settings))
    twin = Twin.from_settings(machine, settings)
    if bag is None:
        all_of_them = experiments(0) if callable(experiments) else experiments
        return run_unrecorded(twin, pace(all_of_them), on_step, summary, in_time)
    untrained = twin.model.record()
    if goes_on:
        twin.adaptor.paused = LearningSwitch(bag).is_off
    with BagWriter(
        bag,
        machine.name,
        namespace,
        settings=settings,
        split_size=settings.get("split_size"),
        resume=goes_on,
        once=goes_on,
        key=key_text(machine, settings),
    ) as writer:
        restart = TwinRestart(twin, RecordedRun(bag, namespace, machine), summary.note)
        done = restart.resume() if goes_on else 0
        if callable(experiments):
            ahead = experiments(done)
        else:
            ahead = restart.following(experiments, summary.reject)
        for index, step in enumerate(in_time(twin.steps(pace(ahead), summary.reject))):
            if index == 0 and not done:
                writer.write("model", untrained, step.experiment.start)
            write_step(writer, step)
            restart.passed(step.experiment)
            on_step(step)
            if not goes_on:
                summary.add(step)
    if goes_on:
        recorded_summary(bag, namespace, machine, summary)
    summary.note(*_troubles(twin))
    return summary


def run_unrecorded(
    twin: Twin,
    experiments: Iterable[Experiment],
    on_step: Callable[[Step], None],
    summary: Summary | None = None,
    in_time: Callable[[Iterable[Step]], Iterable[Step]] = iter,
) -> Summary:
    """Take experiments through a twin; arguments as of `run`."""
    summary = summary or Summary()
    for step in in_time(twin.steps(experiments, summary.reject)):
        summary.add(step)
        on_step(step)
    summary.note(*_troubles(twin))
    return summary


def _troubles(twin: Twin) -> list[str]:
    advised = twin.advisor.trouble if twin.advisor else ""
    found = {"no signal": twin.detector.trouble, "no diagnosis": twin.trouble, "no advice": advised}
    return [f"{what}: {reason}" for what, reason in found.items() if reason]


def write_step(writer: BagWriter, step: Step) -> None:
    """Record a step in the order in which the graph sends its messages."""
    end = step.experiment.end
    writer.write("experiment", step.experiment, end)
    writer.write("prediction", step.prediction, end)
    writer.write("original_prediction", step.original, end)
    writer.write("signal", step.signal, end)
    if step.diagnosis is not None:
        writer.write("diagnosis", step.diagnosis, end)
    if step.model is not None:
        writer.write("model", step.model, end)
    writer.write("adaptation", step.adaptation, end)
    if step.advice is not None:
        writer.write("advice", step.advice, end)


def recorded_summary(bag: Path | str, namespace: str, machine: Machine, summary: Summary) -> None:
    """Fill a summary from a recording of a run, experiments that went all the way alone.

    Args:
        namespace: of the machine in it, "" for the root.
        machine: what could not be its experiment does not count.
        summary: gets the figures, and a note where the recording is damaged or cannot be read.
    """
    if not Path(bag).exists():
        return  # ended before anything was recorded
    try:
        opened = read_bag(bag, namespace or "/")
        for signal, end in _dealt_with(opened, summary):
            summary.add_signal(signal, end)
        ends: dict[int, list[float]] = {}
        for number, end in summary.answered:
            ends.setdefault(number, []).append(end)
        for diagnosis in opened.rare("diagnosis"):
            summary.diagnoses.append(diagnosis)
        for advice in opened.rare("advice"):
            summary.advice = advice
        originals = _Originals(opened)
        # Without one that went all the way there may be none: it ended before, which is no damage.
        for experiment in opened.experiments() if ends else ():
            summary.recorded.append((experiment.number, experiment.end))
            said = any(agree(end, experiment.end) for end in ends.get(experiment.number, ()))
            if said and machine.may_have_made(experiment):
                original = originals.of(experiment)
                if original is not None:
                    summary.add_original(original.max_error(experiment))
        summary.note(*opened.notes)
    except BadInput as error:
        summary.note(f"the recording cannot be read whole: {error}")


def _dealt_with(bag: Bag, summary: Summary) -> Iterator[tuple[Signal, float]]:
    """Signals, with their times, of experiments with an adaptation, which the summary takes in."""
    waiting: dict[Subject, Signal] = {}
    answered: dict[Subject, None] = {}
    for raw, record in bag.usable(bag.messages("signal", "adaptation"), whole=True):
        about = said_of(raw.topic, raw.kind, raw.data) or (record.number, 0.0)
        if isinstance(record, Signal):
            waiting.setdefault(about, record)
        elif about not in answered:
            answered[about] = None
            if ROLLED_BACK not in record.details:
                summary.answered.append(about)
            summary.add_adaptation(record)
        if about in answered and about in waiting:
            yield waiting.pop(about), about[1]


class _Originals:
    """Predictions of the model that never learns, read along with the experiments."""

    def __init__(self, bag: Bag) -> None:
        self._coming = bag.records("original_prediction")
        self._read: dict[Subject, Prediction] = {}

    def of(self, experiment: Experiment) -> Prediction | None:
        """The one of this experiment: a number may come twice, with another start."""
        wanted = experiment.number, experiment.start
        while wanted not in self._read and len(self._read) < LOOK_AHEAD:
            prediction = next(self._coming, None)
            if prediction is None:
                break
            self._read.setdefault((prediction.number, prediction.start), prediction)
        found = self._read.pop(wanted, None)
        forget_oldest(self._read, LOOK_AHEAD // 2)
        return found
