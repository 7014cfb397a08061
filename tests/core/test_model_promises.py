"""Every kind of model that learns keeps the promises of `ldt_core.models.base.Model`."""

from __future__ import annotations

import functools
import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from ldt_core.base.experiment import ModelRecord
from ldt_core.base.settings import resolve
from ldt_core.effects import parse_effect
from ldt_core.machine.machine_file import load_machine
from ldt_core.machine.plant import Plant
from ldt_core.models import build_model, restore_model

ROTOR = replace(load_machine("rotor"), duration=4.0)  # s
KINDS = ["linear", "hybrid", "diagnosed", "remainder", "grey_box"]


@functools.cache
def experiment(number):
    acting = [parse_effect("unbalance:e=0.006")]
    return Plant(ROTOR, degradation="none", effects=acting, seed=3).experiment(number)


def untrained(kind):
    return build_model(kind, ROTOR, resolve({"model": kind}, "model"))


@functools.cache
def learned(kind):
    return untrained(kind).fit([experiment(1)])


def bits(prediction):
    return prediction.speed.tobytes().hex(), prediction.speed_std.tobytes().hex()


@pytest.mark.parametrize("kind", KINDS)
def test_a_record_is_the_model_bit_for_bit(kind):
    """Through JSON text and back, to go on learning from as well."""
    record = learned(kind).record()
    plain = json.loads(json.dumps(record.parameters, allow_nan=False))
    sent = ModelRecord(record.version, record.kind, record.trained_on, plain)
    again = restore_model(sent, ROTOR, resolve({"model": kind}, "model"))
    assert bits(again.predict(experiment(2))) == bits(learned(kind).predict(experiment(2)))
    more = [experiment(3)]
    assert again.fit(more).parameters == learned(kind).fit(more).parameters


@pytest.mark.parametrize("kind", KINDS)
def test_only_the_first_measurement_is_read(kind):
    """Later speeds do not change a free run of a machine that stood still.

    Of one that was running they tell the current that nobody measured, and nothing else.
    """
    e = experiment(2)
    other = replace(e, speed=np.where(np.arange(len(e)) == 0, e.speed, 1e3))
    assert bits(learned(kind).predict(e)) == bits(learned(kind).predict(other))


@pytest.mark.parametrize("kind", KINDS)
def test_a_fit_gives_a_new_version_and_leaves_the_old_one(kind):
    """Versions count up, and the experiments are named."""
    before = json.dumps(learned(kind).parameters)
    second = learned(kind).fit([experiment(4)])
    assert (learned(kind).version, second.version, second.trained_on) == (1, 2, (4,))
    assert json.dumps(learned(kind).parameters) == before
    if kind not in ("diagnosed", "grey_box"):  # which begin with what they know
        assert second.parameters == untrained(kind).fit([experiment(4)]).parameters


CHILD = """
import json, sys
sys.path.insert(0, {folder!r})
from test_model_promises import KINDS, bits, experiment, learned
told = {{k: [learned(k).parameters, *bits(learned(k).predict(experiment(2)))] for k in KINDS}}
print(json.dumps([told, "sklearn" in sys.modules]))
"""


@pytest.mark.slow
def test_another_process_gets_the_same_bits_without_scikit_learn():
    """Training and prediction; the import would take a second."""
    command = [sys.executable, "-c", CHILD.format(folder=str(__file__.rpartition("/")[0]))]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    told, slow = json.loads(done.stdout)
    for kind in KINDS:
        there = [learned(kind).parameters, *bits(learned(kind).predict(experiment(2)))]
        assert told[kind] == there, kind
    assert not slow
