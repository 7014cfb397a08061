"""Experiments cut out of one continuous record: the current at their start was never measured."""

from __future__ import annotations

import numpy as np
import pytest

import ldt_core as ldt
from ldt_core.base.experiment import Experiment
from ldt_core.effects import parse_effect
from ldt_core.estimation.free_run_start import current_beside, is_current_unknown
from ldt_core.machine.machine_file import load_machine
from ldt_core.models import MODELS, build_model
from ldt_core.physics.base import CURRENT

MOTOR = load_machine("dc_motor").with_parameters(J=5e-4, K_t=0.05, R=1.0, L=0.05, b=1e-3)
PERIOD, LENGTH, NOISE = 0.002, 400, 0.1  # s, samples of an experiment, rad/s


def cut(count, effect="", change_at=0, seed=3, noise=NOISE):
    """Experiments of a motor that never stops, and the current at their first samples [A]."""
    random, model = np.random.default_rng(seed), MOTOR.model
    samples = (count + 1) * LENGTH
    volts = np.repeat(random.uniform(-12, 12, samples // 150 + 1), 150)[:samples]
    at = LENGTH // 3 + change_at * LENGTH
    about = MOTOR.parameters, volts[: at + 1], PERIOD
    before = model.simulate(*about, model.initial_state(MOTOR.parameters, 0.0), [])
    acting = [parse_effect(effect)] if effect else []
    after = model.simulate(MOTOR.parameters, volts[at:], PERIOD, before[-1], acting)
    states = np.concatenate([before[:-1], after])
    begins = range(LENGTH // 3, samples - LENGTH, LENGTH)
    begins = [k for k in begins if abs(states[k, 1]) > 10 * NOISE]  # else it may have been at rest
    found = []
    for number, k in enumerate(begins, start=1):
        speed = states[k : k + LENGTH, 1] + noise * random.standard_normal(LENGTH)
        found.append(Experiment(number, k * PERIOD, PERIOD, volts[k : k + LENGTH], speed))
    return found, states[begins, CURRENT]


@pytest.mark.parametrize("kind", sorted(MODELS.builtin))
def test_an_untrained_model_takes_the_current_that_the_speed_tells(kind):
    """The winding keeps it for 50 ms: free runs were 100 times the noise off."""
    settings = {"cause": "coulomb_friction"} if kind == "diagnosed" else {}
    model = build_model(kind, MOTOR, settings)
    for e in cut(4)[0]:
        assert is_current_unknown(e)
        assert model.predict(e).max_error(e) < 5 * NOISE


def test_the_current_is_found():
    """To a twentieth of the least that flowed."""
    experiments, flowed = cut(6)
    model = MOTOR.model
    for e, current in zip(experiments, flowed, strict=True):
        start = model.initial_state(MOTOR.parameters, float(e.speed[0]))
        speed = model.simulate(MOTOR.parameters, e.voltage, PERIOD, start)[:, 1]
        found = start[CURRENT] + current_beside(MOTOR.parameters, e, speed)
        assert found == pytest.approx(current, abs=0.15)


def test_no_more_current_is_told_than_the_voltages_drive():
    """However far a free run is off."""
    (e,) = cut(1)[0]
    most = (np.abs(e.voltage).max() + 0.05 * np.abs(e.speed).max()) / 1.0
    assert current_beside(MOTOR.parameters, e, e.speed - 1e6) == pytest.approx(most)
    assert current_beside(MOTOR.parameters, e, e.speed + 1e6) == pytest.approx(-most)


def test_a_machine_that_never_stops_is_no_changed_one():
    """Each experiment was `inadequate`, and no change was ever learned."""
    run = ldt.run(cut(10)[0], MOTOR)
    assert {s.signal.state for s in run.steps} == {"holds"}


def test_what_changes_in_it_is_learned():
    """From the second experiment behind the change on, to the noise."""
    run = ldt.run(cut(14, "coulomb_friction:torque=0.03", change_at=7)[0], MOTOR)
    late = run.steps[9:]
    errors = [
        np.mean([p.max_error(s.experiment) for s, p in both])
        for both in ([(s, s.prediction) for s in late], [(s, s.original) for s in late])
    ]
    assert errors[0] < 0.15 * errors[1]
    assert {s.signal.state for s in run.steps[:6]} == {"holds"}
