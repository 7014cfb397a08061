"""What the states at an experiment's first sample were, as far as more than noise hides them.

A machine at rest stands still, at an angle that may matter. One that was running has a speed and a
current, a foundation in motion, a warm winding: all are estimated with the effects, and what is
still unknown of them is projected out of the residuals.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.diagnosis.nominal_prior import MOTOR
from ldt_core.estimation.variable_projection import basis_of, least_squares_step, project_out
from ldt_core.physics.base import ANGLE, CURRENT, Physics
from ldt_core.physics.effect import Effect

Use = Sequence[tuple[Effect, Mapping[str, float]]]

NO_OFFSET = np.zeros(0)
SEARCH_STEP = 5e-3  # s, longest integration step: its error is below a third of the noise
GAUSS_NEWTON_STEPS = 12  # for a foundation in motion, whose start is not linear in the speed
LEAST_DECREASE = 0.98  # of the loss: a step after which more than that is left is the last
ANGLES_TRIED = 13  # in a turn: a prime, so that a ripple of few periods a turn is seen at each
ANGLES_FOLLOWED = 2  # from which a foundation's motion is sought
ANGLES_AT_ONCE = 8  # in each finer grid: as many as are simulated at once
ANGLE_TOLERANCE = 2e-3  # rad, to which the best angle is found
LINEAR_IN_ANGLE = 0.03  # rad: a ripple of 24 periods a turn goes through a tenth of one
ANGLE_STEPS = 2  # Gauss-Newton steps from the best of the last grid
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


class SimulatedExperiments(Protocol):
    """What the estimation of start states needs of `FreeRunResiduals`."""

    physics: Physics
    values: dict[str, float]
    pieces: list[Any]
    starts: StartStates
    shaking: bool

    def changed(self, use: Use) -> Mapping[str, float] | None:
        """The machine's parameters with these effects; None where they are impossible."""

    def differences(self, runs: Sequence[Simulated], step: float) -> Iterator[Array]:
        """(rows,) measured minus simulated of each, in noise deviations."""


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
    shaken = any(v != residuals.values[n] for n, v in values.items() if n not in MOTOR)
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

    pieces = residuals.pieces
    if turning:
        sought = [i for i, piece in enumerate(pieces) if free or not piece.at_rest]
        angles[sought] = _best_angles(residuals, sought, use, step, near)
    if turning and free:
        # Else a fit could move the effects only as far as these angles let it.
        still = [i for i, piece in enumerate(pieces) if piece.at_rest or not unknown]
        turned = [
            Simulated(i, use, float(angles[i]) + by)
            for i in still
            for by in (0.0, DIFFERENCE_OF_START)
        ]
        found = residuals.differences(turned, step)
        for i, now, moved in zip(still, found, found, strict=False):
            bases[i] = basis_of(np.column_stack([pieces[i].columns, moved - now]))
    for i, piece in enumerate(pieces):
        if piece.at_rest or not unknown:
            continue
        rest = np.zeros(n + states)
        begun = [(float(angles[i]), rest)]
        if moving and turning and near is None:
            begun += [(t, rest) for t in _projected_angles(residuals, i, use, step, rest, unknown)]
        if near is not None and near.offsets[i].size == n + states:
            begun.append((float(near.angles[i]), near.offsets[i]))
        rounds = GAUSS_NEWTON_STEPS if moving else 1
        tried = [_start_of(residuals, i, use, step, *b, unknown, rounds) for b in begun]
        best = min(range(len(tried)), key=lambda k: tried[k][0])
        angles[i], (_, offsets[i], bases[i]) = begun[best][0], tried[best]
    return StartStates(angles, tuple(bases), tuple(offsets))


def _about(offset: Array, steps: Mapping[int, float]) -> list[Array]:
    """An offset, and for each of these states one that differs in it by its step."""
    found = [offset.copy() for _ in range(1 + len(steps))]
    for moved, (state, by) in zip(found[1:], steps.items(), strict=True):
        moved[state] += by
    return found


def _projected_angles(
    residuals: SimulatedExperiments,
    i: int,
    use: Use,
    step: float,
    offset: Array,
    unknown: Mapping[int, float],
) -> list[float]:
    """Angles at which least is left once the other start states have followed, the best first.

    The motion of a foundation hides the angle from a shaft that is simulated without it.
    """
    piece = residuals.pieces[i]
    tried = [k * 2 * math.pi / ANGLES_TRIED for k in range(ANGLES_TRIED)]
    offsets = _about(offset, {k: by for k, by in unknown.items() if k != ANGLE})
    asked = [Simulated(i, use, angle, begun) for angle in tried for begun in offsets]
    found, left = list(residuals.differences(asked, step)), []
    for k in range(0, len(found), len(offsets)):
        rest, *there = found[k : k + len(offsets)]
        directions = basis_of(np.column_stack([piece.columns, *(m - rest for m in there)]))
        left.append(float(np.sum(project_out(rest, directions) ** 2)))
    return [tried[k] for k in np.argsort(left)[:ANGLES_FOLLOWED]]


