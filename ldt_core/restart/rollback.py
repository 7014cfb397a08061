"""Going back to an earlier model by hand: which there were in a recording, and which goes on.

Nothing is deleted. The earlier model is recorded once more under the next version, with an
adaptation that says so, behind the last step; a run that goes on with the recording begins with it.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path

import msgs_config
from ldt_core.base.errors import OptionError, RecordingError
from ldt_core.base.experiment import FAULTY, Action, Adaptation, ModelRecord
from ldt_core.machine.machine_file import Machine, load_machine
from ldt_core.recording.bag import Bag, read_bag
from ldt_core.recording.health import ANSWERS
from ldt_core.recording.messages import quoted
from ldt_core.recording.writer import BagWriter
from ldt_core.restart.recorded_run import RecordedRun, complete_steps
from ldt_core.restart.run_key import check_key
from ldt_core.twin.adaptor import ROLLED_BACK
from ldt_core.twin.stage import RecordedStep

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
    """

    path: Path
    namespace: str
    machine: Machine
    terms: list[ModelTerm]
    models: dict[int, ModelRecord]
    last: RecordedStep

    def as_dict(self) -> dict[str, object]:
        """For programs."""
        return {"in_force": self.terms[-1].version, "versions": [asdict(r) for r in self.terms]}


def history(path: str | Path, namespace: str = "", machine: str = "") -> History:
    """The models of a run.

    Args:
        namespace: of the machine, "" when there is only one.
        machine: file or name of the machine; "" takes the recorded name.

    Raises:
        RecordingError: no recording of a run, or one of another machine or version.
        OptionError: the recorded machine is a file, which has to be given.
        MachineFileError: no such machine.
    """
    bag = read_bag(path, namespace)
    known = load_machine(machine or _recorded_machine(bag))
    check_key(bag, known)
    models: dict[int, ModelRecord] = {}
    for record in bag.rare("model"):
        models.setdefault(record.version, record)
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
    return History(bag.path, bag.namespace, known, terms, models, last)


def roll_back(found: History, version: int) -> Adaptation:
    """Record that the run goes on with an earlier model.

    Returns:
        What was recorded.

    Raises:
        OptionError: no such version, or the one in force.
        RecordingError: somebody is writing, or the recording ends in the middle of a step.
        LdtError: it cannot be mended or written.
    """
    there = [r.version for r in found.terms]
    if version == there[-1] or version not in there or version not in found.models:
        choices = ", ".join(str(v) for v in sorted({*there[:-1]} & {*found.models})) or "none"
        got = f"{version}, which is in use" if version == there[-1] else str(version)
        raise OptionError("--to", f"a version that was in use before ({choices})", got)
    done = found.last.number
    bag = read_bag(found.path, found.namespace or "/")
    run = RecordedRun(found.path, found.namespace or "/", found.machine)
    for topic in ANSWERS:
        if run.last_of(topic, done)[0] != done:
            expected = f"a recording that ends with experiment {done}; let --resume complete it"
            raise RecordingError(found.path, expected, f"the {topic} of another one behind it")
    model = replace(found.models[version], version=max(found.models) + 1)
    adaptation = Adaptation(
        done,
        Action.ADAPTED,
        model.version,
        f"rolled back by hand: version {model.version} is version {version} again, "
        f"in the place of version {there[-1]}",
        {ROLLED_BACK: version},
    )
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
