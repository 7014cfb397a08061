"""Claims about positions: an import makes speeds of them that fit the voltage beside them."""

from __future__ import annotations

import numpy as np
import pytest

from ldt_core.base.errors import OptionError, RecordingError
from ldt_core.base.units import TURN, parse_field, propose_fields
from ldt_core.cli import invoke
from ldt_core.cli.import_file import command
from ldt_core.recording.importers import import_file

PERIOD, GAIN, LAG = 0.01, 16.0, 0.05  # s, rad/s per V, s: of a motor of one time constant
RATIO = float(np.exp(-PERIOD / LAG))
COUNTS = 2048  # in a turn


def motor(samples: int = 600, low: float = 4.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(times [s], voltage [V], position [rad]) of that motor: exact, in steps of half a second."""
    time = PERIOD * np.arange(samples)
    volts = np.random.default_rng(1).uniform(low, 12.0, samples // 50 + 1)[np.arange(samples) // 50]
    speed, position = np.zeros(samples + 1), np.zeros(samples + 1)
    for k, level in enumerate(GAIN * volts):
        speed[k + 1] = level + RATIO * (speed[k] - level)
        position[k + 1] = position[k] + level * PERIOD + LAG * (1 - RATIO) * (speed[k] - level)
    return time, volts, position[:-1]


def written(path, *columns, header="t,u,x"):
    rows = np.column_stack(columns)
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.17g")
    return path


def load(path, position="x:rad", **options):
    return import_file(path, **{"voltage": "u", "position": position, "time": "t", **options})


def misfit(experiment) -> float:
    """The largest error with which the true motor foretells a speed from the one before [rad/s]."""
    target = GAIN * experiment.voltage[:-1]
    told = target + RATIO * (experiment.speed[:-1] - target)
    return float(np.abs(experiment.speed[1:] - told).max())


def test_the_speed_fits_the_voltage_beside_it(tmp_path):
    """A difference over two samples is ahead of its voltage, one over the last half late."""
    time, volts, position = motor()
    (one,) = load(written(tmp_path / "x.csv", time, volts, position)).experiments
    assert (one.period, len(one)) == (PERIOD, time.size - 1)
    largest = GAIN * np.abs(np.diff(volts)).max()  # of a step, in rad/s
    assert misfit(one) < 0.006 * largest
    for late in (np.gradient(position, time), np.append(0, np.diff(position)) / PERIOD):
        path = written(tmp_path / "late.csv", time, volts, late)
        (other,) = import_file(path, voltage="u", speed="x:rad/s", time="t").experiments
        assert misfit(other) > 0.04 * largest


def test_counts_of_an_encoder_need_the_number_in_a_turn(tmp_path):
    """What one count means for the speed is told."""
    time, volts, position = motor()
    counts = np.floor(position / TURN * COUNTS)
    loaded = load(written(tmp_path / "x.csv", time, volts, counts), f"x:{COUNTS}/rev")
    (one,) = loaded.experiments
    step = TURN / COUNTS / PERIOD
    assert np.abs(one.speed - np.diff(position) / PERIOD).max() <= step
    assert f"the speed has steps of {step:.3g} rad/s" in " ".join(loaded.notes)
    finer = load(tmp_path / "x.csv", f"x:{COUNTS}/rev", sample_period=0.05).experiments[0]
    assert finer.period == 0.05


@pytest.mark.parametrize(
    ("unit", "shown", "words"),
    [
        ("deg", lambda x: np.degrees(x) % 360, "a turn"),
        ("rad", lambda x: (x + np.pi) % TURN - np.pi, "a turn"),
        ("2048/rev", lambda x: np.floor(x / TURN * COUNTS) % COUNTS, "a turn"),
        ("2048/rev", lambda x: (np.floor(x / TURN * COUNTS) + 2**15) % 2**16 - 2**15, "16 bits"),
    ],
)
def test_a_position_may_begin_again(unit, shown, words, tmp_path):
    """Behind a turn, or as a counter does: the shaft goes on."""
    time, volts, position = motor()
    loaded = load(written(tmp_path / "x.csv", time, volts, shown(position)), f"x:{unit}")
    speed = np.diff(position) / PERIOD
    assert loaded.experiments[0].speed == pytest.approx(speed, abs=TURN / COUNTS / PERIOD)
    assert f"begins again behind {words}" in " ".join(loaded.notes)


def test_a_shaft_that_turns_by_half_a_turn_a_sample_is_warned_of(tmp_path):
    """Its direction is lost there, and no number tells."""
    time, volts, position = motor(low=11.0)
    path = written(tmp_path / "x.csv", time, volts, 1.6 * position % TURN)
    assert "of that between two samples; from a half on" in " ".join(load(path).notes)


def test_a_counter_that_is_set_anew_is_refused(tmp_path):
    """The jump was a speed of thousands of rad/s in one sample."""
    time, volts, position = motor()
    position[300:] -= position[300]
    with pytest.raises(RecordingError, match=r"line 302: expected a position without jumps"):
        load(written(tmp_path / "x.csv", time, volts, position))


def test_a_position_that_is_misread_once_is_refused(tmp_path):
    """It was a speed of thousands of rad/s to and fro."""
    time, volts, position = motor()
    position[300] += 20
    with pytest.raises(RecordingError, match=r"line 302: expected a position without jumps"):
        load(written(tmp_path / "x.csv", time, volts, position))


def test_counts_that_are_four_times_as_many_are_doubted(tmp_path):
    """Both edges of both tracks are counted; the data sheet tells the lines."""
    time, volts, position = motor(low=11.0)
    counts = np.floor(8 * position / TURN * COUNTS)
    (doubt,) = load(written(tmp_path / "x.csv", time, volts, counts), "x:2048/rev").doubts
    assert doubt.endswith("an encoder may give four counts a line")


def test_a_number_that_is_the_counts_of_a_turn_is_doubted(tmp_path):
    """As of all quantities, a number in place of a unit is what one is in SI units."""
    time, volts, position = motor()
    counts = np.floor(position / TURN * COUNTS)
    loaded = load(written(tmp_path / "x.csv", time, volts, counts), "x:2048")
    (doubt,) = loaded.doubts
    assert doubt.endswith("if 2048 counts are a turn: --position x:2048/rev")


def test_over_a_pause_no_speed_is_made(tmp_path):
    """Nor is the voltage's mean taken over it."""
    time, volts, position = motor()
    kept = (np.arange(time.size) < 200) | (np.arange(time.size) >= 230)
    loaded = load(written(tmp_path / "x.csv", time[kept], volts[kept], position[kept]))
    first, second = loaded.experiments
    assert (len(first), len(second)) == (199, time.size - 231)
    assert (first.voltage[-1], second.start) == (volts[199], pytest.approx(2.305))


def test_jittered_stamps_make_no_noise(tmp_path):
    """Each difference is taken over its own time."""
    _, volts, _ = motor(400)
    time = PERIOD * (np.arange(400) + np.random.default_rng(2).uniform(-0.3, 0.3, 400))
    (one,) = load(written(tmp_path / "x.csv", time, volts, 100.0 * time)).experiments
    assert one.speed == pytest.approx(100.0, rel=1e-6)


def test_experiments_cut_at_a_trigger_fit_their_voltage_too(tmp_path):
    """There, too, the voltage is that of the time between the speeds."""
    time, volts, position = motor()
    volts_low = np.where(volts < 8, volts, 12.0)
    path = written(tmp_path / "x.csv", time, volts_low, position)
    cut = {"cut": "trigger", "trigger_level": 9.0, "pre_trigger": 0.1}
    made = load(path, length=0.3, cut=cut).experiments
    whole = load(path).experiments[0]
    for one in made:
        at = round((one.start - whole.start) / PERIOD)
        assert one.voltage == pytest.approx(whole.voltage[at : at + len(one)])
    assert made


def test_a_position_needs_its_unit_and_stands_alone(tmp_path):
    """Positions of sensors are rarely in rad; a speed beside one is one too many."""
    path = written(tmp_path / "x.csv", *motor())
    for text, told in (("x", "x:2048/rev"), ("counts", "counts:2048/rev"), ("x:m", "x:NUMBER")):
        with pytest.raises(OptionError, match=told):
            parse_field(text, "position")
    assert parse_field("theta_rad", "position").factor == 1
    with pytest.raises(OptionError, match="or COUNTS/rev, got '0/rev'"):
        parse_field("x:0/rev", "position")
    with pytest.raises(OptionError, match="one of them, got both"):
        load(path, speed="u")
    with pytest.raises(OptionError, match="--position x:UNIT"):
        parse_field("x:deg", "speed")


def test_a_position_is_proposed_where_there_is_no_speed(tmp_path, capsys):
    """In place of the speed, which then is not asked for."""
    assert propose_fields({"t": "", "u": "", "pos": "", "velocity": ""})["speed"] == "velocity:UNIT"
    assert propose_fields({"t": "", "u": "", "theta_deg": ""})["position"] == "theta_deg:deg"
    assert "position" not in propose_fields({"t": "", "u": "", "theta_deg": "", "n": "rpm"})
    path = written(tmp_path / "x.csv", *motor(), header="t,u,counts")
    assert invoke(command, [str(path), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "--voltage u:UNIT --position counts:UNIT --time t:UNIT --out" in said
    given = ["--voltage", "u", "--position", "counts:rad", "--time", "t"]
    assert invoke(command, [str(path), *given, "--out", str(tmp_path / "out")]) == 0
    assert "position from 'counts' in rad" in capsys.readouterr().out
