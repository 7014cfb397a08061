"""Recordings as objects: `read`, `write`; and what stands for them and for machines."""

from __future__ import annotations

import functools
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, overload

from ldt_core.base.errors import ArgumentTypeError, ExperimentError, LdtError, described
from ldt_core.base.experiment import Action, Experiment, Prediction, Step
from ldt_core.machine.machine_file import Machine
from ldt_core.recording.bag import Bag, read_bag
from ldt_core.recording.held_samples import HeldSamples
from ldt_core.recording.writer import BagWriter
from ldt_core.restart.recorded_run import BESIDE, said_at, said_beside
from ldt_core.twin.adaptor import ROLLED_BACK
from ldt_core.twin.stage import RecordedStep

if TYPE_CHECKING:
    import pandas

#: A machine, the name of one that ships with LDT, a machine file, or the keys of one.
MachineLike: TypeAlias = Machine | str | os.PathLike[str] | Mapping[str, Any]


class Recording(Sequence[Experiment]):
    """The experiments of one machine, and the steps of a twin; `read` returns it.

    A sequence of experiments in recorded order, with `len` and indexing.

    Attributes:
        path: as given to `read`; "" for experiments that do not come from a file.
    """

    def __init__(self, experiments: Sequence[Experiment], bag: Bag | None = None, path: str = ""):
        self._experiments, self._bag, self.path = list(experiments), bag, path

    @overload
    def __getitem__(self, place: int) -> Experiment: ...
    @overload
    def __getitem__(self, place: slice) -> list[Experiment]: ...
    def __getitem__(self, place: int | slice) -> Experiment | list[Experiment]:
        return self._experiments[place]

    def __len__(self) -> int:
        return len(self._experiments)

    def __repr__(self) -> str:
        what = "run of a twin" if self._bag and self._bag.judged else "machine alone"
        about = f"{self.machine or 'unknown machine'}, {len(self)} experiments, {what}"
        return f"Recording({self.path!r}, {about})"

    @property
    def machine(self) -> str:
        """Name of the machine; "" where the recording does not say."""
        return self._bag.machine if self._bag else ""

    @property
    def notes(self) -> list[str]:
        """What is odd about the recording, a sentence each."""
        return list(self._bag.notes) if self._bag else []

    def notes_about(self, machine: Machine) -> list[str]:
        """The notes, and one where the recording is of another machine than this."""
        other = self._bag.other_machine(machine) if self._bag else ""
        return [*self.notes, *([other] if other else [])]

    @functools.cached_property
    def steps(self) -> list[RecordedStep]:
        """What the twin said and did, one an experiment; none of a machine alone.

        Experiments that did not go all the way, such as one that the twin refused, have no step.

        Raises:
            RecordingError: a small file that unpacks to gigabytes of predictions.
        """
        if self._bag is None or not self._bag.judged:
            return []
        bag = self._bag
        held = HeldSamples()
        # A counter that begins anew comes by a number again, at another time.
        predictions = {_about(p): p for p in held.predictions(bag, "prediction")}
        originals = {_about(p): p for p in held.predictions(bag, "original_prediction")}
        signals, adaptations = said_beside(bag, "signal"), said_beside(bag, "adaptation")
        diagnoses, advice = (said_beside(bag, name) for name in BESIDE)
        models = {m.version: m for m in bag.records("model")}
        found: dict[_About, RecordedStep] = {}
        for experiment in self:
            about = _about(experiment)
            prediction, signal = predictions.get(about), said_at(experiment, signals)
            adaptation = said_at(experiment, adaptations)
            if prediction is None or signal is None or adaptation is None:
                continue
            new = adaptation.action is Action.ADAPTED or ROLLED_BACK in adaptation.details
            found.setdefault(
                about,
                RecordedStep(
                    experiment,
                    prediction,
                    signal,
                    adaptation,
                    models.get(adaptation.model_version) if new else None,
                    said_at(experiment, diagnoses),
                    said_at(experiment, advice),
                    originals.get(about),
                ),
            )
        return list(found.values())

    def to_frame(self) -> pandas.DataFrame:
        """A table with one row per experiment; with columns of the steps where there was a twin.

        Raises:
            LdtError: pandas is not installed.
        """
        steps = {id(step.experiment): step for step in self.steps}
        return frame(
            described_step(steps[id(e)]) if id(e) in steps else described_experiment(e)
            for e in self
        )


#: Number, start [s since the epoch] and samples.
_About = tuple[int, float, int]


def _about(one: Experiment | Prediction) -> _About:
    """What tells an experiment, and its prediction, from others: a number may come for several."""
    return one.number, one.start, len(one)


