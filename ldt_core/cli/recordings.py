"""Recordings as commands read them: what is odd about one goes to standard error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ldt_core.base.experiment import Experiment
from ldt_core.cli.terminal import warn
from ldt_core.machine.machine_file import Machine
from ldt_core.recording.bag import read_bag


def read_recordings(
    recordings: Sequence[str], namespace: str, machine: Machine | None = None
) -> list[Experiment]:
    """Experiments of all recordings.

    Args:
        recordings: folders or files; those of several are numbered on from one to the next.
        namespace: machine whose topics are meant.
        machine: whose limits the experiments must keep; None when it is not known.

    Raises:
        RecordingError: a recording that cannot be read.
        ExperimentError: an experiment outside the machine's limits.
    """
    found: list[Experiment] = []
    for recording in recordings:
        bag = read_bag(recording, namespace)
        for experiment in bag.experiments(machine):
            numbered = len(recordings) > 1
            found.append(replace(experiment, number=len(found) + 1) if numbered else experiment)
        warn(*bag.notes)
    return found
