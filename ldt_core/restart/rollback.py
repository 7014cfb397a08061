"""Going back to an earlier model by hand: which there were in a recording, and which goes on.

Nothing is deleted. The earlier model is recorded once more under the next version, with an
adaptation that says so, behind the last step; a run that goes on with the recording begins with it.
Where the version in force cannot be used, a run that goes on does so by itself (`withdraw`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import msgs_config
from ldt_core.base.errors import ModelError, OptionError, RecordingError
from ldt_core.base.experiment import FAULTY, Action, Adaptation, Experiment, ModelRecord
from ldt_core.machine.machine_file import Machine, load_machine
from ldt_core.models import MODELS, build_model, restore_model
from ldt_core.recording.bag import Bag, read_bag
from ldt_core.recording.health import ANSWERS
from ldt_core.recording.messages import quoted
from ldt_core.recording.writer import BagWriter
from ldt_core.restart.checkpoint import Lookup
from ldt_core.restart.recorded_run import END, RecordedRun, complete_steps
from ldt_core.restart.run_key import check_key
from ldt_core.twin.adaptor import ROLLED_BACK
from ldt_core.twin.predictor import try_out
from ldt_core.twin.stage import WINDOW, RecordedStep

#: A nanosecond [s].
NANOSECOND = 1e-9


@dataclass
class ModelTerm:
    """A model version, and the time in which it was in force.

    Args:
        before: error of the model before it on data held back [rad/s]; None where not compared.
        mean_max_error: of those [rad/s]; None without any.
        faulty: of those, which were refused for a faulty sensor.
    """

    version: int
    adopted: int
    learned_from: int
    before: float | None
    after: float | None
    reason: str
    experiments: int = 0
    mean_max_error: float | None = None
    faulty: int = 0


@dataclass(frozen=True)
class History:
    """What a recording says of the models of its run.

    Args:
        terms: the first one first; the last one is in force.
        unusable: versions that cannot predict the last experiment, each with the reason.
    """

    path: Path
    namespace: str
    machine: Machine
    terms: list[ModelTerm]
    models: dict[int, ModelRecord]
    last: RecordedStep
    unusable: dict[int, str]

    def as_dict(self) -> dict[str, object]:
        """For programs."""
        versions = [{**asdict(r), "unusable": self.unusable.get(r.version)} for r in self.terms]
        return {"in_force": self.terms[-1].version, "versions": versions}


def history(path: str | Path, namespace: str = "", machine: str = "") -> History:
    """The models of a run.

    Args:
        namespace: of the machine, "" when there is only one.
        machine: file or name of the machine; "" takes the recorded name.

    Raises:
        RecordingError: no recording of a run, or one of another machine.
        OptionError: the recorded machine is a file, which has to be given.
        MachineFileError: no such machine.
    """
    return _history(*_opened(path, namespace, machine))


def unusable_versions(path: str | Path, namespace: str = "") -> dict[int, str]:
    """Versions of a run that cannot predict its last experiment, each with the reason.

    It takes no longer where a run is long, as `history` does.

    Raises:
        RecordingError, OptionError, MachineFileError: as of `history`.
    """
    bag, known, settings = _opened(path, namespace)
    run = RecordedRun(bag.path, bag.namespace or "/", known)
    last = next(iter(deque(run.steps(END), maxlen=1)), None)
    if last is None or settings is None:
        return {}
    return _unusable(_models(bag), known, settings, last.experiment)


def _opened(
    path: str | Path, namespace: str, machine: str = ""
) -> tuple[Bag, Machine, Mapping[str, Any] | None]:
    """A run, its machine, and its parameters where its model is no part of the user's own."""
    bag = read_bag(path, namespace)
    known = load_machine(machine or _recorded_machine(bag))
    check_key(bag, known)
    settings = bag.settings()  # no part of the user's own is run on a recording's word
    return bag, known, settings if settings.get("model") in MODELS.builtin else None


def _models(bag: Bag) -> dict[int, ModelRecord]:
    """By version; of two with the same, the first."""
    models: dict[int, ModelRecord] = {}
    for record in bag.rare("model"):
        models.setdefault(record.version, record)
    return models


def _history(bag: Bag, known: Machine, settings: Mapping[str, Any] | None) -> History:
    models = _models(bag)
    terms: list[ModelTerm] = []
    sums: list[float] = []
    last = None
    for step in complete_steps(bag, known):
        if not terms:
            first = step.prediction.model_version
            trained = len(models[first].trained_on) if first in models else 0
            terms.append(ModelTerm(first, 0, trained, None, None, "to begin with"))
            sums.append(0.0)
        term, last = terms[-1], step
        term.experiments += 1
        term.faulty += bool(step.adaptation.details.get(FAULTY))
        sums[-1] += step.signal.max_error
        term.mean_max_error = sums[-1] / term.experiments
        if step.model is not None:
            terms.append(_term(step.adaptation, step.model))
            sums.append(0.0)
    if last is None:
        raise RecordingError(bag.path, "a run with an experiment that was learned from", "none")
    unusable = _unusable(models, known, settings, last.experiment) if settings else {}
    return History(bag.path, bag.namespace, known, terms, models, last, unusable)


