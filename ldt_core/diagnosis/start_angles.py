"""The shaft's angle at an experiment's first sample, where it matters and is not measured."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.diagnosis.simulated_experiments import (
    DIFFERENCE_OF_START,
    SEARCH_STEP,
    Simulated,
    SimulatedExperiments,
    StartStates,
    Use,
)
from ldt_core.estimation.variable_projection import basis_of, project_out

ANGLES_TRIED = 13  # in a turn: a prime, so that a ripple of few periods a turn is seen at each
ANGLES_AT_ONCE = 8  # in each finer grid: as many as are simulated at once
ANGLE_TOLERANCE = 2e-3  # rad, below which start angles are all one
LINEAR_IN_ANGLE = 0.03  # rad: a ripple of 24 periods a turn goes through a tenth of one
ANGLE_STEPS = 2  # Gauss-Newton steps from the best of the last grid
ANGLE_MATTERS = 0.1  # noise deviations by which a start angle moves some sample, if it matters
FLAT = 1e-8  # squared slope of residuals that an angle does not move


def turns(residuals: SimulatedExperiments, use: Use) -> bool:
    """Whether the start angle makes a difference with these effects."""
    if not use or not residuals.pieces or not residuals.may_turn(use):
        return False
    asked = [Simulated(0, use, angle) for angle in (0.0, 1.0)]
    one, other = residuals.differences(asked, SEARCH_STEP)
    return bool(np.max(np.abs(one - other)) > ANGLE_MATTERS)


def best_angles(
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
        by = [-float(d @ r) / max(float(d @ d), FLAT) for r, d in zip(rests, slopes, strict=True)]
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


def least_from_any_angle(residuals: SimulatedExperiments, use: Use, step: float) -> float:
    """Sum of squares that is left where each experiment takes the best of angles all around."""
    places = range(len(residuals.pieces))
    return float(_losses(residuals, places, use, _turn(len(places)), step).min(axis=1).sum())


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
