"""What was recorded in a run, without a recording."""

from __future__ import annotations

from ldt_core.base.errors import RecordingError


class FakeArchive:
    """Finds what it was given, by its number.

    Args:
        experiments: of the run.
        models: that were in force.
        diagnoses: that were made.
    """

    def __init__(self, experiments=(), models=(), diagnoses=()):
        self.steps = []
        self._experiments = {(e.number, e.start): e for e in experiments}
        self._models = {m.version: m for m in models}
        self._diagnoses = {d.experiment: d for d in diagnoses}

    def experiment(self, number, start):
        return _found(self._experiments, (number, start))

    def model(self, version):
        return _found(self._models, version)

    def diagnosis(self, number):
        return _found(self._diagnoses, number)


def _found(records, key):
    if key not in records:
        raise RecordingError("the run", str(key), "none")
    return records[key]
