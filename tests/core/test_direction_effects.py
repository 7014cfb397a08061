"""Effects that depend on a direction: of rotation, of the current, of braking against driving."""

from __future__ import annotations

import numpy as np
import pytest

from ldt_core.effects import EFFECTS, parse_effect
from ldt_core.machine.machine_file import load_machine

ROTOR, MOTOR = load_machine("rotor"), load_machine("dc_motor")
PERIOD = 0.01


def free_run(machine, volts, *effects, speed=0.0, max_step=0.25e-3):
    """(L, n) states from a steady start."""
    physics, values = machine.model, machine.parameters
    initial = physics.initial_state(values, speed)
    uses = [parse_effect(e) for e in effects]
    return physics.simulate(values, volts, PERIOD, initial, uses, max_step)


def held(level, seconds):
    return np.full(round(seconds / PERIOD) + 1, float(level))


def test_equal_levels_are_coulomb_friction():
    """Through a reversal, too."""
    volts = np.repeat([8.0, -8, 0, 5], 200)
    effect = "asymmetric_friction:torque_forward=0.1,torque_backward=0.1"
    ours, coulomb = (
        free_run(ROTOR, volts, effect),
        free_run(ROTOR, volts, "coulomb_friction:torque=0.1"),
    )
    np.testing.assert_allclose(ours, coulomb, atol=1e-9)


def test_friction_on_one_side_never_drives():
    """With a level on one side only, the power of the torque is nowhere above 0."""
    term, inertia = EFFECTS.get("asymmetric_friction").torque, ROTOR.parameters["J"]
    for levels in ((0.1, 0.0), (0.0, 0.1)):
        for omega in np.linspace(-0.1, 0.1, 201):
            assert term(0.0, 0.0, omega, 0.0, 0.0, (*levels, inertia)) * omega <= 1e-18


@pytest.mark.parametrize("level", [10, -10])
@pytest.mark.parametrize("share", [0.15, 0.5, 0.8])
def test_a_gear_loses_its_share_of_the_motors_torque(level, share):
    """At steady speed (1 - mu) K_t i = b w."""
    effect = f"load_friction:coefficient={share}"
    speed, current = free_run(ROTOR, held(level, 20), effect)[-1, 1:3]
    # the size is smoothed over 0.1 A: 3 A and more pass whole to half of (0.1 / 3)^2
    assert (1 - share) * 0.3 * current == pytest.approx(0.01 * speed, rel=1e-2, abs=1e-2)


def test_a_gear_holds_back_a_braking_motor_as_well():
    """Its friction acts against the rotation, so the shaft stops sooner than by the motor alone."""
    volts = held(0, 0.3)
    plain = free_run(ROTOR, volts, speed=30)[:, 1]
    geared = free_run(ROTOR, volts, "load_friction:coefficient=0.3", speed=30)[:, 1]
    assert np.all(geared[1:] < plain[1:])


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("machine", [ROTOR, MOTOR])
def test_brushes_take_the_same_voltage_at_every_current(machine, sign):
    """Under a load of 2 A and one of 5 A, V - R i - K_t w = V_b, of the current's sign."""
    p = machine.parameters
    for amperes in (2, 5):
        load = f"coulomb_friction:torque={amperes * p['K_t']}"
        speed, current = free_run(machine, held(10 * sign, 20), "brush_drop:voltage=0.8", load)[
            -1, 1:3
        ]
        lost = 10 * sign - p["R"] * current - p["K_t"] * speed
        assert lost == pytest.approx(0.8 * sign, rel=1e-4)


def test_brushes_hold_back_a_small_voltage():
    """Less voltage than they take drives next to no current."""
    states = free_run(MOTOR, held(0.5, 5), "brush_drop:voltage=1")
    assert abs(states[-1, 2]) < 0.06
    assert free_run(MOTOR, held(0.5, 5))[:, 2].max() > 0.3


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("command", [0.0, 2.0])
def test_without_regeneration_the_shaft_coasts_down(command, sign):
    """J w' = -b w at no current, while the shaft is faster than the command; K_t i brakes else."""
    states = free_run(ROTOR, sign * held(command, 2), "no_regeneration", speed=sign * 50.0)
    time = np.arange(states.shape[0]) * PERIOD
    coasting = 50 * np.exp(-0.01 / 0.02 * time)
    late = slice(3, None)  # the steady current of the start has to fade first
    np.testing.assert_allclose(sign * states[late, 1], coasting[late], rtol=3e-3)
    assert np.abs(states[late, 2]).max() < 0.02
    assert np.abs(free_run(ROTOR, sign * held(command, 2), speed=sign * 50.0)[:, 2]).max() > 10


def test_what_is_not_blocked_brakes():
    """Half blocked: the braking current is half of (K_t w - V) / R."""
    states = free_run(ROTOR, held(2, 0.5), "no_regeneration:share=0.5", speed=50.0)
    _, speed, current = states[20, :3]
    assert current == pytest.approx(-0.5 * (0.3 * speed - 2), rel=0.02)


def test_a_drive_without_regeneration_drives_and_reverses_as_others_do():
    """Speeding up, steady running, and a command against the rotation are the same."""
    for volts, speed in ((np.repeat([4.0, 9, 15], 200), 0.0), (held(-10, 1), 20.0)):
        plain = free_run(ROTOR, volts, speed=speed)
        ours = free_run(ROTOR, volts, "no_regeneration", speed=speed)
        np.testing.assert_allclose(ours[:, 1], plain[:, 1], atol=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    "effect",
    [
        "asymmetric_friction:torque_forward=1,torque_backward=0.2",
        "load_friction:coefficient=0.15",
        "load_friction:coefficient=0.8",
        "brush_drop:voltage=0.2",
        "brush_drop:voltage=2",
        "no_regeneration:share=1",
        "no_regeneration:share=0.3",
    ],
)
@pytest.mark.parametrize("machine", [ROTOR, MOTOR])
def test_the_step_that_an_effect_asks_for_resolves_it(machine, effect):
    """A quarter of the step changes the speed by less than a sensor sees, in reversals too."""
    levels = np.random.default_rng(3).uniform(-14, 14, 10)
    volts = np.repeat(levels, 60)
    name, given = parse_effect(effect)
    rate = max(machine.model.rate(machine.parameters, 14), name.rate(machine.parameters, 14, given))
    coarse = free_run(machine, volts, effect)[:, 1]
    fine = free_run(machine, volts, effect, max_step=min(0.25e-3, 1 / rate) / 4)[:, 1]
    assert np.abs(coarse - fine).max() < 5e-3


def test_open_terminals_let_the_shaft_coast_at_a_command_of_zero_alone():
    """By J and b alone, without a current; at any other command the drive brakes as before."""
    rest = free_run(MOTOR, held(0, 0.5), "open_circuit:share=1", speed=30.0)
    values = MOTOR.parameters
    assert abs(rest[-1, 2]) < 1e-3 * abs(rest[0, 2] or 1.0)
    later = rest[10:, 1]  # the current has died out
    decay = -np.log(later[-1] / later[0]) / ((later.size - 1) * PERIOD)
    assert decay == pytest.approx(values["b"] / values["J"], rel=0.05)
    braked = [free_run(MOTOR, held(2, 0.5), *e, speed=30.0) for e in (["open_circuit:share=1"], [])]
    np.testing.assert_allclose(*braked, rtol=1e-6, atol=1e-6)
