"""Generic suite for whoever writes an effect: `ldt effects my_file.py:MY_EFFECT` runs it."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ldt_core.base.errors import BadInput, LdtError, OptionError
from ldt_core.base.sentences import counted
from ldt_core.checks.physics_checks import PERIOD, trial_speed
from ldt_core.machine.machine_file import Machine, load_machine
from ldt_core.physics import PHYSICS
from ldt_core.physics.base import MAX_STEP, SPEED, FreeRun
from ldt_core.physics.effect import Effect
from ldt_core.physics.integrate import MAX_STEP_RATE
from ldt_core.physics.lanes import WIDTH
from ldt_core.physics.motor_driven import MotorDriven
from ldt_core.physics.parameter import Parameter, Values, logarithmic

# rad/s, for a neutral effect: an effect on the equations takes the integrator where the machine
# alone may be solved exactly, and the two agree to 1e-7 here.
NEUTRAL_TOLERANCE = 1e-6
# rad/s, between a step and a quarter of it: a fifth of the rotor's noise. A law that jumps, or is
# stiffer than `fastest` says, makes the speed chatter by more.
STEP_TOLERANCE = 0.02
LEAST_CHANGE = 1e-3  # rad/s: values that change the speed less on every machine are not typical
ECCENTRICITY = 0.004  # m; enough that an effect on the foundation can be seen
DURATION = 6.0  # s, of a trial run
SIDE_BY_SIDE_TOLERANCE = 1e-6  # rad/s, between a run beside others and alone: rounding
FAR_OFF = 30  # between a typical value and the scale; a search tries a tenth to 70 scales
BEYOND = 8  # numbers behind the parameters that a term must not read
# No machine turns so many times as fast for what it has in addition; a wrong sign drives it so.
RUNAWAY = 100.0
LOOK = "look for a wrong sign, unit or size"
# (t [s], theta [rad], omega [rad/s], current [A], voltage [V]) at which a term is called by itself.
PLACES = ((0.0, 0.0, 0.0, 0.0, 0.0), (1.5, 2.0, 30.0, 3.0, 10.0), (0.5, -4.0, -9.0, -2.0, -6.0))


def check_effect(effect: Effect, machines: list[Machine] | None = None) -> list[str]:
    """Check that an effect keeps the promises of `ldt_core.effects.base.Effect`.

    Args:
        effect: to check.
        machines: to try it on; None takes those that ship with LDT, the rotor with some unbalance.

    Returns:
        What was checked, a sentence each.

    Raises:
        AssertionError: with a sentence, at the first promise that is not kept.
        BadInput: a function that cannot be compiled.
    """
    if machines is None:
        rotor = load_machine("rotor").with_parameters(e=ECCENTRICITY)
        machines = [rotor, load_machine("dc_motor")]
    suited = [m for m in machines if _suits(effect, m)]
    name = effect.name
    assert suited, (
        f"{name}: needs {' and '.join(effect.needs)} of a machine, which "
        f"{' and '.join(m.name for m in machines)} lack; --machine names the file of one that has"
    )
    assert effect.description, f"{name}: no description"
    assert effect.equation, f"{name}: no equation"
    assert effect.parameters, f"{name}: no parameter"
    _check_bounds(effect)
    largest = furthest = 0.0
    for machine in suited:
        where = f"{name} on {machine.name}"
        for term in effect.terms:
            _check_reading(term, machine)
        plain = _speed(machine)
        neutral = np.abs(_finite_speed(effect, machine, effect.neutral, "neutral") - plain).max()
        assert neutral <= NEUTRAL_TOLERANCE, (
            f"{where}: the neutral values change the speed by {neutral:.3g} rad/s"
        )
        typical = effect.check(effect.typical)
        first = _finite_speed(effect, machine, typical, "typical")
        again = _speed(machine, effect, typical)
        assert np.array_equal(first, again), f"{where}: two runs differ"
        fast, usual = float(np.abs(first).max()), float(np.abs(plain).max())
        assert fast <= RUNAWAY * usual, (
            f"{where}: its typical values drive the speed to {fast:.3g} rad/s, without it the "
            f"machine reaches {usual:.3g}: {LOOK}"
        )
        largest = max(largest, float(np.abs(first - plain).max()))
        if effect.terms:
            furthest = max(furthest, _check_step(effect, machine, first))
            _check_side_by_side(effect, machine)
        _check_extremes(effect, machine)
    assert largest >= LEAST_CHANGE, (
        f"{name}: its typical values change the speed by {largest:.3g} rad/s"
    )
    on = "on " + " and ".join(m.name for m in suited)
    done = [
        "description and equation are there",
        f"{counted(len(effect.parameters), 'parameter')}, described; values beyond the bounds and "
        "such as are no numbers are refused",
        f"{on}: the neutral values change nothing, two runs are the same to the last bit, and no "
        "bound of a parameter gives a speed that is not finite",
        f"the typical values change the speed by up to {largest:.3g} rad/s",
    ]
    if effect.terms:
        done += [
            "the function is compiled and reads no further than its parameters",
            f"a quarter of the step changes the speed by {furthest:.1g} rad/s at most",
        ]
    return done


def _check_side_by_side(effect: Effect, machine: Machine) -> None:
    """Runs that are computed at once, as those of a fit, are the run alone."""
    physics, values = machine.model, machine.parameters
    volts = np.repeat([0.5, -0.5, 1.0], 40) * machine.voltage_limits[1]
    start, use = physics.initial_state(values, 0.0), [(effect, effect.check(effect.typical))]
    run = FreeRun(values, volts, PERIOD, start, use)
    alone = physics.simulate(values, volts, PERIOD, start, use)[:, SPEED]
    for _, states in physics.simulate_all([run] * WIDTH):
        assert not isinstance(states, LdtError), f"{effect.name} on {machine.name}: {states}"
        off = float(np.abs(states[:, SPEED] - alone).max())
        assert off < SIDE_BY_SIDE_TOLERANCE, (
            f"{effect.name} on {machine.name}: computed beside other runs, the speed differs by "
            f"{off:.2g} rad/s from the run alone"
        )


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
        far = abs(effect.typical.get(parameter.name, 0.0) - (parameter.default or 0.0))
        scale = parameter.scale
        if far == 0 or scale is None or logarithmic(parameter):
            continue
        assert scale / FAR_OFF <= far <= scale * FAR_OFF, (
            f"{effect.name}, {parameter.name}: its typical value is {far:g} from neutral and its "
            f"scale {scale:g}; a search begins at the scale"
        )


def _outside(parameter: Parameter) -> list[float]:
    below = [parameter.low] if parameter.open_low else [math.nextafter(parameter.low, -math.inf)]
    return [*below, math.nextafter(parameter.high, math.inf)]


def _check_reading(effect: Effect, machine: Machine) -> None:
    """Whatever lies behind the parameters in memory, the term gives the same."""
    typical = effect.check(effect.typical)
    known = [typical[p.name] for p in effect.parameters]
    known += [machine.parameters[name] for name in effect.needs]
    count = len(effect.states)
    for place in PLACES:
        given = []
        for behind in (0.0, 1.0e3, math.nan):
            p = np.array([*known, *[behind] * BEYOND])
            state, rate = np.array([0.0] * count + [behind] * BEYOND), np.zeros(count + BEYOND)
            arrays = (p, state, rate) if count else (p,)
            value = _c_function(effect)(*place, *(a.ctypes.data for a in arrays))
            assert not rate[count:].any(), f"{effect.name}: writes more rates than it has states"
            given.append([value, *rate])
        assert np.isfinite(given[0]).all(), (
            f"{effect.name}: gives {value} at (t, theta, omega, current, voltage) = {place}"
        )
        assert all(np.array_equal(given[0], other) for other in given[1:]), (
            f"{effect.name}: reads numbers beyond the {len(known)} in p (its parameters, then what "
            f"it needs of the machine) and its {count} states"
        )


def _c_function(effect: Effect) -> Callable[..., float]:
    pointers: list[Any] = [ctypes.c_void_p] * (3 if effect.states else 1)
    kind = ctypes.CFUNCTYPE(ctypes.c_double, *[ctypes.c_double] * 5, *pointers)
    return kind(effect.compiled.address)


def _check_step(effect: Effect, machine: Machine, speed: np.ndarray) -> float:
    """How much a quarter of the step changes the speed [rad/s], which must be little."""
    typical, limit = effect.check(effect.typical), max(map(abs, machine.voltage_limits))
    physics = machine.model
    values = effect.change_parameters(physics, machine.parameters, typical)
    rate = effect.rate(values, limit, typical)
    bare = PHYSICS.get(machine.physics)
    if isinstance(bare, MotorDriven):
        rate = max(bare.rate(values, limit), rate)
    step = (min(MAX_STEP, MAX_STEP_RATE / rate) if rate > 0 else MAX_STEP) / 4
    change = float(np.abs(_speed(machine, effect, typical, step) - speed).max())
    assert change <= STEP_TOLERANCE, (
        f"{effect.name} on {machine.name}: a quarter of the integration step changes the speed by "
        f"{change:.3g} rad/s: the function jumps, or changes faster than `fastest` says"
    )
    return change


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


def _finite_speed(effect: Effect, machine: Machine, given: Values, which: str) -> np.ndarray:
    where = f"{effect.name} on {machine.name}"
    try:
        speed = _speed(machine, effect, given)
    except LdtError as error:
        if error.__cause__ is not None or isinstance(error, BadInput):  # its function fails
            raise
        raise AssertionError(f"{where}, with its {which} values: {error}: {LOOK}") from error
    assert np.isfinite(speed).all(), f"{where}: its {which} values give speeds that are not finite"
    return speed


def _speed(
    machine: Machine,
    effect: Effect | None = None,
    given: Values | None = None,
    max_step: float = MAX_STEP,
) -> np.ndarray:
    effects = [(effect, given)] if effect is not None and given is not None else []
    return trial_speed(machine, DURATION, effects, max_step)
