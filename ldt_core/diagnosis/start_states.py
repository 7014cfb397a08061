"""What the states at an experiment's first sample were, as far as more than noise hides them.

A machine at rest stands still, at an angle that may matter. One that was running has a speed and a
current, a foundation in motion, a warm winding: all are estimated with the effects, and what is
still unknown of them is projected out of the residuals.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.diagnosis.nominal_prior import MOTOR
from ldt_core.diagnosis.simulated_experiments import (
    DIFFERENCE_OF_START,
    NO_OFFSET,
    Simulated,
    SimulatedExperiments,
    StartStates,
    Use,
    motor_columns,
    states_of,
)
from ldt_core.diagnosis.start_angles import ANGLES_TRIED, best_angles, turns
from ldt_core.estimation.least_squares import damped_step
from ldt_core.estimation.variable_projection import basis_of, project_out
from ldt_core.physics.base import ANGLE, CURRENT, SPEED
from ldt_core.physics.parameter import Values

FOUNDATION_STEPS = 12  # for a foundation in motion, whose start is not linear in the speed
STATE_STEPS = 6  # for effects' states; of several dampings at once, so that few lead to the minimum
LEAST_DECREASE = 0.98  # of the loss: a step after which more than that is left is the last
ANGLES_FOLLOWED = 2  # from which a foundation's motion is sought
DAMPINGS = tuple(10.0 ** np.arange(-6.0, 2.0))  # of Marquardt steps: as many as run at once
STATES_AT_ONCE = 8  # starts of the effects' states that are tried: as many as are simulated at once
STATES_FOLLOWED = 3  # of these, from which steps are made until two end alike
MOST_KEPT = 0.9  # of a state in an experiment: of what is kept longer, the experiment shows little
TINY, LARGEST = 1e-300, 1e150  # of states, and of those whose squares are numbers
TURNED = (0.0, DIFFERENCE_OF_START)  # rad, for the slope by a start angle
FOUNDATION_SCALE = 0.01  # of `DIFFERENCE_OF_START`: a foundation moves by millimetres


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
        free: seek the angle of machines at rest as well, and the states that the effects begin
            with; else these are as usual.
        step: longest integration step [s].
    """
    values = residuals.changed(use)
    if values is None:
        return residuals.starts
    columns = _columns(residuals, values)
    shaken = any(v != residuals.values[n] for n, v in values.items() if n not in MOTOR)
    states = states_of(use)
    still = free and bool(states)
    # The angles that a shaking machine is known by were sought without the effects.
    free = free or residuals.shaking
    turning = bool(use) and (residuals.shaking or turns(residuals, use))
    running = any(not p.at_rest for p in residuals.pieces)
    bent = _is_bent(residuals, use)
    if not ((running and (shaken or states or turning or bent)) or (free and turning) or still):
        if columns is None:
            return residuals.starts
        return replace(residuals.starts, bases=tuple(map(basis_of, columns)))
    moving = residuals.physics.shakes(values)
    turning = turning or (shaken and moving)
    about = residuals, use, moving, turning, free, step, near, still, columns, bent
    return searched_start_states(*about)


def _is_bent(residuals: SimulatedExperiments, use: Use) -> bool:
    """Whether what an unmeasured first current moves may be far from linear: a friction's sign
    changes with it.
    """
    unmeasured = any(p.experiment.current is None for p in residuals.pieces)
    return unmeasured and any(e.terms for e, _ in (*residuals.machine.effects, *use))


def _columns(residuals: SimulatedExperiments, values: Values) -> list[Array] | None:
    """Of each experiment (rows, s) what a first speed and current move in a machine with these
    parameters; None where that is as without effects.

    A current that nobody has measured may be far from its guess, and a winding or an inertia that
    is another keeps it for another time.
    """
    pieces, own = residuals.pieces, residuals.values
    if all(values[n] == own[n] for n in MOTOR) or not any(p.columns.size for p in pieces):
        return None
    motor, noise = residuals.physics.folded(values), residuals.noise
    return [
        motor_columns(motor, p.experiment, (SPEED, CURRENT)[-p.columns.shape[1] :], noise)
        if p.columns.size
        else p.columns
        for p in pieces
    ]


