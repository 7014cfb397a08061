"""What a physics hands to the compiled equations of motion, known before anything is compiled."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, Protocol

import numpy as np

from ldt_core.base.arrays import Array

#: Speeds to follow (L,) [rad/s] or none (0,), and the part of the difference taken at a sample.
Tracked = tuple[Array, float]

NOT_TRACKED: Tracked = (np.zeros(0), 0.0)
MAX_STEP = 0.25e-3  # s; worst relative speed error 5e-6 over 300 random experiments of the rotor


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


class Equations(Protocol):
    """What the integrator asks of a physics; see `Physics` for each."""

    @property
    def name(self) -> str:
        """In the registry."""

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states."""

    def constants(self, values: Mapping[str, float]) -> Constants:
        """Numbers of the equations."""

    def rate(self, values: Mapping[str, float], voltage: float) -> float:
        """Fastest rate of change [1/s]."""
