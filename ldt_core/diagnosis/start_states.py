"""What the states at an experiment's first sample were, as far as more than noise hides them.

A machine at rest stands still, at an angle that may matter. One that was running has a speed and a
current, a foundation in motion, a warm winding: all are estimated with the effects, and what is
still unknown of them is projected out of the residuals.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from scipy.optimize import minimize_scalar

from ldt_core.base.arrays import Array
from ldt_core.estimation.variable_projection import basis_of, least_squares_step, project_out
from ldt_core.physics.base import ANGLE, CURRENT, Physics
from ldt_core.physics.effect import Effect

Use = Sequence[tuple[Effect, Mapping[str, float]]]

MOTOR_NAMES = ("J", "K_t", "R", "L", "b")  # parameters that shake nothing
NO_OFFSET = np.zeros(0)
SEARCH_STEP = 2e-3  # s, longest integration step: its error is far below the noise
GAUSS_NEWTON_STEPS = 4  # for a foundation in motion, whose start is not linear in the speed
LEAST_DECREASE = 0.98  # of the loss: a step after which more than that is left is the last
ANGLES_TRIED = 13  # in a turn: a prime, so that a ripple of few periods a turn is seen at each
ANGLE_TOLERANCE = 2e-3  # rad, to which the best angle is then found
ANGLE_MATTERS = 0.1  # noise deviations by which a start angle moves some sample, if it matters
DIFFERENCE_OF_START = 0.01  # rad, K, ...: of a start state, for difference quotients
SINGULAR = 1e-8  # of the largest singular value: a combination of start states that moves nothing
FOUNDATION_SCALE = 0.01  # of that difference: a foundation moves by millimetres


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


class SimulatedExperiments(Protocol):
    """What the estimation of start states needs of `FreeRunResiduals`."""

    physics: Physics
    values: dict[str, float]
    pieces: list[Any]
    starts: StartStates
    shaking: bool

    def changed(self, use: Use) -> Mapping[str, float] | None:
        """The machine's parameters with these effects; None where they are impossible."""

    def difference(
        self, i: int, use: Use, step: float, angle: float, offset: Array = NO_OFFSET
    ) -> Array:
        """(rows,) measured minus simulated of one experiment, in noise deviations."""

    def each(self, work: Callable[[int], None]) -> None:
        """Do something with every experiment, by its place."""


def start_states_for(
    residuals: SimulatedExperiments,
    use: Use,
    free: bool,
    step: float,
    near: StartStates | None = None,
) -> StartStates:
    """Start states for these effects, where more is unknown than a motor's speed and current.

    A machine that was running has a foundation in motion, a warm winding and the like, each of
    which moves the residuals in a direction of its own, and an angle that is sought.

    Args:
        free: seek the angle of machines at rest as well; else it is 0.
        step: longest integration step [s].
    """
    values = residuals.changed(use)
    if values is None:
        return residuals.starts
    shaken = any(v != residuals.values[n] for n, v in values.items() if n not in MOTOR_NAMES)
    states = sum(len(e.states) for e, _ in use if e.torque is not None or e.terminal is not None)
    # The angles that a shaking machine is known by were sought without the effects.
    free = free or residuals.shaking
    turning = bool(use) and (residuals.shaking or turns(residuals, use))
    running = any(not p.at_rest for p in residuals.pieces)
    if not ((running and (shaken or states or turning)) or (free and turning)):
        return residuals.starts
    moving = residuals.physics.shakes(values)
    return searched_start_states(
        residuals, use, moving, states, turning or (shaken and moving), free, step, near
    )