def searched_start_states(
    residuals: SimulatedExperiments,
    use: Use,
    moving: bool,
    turning: bool,
    free: bool,
    step: float,
    near: StartStates | None = None,
    still: bool = False,
    columns: Sequence[Array] | None = None,
    bent: bool = False,
) -> StartStates:
    """The same, once it is known what is unknown.

    Args:
        moving: the foundation moves.
        turning: the angle matters.
        free: also that of machines at rest.
        step: longest integration step [s].
        near: starts beside whose angles these are sought.
        still: the effects' states are sought in machines at rest as well.
        columns: of each experiment, see `PreparedExperiment`, where the effects change them.
        bent: the first speed and current are sought as well.
    """
    pieces = residuals.pieces
    search = _StartSearch(residuals, use, step, columns or [p.columns for p in pieces])
    angles, bases = residuals.starts.angles.copy(), list(residuals.starts.bases)
    if columns is not None:
        bases = list(map(basis_of, columns))
    offsets = list(residuals.starts.offsets)
    n, states = search.machine, search.own
    # The states of a foundation in motion and of the effects, each with its difference step. Beside
    # the latter, the speed is no longer linear in the first speed and current.
    unknown = (
        {k: DIFFERENCE_OF_START * FOUNDATION_SCALE for k in range(CURRENT + 1, n)} if moving else {}
    )
    if states or bent:
        unknown |= {k: DIFFERENCE_OF_START for k in (SPEED, CURRENT, *range(n, n + states))}
    if turning:
        unknown[ANGLE] = DIFFERENCE_OF_START

    if turning:
        sought = [i for i, piece in enumerate(pieces) if free or not piece.at_rest]
        angles[sought] = best_angles(residuals, sought, use, step, near)
    if turning and free:
        # Else a fit could move the effects only as far as these angles let it.
        stood = [i for i, piece in enumerate(pieces) if piece.at_rest or not unknown]
        turned = [(i, float(angles[i]) + by, NO_OFFSET) for i in stood for by in TURNED]
        found = search.rests(turned)
        for i, now, moved in zip(stood, found, found, strict=False):
            bases[i] = basis_of(np.column_stack([search.columns[i], moved - now]))
    begin = [i for i, piece in enumerate(pieces) if unknown and (still or not piece.at_rest)]
    reached = search.attained(begin, angles) if states else []
    for at, i in enumerate(begin):
        own = {k: by for k, by in unknown.items() if k in (ANGLE, *range(n, n + states))}
        steps = own if pieces[i].at_rest else unknown
        rest = np.zeros(n + states)
        begun, reach = [(float(angles[i]), rest)], np.full((2, n + states), [[-np.inf], [np.inf]])
        if states:
            reach[:, n:] = reached[at].reach
            followed = STATES_FOLLOWED if near is None else 1
            begun = [(float(angles[i]), o) for o in reached[at].offsets[:followed]]
        if moving and turning and near is None:
            begun += [(t, rest) for t in search.projected_angles(i, rest, unknown)]
        if near is not None and near.offsets[i].size == n + states:
            begun.append((float(near.angles[i]), near.offsets[i]))
        rounds = FOUNDATION_STEPS if moving else STATE_STEPS if states or bent else 1
        tried: list[tuple[float, Array, Array]] = []
        for start in begun:
            tried.append(search.descended(i, *start, steps, rounds, reach))
            least, *further = sorted(left for left, *_ in tried)
            if further and least > LEAST_DECREASE * further[0]:
                break
        best = min(range(len(tried)), key=lambda k: tried[k][0])
        angles[i], (_, offsets[i], bases[i]) = begun[best][0], tried[best]
    return StartStates(angles, tuple(bases), tuple(offsets))


