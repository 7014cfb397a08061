"""Claims about places: a gap that lies somewhere is found there."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from recorded_machines import NOISE, ROTOR, record, steps

from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.gap_location import BAND_POWER, NAMED_LIFT, places, steady_places
from ldt_core.diagnosis.residual_torque import added_torque, residual_torque
from ldt_core.effects import get_effect
from ldt_core.physics.effect import Effect
from ldt_core.physics.parameter import Parameter

SIZE = 0.4  # N m, a twelfth of the rotor's stall torque


def confined(name, torque):
    """An effect of one's own that acts in a range only."""
    size = Parameter("torque", "N m", 0.0, default=0.0, description="size", scale=0.1)
    return (
        Effect(
            name=name,
            description="acts in a range only",
            equation="torque = -T inside",
            parameters=(size,),
            typical={"torque": SIZE},
            torque=torque,
        ),
        {"torque": SIZE},
    )


def at_speeds(t, theta, omega, current, voltage, p):
    return -p[0] if 18.0 < omega < 30.0 else 0.0


def at_voltages(t, theta, omega, current, voltage, p):
    return -p[0] if 5.0 < voltage < 10.0 else 0.0


def at_times(t, theta, omega, current, voltage, p):
    return -p[0] if 2.0 < t < 4.5 else 0.0


def turning(t, theta, omega, current, voltage, p):
    return -p[0] * math.sin(2 * math.pi * 1.5 * t)


def found(*recordings):
    """Places of all experiments together, by quantity."""
    experiments = [e for recording in recordings for e in recording]
    residuals = FreeRunResiduals(ROTOR, experiments, (NOISE, 1.0))
    return places(residual_torque(residuals))


def overlap(place, begin, end):
    """Intersection over union."""
    both = min(place.end, end) - max(place.begin, begin)
    return both / (max(place.end, end) - min(place.begin, begin))


def named(named_places, quantity):
    (place,) = [p for p in named_places if p.quantity == quantity]
    return place


def made(effect, **changed):
    return record(ROTOR, effect, **{"volts": (2.0, 16.0), "samples": 800, **changed})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("quantity", "torque", "begin", "end"),
    [
        ("speed", at_speeds, 18.0, 30.0),
        ("voltage", at_voltages, 5.0, 10.0),
        ("time", at_times, 2.0, 4.5),
    ],
)
def test_the_range_in_which_an_effect_acts_is_found(quantity, torque, begin, end):
    """Overlapping the true one by half, and holding most of the gap in less of the data."""
    listed = found(made(confined(f"at_some_{quantity}", torque), count=4))
    place = named(listed, quantity)
    assert overlap(place, begin, end) >= 0.5
    assert BAND_POWER <= place.share_of_gap <= 1.0
    assert place.share_of_data <= place.share_of_gap - NAMED_LIFT
    assert listed[0].quantity == quantity


@pytest.mark.slow
def test_the_experiments_in_which_it_acts_are_found():
    """The last three of eight."""
    right = record(ROTOR, count=5, volts=(2.0, 16.0))
    wrong = record(ROTOR, "coulomb_friction:torque=0.2", count=3, volts=(2.0, 16.0), seed=2)
    numbered = [type(e)(k + 6, e.start, e.period, e.voltage, e.speed) for k, e in enumerate(wrong)]
    place = named(found(right, numbered), "experiment")
    assert (place.begin, place.end) == (6, 8)
    assert place.share_of_data == pytest.approx(3 / 8)


@pytest.mark.slow
def test_the_frequency_at_which_it_acts_is_found():
    """1.5 Hz, where the speed itself hardly moves."""
    effect = confined("shaken", turning)
    random = np.random.default_rng(3)
    levels = [steps(random, 800, 6.0, 12.0, 400) for _ in range(3)]
    place = named(found(record(ROTOR, effect, samples=800, levels=levels)), "frequency")
    assert place.begin <= 1.5 <= place.end
    assert place.end - place.begin < 1.0
    assert place.unit == "Hz"


@pytest.mark.slow
def test_a_gap_that_lies_everywhere_alike_has_one_place_that_is_everything():
    """A load pulls at every speed, voltage and time."""
    experiments = record(ROTOR, "constant_load:torque=0.3", volts=(2.0, 16.0), samples=800)
    (place,) = found(experiments)
    assert (place.quantity, place.share_of_gap, place.share_of_data) == ("speed", 1.0, 1.0)
    speed = np.concatenate([e.speed for e in experiments])
    assert place.begin == pytest.approx(speed.min(), abs=4 * NOISE)
    assert place.end == pytest.approx(speed.max(), abs=4 * NOISE)


def test_the_torque_of_an_effect_is_read_off_the_residual():
    """A constant load's, within 5 % on average."""
    residuals = FreeRunResiduals(
        ROTOR, record(ROTOR, "constant_load:torque=0.3", volts=(2.0, 16.0)), (NOISE, 1.0)
    )
    wrong = residual_torque(residuals)
    assert float(np.mean(wrong.torque)) == pytest.approx(-0.3, rel=0.05)


