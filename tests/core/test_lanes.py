"""Free runs side by side: a lane is the run alone, whatever is beside it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numba import njit

from ldt_core.base.errors import LdtError
from ldt_core.effects import EFFECTS
from ldt_core.machine.machine_file import load_machine
from ldt_core.physics import side_by_side
from ldt_core.physics.base import NOT_TRACKED, FreeRun
from ldt_core.physics.effect import Effect
from ldt_core.physics.lanes import LARGEST_ANGLE, WIDTH, load, store
from ldt_core.physics.parameter import Parameter

ROTOR, MOTOR = load_machine("rotor"), load_machine("dc_motor")
SAMPLES, PERIOD, STEP, SHORTEST = 200, 0.01, 2e-3, 0.5e-3
NAMES = EFFECTS.names()
#: Of the voltage: up to so many units of the last place as a run has steps.
HARDLY = [sign * 2.0**-k for k in range(42, 54) for sign in (-1, 1)]


def simulated(machine, runs, workers=1, step=STEP, shortest=SHORTEST):
    """The states of runs, in their order."""
    found = dict(machine.model.simulate_all(runs, step, shortest, workers))
    return [found[i] for i in range(len(runs))]


def alone(machine, run, step=STEP, shortest=SHORTEST):
    """The states of one run, or the error that it ends with."""
    values, voltage, period, initial, effects, tracked = run[:6]
    about = values, voltage, period, initial, effects, step, tracked, shortest
    try:
        return machine.model.simulate(*about)
    except LdtError as error:
        return error


def a_run(machine, random, names, unbalance):
    """Some machine, voltage, start and strength of these effects, drawn at random."""
    values = {n: v * random.uniform(0.8, 1.25) for n, v in machine.parameters.items()}
    if "e" in values:
        values["e"] = unbalance * random.uniform(0.2, 1.0)
    volts = np.repeat(random.uniform(*machine.voltage_limits, SAMPLES // 50), 50)
    effects = []
    for name in names:
        effect = EFFECTS.get(name)
        typical = {**effect.neutral, **effect.typical}
        share = random.uniform(0.1, 1.0)
        far = {n: v + share * (typical[n] - v) for n, v in effect.neutral.items()}
        effects.append((effect, far))
    changed = values
    for effect, far in effects:
        changed = effect.change_parameters(machine.model, changed, far)
    speed, angle = random.uniform(0.0, 20.0), random.uniform(-3.0, 3.0)
    start = machine.model.running_state(changed, speed, angle)
    tracked = (random.uniform(0.0, 40.0, SAMPLES), 0.1) if random.random() < 0.5 else None
    run = FreeRun(values, volts, PERIOD, start, effects)
    return run if tracked is None else run._replace(tracked=tracked)


def carried(machine, run, expected):
    """(n,) how far a voltage that is `HARDLY` another carries the states of a run alone.

    Where a friction is steeper than the shortest step can follow, near standstill, a step makes
    more of a difference in the last bit: 3e10 times as much within a sample.
    """
    moved = [alone(machine, run._replace(voltage=run.voltage * (1 + x))) for x in HARDLY]
    apart = [np.abs(m - expected).max(axis=0) for m in moved if not isinstance(m, LdtError)]
    return np.max(apart, axis=0, initial=0.0)


@settings(max_examples=60, deadline=None)
@example(2409307721, MOTOR, ["stribeck_friction", "asymmetric_friction"], 0.0)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([ROTOR, MOTOR]),
    st.lists(st.sampled_from(NAMES), max_size=2, unique=True),
    st.sampled_from([0.0, 0.008]),
)
def test_a_lane_equals_the_run_alone(seed, machine, names, unbalance):
    """To 1e-11 of the speed: the C library's sine and the lanes' differ in their last bit.

    Or as far as the run alone is carried by as little.
    """
    random = np.random.default_rng(seed)
    names = [n for n in names if set(EFFECTS.get(n).needs) <= set(machine.parameters)]
    runs = [a_run(machine, random, names, unbalance) for _ in range(random.integers(1, 12))]
    for run, states in zip(runs, simulated(machine, runs), strict=True):
        expected = alone(machine, run)
        if isinstance(expected, LdtError):
            assert str(states) == str(expected)
            continue
        size = np.abs(expected).max(axis=0)
        apart, most = np.abs(states - expected), 1e-11 * size + 1e-300
        if not (apart <= most).all():
            most = most + 2 * carried(machine, run, expected)  # it tries a few of many
        assert (apart <= most).all(), names


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([None, *NAMES]))
def test_bits_of_a_lane_depend_on_no_neighbour_place_or_thread(seed, name):
    random = np.random.default_rng(seed)
    names = [] if name is None else [name]
    runs = [a_run(ROTOR, random, names, 0.008) for _ in range(2 * WIDTH + 3)]
    first = simulated(ROTOR, runs)
    order = random.permutation(len(runs))
    for workers in (1, 3):
        again = simulated(ROTOR, [runs[i] for i in order], workers)
        for i, states in zip(order, again, strict=True):
            assert np.array_equal(states, first[i])
    for run, states in zip(runs[:2], first[:2], strict=True):
        assert np.array_equal(simulated(ROTOR, [run])[0], states)


def test_without_laws_that_ask_the_c_library_a_lane_is_the_run_alone_to_the_last_bit():
    random = np.random.default_rng(5)
    runs = [a_run(ROTOR, random, [], 0.008) for _ in range(11)]
    for run, states in zip(runs, simulated(ROTOR, runs), strict=True):
        assert np.array_equal(states, alone(ROTOR, run))


@pytest.mark.parametrize("samples", [1, 2])
def test_an_experiment_of_hardly_any_samples_is_simulated_as_alone(samples):
    random = np.random.default_rng(9)
    runs = [a_run(ROTOR, random, [], 0.008) for _ in range(3)]
    runs = [r._replace(voltage=r.voltage[:samples], tracked=NOT_TRACKED) for r in runs]
    for run, states in zip(runs, simulated(ROTOR, runs), strict=True):
        assert np.array_equal(states, alone(ROTOR, run))


def test_runs_too_long_to_be_held_eight_at_once_are_simulated_alone(monkeypatch):
    random = np.random.default_rng(10)
    runs = [a_run(ROTOR, random, [], 0.008) for _ in range(3)]
    expected = simulated(ROTOR, runs)
    monkeypatch.setattr(side_by_side, "MOST_SAMPLES", SAMPLES - 1)
    monkeypatch.setattr(side_by_side, "run_lanes", None)
    for states, one in zip(simulated(ROTOR, runs), expected, strict=True):
        assert np.array_equal(states, one)


def _driving(t, theta, omega, current, voltage, p):
    return p[0] * omega**3 + p[0]


DRIVING = Effect(
    name="driving",
    description="drives the shaft the faster, the faster it turns",
    equation="torque = c (omega^3 + 1)",
    parameters=(Parameter("c", "N m", 0.0, default=0.0, description="c", scale=1.0),),
    torque=_driving,
)


def test_a_lane_that_diverges_costs_only_itself():
    random = np.random.default_rng(6)
    calm = [a_run(ROTOR, random, [], 0.0)._replace(effects=[(DRIVING, {"c": 0.0})]) for _ in "123"]
    wild = calm[0]._replace(effects=[(DRIVING, {"c": 5.0})])
    one, ended, two, three = simulated(ROTOR, [calm[0], wild, *calm[1:]])
    assert "diverged" in str(ended)
    assert str(ended) == str(alone(ROTOR, wild))
    for states, run in zip((one, two, three), calm, strict=True):
        assert np.array_equal(states, alone(ROTOR, run))


def _stepped(t, theta, omega, current, voltage, p):
    if omega > p[1] and math.sin(theta) > 0:
        return -p[0] * omega
    return 0.0


STEPPED = Effect(
    name="stepped",
    description="a law that decides by its values",
    equation="torque = -c omega above a speed, in half of each turn",
    parameters=(
        Parameter("c", "N m s", 0.0, default=0.0, description="c", scale=0.01),
        Parameter("above", "rad/s", 0.0, default=5.0, description="speed", scale=1.0),
    ),
    torque=_stepped,
)


def test_a_law_that_decides_by_its_values_is_called_lane_by_lane():
    random = np.random.default_rng(7)
    runs = [
        a_run(ROTOR, random, [], 0.0)._replace(effects=[(STEPPED, {"c": 0.01 * c, "above": 8.0})])
        for c in range(10)
    ]
    assert STEPPED.compiled_for_lanes is None
    for run, states in zip(runs, simulated(ROTOR, runs), strict=True):
        assert np.array_equal(states, alone(ROTOR, run))


@pytest.mark.parametrize("exponent", [0.5, 1.5, 2.0, -1.0, 1.85])
def test_a_power_that_is_no_whole_number_is_that_power(exponent):
    """A law with |omega|^0.5 was computed with |omega|^0, and diagnosed as another."""
    law = Effect(
        name="power",
        description="a drag of any power",
        equation="torque = -c omega |omega|^n",
        parameters=(Parameter("c", "N m", 0.0, default=0.0, description="c", scale=0.01),),
        torque=_of_power(exponent),
    )
    random = np.random.default_rng(9)
    runs = [
        a_run(ROTOR, random, [], 0.0)._replace(effects=[(law, {"c": 1e-4 * c})])
        for c in range(1, 11)
    ]
    assert law.compiled_for_lanes is not None
    for run, states in zip(runs, simulated(ROTOR, runs), strict=True):
        assert states == pytest.approx(alone(ROTOR, run), abs=1e-9)


def _of_power(exponent):
    def law(t, theta, omega, current, voltage, p):
        return -p[0] * omega * (abs(omega) + 1.0) ** exponent

    return law


FUNCTIONS = {
    "sin": (njit(lambda x: math.sin(x)), 1.0),
    "cos": (njit(lambda x: math.cos(x)), 1.0),
    "exp": (njit(lambda x: math.exp(x)), None),
    "tanh": (njit(lambda x: math.tanh(x)), None),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_of_lanes_are_those_of_the_c_library_to_rounding(name):
    """Of sine and cosine the absolute error counts, of the others the relative one."""
    function, size = FUNCTIONS[name]

    @njit
    def mapped(x, found):
        for k in range(x.size // WIDTH):
            store(found, k, function(load(x, k)))

    scales = (1e-9, 1e-3, 0.3, 3.0, 100.0, *((1e4, 1e6, 2 * LARGEST_ANGLE) if size else ()))
    random = np.random.default_rng(8)
    x = np.concatenate([random.normal(size=8000) * scale for scale in scales])
    x[:4] = 0.0, math.nan, math.inf, -math.inf
    found = np.empty_like(x)
    mapped(x, found)
    with np.errstate(invalid="ignore"):
        expected = getattr(np, name)(x)
    assert np.array_equal(np.isnan(found), np.isnan(expected))
    kept = np.isfinite(expected)
    assert np.array_equal(found[~kept & ~np.isnan(found)], expected[~kept & ~np.isnan(expected)])
    allowed = 3e-16 * size if size else 6e-16 * np.abs(expected[kept])
    assert (np.abs(found[kept] - expected[kept]) <= allowed).all()
