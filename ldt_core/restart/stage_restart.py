"""How a stage comes to where the recording of its run ends, in a run without ROS and in a node."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

import msgs_config
from ldt_core.base.errors import LdtError, RecordingError
from ldt_core.base.experiment import Experiment
from ldt_core.restart.checkpoint import Checkpoint, CheckpointFiles, Lookup
from ldt_core.restart.recorded_run import RecordedRun
from ldt_core.restart.run_key import key_text
from ldt_core.twin.adaptor import ROLLED_BACK
from ldt_core.twin.loop import Twin
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
        self._log = log
        own = {n: settings[n] for n in msgs_config.parameters(*GROUPS[role]) if n in settings}
        key = [key_text(run.machine), run.namespace.strip("/"), role, own]
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
                break
        return self.known

    def recall(self, step: RecordedStep) -> None:
        """Let the stage recall a step, unless it has returned to a later one."""
        if step.number <= self.known:
            return
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
            self.files.write(Checkpoint(experiment.number, experiment.start, state))
        except (OSError, TypeError, ValueError) as error:
            self._every = 0
            self._log(f"no checkpoints of the {self.role} are kept: {error}")

    def _lookup(self, checkpoint: Checkpoint) -> Lookup:
        """What leads to that step, which has to be in the recording and the very same."""
        number, path = checkpoint.experiment, self.run.path
        before: deque[RecordedStep] = deque(maxlen=WINDOW)
        for step in self.run.steps(number):
            before.append(step)
            if step.number >= number:
                break
        bag = self.run.bag(listed=True)
        last = before[-1] if before else None
        if last is None or bag is None or last.number != number:
            raise RecordingError(path, f"step {number}, complete", "none")
        if last.experiment.start != checkpoint.start or ROLLED_BACK in last.adaptation.details:
            raise RecordingError(path, f"the same step {number}", "another")
        return Lookup(bag, self.run.machine, self.settings, before)


class TwinRestart:
    """Brings a twin, all its stages, to where its recording ends.

    Args:
        twin: whose settings say how often checkpoints are kept.
    """

    def __init__(self, twin: Twin, run: RecordedRun, log: Callable[[str], None]) -> None:
        self._twin, self._run = twin, run
        self._stages = [
            StageRestart(stage, role, run, twin.settings, log)
            for role, stage in twin.stages.items()
        ]

    def resume(self) -> int:
        """Bring the twin to where its recording ends; number of the last step, 0 without any.

        Raises:
            RecordingError: a recording that cannot be read, or that this twin cannot have made.
            ModelError: a recorded model that cannot be this machine's.
        """
        last = 0
        least = min([restart.return_to_checkpoint() for restart in self._stages])
        for step in self._run.steps(least):
            last = step.number
            self.recall(step)
        return last

    def recall(self, step: RecordedStep) -> None:
        """Take over what a recorded step says; raises as `resume`."""
        self._twin.predictor.recall(step)
        for restart in self._stages:
            restart.recall(step)
        self._twin.predictor.model = self._twin.adaptor.model

    def passed(self, experiment: Experiment) -> None:
        """The twin has taken an experiment."""
        for restart in self._stages:
            restart.passed(experiment)
