"""What the versions of a machine's model say of when it has changed."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from ldt_core.base.experiment import Experiment, Prediction
from ldt_core.twin.condition_chain import ConditionChain
from ldt_core.twin.known_versions import KnownVersions

SAMPLES, NOISE = 1000, 0.1  # , rad/s
WAVE = np.sin(np.linspace(0, 40, SAMPLES))


def experiments_of(count):
    """Of a machine that stands still: noise."""
    random = np.random.default_rng(1)
    measured = NOISE * random.standard_normal((count, SAMPLES))
    return [Experiment(k + 1, 10.0 * k, 0.01, np.ones(SAMPLES), y) for k, y in enumerate(measured)]


class Erring:
    """A model that leaves noise, and in some experiments a wave of so many of its deviations."""

    kind = "erring"

    def __init__(self, version, by):
        self.version, self.parameters, self._by = version, {"by": by}, by

    def predict(self, e):
        speed = NOISE * self._by.get(e.number, 0.0) * WAVE
        return Prediction(e.number, e.start, e.period, self.version, speed)


def changed_from(before, after, experiments, learned):
    """What `_changed_from` says of the newest of these experiments."""
    versions = object.__new__(KnownVersions)
    versions.model, versions.earlier = after, [before]
    versions.original, versions.learned_from = before, learned
    return versions._changed_from(before, experiments[:-1], experiments[-1])


def test_a_machine_has_changed_if_what_lies_between_speaks_for_the_version_before():
    """The new version explains what taught the one before, but fails between, where that one was
    right.
    """
    experiments = experiments_of(8)
    before = Erring(1, {8: 2.0})
    fails = Erring(2, {4: 1.0, 7: 1.5})
    right = Erring(2, {})
    assert changed_from(before, right, experiments, experiments[:1])[1:] == (experiments[0], True)
    assert changed_from(before, fails, experiments, experiments[:1])[1:] == (experiments[7], False)


def test_a_machine_that_was_repaired_once_does_not_change_often():
    """Its first experiment hardly excites it, so that the version of the fault hardly errs there;
    the fault lasted ten experiments, and the original errs far more in these.
    """
    experiments = experiments_of(20)
    original = Erring(0, dict.fromkeys(range(10, 20), 1000.0))
    fault = Erring(1, {**dict.fromkeys(range(1, 10), 1000.0), 20: 80.0})
    versions = object.__new__(KnownVersions)
    versions.model, versions.earlier, versions.original = fault, [original], original
    versions.followed, versions.watch = fault, SimpleNamespace(trails=False)
    versions.chain = ConditionChain()
    for e in experiments[:-1]:
        versions.chain.saw(0 if e.number < 10 else 1, e)
    assert versions._foreseen(original, experiments[-1]) is original
