"""Experiments cut out of one continuous record: the current at their start was never measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import ldt_core as ldt
from ldt_core.base.experiment import Experiment
from ldt_core.effects import parse_effect
from ldt_core.estimation.free_run_start import told_current
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
    at = LENGTH // 3 + round(change_at * LENGTH)
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
        assert model.predict(e).max_error(e) < 5 * NOISE


def begun_at(e, effect=""):
    """(guess [A], the speed from so much beside it) of an experiment."""
    model, acting = MOTOR.model, [parse_effect(effect)] if effect else []
    start = model.initial_state(MOTOR.parameters, float(e.speed[0]))

    def run(more):
        begun = start + np.array([0.0, 0.0, more])
        return model.simulate(MOTOR.parameters, e.voltage, PERIOD, begun, acting)[:, 1]

    return start[CURRENT], run


def test_the_current_is_found():
    """To a twentieth of the largest."""
    experiments, flowed = cut(6)
    for e, current in zip(experiments, flowed, strict=True):
        guess, run = begun_at(e)
        found = guess + told_current(run, MOTOR.parameters, e)
        assert found == pytest.approx(current, abs=0.05 * np.abs(flowed).max())


def test_a_friction_that_changes_its_sign_bends_what_the_current_moves():
    """One step of the ideal motor left more than five deviations in a quarter of such runs."""
    far = []
    for seed in range(10, 16):
        for e in cut(6, "coulomb_friction:torque=0.03", seed=seed)[0]:
            _, run = begun_at(e, "coulomb_friction:torque=0.03")
            left = e.speed - run(told_current(run, MOTOR.parameters, e))
            far.append(np.abs(left).max() > 5 * NOISE)
    assert np.mean(far) < 0.1


def test_no_more_current_is_told_than_the_voltages_drive():
    """However far a free run is off: it is not taken where that does not help."""
    (e,) = cut(1)[0]
    most = (np.abs(e.voltage).max() + 0.05 * np.abs(e.speed).max()) / 1.0
    asked = []

    def run(more):
        asked.append(more)
        return e.speed + 1e6

    assert told_current(run, MOTOR.parameters, e) == 0.0
    assert min(asked) == pytest.approx(-most)
    assert len(asked) <= 7


def test_what_was_measured_or_stood_still_is_not_sought():
    """No free run is spent on it."""
    (e,) = cut(1)[0]
    measured = replace(e, voltage=e.voltage, speed=e.speed, current=np.ones(len(e)))
    still = replace(e, voltage=e.voltage, speed=e.speed - e.speed[0])
    for known in (measured, still):
        assert told_current(None, MOTOR.parameters, known) == 0.0


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


@pytest.mark.slow
def test_its_friction_is_named():
    """It was an asymmetric friction, of which both directions had the same amount."""
    verdict = ldt.diagnose(cut(8, "coulomb_friction:torque=0.03")[0], MOTOR).verdict
    assert verdict.acting == [["coulomb_friction"]]
    assert verdict.confidence > 0.9


@pytest.mark.slow
def test_a_change_is_learned_soon_though_its_own_experiment_has_misled():
    """It falls within one, whose wrong cause the original takes the place of.

    What is new then had to err less over ten experiments, also those before the change: 56 % of the
    original's error was left.
    """
    experiments, _ = cut(24, "inertia:factor=1.4", change_at=10.3, seed=32)
    steps = ldt.run(experiments, MOTOR).steps
    assert any("is the original again" in s.adaptation.reason for s in steps)
    errors = [sum(s.signal.max_error for s in steps), 0.0]
    errors[1] = sum(s.original.max_error(s.experiment) for s in steps)
    assert errors[0] < 0.4 * errors[1]


@pytest.mark.parametrize("seed", [1, 4])
def test_a_file_that_knows_its_friction_leaves_no_gap(seed, tmp_path):
    """It was a winding's heating, at 0.92."""
    values = "".join(f"  {n}: {MOTOR.parameters[n]}\n" for n in ("J", "K_t", "R", "L", "b"))
    file = tmp_path / "motor.yaml"
    file.write_text(
        "name: motor\nphysics: dc_motor\nlimits: {voltage: [-24, 24]}\n"
        "experiment: {duration: 0.8, sample_period: 0.002}\nparameters:\n" + values + "effects:\n"
        "- {name: coulomb_friction, parameters: {torque: 0.03}}\n"
    )
    experiments, _ = cut(8, "coulomb_friction:torque=0.03", seed=seed)
    assert ldt.diagnose(experiments, load_machine(str(file))).verdict.kind == "none"
