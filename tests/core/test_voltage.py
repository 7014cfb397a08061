"""The excitation: seeded, within its levels, and refused when it cannot be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ldt_core.base.errors import MachineFileError
from ldt_core.machine.excitation import KINDS, excitation
from ldt_core.machine.machine_file import load_machine

ROTOR = load_machine("rotor")


def machine(**voltage):
    return replace(ROTOR, simulation={"voltage": voltage})


def volts(given, number=1, samples=2000):
    return given.voltage(samples, 0.01, np.random.SeedSequence([7, number]))


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@given(low=st.floats(-24, 24), span=st.floats(0, 1), samples=st.integers(1, 500))
def test_every_kind_stays_within_its_levels(kind, low, span, samples):
    """Any levels within the machine's limits, any length."""
    high = min(24.0, low + span * (24 - low))
    row = volts(excitation(machine(kind=kind, low=low, high=high)), samples=samples)
    assert row.shape == (samples,)
    assert row.min() >= low - 1e-12
    assert row.max() <= high + 1e-12


def test_steps_are_held_and_uniform():
    """20 levels of 1 s each, spread evenly over 6 to 16 V; another experiment has others."""
    steps = excitation(ROTOR)
    row = volts(steps)
    assert np.array_equal(row, np.repeat(row[::100], 100))
    assert np.unique(row).size == 20
    np.testing.assert_array_equal(volts(steps), row)
    assert not np.array_equal(volts(steps, 2), row)
    levels = np.concatenate([volts(steps, i)[::100] for i in range(100)])
    counts, _ = np.histogram(levels, bins=5, range=(6, 16))
    assert counts.min() > 340  # of 400 expected, standard deviation 18


def test_a_hold_that_is_no_multiple_of_the_period_switches_at_the_next_sample():
    """0.025 s at 100 Hz: levels of three, two, three, two samples."""
    row = volts(excitation(machine(kind="steps", low=0, high=9, hold=0.025)), samples=10)
    assert [int(n) for n in np.flatnonzero(np.diff(row)) + 1] == [3, 5, 8]


def test_a_ramp_goes_there_and_back():
    """From low to high in the first half, back in the second, by equal steps."""
    row = volts(excitation(machine(kind="ramp", low=0, high=24)))
    assert row[0] == 0
    assert row[1000] == 24
    assert row[500] == row[1500] == 12
    np.testing.assert_allclose(np.abs(np.diff(row)), 0.024)


def test_a_chirp_rises_from_its_first_to_its_last_frequency():
    """Zero crossings of the last second come at 4 Hz, those of the first at 1 Hz."""
    chirp = {"kind": "chirp", "low": -2, "high": 6, "from": 1, "to": 4}
    row = volts(excitation(machine(**chirp)), samples=100_000) - 2

    def frequency(part):
        return np.count_nonzero(np.diff(np.sign(part))) / 2 / (part.size * 0.01)

    assert frequency(row[:5000]) == pytest.approx(1.075, abs=0.03)
    assert frequency(row[-5000:]) == pytest.approx(3.925, abs=0.03)


def test_another_kind_keeps_the_levels_of_the_file():
    """`--voltage constant` on a file with steps: one level of 6 to 16 V, new in each experiment."""
    constant = excitation(ROTOR, "constant")
    levels = [volts(constant, i) for i in range(50)]
    assert all(np.ptp(row) == 0 and 6 <= row[0] <= 16 for row in levels)
    assert len({row[0] for row in levels}) == 50


def test_without_a_section_the_middle_of_the_positive_range_is_stepped():
    """Limits -24 to 24 V: 6 to 18 V in twenty steps."""
    plain = excitation(replace(ROTOR, simulation={}))
    assert (plain.kind, plain.low, plain.high, plain.hold) == ("steps", 6, 18, 1)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"kind": "stepz"}, "voltage.kind: expected one of .*did you mean 'steps'"),
        ({"lo": 3}, "expected one of .*'low'.* got unknown key 'lo'"),
        ({"kind": "ramp", "hold": 1}, "unknown key 'hold'"),
        ({"low": -30}, r"voltage.low: expected -24 to 24 V \(the machine's limits\), got -30 V"),
        ({"high": "much"}, "voltage.high: expected a number"),
        ({"low": 9, "high": 3}, "at most high"),
        ({"hold": 0.001}, r"at least the sample period \(0.01 s\)"),
        ({"kind": "chirp", "to": 80}, "half the sample rate"),
    ],
)
def test_what_is_no_excitation_is_refused_with_a_sentence(given, words):
    """Unknown kinds and keys, levels beyond the machine, holds below a sample."""
    with pytest.raises(MachineFileError, match=words):
        excitation(machine(**given))


def test_a_number_that_yaml_reads_as_text_is_a_number():
    """1e-1 without a point, which YAML 1.1 takes for text."""
    assert excitation(machine(kind="steps", hold="1e-1")).hold == 0.1
