"""A twin that keeps checkpoints beside its recording, and goes on from them and the recording."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ldt_core.base.experiment import Experiment
from ldt_core.restart.checkpoint import Checkpoints
from ldt_core.restart.recorded_steps import past_of
from ldt_core.twin.adaptor import ROLLED_BACK
from ldt_core.twin.loop import Twin


class Kept:
    """The checkpoints of all stages of a twin.

    Args:
        twin: whose settings say how often.
        folder: of the recording, "" where there is none.
        namespace: of the machine in it.
        log: told what is ignored, or cannot be kept.
    """

    def __init__(
        self, twin: Twin, folder: str | Path, namespace: str, log: Callable[[str], None]
    ) -> None:
        self._twin, self._folder, self._namespace = twin, folder, namespace
        machine, settings = twin.predictor.machine, twin.settings
        self._of = {
            name: Checkpoints(folder, namespace, machine, name, settings, log)
            for name in twin.stages
        }

    def recall(self) -> int:
        """Bring the twin to where its recording ends; number of the last step, 0 without any.

        Raises:
            RecordingError: a recording that cannot be read, or that this twin cannot have made.
            ModelError: a recorded model that cannot be this machine's.
        """
        twin, last = self._twin, 0
        stages = twin.stages.items()
        known = {n: self._of[n].returned(self._folder, stage.return_to) for n, stage in stages}
        least = min(known.values())
        machine = twin.predictor.machine
        for step in past_of(self._folder, self._namespace, machine, least):
            last = step.experiment.number
            if last <= least:
                twin.predictor.recall(step, None)
                continue
            twin.recall(step, known)
            if ROLLED_BACK not in step.adaptation.details:
                self.passed(step.experiment, known)
        twin.predictor.model = twin.adaptor.model
        return last

    def passed(self, experiment: Experiment, known: dict[str, int] | None = None) -> None:
        """The twin has taken an experiment; of the stages that had not before."""
        for name, stage in self._twin.stages.items():
            if experiment.number > (known or {}).get(name, 0):
                self._of[name].passed(experiment, stage.mark)
