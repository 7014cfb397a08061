"""The remainder model: what physics leaves is learned, with memory, and judged where it is new."""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np
import pytest

import ldt_core as ldt
from ldt_core.base.errors import LdtError, ModelError
from ldt_core.base.experiment import rms
from ldt_core.estimation.remainder_run import RemainderShape, free_run
from ldt_core.lab.study.robustness.streams import STREAMS
from ldt_core.models.remainder import RemainderModel
from ldt_core.twin.loop import Twin

MOTOR = ldt.Machine("dc_motor")


def driven(law, seed, count=600, noise=0.1):
    """An experiment of the motor with a torque of its own, by Euler steps."""
    random = np.random.default_rng(seed)
    p, period, fine = MOTOR.parameters, 0.01, 20
    volts = np.repeat(random.uniform(4, 12, count // 60), 60)
    i = w = 0.0
    memory, speed = 0.0, np.empty(count)
    for k in range(count):
        speed[k] = w
        for _ in range(fine):
            h = period / fine
            torque, memory = law(w, memory)
            i += h * (volts[k] - p["R"] * i - p["K_t"] * w) / p["L"]
            w += h * (p["K_t"] * i - p["b"] * w - torque) / p["J"]
    return ldt.Experiment(
        seed, 0.0, period, voltage=volts, speed=speed + random.normal(0, noise, count)
    )


def curve(w, memory):
    """Of the speed alone."""
    return 0.03 * np.exp(-(((w - 150) / 30) ** 2)), memory


def play(w, memory, width=12.0):
    """That of a loose joint: it depends on where the speed came from."""
    memory = min(max(memory, w - width), w + width)
    return 0.03 * (w - memory) / width, memory


@pytest.mark.parametrize("law", [curve, play])
def test_a_law_that_the_physics_lacks_is_learned_from_one_experiment(law):
    """And predicts others in free run."""
    first, others = driven(law, 1), [driven(law, seed) for seed in (2, 3, 4)]
    physics = RemainderModel(MOTOR)
    learned = physics.fit([first])
    before, after = (
        np.mean([m.predict(e).max_error(e) for e in others]) for m in (physics, learned)
    )
    assert after < 0.15 * before


@pytest.mark.parametrize("led", [0.0, 1.0])
def test_the_derivatives_are_those_of_the_free_run(led):
    """By every weight, plays and lags that act on each other included: against differences."""
    random, first = np.random.default_rng(1), driven(play, 1)
    p, nothing = MOTOR.parameters, np.zeros(len(first))
    run = RemainderModel(MOTOR)._drive(first, nothing)
    shape = RemainderShape.of([run])
    weights = random.normal(0, p["K_t"] / p["J"] / 10, shape.size)
    _, slopes = free_run(shape, weights, run, 1, led)
    size, found = 1e-6, np.empty_like(slopes)
    for j, step in enumerate(size * np.eye(shape.size)):
        up, down = (free_run(shape, weights + s, run, 0, led)[0] for s in (step, -step))
        found[:, j] = (up - down) / (2 * size)
    assert np.abs(slopes - found).max() < 1e-4 * np.abs(found).max()


def test_where_nothing_is_lacking_nothing_is_learned():
    """The error stays that of the noise."""
    first, other = (driven(lambda w, memory: (0.0, 0.0), seed) for seed in (1, 2))
    learned = RemainderModel(MOTOR).fit([first])
    physics = RemainderModel(MOTOR).predict(other).max_error(other)
    assert learned.predict(other).max_error(other) < 1.3 * physics


def test_a_run_that_leaves_all_that_was_learned_from_is_the_physics_alone():
    """Of a shaft with a spring one ran away to twice the speed that the voltage gives."""
    learned = RemainderModel(MOTOR).fit([driven(curve, 1)])
    fast = driven(curve, 2)
    fast = dataclasses.replace(fast, voltage=2 * fast.voltage, speed=2 * fast.speed)
    seen, physics = learned.predict(fast), RemainderModel(MOTOR).predict(fast)
    assert np.array_equal(seen.speed, physics.speed)
    assert seen.speed_std.max() > 5 * learned.learned.noise_std


def test_it_claims_not_to_know_where_it_has_not_been():
    """Beyond the speeds that it has learned from."""
    first = driven(curve, 1)
    fast = dataclasses.replace(first, voltage=2 * first.voltage)
    learned = RemainderModel(MOTOR).fit([first])
    known, unknown = (learned.predict(e).speed_std.max() for e in (first, fast))
    assert unknown > 3 * known


def test_blocks_held_back_are_not_looked_at():
    """A fault in the second half changes nothing that is learned from the first."""
    first = driven(curve, 1)
    other = dataclasses.replace(first, speed=first.speed + 2.0 * (np.arange(600) >= 300))
    held = [slice(300, 600)]
    one, two = (RemainderModel(MOTOR).fit_without([e], held) for e in (first, other))
    left = [(m.predict(first).residual(first))[:300] for m in (one, two)]
    assert np.sqrt(np.mean(np.square(left))) < 0.15


def test_what_cannot_be_its_parameters_is_refused():
    """With one sentence; a number that is not finite would be written by beside its arrays."""
    record = RemainderModel(MOTOR).fit([driven(curve, 1)]).record()
    known = record.parameters["remainder"]
    (_, *others), (_, *more) = known["speed"], known["weights"]
    for broken in (
        {"span": 0.0},
        {"weights": [1.0]},
        {"speed": [0.0, 1.0, 1]},
        {"lags": [-1.0]},
        {"weights": [None, *more]},
        {"weights": [math.nan, *more]},
        {"speed": [None, *others]},
        {"plays": [math.inf, *known["plays"][1:]]},
    ):
        wrong = {**record.parameters, "remainder": {**known, **broken}}
        with pytest.raises(ModelError):
            RemainderModel.from_record(dataclasses.replace(record, parameters=wrong), MOTOR)


def test_a_run_that_diverges_is_told_and_looks_nothing_up():
    """Beyond floating point there is no place among the nodes."""
    learned = RemainderModel(MOTOR).fit([driven(curve, 1)])
    shape, weights = learned.learned.shape, np.full(learned.learned.shape.size, 1e308)
    run = learned._drive(driven(curve, 2), np.zeros(600))
    speed, _ = free_run(shape, weights, run)
    assert not np.isfinite(speed[-1])


def test_a_machine_that_stood_still_teaches_nothing():
    """There is no range to learn over."""
    still = ldt.Experiment(1, 0.0, 0.01, voltage=np.zeros(100), speed=np.zeros(100))
    with pytest.raises(LdtError, match="never changes"):
        RemainderModel(MOTOR).fit([still])
    with pytest.raises(LdtError, match="got none"):
        RemainderModel(MOTOR).fit([])


@pytest.mark.slow
def test_a_torque_with_memory_is_learned_from_two_experiments():
    """Nothing in the library is like it."""
    given = STREAMS["own_hysteresis"](3, 60)
    changed = next(i for i in range(45, 55) if len(set(given.conditions[i : i + 3])) == 1)
    twin = Twin(given.machine)
    third = [twin.step(e) for e in given.experiments[changed : changed + 3]][-1]
    assert third.signal.max_error < 0.5 * third.original.max_error(third.experiment)


@pytest.mark.parametrize("width", [15.0, 18.0, 22.0])
def test_a_play_of_any_width_is_learned_from_three_experiments(width):
    """Also of one between those that the model has; a noise of 0.1 is left."""
    law = functools.partial(play, width=width)
    learned = RemainderModel(MOTOR).fit([driven(law, seed) for seed in (1, 2, 3)])
    others = [driven(law, seed) for seed in (4, 5, 6, 7)]
    left = [np.sqrt(np.mean(learned.predict(e).residual(e) ** 2)) for e in others]
    assert np.mean(left) < 0.2  # rad/s


@pytest.mark.parametrize("seed", [0, 1])
def test_what_fits_only_where_it_looks_gives_way_to_a_likelier_fit(seed):
    """An unbalance is no law of this model: half an experiment must not make the other half worse.

    One fit alone, from where the measured speed leads, left 2.1 and 3.4 times the physics' error.
    """
    stream = STREAMS["off_5mm"](seed)
    experiment = stream.experiments[12]
    physics = RemainderModel(stream.machine)
    plain = physics.predict(experiment).residual(experiment)
    left = []
    for held in (slice(0, 1000), slice(1000, 2000)):
        learned = physics.fit_without([experiment], [held])
        left.append(learned.predict(experiment).residual(experiment)[held])
    assert rms(np.concatenate(left)) < rms(plain)
