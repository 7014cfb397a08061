"""The sample recording is what `bags/README.md` says, for us and for a reader that is not ours."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ldt_core.base.metrics import Summary
from ldt_core.base.settings import resolve
from ldt_core.machine.machine_file import load_machine
from ldt_core.models.physics import PhysicsModel
from ldt_core.recording.bag import read_bag
from ldt_core.runs.offline import recorded_summary, run

BAGS = Path(__file__).resolve().parents[1] / "bags"
SAMPLE = BAGS / "rotor_drift"


@pytest.fixture(scope="module")
def summary() -> Summary:
    recorded = Summary()
    recorded_summary(SAMPLE, "", load_machine("rotor"), recorded)
    return recorded


def test_it_is_small():
    """Under 3 MB."""
    assert sum(f.stat().st_size for f in SAMPLE.iterdir()) < 3_000_000


def test_its_figures_are_those_of_its_description(summary):
    """Read back from the recording."""
    assert summary.notes == []
    text = " ".join((BAGS / "README.md").read_text().split())
    assert f"MME {summary.mme:.3f} rad/s for the twin" in text
    assert f"{summary.mme_original:.3f} for the original model" in text
    signals = f"{summary.negatives} negative, {summary.warnings} warnings, {summary.positives}"
    assert f"{signals} positive" in text
    assert f"{summary.adaptations} adaptations, {summary.refusals} new models refused" in text


def test_its_predictions_by_the_physics_come_again():
    """To the rounding of another processor's mathematics."""
    model = PhysicsModel(load_machine("rotor"))
    bag = read_bag(SAMPLE)
    originals = {p.number: p for p in bag.records("original_prediction")}
    for experiment in bag.experiments():
        expected = originals[experiment.number].speed
        np.testing.assert_allclose(model.predict(experiment).speed, expected, rtol=1e-9, atol=1e-9)


def test_its_replay_gives_its_figures(summary):
    """The same model and detector on the same experiments; see `bags/README.md` on last digits."""
    again = run(
        load_machine("rotor"),
        resolve({"model": "hybrid", "detector": "threshold"}),
        read_bag(SAMPLE).experiments(),
        None,
    )
    assert again.mme == pytest.approx(summary.mme, rel=0.05)
    assert again.mme_original == pytest.approx(summary.mme_original, rel=1e-6)


def test_another_reader_reads_it():
    """`rosbags` finds the same experiments."""
    highlevel = pytest.importorskip("rosbags.highlevel")
    with highlevel.AnyReader([SAMPLE]) as reader:
        wanted = [c for c in reader.connections if c.topic == "/experiment"]
        read = [reader.deserialize(d, c.msgtype) for c, _, d in reader.messages(wanted)]
    ours = list(read_bag(SAMPLE).experiments())
    assert len(read) == len(ours) == 40
    for message, experiment in zip(read, ours, strict=True):
        np.testing.assert_array_equal(message.data[3::2], experiment.voltage)
        np.testing.assert_array_equal(message.data[4::2], experiment.speed)
