"""Recordings far larger than any fit needs: an evenly spread part is worked on, and told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ldt_core.base import evenly_spread as module
from ldt_core.base.evenly_spread import evenly_spread
from ldt_core.base.experiment import Experiment
from ldt_core.calibration import calibrate
from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.effects import get_effect
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine


def blank(number: int, samples: int) -> Experiment:
    """At rest; the voltage counts the samples."""
    return Experiment(number, float(number), 0.01, np.arange(samples) * 1.0, np.zeros(samples))


def test_what_is_not_too_large_is_left_as_it_is():
    """Neither a copy nor a note."""
    given = [blank(n, 100) for n in range(1, 2001)]
    kept, note = evenly_spread(given)
    assert note == ""
    assert all(a is b for a, b in zip(kept, given, strict=True))


@pytest.fixture
def hundredth(monkeypatch: pytest.MonkeyPatch) -> None:
    """All limits a hundredth of what they are, but for the least number of experiments."""
    for name in ("MOST_EXPERIMENTS", "MOST_SAMPLES", "LONGEST"):
        monkeypatch.setattr(module, name, getattr(module, name) // 100)


@pytest.mark.usefixtures("hundredth")
def test_of_many_short_experiments_so_many_as_can_be_borne_are_spread_over_all():
    """One in ten of 200; the note says how many there were."""
    kept, note = evenly_spread([blank(n, 10) for n in range(1, 201)])
    assert len(kept) == 20
    assert set(np.diff([e.number for e in kept])) == {10}
    assert "of 200 experiments of 2000 samples 20 were used" in note


@pytest.mark.usefixtures("hundredth")
def test_of_long_experiments_stretches_are_taken_from_begin_to_end():
    """Three: as many samples as of forty experiments, none longer than theirs."""
    kept, note = evenly_spread([blank(n, 10_000) for n in (1, 2, 3)])
    assert max(len(e) for e in kept) == 500
    assert sum(len(e) for e in kept) <= 20_000
    for number in (1, 2, 3):
        begins = [e.voltage[0] for e in kept if e.number == number]
        assert len(begins) == 13
        assert np.ptp(np.diff(begins)) <= 1.0
        assert (begins[0], begins[-1]) == (0.0, 9500.0)
    assert kept[5].start == pytest.approx(1 + 0.01 * kept[5].voltage[0])
    assert "of 3 experiments of 30000 samples 3 were used" in note


def test_many_long_experiments_have_one_stretch_each_at_different_places(monkeypatch):
    """So that begin and end of an experiment are both seen."""
    monkeypatch.setattr(module, "MOST_SAMPLES", 20_000)
    monkeypatch.setattr(module, "LONGEST", 500)
    kept, _ = evenly_spread([blank(n, 1000) for n in range(1, 101)])
    numbers = [e.number for e in kept]
    assert numbers == sorted(set(numbers))
    assert {len(e) for e in kept} == {500}
    assert (kept[0].voltage[0], kept[-1].voltage[0]) == (0.0, 500.0)


def test_a_part_finds_what_all_of_them_show(monkeypatch):
    """Dry friction in 24 experiments, by ten of them: within its interval, and told."""
    machine = replace(load_machine("dc_motor"), duration=1.0)
    friction = get_effect("coulomb_friction")
    acting = [(friction, {"torque": 0.03})]
    plant = Plant(machine, seed=4, effects=acting, degradation="none")
    made = [plant.experiment(n) for n in range(1, 25)]
    monkeypatch.setattr(module, "MOST_EXPERIMENTS", 10)
    fitted = calibrate(machine, made, free=["b"])
    assert fitted.notes[0].startswith("Of 24 experiments of 2400 samples 10 were used")
    assert sum(map(len, fitted.experiments.values())) == 10
    found = diagnose(machine, made, effects=[friction])
    assert "of 24 experiments of 2400 samples 10 were used" in found.notes[0]
    amount = found.candidates[0].parameters["torque"]
    assert amount.ci95[0] < 0.03 < amount.ci95[1]
