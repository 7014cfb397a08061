"""How a free run is integrated: the numbers that motor-driven machines' equations take."""

from __future__ import annotations

import functools
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError
from ldt_core.physics.base import Effects, FreeRun, Tracked, Work
from ldt_core.physics.parameter import Values

GRIDS_REMEMBERED = 8  # sample times: experiments of one stream mostly share theirs
STEP_SHARE = 1e-9  # of a step by which rounding may make it longer


class Constants(NamedTuple):
    """Numbers of the equations, in SI units."""

    torque_constant: float
    friction: float
    resistance: float
    inductance: float
    inertia: float  # J + m e^2 - (m e)^2 / (M + m): what is left after solving for theta''
    unbalance: float  # m e
    mass: float  # M + m
    stiffness_x: float
    stiffness_y: float
    damping_x: float
    damping_y: float
    weight_torque: float  # m g e


class Coefficients(NamedTuple):
    """The constants as the equations use them: divisions done once, not in each stage."""

    pull: float
    drag: float
    ease: float
    weight: float
    coupling: float
    supply: float
    loss: float
    emf: float
    lever: float
    stiffness_x: float
    stiffness_y: float
    damping_x: float
    damping_y: float


class BegunRun(NamedTuple):
    """A free run behind its effects on parameters and voltage.

    `switches` are the times [s] and levels [V] of the voltage, `on_grid` whether those times are
    the samples', `exact` whether all is linear.
    """

    values: Values
    times: Array
    switches: tuple[Array, Array]
    on_grid: bool
    initial: Array
    terms: Effects
    tracked: Tracked
    exact: bool
    work: Work | None


class Plan(NamedTuple):
    """How a free run is integrated.

    `step` and `calm` are the longest steps [s], and those to try first; `watched` and `quiet` as
    for `effect.gather`; `first` (7 + own,) the first state with the effects'; `rigid` whether three
    states are enough; `fast` whether the current is solved for, and then `explicit` whether that
    takes no more than its exponential, else `finest` how short a step may become [s].
    """

    values: Values
    coefficients: Coefficients
    step: float
    calm: float
    watched: list[bool]
    quiet: tuple[float, float]
    first: Array
    rigid: bool
    fast: bool
    explicit: bool
    finest: float


class Plans(Protocol):
    """What `side_by_side` asks of a physics: see `motor_driven.MotorDriven`."""

    states: tuple[str, ...]

    def begun(self, run: FreeRun) -> BegunRun:
        """The run with its effects on parameters and voltage done."""

    def alone(self, run: BegunRun, period: float, max_step: float, least_step: float) -> Array:
        """The states of a run that has begun."""

    def planned(
        self,
        values: Values,
        most: float,
        end: float,
        initial: Array,
        terms: Effects,
        max_step: float,
        least_step: float,
    ) -> Plan:
        """How to integrate a machine at up to `most` volts until `end` [s]."""

    def diverged(self, when: float) -> LdtError:
        """What is raised where the state is not finite at this time [s]."""


def coefficients_of(c: Constants) -> Coefficients:
    """The divisions done."""
    return Coefficients(
        pull=c.torque_constant / c.inertia,
        drag=c.friction / c.inertia,
        ease=1.0 / c.inertia,
        weight=c.weight_torque / c.inertia,
        coupling=c.unbalance / c.inertia,
        supply=1.0 / c.inductance,
        loss=c.resistance / c.inductance,
        emf=c.torque_constant / c.inductance,
        lever=c.unbalance / c.mass,
        stiffness_x=c.stiffness_x / c.mass,
        stiffness_y=c.stiffness_y / c.mass,
        damping_x=c.damping_x / c.mass,
        damping_y=c.damping_y / c.mass,
    )


def steps_of(edges: Array, longest: float) -> NDArray[np.int64]:
    """(K,) steps between the edges (K + 1,), none longer than that [s]."""
    return np.maximum(1, np.ceil(np.diff(edges) / longest - STEP_SHARE)).astype(np.int64)


@functools.lru_cache(maxsize=GRIDS_REMEMBERED)
def sample_times(length: int, period: float) -> Array:
    """(length,) from 0 [s]."""
    return np.asarray(np.arange(length) * period, dtype=np.float64)
