"""Generic suite for whoever writes an effect of their own.

    from ldt_core.checks_effect import check_effect
    check_effect(MY_EFFECT)

raises AssertionError with a sentence at the first promise that is not kept. The effects that ship
with LDT go through the same suite.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from ldt_core.effects.base import Effect, Values
from ldt_core.errors import BadInput, OptionError
from ldt_core.machine import Machine, load_machine
from ldt_core.physics.parameter import Parameter

# rad/s, for a neutral effect: an effect on the equations takes the integrator where the machine
# alone may be solved exactly, and the two agree to 1e-7 here.
NEUTRAL_TOLERANCE = 1e-6
VISIBLE = 1e-3  # rad/s; typical values that do less, on every machine, are no typical values
ECCENTRICITY = 0.004  # m; enough that an effect on the foundation can be seen
SECONDS, HOLD, PERIOD = 6.0, 1.0, 0.01
SEED = 20240604


def check_effect(effect: Effect, machines: list[Machine] | None = None) -> None:
    """Check that an effect keeps the promises of `ldt_core.effects.base.Effect`.

    Args:
        effect: to check.
        machines: to try it on; None takes those that ship with LDT, the rotor with some unbalance.

    Raises:
        AssertionError: with a sentence, at the first promise that is not kept.
    """
    if machines is None:
        rotor = load_machine("rotor").with_parameters(e=ECCENTRICITY)
        machines = [rotor, load_machine("dc_motor")]
    suited = [m for m in machines if _suits(effect, m)]
    name = effect.name
    assert suited, f"{name}: none of the machines {[m.name for m in machines]} has {effect.needs}"
    assert effect.description, f"{name}: no description"
    assert effect.equation, f"{name}: no equation"
    assert effect.parameters, f"{name}: no parameter"
    _check_bounds(effect)
    largest = 0.0
    for machine in suited:
        where = f"{name} on {machine.name}"
        plain = _speed(machine)
        neutral = np.abs(_speed(machine, effect, effect.neutral) - plain).max()
        assert neutral <= NEUTRAL_TOLERANCE, (
            f"{where}: the neutral values change the speed by {neutral:.3g} rad/s"
        )
        typical = effect.check(effect.typical)
        first, again = _speed(machine, effect, typical), _speed(machine, effect, typical)
        assert np.array_equal(first, again), f"{where}: two runs differ"
        assert np.isfinite(first).all(), f"{where}: speeds that are not finite"
        largest = max(largest, float(np.abs(first - plain).max()))
        _check_extremes(effect, machine)
    assert largest >= VISIBLE, f"{name}: its typical values change the speed by {largest:.3g} rad/s"


def _suits(effect: Effect, machine: Machine) -> bool:
    try:
        effect.require(machine.model)
    except OptionError:
        return False
    return True


def _check_bounds(effect: Effect) -> None:
    for parameter in effect.parameters:
        assert parameter.description, f"{effect.name}, {parameter.name}: no description"
        for value in (*_outside(parameter), math.nan, math.inf):
            try:
                effect.check({parameter.name: value})
            except OptionError:
                continue
            raise AssertionError(f"{effect.name}: {parameter.name} = {value:g} is not refused")


def _outside(parameter: Parameter) -> list[float]:
    below = [parameter.low] if parameter.open_low else [math.nextafter(parameter.low, -math.inf)]
    return [*below, math.nextafter(parameter.high, math.inf)]


def _check_extremes(effect: Effect, machine: Machine) -> None:
    """Each finite bound, the others typical: finite speeds, or a sentence that refuses."""
    for parameter in effect.parameters:
        for value in (parameter.low, parameter.high):
            if not parameter.accepts(value):
                continue
            given = effect.check({**effect.typical, parameter.name: value})
            try:
                speed = _speed(machine, effect, given)
            except BadInput:
                continue
            assert np.isfinite(speed).all(), (
                f"{effect.name} on {machine.name}: {parameter.name} = {value:g} gives speeds that "
                "are not finite"
            )


def _speed(machine: Machine, effect: Effect | None = None, given: Values | None = None):
    """Measured speed [rad/s] under steps of voltage, both signs of it, from rest."""
    low, high = machine.voltage_limits
    levels = np.random.default_rng(SEED).uniform(low, high, round(SECONDS / HOLD))
    volts = np.repeat(levels, round(HOLD / PERIOD))
    physics, values = machine.model, machine.parameters
    effects: list[tuple[Effect, Mapping[str, float]]] = []
    if effect is not None and given is not None:
        effects = [(effect, given)]
    initial = physics.initial_state(values, 0.0)
    states = physics.simulate(values, volts, PERIOD, initial, effects)
    return physics.measure(states, PERIOD, effects)