class _Attained(NamedTuple):
    """What the effects' states come to in an experiment.

    Attributes:
        offsets: (tried, states) of all states at the first sample, that of least loss first.
        reach: (2, states) the least and the largest of the effects' states.
    """

    offsets: Array
    reach: Array


class _StartSearch:
    """Free runs of one set of effects from start states that are sought.

    Args:
        step: longest integration step [s].
        columns: of each experiment (rows, s), per unknown first speed and current.
    """

    def __init__(
        self, residuals: SimulatedExperiments, use: Use, step: float, columns: Sequence[Array]
    ) -> None:
        self.residuals, self.use, self.step, self.columns = residuals, use, step, columns
        #: Number of the machine's states, and of the effects'.
        self.machine, self.own = len(residuals.physics.states), states_of(use)

    def rests(self, starts: Sequence[tuple[int, float, Array]]) -> Iterator[Array]:
        """(rows,) residuals of each experiment from an angle [rad] and an offset."""
        return self.residuals.differences(self._runs(starts), self.step)

    def _runs(self, starts: Sequence[tuple[int, float, Array]]) -> list[Simulated]:
        return [Simulated(i, self.use, angle, offset) for i, angle, offset in starts]

    def attained(self, places: Sequence[int], angles: Array) -> list[_Attained]:
        """Of each of these experiments, what the effects' states come to.

        Where a far end lies within its play moves the speed by no slope that leads there. Beyond
        what they come to, a winding that hardly warms would begin as hot as any resistance asks
        for. What they come to is told by the experiment done twice: what is gained the second time
        is taken to go on shrinking as it did (Aitken's extrapolation).
        """
        n = self.machine
        usual = np.zeros(n + self.own)

        def ends(own: Sequence[Array]) -> list[Array]:
            begun = [
                (i, float(angles[i]), np.append(usual[:n], o))
                for i, o in zip(places, own, strict=True)
            ]
            return self.residuals.own_states(self._runs(begun), self.step)

        once = ends([usual[n:]] * len(places))
        twice = ends([rows[-1] for rows in once])
        reached = []
        for one, two in zip(once, twice, strict=True):
            first, second = one[-1], two[-1]
            kept = np.clip((second - first) / np.where(first == 0, np.inf, first), 0.0, MOST_KEPT)
            reached.append(np.vstack([one, two, first + (second - first) / (1 - kept)]))
        tried = np.zeros((len(places), STATES_AT_ONCE, n + self.own))
        for offsets, rows in zip(tried, reached, strict=True):
            offsets[1:, n:] = _far_apart(rows, STATES_AT_ONCE - 1)
        asked = [
            (i, float(angles[i]), offset)
            for i, offsets in zip(places, tried, strict=True)
            for offset in offsets
        ]
        motors = {i: basis_of(self.columns[i]) for i in places}
        left = [
            _loss_beside(motors[i], rest)
            for (i, _, _), rest in zip(asked, self.rests(asked), strict=True)
        ]
        found = []
        for offsets, losses, rows in zip(
            tried, np.reshape(left, tried.shape[:2]), reached, strict=True
        ):
            best = np.argsort(losses, kind="stable")
            reach = np.array([np.minimum(rows.min(axis=0), 0.0), np.maximum(rows.max(axis=0), 0.0)])
            found.append(_Attained(offsets[best], reach))
        return found

    def projected_angles(self, i: int, offset: Array, unknown: Mapping[int, float]) -> list[float]:
        """Angles at which least is left once the other start states have followed, best first.

        The motion of a foundation hides the angle from a shaft that is simulated without it.
        """
        columns = self.columns[i]
        tried = [k * 2 * math.pi / ANGLES_TRIED for k in range(ANGLES_TRIED)]
        offsets = _about(offset, {k: by for k, by in unknown.items() if k != ANGLE})
        found, left = list(self.rests([(i, a, begun) for a in tried for begun in offsets])), []
        for k in range(0, len(found), len(offsets)):
            rest, *there = found[k : k + len(offsets)]
            moved = basis_of(np.column_stack([columns, *(m - rest for m in there)]))
            left.append(float(np.sum(project_out(rest, moved) ** 2)))
        return [tried[k] for k in np.argsort(left)[:ANGLES_FOLLOWED]]

    def descended(
        self,
        i: int,
        angle: float,
        offset: Array,
        unknown: Mapping[int, float],
        rounds: int,
        reach: Array,
    ) -> tuple[float, Array, Array]:
        """(loss, offset of the start states, directions in which they move the residuals).

        Marquardt steps from an offset, of several dampings at once, as long as the best one helps;
        the first speed and current are left to the directions where they are linear.

        Args:
            unknown: places of the states that are sought, each with its difference step.
            reach: (2, states) least and largest offsets.
        """
        columns = self.columns[i]
        linear = columns[:, :0] if SPEED in unknown else columns
        motor, kept = basis_of(linear), offset
        (rest,) = self.rests([(i, angle, kept)])
        loss = _loss_beside(motor, rest)
        for last in (False,) * (rounds - 1) + (True,):
            there = list(self.rests([(i, angle, begun) for begun in _about(kept, unknown)[1:]]))
            both = np.column_stack([linear, *(moved - rest for moved in there)])
            half = (reach[1] - reach[0])[list(unknown)] / 2 / list(unknown.values())
            basis = directions(both, np.append(np.full(linear.shape[1], np.inf), half))
            left = float(np.sum(project_out(rest, basis) ** 2))
            if last or left > loss * LEAST_DECREASE:
                break
            normal, slope = both.T @ both, both.T @ rest
            tried = []
            for damping in DAMPINGS:
                by = damped_step(normal, slope, damping, np.full(len(slope), np.inf))
                moved = kept.copy()
                moved[list(unknown)] += by[linear.shape[1] :] * list(unknown.values())
                tried.append(np.clip(moved, *reach))
            rests = list(self.rests([(i, angle, begun) for begun in tried]))
            losses = [_loss_beside(motor, r) for r in rests]
            best = int(np.argmin(losses))
            if not losses[best] < loss * LEAST_DECREASE:
                break
            kept, rest, loss = tried[best], rests[best], losses[best]
        return left, kept, basis