def searched_start_states(
    residuals: SimulatedExperiments,
    use: Use,
    moving: bool,
    states: int,
    turning: bool,
    free: bool,
    step: float,
    near: StartStates | None = None,
) -> StartStates:
    """The same, once it is known what is unknown.

    Args:
        moving: the foundation moves.
        states: how many states the effects have.
        turning: the angle matters.
        free: also that of machines at rest.
        step: longest integration step [s].
        near: starts beside whose angles these are sought.
    """
    angles, bases = residuals.starts.angles.copy(), list(residuals.starts.bases)
    offsets = list(residuals.starts.offsets)
    n = len(residuals.physics.states)
    # The states of a foundation in motion and of the effects, each with its difference step.
    unknown = (
        {k: DIFFERENCE_OF_START * FOUNDATION_SCALE for k in range(CURRENT + 1, n)} if moving else {}
    )
    unknown |= {k: DIFFERENCE_OF_START for k in range(n, n + states)}
    if turning:
        unknown[ANGLE] = DIFFERENCE_OF_START

    def work(i: int) -> None:
        piece = residuals.pieces[i]
        if turning and (free or not piece.at_rest):
            about = None if near is None else float(near.angles[i])
            angles[i] = _best_angle(residuals, i, use, step, about)
        if not piece.at_rest and unknown:
            rounds = GAUSS_NEWTON_STEPS if moving else 1
            found = _start_of(
                residuals, i, use, step, float(angles[i]), unknown, n + states, rounds
            )
            offsets[i], bases[i] = found
        elif turning and free and not residuals.shaking:
            # Else a fit could move the effects only as far as these angles let it.
            now, moved = (
                residuals.difference(i, use, step, float(angles[i]) + by)
                for by in (0.0, DIFFERENCE_OF_START)
            )
            bases[i] = basis_of(np.column_stack([piece.columns, moved - now]))

    residuals.each(work)
    return StartStates(angles, tuple(bases), tuple(offsets))


def _start_of(
    residuals: SimulatedExperiments,
    i: int,
    use: Use,
    step: float,
    angle: float,
    unknown: Mapping[int, float],
    count: int,
    rounds: int,
) -> tuple[Array, Array]:
    """(offset of the start states, directions in which they move the residuals).

    Gauss-Newton steps from the guess, as long as they help; the first speed and current are
    left to the directions, in which they are linear.
    """
    piece, offset = residuals.pieces[i], np.zeros(count)
    names = list(unknown)
    best, basis, kept = math.inf, residuals.starts.bases[i], offset
    motor = basis_of(piece.columns)
    for _ in range(rounds):
        rest = residuals.difference(i, use, step, angle, offset)
        loss = float(rest @ rest - np.sum((motor.T @ rest) ** 2))
        if loss >= best * LEAST_DECREASE:
            break
        columns = np.empty((rest.size, len(names)))
        for j, state in enumerate(names):
            moved = offset.copy()
            moved[state] += unknown[state]
            columns[:, j] = residuals.difference(i, use, step, angle, moved) - rest
        both = np.column_stack([piece.columns, columns])
        directions = basis_of(both)
        left = project_out(rest, directions)
        best, basis, kept = loss, directions, offset
        if float(left @ left) > loss * LEAST_DECREASE:
            break
        solved = least_squares_step(both, -rest, SINGULAR)
        offset = offset.copy()
        for j, state in enumerate(names):
            offset[state] += solved[piece.columns.shape[1] + j] * unknown[state]
    return kept, basis


def turns(residuals: SimulatedExperiments, use: Use) -> bool:
    """Whether the start angle makes a difference with these effects."""
    if not use or not residuals.pieces:
        return False
    one, other = (residuals.difference(0, use, SEARCH_STEP, angle) for angle in (0.0, 1.0))
    return bool(np.max(np.abs(one - other)) > ANGLE_MATTERS)


def _best_angle(
    residuals: SimulatedExperiments, i: int, use: Use, step: float, about: float | None
) -> float:
    basis = residuals.starts.bases[i]

    def loss(angle: float) -> float:
        rest = residuals.difference(i, use, step, angle)
        along = basis.T @ rest
        return float(rest @ rest - along @ along)

    width = 2 * math.pi / ANGLES_TRIED
    best = about
    if best is None:
        best = min((loss(k * width), k * width) for k in range(ANGLES_TRIED))[1]
    near, exact = (best - width, best + width), {"xatol": ANGLE_TOLERANCE}
    return float(minimize_scalar(loss, bounds=near, method="bounded", options=exact).x)
