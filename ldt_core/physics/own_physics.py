"""What a physics that somebody else wrote must answer before anything is computed with it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from ldt_core.base.errors import FAULTS, MachineFileError, OptionError, described, reason_of
from ldt_core.base.registry import line_in
from ldt_core.physics import PHYSICS
from ldt_core.physics.base import CURRENT, SPEED, Physics
from ldt_core.physics.motor import MOTOR, motor_system
from ldt_core.physics.motor_driven import MotorDriven

if TYPE_CHECKING:
    from ldt_core.physics.parameter import Values

SAME = 1e-6  # relative: far above rounding, far below what a recording shows


def named_physics(source: str, given: Any) -> Physics:
    """The physics that a machine file names.

    Raises:
        MachineFileError: no such name or file, one that fails as it is imported, or no physics.
    """
    where = f"{source}, physics"
    if not isinstance(given, str):
        raise MachineFileError(where, "a name or file.py:NAME (ldt docs physics)", described(given))
    try:
        found = PHYSICS.get(given)
    except OptionError as error:
        own = f"{where} {given}" if ".py:" in given else where
        raise MachineFileError(own, error.expected, error.got) from error
    if not isinstance(found, Physics):
        expected = "an object whose class is a Physics (ldt docs physics)"
        if isinstance(found, type) and issubclass(found, Physics):
            expected = f"an object, as in {found.__name__.upper()} = {found.__name__}()"
        raise MachineFileError(f"{where} {given}", expected, described(found))
    return found


def refuse_faulty(source: str, given: str, physics: Physics, values: Values, most: float) -> None:
    """Ask each function of somebody else's physics once, at the file's values.

    A mistake in one would else come up in the middle of a run, as the fault of whoever called it.

    Args:
        source: the machine file, for messages.
        given: what it names the physics.
        physics: to ask.
        values: its parameters; a function that changes them is refused.
        most: largest voltage [V].

    Raises:
        MachineFileError: a function that fails, gives numbers that are not finite, or describes
            another machine than `constants`.
    """
    if given in PHYSICS.builtin:
        return
    asked: dict[str, Callable[[Values], Any]] = {
        "initial_state": lambda v: physics.initial_state(v, 0.0),
        "is_linear": physics.is_linear,
        "shakes": physics.shakes,
        "state_space": physics.state_space,
    }
    if isinstance(physics, MotorDriven):
        asked["rate"] = lambda v: physics.rate(v, most)
        asked["constants"] = physics.constants
        asked["system"] = lambda v: physics.system(v) if physics.is_linear(v) else ()
    file = given.rpartition(":")[0]
    for name, function in asked.items():
        where, own = f"{source}, physics {given}, {name}", dict(values)
        try:
            found = function(own)
            rows = found if isinstance(found, tuple) else (found,)
            finite = all(np.isfinite(np.asarray(x, dtype=np.float64)).all() for x in rows)
        except FAULTS as error:  # whatever somebody else's function does
            got = reason_of(error) + line_in(file, error)
            raise MachineFileError(where, "numbers", got) from error
        if own != values:
            expected = "the parameters left as they are (change a copy: {**values, ...})"
            raise MachineFileError(where, expected, "others behind it")
        if not finite:
            raise MachineFileError(where, "finite numbers", "some that are not")
    if not isinstance(physics, MotorDriven) or len(physics.states) != len(MOTOR.states):
        return
    if physics.is_linear(values):
        _refuse_two_machines(f"{source}, physics {given}", physics, values, most)


def _refuse_two_machines(where: str, physics: MotorDriven, values: Values, most: float) -> None:
    """Refuse functions that differ: one is used with effects, one without, one to learn from."""
    c = physics.constants(values)
    if min(c.inertia, c.resistance, c.torque_constant) <= 0:
        expected = "an inertia, a resistance and a torque constant above 0"
        got = f"{c.inertia:.3g}, {c.resistance:.3g} and {c.torque_constant:.3g}"
        raise MachineFileError(f"{where}, constants", expected, got)
    motor = {"J": c.inertia, "K_t": c.torque_constant, "R": c.resistance}
    a, _ = motor_system({**motor, "L": c.inductance, "b": c.friction}, len(MOTOR.states))
    own = a[np.ix_([CURRENT, SPEED], [CURRENT, SPEED])]
    for name, told, right in (
        ("system", physics.system(values)[0], a),
        ("state_space", physics.state_space(values)[0], own),
    ):
        if told.shape != right.shape or not np.allclose(told, right, SAME, SAME):
            raise MachineFileError(f"{where}, {name}", "the machine of `constants`", "another")
    rate, fastest = physics.rate(values, most), float(np.abs(np.linalg.eigvals(own)).max())
    if rate < fastest * (1 - SAME):
        expected = f"{fastest:.3g} 1/s or more, as of `constants`"
        raise MachineFileError(f"{where}, rate", expected, f"{rate:.3g}")
