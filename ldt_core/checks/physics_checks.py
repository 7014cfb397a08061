"""Suite for whoever writes a physics of their own."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError, MachineFileError, reason_of
from ldt_core.machine.machine_file import Machine
from ldt_core.physics import PHYSICS
from ldt_core.physics.base import MAX_STEP, SPEED
from ldt_core.physics.effect import Effect
from ldt_core.physics.integrate import STATES
from ldt_core.physics.motor_driven import MotorDriven
from ldt_core.physics.parameter import Parameter

FIRST = ("theta", "omega", "current")
SOLVED = (len(FIRST), STATES)  # states of the equations that the integrator is compiled for
# rad/s between the exact solution and Runge-Kutta steps of the same machine, which agree to 1e-7.
TOLERANCE = 1e-6
DURATION = 4.0  # s, of a trial run
HOLD = 1.0  # s, for which each level of its voltage is held
PERIOD = 0.01  # s, between its samples
SEED = 20240604


def check_physics(machine: Machine) -> list[str]:
    """Check that a machine's physics keeps the promises of `ldt_core.physics.base.Physics`.

    Args:
        machine: of that physics; its parameters are those that are tried, its known effects not.

    Returns:
        What was checked, a sentence each.

    Raises:
        AssertionError: with a sentence, at the first promise that is not kept.
        BadInput: a machine that cannot be simulated.
    """
    try:
        return _checked(machine)
    except (AssertionError, LdtError):
        raise
    except Exception as error:  # whatever somebody else's functions do
        raise AssertionError(f"{machine.physics}: {reason_of(error)}") from error


def _checked(machine: Machine) -> list[str]:
    physics = PHYSICS.get(machine.physics)
    values = {p.name: machine.parameters[p.name] for p in physics.parameters}
    machine = replace(machine, parameters=values, deviations={}, acting=())
    name, names = physics.name, [p.name for p in physics.parameters]
    assert physics.states[: len(FIRST)] == FIRST, (
        f"{name}: states must begin with {', '.join(FIRST)}"
    )
    for parameter in physics.parameters:
        assert parameter.description, f"{name}, {parameter.name}: no description"
        _check_refusal(machine, parameter)
    done = [f"{' '.join(names)}: described, a bound each that is refused beyond"]
    state = physics.initial_state(values, 10.0)
    count = len(physics.states)
    assert state.shape == (count,), f"{name}: {count} states, but a first state of {state.shape}"
    assert state[SPEED] == 10.0, (
        f"{name}: the first state does not have the speed that was measured"
    )
    first, again = trial_speed(machine, DURATION), trial_speed(machine, DURATION)
    assert np.array_equal(first, again), f"{name}: two runs differ"
    assert np.isfinite(first).all(), f"{name}: speeds that are not finite"
    done.append("two runs are the same to the last bit, and finite")
    if not isinstance(physics, MotorDriven):
        return done
    fastest = physics.rate(values, max(map(abs, machine.voltage_limits)))
    assert math.isfinite(fastest), f"{name}: rate is not finite"
    assert fastest > 0, f"{name}: rate is {fastest:g}, expected above 0"
    if count not in SOLVED:
        return [
            *done,
            f"{count} states: no effect on torque or terminals can act on it, so it cannot be "
            "diagnosed",
        ]
    if physics.is_linear(values):
        a, b = physics.system(values)
        assert a.shape == (count, count), f"{name}: system gives A of shape {a.shape}"
        assert b.shape == (count,), f"{name}: system gives B of shape {b.shape}"
        neutral = trial_speed(machine, DURATION, [(NEUTRAL, NEUTRAL.neutral)])
        off = float(np.abs(neutral - first).max())
        assert off <= TOLERANCE, (
            f"{name}: `system` and `constants` tell of different machines, by up to {off:.3g} rad/s"
        )
        done.append(f"solved exactly and in steps, the speeds agree to {off:.1g} rad/s")
        modes = np.linalg.eigvals(physics.state_space(values)[0])
        of_system = np.linalg.eigvals(a)
        apart = max(np.abs(of_system - mode).min() for mode in modes) / np.abs(modes).max()
        assert apart <= TOLERANCE, (
            f"{name}: `system` and `state_space` tell of different machines: a mode of one differs "
            f"by {apart:.2g} of the fastest"
        )
        motor = np.abs(modes).max()
        assert fastest >= motor * (1 - TOLERANCE), (
            f"{name}: `rate` is {fastest:.3g} 1/s, the motor's fastest mode {motor:.3g}"
        )
        done.append("rate is that of the fastest mode, or above it")
    return done


def _check_refusal(machine: Machine, parameter: Parameter) -> None:
    for value in (
        math.nextafter(parameter.low, -math.inf),
        math.nextafter(parameter.high, math.inf),
    ):
        if not math.isfinite(value):
            continue
        try:
            machine.with_parameters(**{parameter.name: value})
        except MachineFileError:
            continue
        raise AssertionError(f"{machine.physics}: {parameter.name} = {value:g} is not refused")


def _nothing(t, theta, omega, current, voltage, p):  # type: ignore[no-untyped-def] # compiled
    return 0.0 * p[0]


NEUTRAL = Effect(
    name="nothing",
    description="no torque, which keeps the exact solution from being taken",
    equation="torque = 0",
    parameters=(Parameter("size", "", default=0.0, description="unused"),),
    torque=_nothing,
)


def trial_speed(
    machine: Machine,
    duration: float,
    effects: Sequence[tuple[Effect, Mapping[str, float]]] = (),
    max_step: float = MAX_STEP,
) -> Array:
    """(L,) measured speed [rad/s] under steps of voltage, both signs of it, from rest.

    Args:
        machine: to simulate.
        duration: of the trial run [s].
        effects: that act on it, with their parameters.
        max_step: of the integrator [s].
    """
    low, high = machine.voltage_limits
    levels = np.random.default_rng(SEED).uniform(low, high, round(duration / HOLD))
    levels[-1:] = 0.0  # some effects act at a command of 0 alone
    volts = np.repeat(levels, round(HOLD / PERIOD))
    physics, values = machine.model, machine.parameters
    initial = physics.initial_state(values, 0.0)
    states = physics.simulate(values, volts, PERIOD, initial, effects, max_step)
    speed = np.asarray(physics.measure(states, PERIOD, effects))
    assert speed.shape == volts.shape, (
        f"{effects[0][0].name if effects else machine.name}: expected {volts.size} measured "
        f"speeds, got shape {speed.shape}"
    )
    return speed
