"""How a stage comes to where the recording of its run ends, in a run without ROS and in a node."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import msgs_config
from ldt_core.base.errors import ExperimentError, LdtError, RecordingError
from ldt_core.base.experiment import Experiment
from ldt_core.recording.message_subject import Subject
from ldt_core.restart.checkpoint import Checkpoint, CheckpointFiles, Lookup, fingerprint
from ldt_core.restart.recorded_run import RecordedRun
from ldt_core.restart.run_key import key_text
from ldt_core.twin.adaptor import ROLLED_BACK
from ldt_core.twin.loop import Twin
from ldt_core.twin.numbering import Numbering
from ldt_core.twin.stage import WINDOW, RecordedStep, Stage

#: Groups of parameters from which a stage's state follows, beside machine and versions.
GROUPS = {
    "detector": ("detector",),
    "adaptor": ("model", "adaptor", "diagnosis"),
    "diagnoser": ("diagnosis",),
    "advisor": ("model", "advice"),
}


class StageRestart:
    """Brings one stage to where its recording ends: by a checkpoint, and the steps since.

    First `return_to_checkpoint`, then `recall` for each recorded step, then `passed` for each
    experiment that the stage has dealt with.

    Args:
        role: of its node, one of `GROUPS`.
        run: its recording; with the path "" nothing is kept.
        settings: parameters of the stage's groups at least; `checkpoint_every` says how often.

    Attributes:
        known: number of the step whose checkpoint the stage has returned to, 0 without any.
    """

    def __init__(
        self,
        stage: Stage,
        role: str,
        run: RecordedRun,
        settings: Mapping[str, Any],
        log: Callable[[str], None],
    ) -> None:
        self.stage, self.role, self.run, self.settings = stage, role, run, settings
        self.known = 0
        self._until: Subject | None = None  # number and start of that step, before it comes
        self._log = log
        own = {n: settings[n] for n in msgs_config.parameters(*GROUPS[role]) if n in settings}
        key = [key_text(run.machine, own), run.namespace.strip("/"), role, own]
        self.files = CheckpointFiles(run.path, role, key, log)
        self._every: int = settings.get("checkpoint_every", 0) if str(run.path) else 0
        self._since = 0  # experiments after the last checkpoint

    def return_to_checkpoint(self) -> int:
        """Return to the newest checkpoint that counts; `known`."""
        for checkpoint in self.files.read() if self._every else ():
            try:
                self.stage.return_to(checkpoint.state, self._lookup(checkpoint))
            except (LdtError, OSError, ValueError, TypeError, KeyError, AttributeError) as error:
                where = f"the checkpoint of the {self.role} at {checkpoint.experiment}"
                self._log(f"{where} is ignored, the recording decides: {error}")
            else:
                self.known = checkpoint.experiment
                self._until = checkpoint.experiment, checkpoint.start
                break
        return self.known

    def covers(self, step: RecordedStep) -> bool:
        """Whether the stage has returned to this step of the recording, or a later one.

        To be asked of each step that comes, in their order, and once.
        """
        if self._until is None:
            return False
        if self._until == (step.number, step.experiment.start):
            self._until = None
        return True

    def recall(self, step: RecordedStep) -> None:
        """Let the stage recall a step that it has not returned to."""
        self.stage.recall(step)
        if ROLLED_BACK not in step.adaptation.details:
            self.passed(step.experiment)

    def passed(self, experiment: Experiment) -> None:
        """The stage has dealt with an experiment for good: keep a checkpoint if it is time."""
        self._since += 1
        if not self._every or self._since < self._every:
            return
        self._since = 0
        state = self.stage.state()
        if state is None:
            self._every = 0
            return
        try:
            speed = fingerprint(experiment)
            self.files.write(Checkpoint(experiment.number, experiment.start, speed, state))
        except (OSError, TypeError, ValueError) as error:
            self._every = 0
            self._log(f"no checkpoints of the {self.role} are kept: {error}")

    def _lookup(self, checkpoint: Checkpoint) -> Lookup:
        """What leads to that step, which has to be in the recording and the very same."""
        number, path = checkpoint.experiment, self.run.path
        before: deque[RecordedStep] = deque(maxlen=WINDOW)
        for step in self.run.steps(number):
            before.append(step)
            if (step.number, step.experiment.start) == (number, checkpoint.start):
                break
        else:
            raise RecordingError(path, f"step {number} at {checkpoint.start}, complete", "none")
        bag = self.run.bag(listed=True)
        other = fingerprint(before[-1].experiment) != checkpoint.speed
        if bag is None or other or ROLLED_BACK in before[-1].adaptation.details:
            raise RecordingError(path, f"the same step {number}", "another")
        return Lookup(bag, self.run.machine, self.settings, before)


class TwinRestart:
    """Brings a twin, all its stages, to where its recording ends.

    Args:
        twin: whose settings say how often checkpoints are kept.
    """

    def __init__(self, twin: Twin, run: RecordedRun, log: Callable[[str], None]) -> None:
        self._twin, self._run, self._log = twin, run, log
        self._last: Experiment | None = None
        self._count = 0  # of the steps that were read
        self._stages = [
            StageRestart(stage, role, run, twin.settings, log)
            for role, stage in twin.stages.items()
        ]

    def resume(self) -> int:
        """Bring the twin to where its recording ends; number of the last step, 0 without any.

        Raises:
            RecordingError: a recording that cannot be read, or that this twin cannot have made.
            ModelError: nobody can use the version in force (see `rollback.withdraw`).
        """
        for step in self._run.steps(*[r.return_to_checkpoint() for r in self._stages]):
            self._last, self._count = step.experiment, self._count + 1
            self.recall(step)
        adaptor = self._twin.adaptor
        if error := adaptor.unusable.get(adaptor.model.version):
            raise error
        for why in adaptor.unusable.values():
            self._log(f"{self._run.path}, {why}; the version before it stands in its place")
        return self._last.number if self._last else 0

    def following(
        self, experiments: Iterable[Experiment], rejected: Callable[[LdtError], None]
    ) -> Iterator[Experiment]:
        """The experiments of the run that come after the last recorded step.

        Their numbers do not tell: a counter may have begun anew. So all that came before are let
        pass as the twin let them pass, until the last one comes; it refuses the next ones then as
        if nothing had happened.

        Args:
            experiments: all of the run from the first on, or those that follow alone.
            rejected: told of those that were refused before, once more.

        Raises:
            RecordingError: the last step's experiment is not among them.
        """
        stream, last = iter(experiments), self._last
        if last is None:
            yield from stream
            return
        numbering, passed = Numbering(), 0
        for index, one in enumerate(stream):
            if index == 0 and one.number > last.number and one.start > last.start:
                yield one
                break
            try:
                self._run.machine.check(one)
                numbering.admit(one)
            except ExperimentError as error:
                rejected(error)
                continue
            passed += 1
            # One that is sent twice, far apart, is the last one where enough came before it.
            if passed >= self._count and (one.number, one.start) == (last.number, last.start):
                self._twin.predictor.numbering = numbering
                break
        else:
            expected = f"experiment {last.number}, with which {self._run.path} ends, among those"
            raise RecordingError("the experiments of the run", expected, "others")
        yield from stream

    def recall(self, step: RecordedStep) -> None:
        """Take over what a recorded step says; raises as `resume`."""
        self._twin.predictor.recall(step)
        for restart in self._stages:
            if not restart.covers(step):
                restart.recall(step)
        self._twin.predictor.model = self._twin.adaptor.model

    def passed(self, experiment: Experiment) -> None:
        """The twin has taken an experiment."""
        for restart in self._stages:
            restart.passed(experiment)