def read(path: str | os.PathLike[str], namespace: str | None = None) -> Recording:
    """Read a recording into memory.

    Args:
        path: folder of a recording, or one of its files (`.mcap`, `.mcap.zstd`, `.db3`).
        namespace: of the machine, if the recording has several; "/" is the root.

    Returns:
        Its experiments, in recorded order, and the twin's steps where there was a twin.

    Raises:
        RecordingError: no such file, no recording, several machines, no experiments, or a
            small file that unpacks to gigabytes of them.
        ExperimentError: nothing but messages that are no experiment.
        ArgumentTypeError: not a path.
    """
    if not isinstance(path, str | os.PathLike):
        raise ArgumentTypeError("path", "the folder or file of a recording", described(path))
    if namespace is not None and not isinstance(namespace, str):
        raise ArgumentTypeError("namespace", "the name of one", described(namespace))
    bag = read_bag(Path(path), namespace)
    return Recording(list(HeldSamples().of(bag)), bag, os.fspath(path))


def write(
    recording: ExperimentsLike, path: str | os.PathLike[str], machine: MachineLike | None = None
) -> None:
    """Write experiments as a recording, which every command and `read` take.

    Args:
        recording: experiments, in the order in which they were measured.
        path: of the folder to make.
        machine: of which they are, to be named in the recording; None says nothing.

    Raises:
        RecordingError: the folder exists, or cannot be made.
        ArgumentTypeError: no experiments, not a path, or no machine.
        MachineFileError: no such machine, or a file that cannot be used.
        LdtError: the disk is full or fails.
    """
    order = "first experiments (a list of ldt.Experiment), then the folder to make"
    if not isinstance(path, str | os.PathLike):
        got = f"{described(recording)}, then {described(path)}"
        raise ArgumentTypeError("arguments", order, got)
    found = _experiments(recording, order)
    if not found:
        raise ArgumentTypeError("recording", "experiments", "none")
    name = "" if machine is None else Machine(machine).name
    with BagWriter(Path(path), name) as writer:
        for experiment in found:
            writer.write("experiment", experiment, experiment.end)


def described_experiment(experiment: Experiment) -> dict[str, Any]:
    """Its number, start [s since the epoch], duration [s], sample period [s] and samples."""
    return {
        "experiment": experiment.number,
        "start": experiment.start,
        "duration": experiment.duration,
        "sample_period": experiment.period,
        "samples": len(experiment),
    }


def described_step(step: Step | RecordedStep) -> dict[str, Any]:
    """What the twin said and did at an experiment; errors [rad/s]."""
    original, diagnosis = step.original, step.diagnosis
    return {
        **described_experiment(step.experiment),
        "detector": step.signal.detector,
        "model_version": step.signal.model_version,
        "max_error": step.signal.max_error,
        "max_error_original": original and original.max_error(step.experiment),
        "signal": step.signal.level.word,
        "state": step.signal.state,
        "adequacy": step.signal.adequacy,
        "adaptation": str(step.adaptation.action),
        "reason": step.adaptation.reason,
        "diagnosis": diagnosis and diagnosis.sentence,
    }


def frame(rows: Iterable[dict[str, Any]]) -> pandas.DataFrame:
    """The rows as a table."""
    try:
        import pandas
    except ImportError as error:
        raise LdtError(
            "a DataFrame needs pandas, which is not installed: pip install pandas"
        ) from error
    return pandas.DataFrame(list(rows))


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
    return _experiments(recording, order), known


def _experiments(recording: ExperimentsLike, order: str) -> Recording:
    """Those that are meant; `order` says which arguments are expected."""
    if isinstance(recording, Recording):
        return recording
    if isinstance(recording, str | os.PathLike):
        return read(recording)
    if isinstance(recording, Experiment | Machine) or not isinstance(recording, Iterable):
        raise ArgumentTypeError("arguments", order, f"first {described(recording)}")
    found = list(recording)
    for place, one in enumerate(found):
        if not isinstance(one, Experiment):
            where = f"recording, item {place}"
            raise ArgumentTypeError(where, "an ldt.Experiment", described(one))
    return Recording(found)


def possible(recording: ExperimentsLike, machine: MachineLike) -> tuple[Recording, Machine]:
    """As `measured`, of experiments that the machine can have made.

    Raises:
        ExperimentError: one that it cannot have made.
    """
    found, known = measured(recording, machine)
    for experiment in found:
        try:
            known.check(experiment)
        except ExperimentError as error:
            got = f"{error.got}; [e for e in recording if machine.may_have_made(e)] leaves it out"
            raise ExperimentError(error.where, error.expected, got) from None
    return found, known