def _far_apart(rows: Array, count: int) -> Array:
    """(count, n) of these rows, each the farthest from those before it and from 0."""
    finite = np.clip(rows, -LARGEST, LARGEST)  # a run may explode
    scaled = np.clip(finite / np.maximum(np.std(finite, axis=0), TINY), -LARGEST, LARGEST)
    away, found = np.sum(scaled**2, axis=1), []
    for _ in range(count):
        found.append(int(np.argmax(away)))
        away = np.minimum(away, np.sum((scaled - scaled[found[-1]]) ** 2, axis=1))
    return np.asarray(rows[found])


def _about(offset: Array, steps: Mapping[int, float]) -> list[Array]:
    """An offset, and for each of these states one that differs in it by its step."""
    found = [offset.copy() for _ in range(1 + len(steps))]
    for moved, (state, by) in zip(found[1:], steps.items(), strict=True):
        moved[state] += by
    return found


def _loss_beside(basis: Array, rest: Array) -> float:
    """Sum of squares of what is left beside orthonormal directions."""
    return float(rest @ rest - np.sum((basis.T @ rest) ** 2))


def directions(columns: Array, deviations: Array) -> Array:
    """(rows, k) by which `project_out` leaves of residuals what start states do not explain.

    What is known of a start state beforehand is one more source of noise: residuals are divided by
    the deviation of both together.

    Args:
        columns: (rows, s) change of the residuals per start state.
        deviations: (s,) of what is known of each, infinite where nothing is.
    """
    free = basis_of(columns[:, np.isinf(deviations)])
    known = np.isfinite(deviations)
    if not known.any():
        return free
    moved = project_out(columns[:, known] * deviations[known], free)
    left, size, _ = np.linalg.svd(moved, full_matrices=False)
    return np.column_stack([free, left * np.sqrt(1 - 1 / np.hypot(1.0, size))])
