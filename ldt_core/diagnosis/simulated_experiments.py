"""What the estimation of start states is told and takes: simulations of recorded experiments."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.experiment import Experiment
from ldt_core.machine.machine_file import Machine
from ldt_core.physics.base import ANGLE, CURRENT, NOT_TRACKED, SPEED, FreeRun, Physics
from ldt_core.physics.effect import Effect
from ldt_core.physics.integrate import propagate
from ldt_core.physics.motor import MOTOR
from ldt_core.physics.parameter import Values

Used = tuple[Effect, Mapping[str, float]]
Use = Sequence[Used]

NO_OFFSET = np.zeros(0)
SEARCH_STEP = 5e-3  # s, longest integration step: its error is below a third of the noise
DIFFERENCE_OF_START = 0.01  # rad, K, ...: of a start state, for difference quotients


def states_of(use: Use) -> int:
    """How many states the effects have."""
    return sum(len(effect.states) for effect, _ in use)


@dataclass(frozen=True, eq=False)
class StartStates:
    """What is taken of the states at the first samples.

    Attributes:
        angles: (experiments,) [rad].
        bases: for each experiment (rows, s) orthonormal directions that an unknown start moves.
        offsets: for each experiment the change of the states at its first sample from what is
            guessed, foundation's and effects' included; empty where that is not estimated.
    """

    angles: Array
    bases: tuple[Array, ...]
    offsets: tuple[Array, ...]


class Simulated(NamedTuple):
    """One simulation of an experiment.

    Attributes:
        place: of the experiment in the list.
        use: effects that act, with all their values.
        angle: at the first sample [rad].
        offset: (states,) change of the states at the first sample, or none.
        follow: False makes it a free run whatever the machine is.
    """

    place: int
    use: Use
    angle: float = 0.0
    offset: Array = NO_OFFSET
    follow: bool = True


@dataclass(frozen=True, eq=False)
class PreparedExperiment:
    """One experiment, prepared for its residuals.

    Attributes:
        columns: (rows, s) change of the residuals per unknown first speed and current.
    """

    experiment: Experiment
    at_rest: bool
    rows: slice
    columns: Array

    @property
    def channels(self) -> list[slice]:
        """Rows of the speed, and of the current where it was measured."""
        length = len(self.experiment)
        return [slice(k, k + length) for k in range(self.rows.start, self.rows.stop, length)]


def motor_columns(
    values: Values, e: Experiment, unknown: Sequence[int], noise: tuple[float, float]
) -> Array:
    """(rows, s) change of an experiment's residuals per unknown first speed and current.

    Args:
        values: of the motor.
        unknown: places of those states.
        noise: deviations of speed [rad/s] and current [A].
    """
    columns = np.zeros((len(e) * (1 if e.current is None else 2), len(unknown)))
    ad, bd = MOTOR.discretised(values, e.period)
    for column, state in zip(columns.T, unknown, strict=True):
        first = np.zeros(3)
        first[state] = 1.0
        moved = propagate(ad, bd, np.zeros(len(e)), first, *NOT_TRACKED)
        column[: len(e)] = moved[:, SPEED] / noise[0]
        if e.current is not None:
            column[len(e) :] = moved[:, CURRENT] / noise[1]
    return columns


def corrections(physics: Physics, values: Values, run: FreeRun, states: Array) -> Array:
    """(L, 3) what the observer has added to angle, speed and current so far."""
    seen, gain = run.tracked
    ad, _ = MOTOR.discretised(physics.folded(values), run.period)
    pushed = gain * (seen - states[:, SPEED])
    moved = propagate(ad, np.ascontiguousarray(ad[:, SPEED]), pushed, np.zeros(3), *NOT_TRACKED)
    moved[:, ANGLE] = 0.0
    return moved


class SimulatedExperiments(Protocol):
    """What the estimation of start states needs of `FreeRunResiduals`."""

    machine: Machine
    physics: Physics
    values: dict[str, float]
    pieces: list[PreparedExperiment]
    starts: StartStates
    noise: tuple[float, float]
    shaking: bool

    def changed(self, use: Use) -> Mapping[str, float] | None:
        """The machine's parameters with these effects; None where they are impossible."""

    def may_turn(self, use: Use) -> bool:
        """Whether anything may depend on the shaft's angle: the machine, or what an effect does."""

    def differences(self, runs: Sequence[Simulated], step: float) -> Iterator[Array]:
        """(rows,) measured minus simulated of each, in noise deviations."""

    def own_states(self, runs: Sequence[Simulated], step: float) -> list[Array]:
        """Of each (samples, states) of the effects, less what they would begin with there."""