def _start_of(
    residuals: SimulatedExperiments,
    i: int,
    use: Use,
    step: float,
    angle: float,
    offset: Array,
    unknown: Mapping[int, float],
    rounds: int,
) -> tuple[float, Array, Array]:
    """(loss, offset of the start states, directions in which they move the residuals).

    Gauss-Newton steps from an offset, as long as they help, each shortened until it does; the
    first speed and current are left to the directions, in which they are linear.
    """
    piece = residuals.pieces[i]
    best, left, basis, kept = math.inf, math.inf, residuals.starts.bases[i], offset
    motor, by = basis_of(piece.columns), np.zeros(offset.size)
    for _ in range(rounds):
        now = kept + by
        asked = [Simulated(i, use, angle, begun) for begun in _about(now, unknown)]
        rest, *there = residuals.differences(asked, step)
        loss = float(rest @ rest - np.sum((motor.T @ rest) ** 2))
        if loss >= best * LEAST_DECREASE:
            if loss < best / LEAST_DECREASE:
                break
            by = by / 4
            continue
        both = np.column_stack([piece.columns, *(moved - rest for moved in there)])
        best, kept, basis = loss, now, basis_of(both)
        left = float(np.sum(project_out(rest, basis) ** 2))
        if left > loss * LEAST_DECREASE:
            break
        solved = least_squares_step(both, -rest, SINGULAR)
        by = np.zeros(offset.size)
        for j, state in enumerate(unknown):
            by[state] = solved[piece.columns.shape[1] + j] * unknown[state]
    return left, kept, basis


def turns(residuals: SimulatedExperiments, use: Use) -> bool:
    """Whether the start angle makes a difference with these effects."""
    if not use or not residuals.pieces:
        return False
    asked = [Simulated(0, use, angle) for angle in (0.0, 1.0)]
    one, other = residuals.differences(asked, SEARCH_STEP)
    return bool(np.max(np.abs(one - other)) > ANGLE_MATTERS)


def _best_angles(
    residuals: SimulatedExperiments,
    places: Sequence[int],
    use: Use,
    step: float,
    near: StartStates | None,
) -> Array:
    """The start angles of these experiments at which least is left [rad].

    Grids about the best angle so far, each finer by half its points: all angles of a grid are
    simulated at once. The last one is so fine that the residuals are nearly linear in the angle.
    """

    def best_of(grids: Array) -> Array:
        least = np.argmin(_losses(residuals, places, use, grids, step), axis=1)
        return np.asarray(grids[np.arange(len(places)), least])

    width = 2 * math.pi / ANGLES_TRIED
    best = best_of(_turn(len(places))) if near is None else near.angles[list(places)]
    while width > LINEAR_IN_ANGLE:
        parts = np.arange(1, ANGLES_AT_ONCE + 1) * (2 / (ANGLES_AT_ONCE + 1)) - 1.0
        best = best_of(best[:, None] + width * parts)
        width *= 2 / (ANGLES_AT_ONCE + 1)
    for _ in range(ANGLE_STEPS):
        rests, slopes = _slopes(residuals, places, use, best, step)
        by = [
            -float(d @ r) / max(float(d @ d), SINGULAR) for r, d in zip(rests, slopes, strict=True)
        ]
        best = best + np.clip(by, -width, width)
    return best


def _turn(count: int) -> Array:
    """(count, angles) the same angles all around for each [rad]."""
    return np.tile(2 * math.pi / ANGLES_TRIED * np.arange(ANGLES_TRIED), (count, 1))


def _losses(
    residuals: SimulatedExperiments, places: Sequence[int], use: Use, angles: Array, step: float
) -> Array:
    """(places, angles) what is left of each experiment from each of its angles."""
    asked = [
        Simulated(i, use, float(angle))
        for i, row in zip(places, angles, strict=True)
        for angle in row
    ]
    losses = []
    for run, rest in zip(asked, residuals.differences(asked, step), strict=True):
        along = residuals.starts.bases[run.place].T @ rest
        losses.append(float(rest @ rest - along @ along))
    return np.reshape(losses, angles.shape)


def _slopes(
    residuals: SimulatedExperiments, places: Sequence[int], use: Use, angles: Array, step: float
) -> tuple[list[Array], list[Array]]:
    """Of each experiment (rows,) what is left, and its change per angle [1/rad]."""
    asked = [
        Simulated(i, use, float(angle) + by)
        for i, angle in zip(places, angles, strict=True)
        for by in (0.0, DIFFERENCE_OF_START)
    ]
    bases = residuals.starts.bases
    found = [
        project_out(rest, bases[run.place])
        for run, rest in zip(asked, residuals.differences(asked, step), strict=True)
    ]
    rests, moved = found[::2], found[1::2]
    return rests, [(m - r) / DIFFERENCE_OF_START for r, m in zip(rests, moved, strict=True)]


def gain_of_angles(
    residuals: SimulatedExperiments, use: Use, jacobian: Array, step: float
) -> float:
    """About how much less is left where each experiment has a start angle of its own.

    The larger of what other angles alone gain, all around, and what angles nearby gain together
    with the parameters, to first order.

    Args:
        jacobian: (size, p) change of the residuals per coordinate.
    """
    places = range(len(residuals.pieces))
    angles = residuals.starts.angles
    losses = _losses(residuals, places, use, angles[:, None] + _turn(len(angles)), step)
    around = float(np.sum(losses[:, 0] - losses.min(axis=1)))
    rests, slopes = _slopes(residuals, places, use, angles, step)
    columns = np.zeros((len(jacobian), len(slopes)))
    for j, (piece, slope) in enumerate(zip(residuals.pieces, slopes, strict=True)):
        columns[piece.rows, j] = slope
    rest = np.concatenate(rests)
    with_angles = basis_of(np.column_stack([jacobian, columns])).T @ rest
    without = basis_of(jacobian).T @ rest
    return max(around, float(with_angles @ with_angles - without @ without))
