"""A motor of another engine (scipy's LSODA) behind an encoder whose steps are far above the noise.

It settles in a fifth of the time that a voltage is held: rounding errors repeat for many samples.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recorded_machines import MOTOR, ROTOR, record, steps
from scipy.integrate import solve_ivp

from ldt_core.base.experiment import Experiment
from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.effects import get_effect
from ldt_core.estimation.noise import ROUNDING, rounding_correlation, sensor_step, white_noise
from tests.motors import motor_file

TRUE = {"J": 2e-4, "K_t": 0.038, "R": 0.6, "L": 1e-4, "b": 2e-4}
PERIOD, SAMPLES, NOISE = 0.02, 250, 0.02  # s, of an experiment, rad/s
STEPS = (0.1, 0.5, 1.0, 5.0)  # rad/s
TRIED = ("coulomb_friction", "constant_load", "quadratic_drag", "viscous_friction")
MACHINE = motor_file(TRUE, SAMPLES, PERIOD)


def turned(torque, count=5):
    """(voltage, speed) of experiments with a further torque on the shaft [N m], without steps."""
    random, found = np.random.default_rng(3), []
    for _ in range(count):
        u = steps(random, SAMPLES, -12.0, 12.0, 50)
        state, speed = np.zeros(2), np.empty(SAMPLES)
        for i in range(SAMPLES):
            speed[i] = state[0]

            def rate(_, y, u=u[i]):
                drive = TRUE["K_t"] * y[1] - TRUE["b"] * y[0] + torque(y[0])
                return [drive / TRUE["J"], (u - TRUE["R"] * y[1] - TRUE["K_t"] * y[0]) / TRUE["L"]]

            state = solve_ivp(rate, (0, PERIOD), state, "LSODA", rtol=1e-6, atol=1e-8).y[:, -1]
        found.append((u, speed + NOISE * random.standard_normal(SAMPLES)))
    return found


def seen(motion, step):
    """The experiments as an encoder shows them."""
    return [
        Experiment(k + 1, 10.0 * k, PERIOD, u, np.round(speed / step) * step)
        for k, (u, speed) in enumerate(motion)
    ]


@pytest.fixture(scope="module")
def healthy():
    return turned(lambda speed: 0.0)


@pytest.mark.parametrize("step", STEPS)
def test_the_step_and_its_noise_are_found(healthy, step):
    """Also where most neighbours are alike."""
    speeds = [e.speed for e in seen(healthy, step)]
    assert sensor_step(speeds) == pytest.approx(step)
    assert ROUNDING * step * 0.999 <= white_noise(speeds) < 1.3 * ROUNDING * step


def test_other_signals_have_no_step():
    """Noise of any law, a smooth curve, one that is constant, none at all."""
    random, time = np.random.default_rng(1), np.linspace(0, 20, 2000)
    smooth = np.sin(time) + 2 * time
    noisy = smooth + random.standard_t(3, time.size)
    for signals in ([smooth], [noisy], [random.random(50)], [np.zeros(100)], []):
        assert sensor_step(signals) == 0.0


def test_steps_below_the_noise_are_white(healthy):
    """What rounding adds to noise of its own size is independent from sample to sample."""
    speeds = [speed for _, speed in healthy]
    assert rounding_correlation(speeds, 0.1, 0.1) == 1.0
    assert rounding_correlation(speeds, 5.0, 5.0 * ROUNDING) > 5.0


@pytest.mark.parametrize("step", STEPS)
def test_a_healthy_machine_has_no_gap(healthy, step):
    """What a coarse encoder rounds off is no effect."""
    effects = [get_effect(n) for n in TRIED]
    found = diagnose(MACHINE, seen(healthy, step), effects=effects, workers=1)
    assert found.verdict.kind == "none"
    assert found.gap.noise_std == pytest.approx(ROUNDING * step, rel=0.3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "torque"),
    [
        ("coulomb_friction", lambda speed: -0.02 * np.tanh(speed / 0.4)),
        ("constant_load", lambda speed: -0.03),
        ("quadratic_drag", lambda speed: -1e-6 * speed * abs(speed)),
    ],
)
def test_a_real_effect_is_not_missed(name, torque):
    """Each behind the coarsest encoder; none of them is the library's own law to the letter."""
    effects = [get_effect(n) for n in TRIED]
    found = diagnose(MACHINE, seen(turned(torque), 5.0), effects=effects, workers=1)
    assert list(found.verdict.effects) == [name]


def test_residuals_are_divided_by_what_the_steps_hide(healthy):
    """They repeat for as long as a voltage is held; the noise that is told is that of a sample."""
    residuals = FreeRunResiduals(MACHINE, seen(healthy, 5.0))
    assert residuals.noise[0] * residuals.whiteness[0] == pytest.approx(5.0 * ROUNDING, rel=0.2)
    assert residuals.whiteness[0] < 0.5


@pytest.mark.slow
@pytest.mark.parametrize("machine", [ROTOR, MOTOR], ids=["rotor", "motor"])
def test_steps_that_hide_some_of_the_noise_make_no_gap(machine):
    """Noise of a third of a step hardly shows in the differences of a slow signal."""
    step, part = 0.56, np.linspace(0.0, 1.0, 1000)
    ramps = [8.0 * np.interp((2 * part + 0.37 * k) % 1, [0, 0.5, 1], [-1, 1, -1]) for k in range(6)]
    healthy = record(machine, count=6, samples=1000, noise=0.165, levels=ramps)
    seen = [replace(e, speed=step * np.round(e.speed / step)) for e in healthy]
    assert diagnose(machine, seen, workers=1).verdict.kind == "none"