def _unusable(
    models: Mapping[int, ModelRecord],
    machine: Machine,
    settings: Mapping[str, Any],
    experiment: Experiment,
) -> dict[int, str]:
    """Versions that cannot predict an experiment, each with the reason."""
    found = {}
    for version, record in models.items():
        try:
            try_out(restore_model(record, machine, settings), experiment)
        except ModelError as error:
            found[version] = str(error)
    return found


def roll_back(found: History, version: int) -> Adaptation:
    """Record that the run goes on with an earlier model.

    Returns:
        What was recorded.

    Raises:
        OptionError: no such version, the one in force, or one that cannot be used.
        RecordingError: somebody is writing, or the recording ends in the middle of a step.
        LdtError: it cannot be mended or written.
    """
    there = [r.version for r in found.terms]
    if version == there[-1] or version not in there or version not in found.models:
        choices = ", ".join(str(v) for v in sorted({*there[:-1]} & {*found.models})) or "none"
        got = f"{version}, which is in use" if version == there[-1] else str(version)
        raise OptionError("--to", f"a version that was in use before ({choices})", got)
    if version in found.unusable:
        sound = [v for v in there[:-1] if v in found.models and v not in found.unusable]
        choices = ", ".join(map(str, sorted({*sound}))) or "none"
        told = f"{version}, which cannot be used ({found.path}, {found.unusable[version]})"
        raise OptionError("--to", f"a version that can be used ({choices})", told)
    done = found.last.number
    run = RecordedRun(found.path, found.namespace or "/", found.machine)
    for topic in ANSWERS:
        if run.last_of(topic, done)[0] != done:
            expected = f"a recording that ends with experiment {done}; let --resume complete it"
            raise RecordingError(found.path, expected, f"the {topic} of another one behind it")
    return _go_back(found, found.models[version], "rolled back by hand:")


def withdraw(run: RecordedRun, settings: Mapping[str, Any]) -> list[str]:
    """Go back from the version in force to the last one that can be used, where it cannot.

    A run that went on with it would answer no experiment any more.

    Args:
        settings: all parameters of the run.

    Returns:
        What was recorded, in a sentence; none where the version in force can be used.

    Raises:
        LdtError: the recording cannot be mended or written.
    """
    steps = deque(run.steps(END), maxlen=WINDOW)
    if not steps or (version := steps[-1].adaptation.model_version) == 0:
        return []
    bag = run.bag()
    assert bag is not None  # it has steps
    try:
        try_out(Lookup(bag, run.machine, settings, steps).model(version), steps[-1].experiment)
        return []
    except ModelError as error:
        why = f"{run.path}, {error};"
    found = _history(bag, run.machine, settings)
    before = {t.version for t in found.terms} & {*found.models} - {*found.unusable, version}
    original = build_model(settings["model"], run.machine, settings).record()
    return [_go_back(found, found.models[max(before)] if before else original, why).reason]


def _go_back(found: History, to: ModelRecord, why: str) -> Adaptation:
    """Record that a model goes on as the next version."""
    model = replace(to, version=max(found.models) + 1)
    reason = (
        f"{why} version {model.version} is version {to.version} again, "
        f"in the place of version {found.terms[-1].version}"
    )
    details = {ROLLED_BACK: to.version}
    adaptation = Adaptation(found.last.number, Action.ADAPTED, model.version, reason, details)
    bag = read_bag(found.path, found.namespace or "/")
    information = bag.storage.metadata
    begin = information["starting_time"]["nanoseconds_since_epoch"]
    end = (begin + information["duration"]["nanoseconds"]) * NANOSECOND
    with BagWriter(found.path, found.machine.name, found.namespace, resume=True) as writer:
        writer.write("model", model, end)
        writer.write("adaptation", adaptation, end)
    return adaptation


def _recorded_machine(bag: Bag) -> str:
    name = bag.settings().get("machine")
    if name is None:
        expected = "the recording of a run (of ldt run, up or replay), with its settings"
        raise RecordingError(bag.path, expected, "one without")
    if name not in msgs_config.machine_names():
        told = f"{quoted(str(name))} to be given again: no file is read on a recording's word"
        raise OptionError("--machine", told, "nothing")
    return str(name)


def _term(told: Adaptation, model: ModelRecord) -> ModelTerm:
    before, after = told.details.get("present_rmse"), told.details.get("candidate_rmse")
    return ModelTerm(
        model.version, told.experiment, len(model.trained_on), before, after, told.reason
    )