def test_the_noise_alone_has_no_power():
    """What is left of a right model is no more than what its noise makes."""
    residuals = FreeRunResiduals(ROTOR, record(ROTOR), (NOISE, 1.0))
    power = residual_torque(residuals).power
    assert abs(float(power.mean())) < 0.3 * float(np.mean(residual_torque(residuals).noise ** 2))


def both_ways(t, theta, omega, current, voltage, p):
    return -p[0] * (1.0 if omega > 0 else -1.0) if 12.0 < abs(omega) < 20.0 else 0.0


@pytest.mark.slow
def test_what_lies_at_the_same_speeds_in_both_directions_is_two_ranges():
    """One for each direction, and both right."""
    effect = confined("both_ways", both_ways)
    listed = found(made(effect, count=6, volts=(-14.0, 14.0), hold=120))
    ranges = [(p.begin, p.end) for p in listed if p.quantity == "speed"]
    assert len(ranges) == 2
    assert {b > 0 for b, _ in ranges} == {True, False}
    for p in (p for p in listed if p.quantity == "speed"):
        low, high = sorted((abs(p.begin), abs(p.end)))
        assert (min(high, 20.0) - max(low, 12.0)) / (max(high, 20.0) - min(low, 12.0)) >= 0.5


@pytest.mark.slow
def test_a_named_effect_lies_where_it_acts_not_where_the_recording_was():
    """Only a fortieth of the samples reach the limit of the supply; all of its place is there."""
    limit = {"limit": 13.0}
    effect = get_effect("voltage_saturation")
    experiments = made((effect, limit), volts=(2.0, 14.0), count=6)
    residuals = FreeRunResiduals(ROTOR, experiments, (NOISE, 1.0))
    (first, *_) = places(added_torque(residuals, [], [(effect, limit)]))
    assert first.quantity == "voltage"
    assert 12.9 < first.begin < 13.4
    assert first.share_of_gap > BAND_POWER
    assert first.share_of_data < 0.3


def resonant(t, theta, omega, current, voltage, p):
    return -p[0] * math.exp(-(((omega - 24.0) / 2.0) ** 2))


@pytest.mark.slow
def test_a_narrow_place_that_a_recording_runs_past_is_found_as_narrow_as_it_is():
    """A drag around 24 rad/s: not blurred by the time in which the motor answers."""
    listed = found(made(confined("resonant", resonant), count=6, hold=160))
    place = named(listed, "speed")
    assert overlap(place, 21.0, 27.0) >= 0.7
    assert listed[0].quantity == "speed"


def rippled(t, theta, omega, current, voltage, p):
    return p[0] * (math.sin(6.0 * theta) - (1.0 if 20.0 < omega < 26.0 else 0.0))


@pytest.mark.slow
def test_a_ripple_everywhere_hides_no_place():
    """As large as what acts there, it has no mean."""
    effect = confined("rippled", rippled)
    experiments = made(effect, count=6, hold=160)
    residuals = FreeRunResiduals(ROTOR, experiments, (NOISE, 1.0))
    listed = places(added_torque(residuals, [], [effect]))
    assert overlap(named(listed, "speed"), 20.0, 26.0) >= 0.5


def limited(t, theta, omega, current, voltage, p):
    return -4 * p[0] * max(0.0, omega - 34.0)


@pytest.mark.slow
def test_a_narrow_range_at_the_top_is_found_at_the_top():
    """Not over all the speeds that the machine passes through on its way there."""
    listed = found(made(confined("limited", limited), count=6, volts=(2.0, 18.0)))
    place = named(listed, "speed")
    assert place.begin == pytest.approx(34.0, abs=1.0)


@pytest.mark.slow
def test_a_weak_range_is_not_narrowed_by_noise():
    """Half of what is there, at least, at a torque of a few deviations."""
    size = 0.05
    effect = (confined("weak", at_speeds)[0], {"torque": size})
    place = named(found(record(ROTOR, effect, count=6, volts=(2.0, 16.0), samples=800)), "speed")
    assert overlap(place, 18.0, 30.0) >= 0.5


def test_an_unbalance_acts_at_its_resonances_however_it_was_run():
    """Run through quickly it shows above them; a steady shaft would feel it from 16 to 31 rad/s."""
    experiments = record(ROTOR, volts=(15.0, 16.0), count=3, samples=600, hold=600)
    residuals = FreeRunResiduals(ROTOR, experiments, (NOISE, 1.0))
    use = [(get_effect("unbalance"), {"e": 0.004})]
    (place,) = steady_places(added_torque(residuals, (), use), use)
    assert place.steady
    assert overlap(place, 16.0, 31.0) >= 0.8
    assert (
        steady_places(residual_torque(residuals), [(get_effect("constant_load"), {"torque": 0.1})])
        == []
    )


def test_a_parameter_called_e_is_no_foundation():
    """A physics of one's own may have one: nothing of it shakes."""
    values = {"J": 0.02, "e": 1.0}
    residuals = SimpleNamespace(changed=lambda use: values, values=values)
    found = SimpleNamespace(residuals=residuals, over={"speed": np.array([0.0, 30.0])})
    assert steady_places(found, []) == []
