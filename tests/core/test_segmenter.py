"""Claims about the segmenter: what streams is cut into the experiments that it is made of."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ldt_core.base.errors import OptionError
from ldt_core.base.experiment import Experiment
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine
from ldt_core.segmenter import CHANNELS, Segmenter, build_rule
from ldt_core.segmenter.cut_rules import LengthRule
from ldt_core.segmenter.resampling import Series, resample
from ldt_core.segmenter.segmenter import ArrivalClock, StreamAligner

PERIOD = 0.01  # s
EPOCH = 1.7e9  # s, where a double's resolution is a quarter of a microsecond
SIZE = 20  # samples of an experiment


def segmenter(cut: str = "length", length: float = SIZE * PERIOD, **options) -> Segmenter:
    own = {n: options.pop(n) for n in ("gap", "lateness", "current", "first") if n in options}
    return Segmenter(build_rule(cut, PERIOD, length, **options), PERIOD, **own)


def fed(one: Segmenter, time, voltage, speed, current=None) -> list[Experiment]:
    """Sample by sample, as messages come in."""
    done = []
    for index, at in enumerate(time):
        done += one.feed("voltage", at, voltage[index])
        if current is not None:
            done += one.feed("current", at, current[index])
        done += one.feed("speed", at, speed[index])
    return done


def plain(experiments) -> list[tuple]:
    """For comparison bit by bit."""
    channels = [(e.voltage, e.speed, e.current) for e in experiments]
    return [
        (e.number, e.start, e.period, *(None if c is None else c.tobytes() for c in all_))
        for e, all_ in zip(experiments, channels, strict=True)
    ]


def stream(count: int, seed: int = 0, start: float = EPOCH):
    random = np.random.default_rng(seed)
    time = start + PERIOD * np.arange(count)
    return time, random.uniform(6, 16, count), random.normal(40, 5, count)


def test_the_plants_experiments_come_back_bit_for_bit():
    """Streamed sample by sample, back to back, the current too."""
    machine = load_machine("rotor")
    plant = Plant(machine, experiments=3, seed=4, start_time=EPOCH, measure_current=True)
    made = [plant.experiment(number) for number in (1, 2, 3)]
    one = Segmenter(build_rule("length", 0.01, machine.duration), 0.01, current=True)
    cut = []
    for e in made:
        cut += fed(one, e.start + e.time, e.voltage, e.speed, e.current)
    assert plain(cut) == plain(made)
    assert not one.counts


jitters = st.floats(0.0, 0.45)
lengths = st.integers(2, 30)
counts = st.integers(0, 150)
seeds = st.integers(0, 10**6)


FEW = settings(max_examples=30)  # each is a stream of a hundred samples or more


@FEW
@given(counts, lengths, seeds, jitters, st.sampled_from([1.0, 1.003, 0.4, 2.1]))
def test_no_sample_is_lost_or_doubled_between_experiments_by_length(
    count, length, seed, jitter, pace
):
    """Whatever the jitter and the rate, each belongs to one experiment, or is still under way."""
    random = np.random.default_rng(seed)
    steps = pace * (np.arange(count) + jitter * random.uniform(-1, 1, count))
    time = EPOCH + PERIOD * steps
    one = segmenter(length=length * PERIOD, gap=10 * PERIOD)
    cuts, made = [], one.rule.feed
    one.rule.feed = lambda row: (new := made(row), cuts.extend(new))[0]
    experiments = fed(one, time, np.ones(count), time)
    owned = [row.time for cut in cuts for row in cut.rows]
    assert owned == time[: len(owned)].tolist()
    assert len(owned) + one.rule.pending == count
    assert one.left_out == 0
    assert [e.number for e in experiments] == list(range(1, len(experiments) + 1))
    assert all(len(e) == length for e in experiments)
    for earlier, later in itertools.pairwise(experiments):
        # An experiment begins with a measured sample, the nearest to where the last one ended.
        assert abs(later.start - earlier.end) <= PERIOD * (0.5 + pace * (1 + 2 * jitter))


@FEW
@given(lengths, seeds)
def test_samples_on_the_grid_are_taken_as_they_are(length, seed):
    """Back to back, the experiments are the stream again."""
    time, voltage, speed = stream(5 * length + 1, seed)
    experiments = fed(segmenter(length=length * PERIOD), time, voltage, speed)
    assert len(experiments) == 5
    for name, column in (("voltage", voltage), ("speed", speed)):
        joined = np.concatenate([getattr(e, name) for e in experiments])
        assert joined.tobytes() == column[: 5 * length].tobytes()
    assert [e.start for e in experiments] == time[: 5 * length : length].tolist()


def spoiled(seed: int, count: int = 160):
    """A stream with jitter, gaps, jumps back, repeated times and values that are no numbers."""
    random = np.random.default_rng(seed)
    time, voltage, speed = stream(count, seed)
    time += PERIOD * random.uniform(-0.3, 0.3, count)
    for at in random.integers(1, count, 4):
        time[at:] += PERIOD * random.choice([0.0, 2.0, 30.0, -1.0, -200.0])
    time[random.integers(0, count)] = np.nan
    speed[random.integers(0, count, 3)] = random.choice([np.nan, np.inf, 40.0])
    return time, np.round(voltage - 11), speed.cumsum() / 100


RULES = {
    "length": {},
    "trigger": {"trigger_level": 1.0, "pre_trigger": 0.03},
    "steady": {"steady_band": 3.0, "steady_time": 0.05},
}


@FEW
@given(st.sampled_from(sorted(RULES)), seeds, st.lists(st.integers(1, 40), min_size=1))
def test_any_division_into_calls_gives_the_same_cut(cut, seed, sizes):
    """One sample a call or many, with everything wrong that a stream can have."""
    time, voltage, speed = spoiled(seed)
    singly, chunked = segmenter(cut, **RULES[cut]), segmenter(cut, **RULES[cut])
    expected = fed(singly, time, voltage, speed) + singly.end()
    # The order in which they come is the same, only that calls are for several samples.
    order = [(c, i) for i in range(time.size) for c in ("voltage", "speed")]
    whole = []
    for channel, indices in itertools.groupby(order, key=lambda pair: pair[0]):
        whole.append((channel, [i for _, i in indices]))
    values = {"voltage": voltage, "speed": speed}
    done = []
    for channel, indices in whole:
        done += chunked.feed(channel, time[indices], values[channel][indices])
    assert plain(done + chunked.end()) == plain(expected)
    assert chunked.counts == singly.counts
    # The same with chunks of a channel, which is another order of arrival, within its limits.
    by_chunks = segmenter(cut, lateness=10.0, **RULES[cut])
    by_ones = segmenter(cut, lateness=10.0, **RULES[cut])
    tidy = EPOCH + PERIOD * np.arange(time.size)
    speed = np.nan_to_num(speed, posinf=0.0)
    expected = fed(by_ones, tidy, voltage, speed) + by_ones.end()
    done, begin = [], 0
    for size in itertools.cycle(sizes):
        part = slice(begin, begin + size)
        done += by_chunks.feed("speed", tidy[part], speed[part])
        done += by_chunks.feed("voltage", tidy[part], voltage[part])
        begin += size
        if begin >= time.size:
            break
    assert plain(done + by_chunks.end()) == plain(expected)


@FEW
@given(seeds, st.floats(0.0, 0.15))
def test_the_order_in_which_two_topics_come_makes_no_difference(seed, lag):
    """As long as neither lags more than the lateness: here a voltage sent only when it changes."""
    random = np.random.default_rng(seed)
    time, _, speed = stream(120, seed)
    changes = np.sort(random.choice(120, 12, replace=False))
    changes[0] = 0
    sent = time[changes] + np.append(0.0, random.choice([0.0, 0.3 * PERIOD], 11))
    volts = random.uniform(6, 16, 12)
    speeds = [("speed", t, v, t) for t, v in zip(time, speed, strict=True)]
    came = np.maximum.accumulate(sent + random.uniform(0, lag, 12))  # a topic keeps its order
    results = []
    for arrival in (sent, came):
        messages = speeds + [
            ("voltage", t, v, a) for t, v, a in zip(sent, volts, arrival, strict=True)
        ]
        one = segmenter()
        done = []
        for channel, at, value, _ in sorted(messages, key=lambda m: (m[3], m[0])):
            done += one.feed(channel, at, value)
        results.append(plain(done + one.end()))
        assert "voltage too late" not in one.counts
    assert results[0] == results[1]
    expected = volts[np.searchsorted(sent, time + 1e-4, side="right") - 1]
    got = np.concatenate([np.frombuffer(e[3]) for e in results[0]])
    assert got.tolist() == expected[: got.size].tolist()


def test_jitter_is_resampled_onto_the_grid():
    """A ramp stays a ramp; the voltage holds."""
    random = np.random.default_rng(1)
    time = EPOCH + PERIOD * (np.arange(103) + np.append(0, random.uniform(-0.3, 0.3, 102)))
    experiments = fed(segmenter(), time, np.full(103, 7.0), 2 * (time - EPOCH))
    assert len(experiments) == 5
    for e in experiments:
        np.testing.assert_allclose(e.speed, 2 * (e.start + e.time - EPOCH), atol=2e-6)
        assert set(e.voltage) == {7.0}
        assert e.start in time


@pytest.mark.parametrize("jitter", [1e-4, 3e-4, 1e-3])
def test_jitter_makes_no_other_machine_of_one(jitter):
    """A motor that follows the voltage within 50 ms, exactly from stamp to stamp.

    A step that came 0.2 ms behind a point of the grid counted a whole period of 10 ms late: ten
    times the noise of a good sensor, and a twin that was inadequate for ever.
    """
    random, period, memory, gain = np.random.default_rng(1), 0.01, 0.05, 20.0
    time = np.arange(1001) * period + random.normal(0.0, jitter, 1001)
    voltage = np.repeat(random.uniform(-10, 10, 41), 25)[:1001]
    speed = np.zeros(1001)
    for i, step in enumerate(np.diff(time)):
        speed[i + 1] = gain * voltage[i] + (speed[i] - gain * voltage[i]) * np.exp(-step / memory)
    grid = time[0] + np.arange(1000) * period
    shown, volts = (
        resample(Series(time, x, str), grid, period, held)
        for x, held in ((speed, False), (voltage, True))
    )
    predicted = np.full(1000, shown[0])
    kept = np.exp(-period / memory)
    for i in range(999):
        predicted[i + 1] = gain * volts[i] + (predicted[i] - gain * volts[i]) * kept
    assert np.sqrt(np.mean((predicted - shown) ** 2)) < 0.01 * np.abs(shown).max() * (jitter / 1e-3)


def test_a_faster_stream_is_averaged_and_a_slower_one_interpolated():
    """As an import does it."""
    for dt in (PERIOD / 10, 2 * PERIOD):
        time = EPOCH + dt * np.arange(round(3.5 * SIZE * PERIOD / dt))
        experiments = fed(segmenter(), time, np.full(time.size, 7.0), 2 * (time - EPOCH))
        assert [len(e) for e in experiments] == [SIZE] * 3
        inner = experiments[1]
        ramp = 2 * (inner.start + inner.time - EPOCH)
        np.testing.assert_allclose(inner.speed[1:], ramp[1:], atol=1e-3 if dt < PERIOD else 2e-6)


def test_three_lost_samples_are_bridged_and_four_are_not():
    """No experiment reaches over a gap; what is left is counted."""
    time, voltage, speed = stream(3 * SIZE)
    for lost, expected in ((2, 3), (3, 2)):
        kept = np.delete(np.arange(time.size), np.s_[5 : 5 + lost])
        one = segmenter()
        experiments = fed(one, time[kept], voltage[kept], speed[kept])
        assert len(experiments) == expected
        assert one.counts["pause of the speed"] == (expected == 2)
    assert one.counts["samples in no experiment"] == 5
    assert experiments[0].start == time[8]


def test_a_clock_that_jumps_back_begins_anew():
    """What was under way is dropped, what comes is cut as if it came first."""
    one = segmenter()
    before = stream(SIZE + 5)
    after = stream(2 * SIZE, seed=1, start=EPOCH - 3600.0)
    experiments = fed(one, *before) + fed(one, *after)
    assert [e.start for e in experiments] == [EPOCH, after[0][0], after[0][SIZE]]
    assert experiments[1].speed.tolist() == after[2][:SIZE].tolist()
    assert one.counts["samples in no experiment"] == 5
    assert one.counts["clock of the voltage jumped back"] == 1


def test_one_straggler_or_a_repeated_sample_is_left_out():
    """Both are counted, and change nothing."""
    time, voltage, speed = stream(SIZE)
    one = segmenter()
    done = fed(one, time[:9], voltage[:9], speed[:9])
    done += one.feed("speed", [time[8], time[7]], [1.0, 2.0])
    done += fed(one, time[9:], voltage[9:], speed[9:])
    assert done[0].speed.tolist() == speed.tolist()
    assert one.counts == {"speed out of order or twice": 2}


def test_what_is_no_number_is_a_lost_sample():
    """Counted and bridged."""
    time, voltage, speed = stream(SIZE + 1)
    speed[4] = np.nan
    one = segmenter()
    (experiment,) = fed(one, time, voltage, speed)
    assert experiment.speed[4] == pytest.approx((speed[3] + speed[5]) / 2)
    assert one.counts["speed that is no finite number"] == 1


def test_a_voltage_that_comes_too_late_spoils_what_is_under_way():
    """Rows with the old voltage are not sent; the next experiment has the new one."""
    time, _, speed = stream(4 * SIZE)
    one = segmenter(lateness=0.05)
    one.feed("voltage", EPOCH - 1, 5.0)
    done = one.feed("speed", time[: SIZE - 1], speed[: SIZE - 1])
    assert done == []
    done = one.feed("voltage", time[3], 9.0)
    done += one.feed("speed", time[SIZE - 1 :], speed[SIZE - 1 :]) + one.end()
    assert one.counts["voltage too late"] == 1
    assert done
    assert all(set(e.voltage) == {9.0} for e in done)


def test_a_dead_current_ends_what_is_under_way():
    """A channel that is measured cannot be held."""
    time, voltage, speed = stream(3 * SIZE)
    one = segmenter(current=True, lateness=0.05)
    cut = fed(one, time[:30], voltage[:30], speed[:30], speed[:30])
    cut += fed(one, time[30:], voltage[30:], speed[30:]) + one.end()
    assert len(cut) == 1
    assert one.counts["pause of the current"] > 0


def test_speed_before_the_first_voltage_is_dropped():
    """Nobody knows what drove it."""
    time, voltage, speed = stream(3 * SIZE)
    one = segmenter(lateness=0.05)
    one.feed("speed", time[:10], speed[:10])
    cut = fed(one, time[10:], voltage[10:], speed[10:])
    assert [e.start for e in cut] == [time[10], time[10 + SIZE]]
    assert one.counts["speed before the first voltage"] == 10


def test_nothing_is_awaited_once_the_stream_is_silent():
    """The last rows wait for a voltage that may yet come, but not for ever."""
    time, _, speed = stream(SIZE)
    one = segmenter()
    one.feed("voltage", EPOCH, 5.0)
    assert one.feed("speed", time, speed) == []
    (experiment,) = one.catch_up()
    assert experiment.speed.tolist() == speed.tolist()


# ---- by trigger


def steps(levels, each: int = 30):
    voltage = np.repeat(np.asarray(levels, float), each)
    time = EPOCH + PERIOD * np.arange(voltage.size)
    return time, voltage, np.arange(voltage.size, dtype=float)


def test_an_experiment_at_each_rising_edge_with_what_came_before():
    """Pre-trigger and length from the edge on; a falling edge and a level kept are none."""
    one = segmenter("trigger", trigger_level=5.0, pre_trigger=4 * PERIOD)
    time, voltage, speed = steps([0, 12, 0, 3, 8, 12])
    experiments = fed(one, time, voltage, speed)
    assert [e.start for e in experiments] == [time[26], time[116]]
    assert all(len(e) == SIZE + 4 for e in experiments)
    assert experiments[0].speed.tolist() == list(range(26, 26 + SIZE + 4))
    assert experiments[1].voltage.tolist() == [3] * 4 + [8] * SIZE


def test_a_stream_that_begins_above_the_level_has_no_edge():
    """Nor does one that is above it after a gap."""
    time, voltage, speed = steps([12, 12])
    time[30:] += 1.0
    assert fed(segmenter("trigger", trigger_level=5.0), time, voltage, speed) == []


def test_the_pretrigger_ends_at_the_last_experiment():
    """No sample is in two experiments."""
    one = segmenter("trigger", trigger_level=5.0, pre_trigger=15 * PERIOD)
    time, voltage, speed = steps([0, 12, 0, 12, 12], each=12)
    first, second = fed(one, time, voltage, speed)
    assert (len(first), len(second)) == (12 + SIZE, 4 + SIZE)
    assert second.start == time[32]


@FEW
@given(seeds, st.floats(0, 0.3))
def test_whatever_triggers_no_sample_is_in_two_experiments(seed, before):
    """And every experiment has one edge at the place that the pre-trigger says."""
    time, voltage, speed = stream(400, seed)
    one = segmenter("trigger", trigger_level=11.0, pre_trigger=before)
    experiments = fed(one, time, voltage, speed)
    assume(experiments)
    for earlier, later in itertools.pairwise(experiments):
        assert later.start >= earlier.end - PERIOD / 2
    for e in experiments:
        edge = len(e) - SIZE
        assert edge <= round(before / PERIOD) + 1
        assert e.voltage[edge] > 11.0
        assert edge == 0 or e.voltage[edge - 1] <= 11.0


# ---- by steady state


def settling(targets, each: int = 200, tau: float = 0.1, noise: float = 0.0):
    """First-order responses, one after the other."""
    random, speed, values = np.random.default_rng(0), 0.0, []
    for target in targets:
        for _ in range(each):
            speed += PERIOD / tau * (target - speed)
            values.append(speed + noise * random.normal())
    time = EPOCH + PERIOD * np.arange(len(values))
    return time, np.repeat(np.asarray(targets, float), each), np.array(values)


def test_an_experiment_ends_when_the_speed_has_settled():
    """Each step response is one, from where it begins to when it kept to the band for so long."""
    one = segmenter("steady", length=5.0, steady_band=1.0, steady_time=0.2)
    time, voltage, speed = settling([0, 40, 20, 60], noise=0.05)
    experiments = fed(one, time, voltage, speed)
    assert len(experiments) == 3
    for e, step in zip(experiments, (2.0, 4.0, 6.0), strict=True):
        assert e.start <= EPOCH + step < e.start + 0.25
        assert np.ptp(e.speed[-20:]) <= 1.0
        assert all(np.ptp(e.speed[k : k + 21]) > 1.0 for k in range(20, len(e) - 21))
        assert e.speed.max() - e.speed.min() > 15


def test_what_does_not_settle_ends_at_the_greatest_length_and_is_counted():
    """The rest of it is the next experiment."""
    time = EPOCH + PERIOD * np.arange(250)
    speed = 5 * np.sin(20 * (time - EPOCH))
    one = segmenter("steady", length=1.0, steady_band=1.0, steady_time=0.2)
    experiments = fed(one, time, np.ones(250), speed)
    assert [len(e) for e in experiments] == [100, 100]
    assert experiments[1].start == pytest.approx(experiments[0].end, abs=1e-6)
    assert one.counts["not settled within the greatest length"] == 2


def test_a_machine_at_rest_makes_no_experiments():
    """It has settled already."""
    time, voltage, speed = settling([0, 0])
    one = segmenter("steady", length=5.0, steady_band=1.0, steady_time=0.2)
    assert fed(one, time, voltage, speed) == []


# ---- what is refused


@pytest.mark.parametrize(
    ("cut", "options", "words"),
    [
        ("lenght", {}, "did you mean 'length'"),
        ("length", {"length": PERIOD}, "2 periods of 0.01 s or more"),
        ("steady", {"length": 0.1, "steady_time": 0.2}, "more than the steady time"),
        ("steady", {"steady_time": 0.0}, "2 periods of 0.01 s or more"),
        ("length", {"gap": PERIOD / 2}, "more than the sample period"),
    ],
)
def test_settings_that_make_no_experiment_are_refused(cut, options, words):
    """One sentence that names the option."""
    with pytest.raises(OptionError, match=words):
        segmenter(cut, **options)


def test_an_unknown_channel_is_refused():
    """With those that there are."""
    with pytest.raises(OptionError, match="speed"):
        segmenter().feed("sped", 0.0, 0.0)


@given(st.lists(st.tuples(st.sampled_from(CHANNELS), st.floats(), st.floats()), max_size=60))
def test_nothing_that_comes_breaks_it(samples):
    """Any times and values in any order: experiments or counts, no exception."""
    for cut, options in RULES.items():
        one = segmenter(cut, current=True, **options)
        for channel, time, value in samples:
            one.feed(channel, time, value)
        one.end()
        assert one.left_out >= 0


def test_memory_is_bounded_where_the_voltage_never_comes():
    """Speeds wait no longer than the lateness."""
    streams = StreamAligner(("voltage", "speed"), 2e-4, 0.035, lateness=0.05)
    for k in range(1000):
        streams.admit("speed", k * PERIOD, 0.0)
        assert streams.next_row() is None
        assert streams.waiting <= 6


def test_bursts_as_long_as_an_experiment_are_experiments():
    """With pauses between them, and stamps that jitter: up to half of them were dropped."""
    random, samples = np.random.default_rng(2), 100
    made = Segmenter(LengthRule(0.01, 1.0), 0.01)
    done = []
    for burst in range(40):
        time = 10.0 * burst + np.arange(samples) * 0.01 + random.normal(0.0, 1e-3, samples)
        time = np.sort(time)
        done += made.feed("voltage", time, np.full(samples, 5.0))
        done += made.feed("speed", time, np.full(samples, 50.0))
    done += made.end()
    assert len(done) == 40
    assert {len(e) for e in done} == {samples}


def test_another_rate_than_the_period_is_noticed():
    """At 50 Hz, a machine that was declared at 100 Hz looked like another one."""
    made = Segmenter(LengthRule(0.01, 1.0), 0.01)
    time = np.arange(200) * 0.02
    made.feed("voltage", time, np.full(200, 5.0))
    assert made.pace is None
    made.feed("speed", time, np.full(200, 50.0))
    assert made.pace == pytest.approx(0.02)


def test_a_message_that_was_long_under_way_moves_no_other_in_time():
    """Those without a stamp came out of order where the last stamped one had been quick."""
    clock = ArrivalClock()
    for stamp, way in ((0.0, 0.003), (0.1, 0.05), (0.2, 0.002), (0.3, 0.04)):
        assert clock.stamped(stamp, 100.0 + stamp + way) == stamp
    assert clock.unstamped(100.35) == pytest.approx(0.348)
    clock.stamped(5.0, 200.0)  # a clock that began anew
    assert clock.unstamped(200.1) == pytest.approx(5.1)
