"""A set of effects fitted to the residuals: all its parameters, by nonlinear least squares."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.sentences import spoken
from ldt_core.diagnosis.candidate import START_PHASES, Candidate
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.nominal_prior import NominalCandidate
from ldt_core.diagnosis.simulated_experiments import SEARCH_STEP, StartStates, Used, states_of
from ldt_core.diagnosis.start_angles import gain_of_angles, least_from_any_angle, turns
from ldt_core.diagnosis.thresholds import THRESHOLDS
from ldt_core.estimation.least_squares import ForwardDifferences, trust_region
from ldt_core.physics.lanes import WIDTH

STEPS = 12  # least-squares steps of one fit: from good starts, more gain nothing
STEPS_TO_START_STATES = 4  # least-squares steps after which start states are estimated again
PRECISION = 1e-5  # of the loss: a step that gains less ends the fit
START_STATE_ROUNDS = 4  # in which start states and parameters are fitted in turn, at most
START_STATE_GAIN = 0.02  # of the loss: a round that gains less is the last
GAIN_IN_VIEW = 0.5  # of what own start angles have to gain: they are sought where so much shows


@dataclass(frozen=True, eq=False)
class EffectFit:
    """A set of effects, fitted.

    Attributes:
        members: its candidates, then that of the machine's own parameters, fitted with it.
        z: their coordinates, one array each.
        residual: (size,) residuals that it leaves, in noise deviations.
        jacobian: (size, p) change of the residuals per coordinate.
        loss: sum of squares of `residual`, and of the own coordinates: their prior's.
        own: how many of the members are the machine's own parameters, 1 or 0.
    """

    members: tuple[Candidate, ...]
    z: tuple[Array, ...]
    residual: Array
    jacobian: Array
    loss: float
    own: int = 0
    starts: StartStates | None = None

    @property
    def effects(self) -> tuple[Candidate, ...]:
        """The set itself."""
        return self.members[: len(self.members) - self.own]

    @property
    def own_columns(self) -> tuple[int, ...]:
        """Coordinates of the machine file's prior that were fitted along."""
        kept = self.members[len(self.members) - self.own :]
        return tuple(j for c in kept if isinstance(c, NominalCandidate) for j in c.columns)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the set itself."""
        return tuple(c.name for c in self.effects)

    @property
    def families(self) -> tuple[str, ...]:
        """Of its effects, sorted; one that has none is its own."""
        return tuple(sorted(c.effect.family or c.name for c in self.effects))

    @property
    def prior_rows(self) -> Array:
        """(k, p) what the prior of the machine's own parameters adds to the Jacobian."""
        return _prior_rows(self.members, self.own)

    @property
    def use(self) -> list[Used]:
        """The effects with all their values, as a simulation takes them."""
        return used(self.members, self.z)

    @property
    def ended(self) -> list[str]:
        """Parameters whose fit ended where the search does: "stiffness of torsional compliance"."""
        return [
            f"{name} of {spoken(c.name)}"
            for c, z in zip(self.members, self.z, strict=True)
            for name in c.at_limit(z)
        ]

    @property
    def free(self) -> int:
        """Parameters fitted, without the details of laws: those make no other law of one."""
        return sum(len(c) - c.details for c in self.effects)


def _prior_rows(members: Sequence[Candidate], own: int) -> Array:
    count = sum(len(c) for c in members)
    known = sum(len(c) for c in members[len(members) - own :])
    return np.eye(count)[count - known :]


def _other_phases(members: Sequence[Candidate], z: Array) -> list[Array]:
    """The same coordinates with each angle of an effect turned on, in steps of a turn's eighth."""
    parameters = [(c, j) for c in members for j in range(len(c))]
    found = []
    for k, (c, j) in enumerate(parameters):
        if not c.parameters[j].cyclic:
            continue
        for part in range(START_PHASES):
            moved = z.copy()
            moved[k] += part * 2 * math.pi / START_PHASES / c.scale(j)
            found.append(moved)
    return found


def used(members: Sequence[Candidate], z: Sequence[Array]) -> list[Used]:
    """Effects with all their values, as a simulation takes them."""
    return [(c.effect, c.given(part)) for c, part in zip(members, z, strict=True)]


def by_member(members: Sequence[Candidate], z: Array) -> tuple[Array, ...]:
    """A row of coordinates, an array for each member."""
    edges = np.cumsum([len(c) for c in members])[:-1]
    return tuple(np.split(z, edges))


def fit(
    residuals: FreeRunResiduals,
    members: Sequence[Candidate],
    start: Sequence[Array],
    step: float = SEARCH_STEP,
    steps: int = STEPS,
    precision: float = PRECISION,
    own: int = 0,
    known: StartStates | None = None,
) -> EffectFit:
    """Least squares of a set's parameters, from a start.

    Args:
        members: the set, then the machine's own parameters, whose coordinates have a normal prior
            of deviation 1.
        step: longest integration step [s].
        precision: part of the sum of squares; a step that gains less was the last.
        own: how many members are the machine's own parameters.
        known: states at the first samples, nearly, if an earlier fit has found them.
    """
    members = tuple(members)
    low = np.concatenate([c.bounds[0] for c in members])
    high = np.concatenate([c.bounds[1] for c in members])

    starts = [residuals.starts]

    prior = _prior_rows(members, own)

    def rows(points: list[Array]) -> list[Array]:
        uses = [used(members, by_member(members, z)) for z in points]
        rests = residuals.of_all(uses, step, starts[0])
        return [np.concatenate([r, prior @ z]) for r, z in zip(rests, points, strict=True)]

    sizes = np.concatenate([c.differences for c in members])
    steady = np.concatenate([np.full(len(c), c.steady) for c in members])
    alike = Counter((len(e), e.period) for e in residuals.experiments)
    abreast = WIDTH / max(alike.values(), default=1)

    def descend(z: Array, count: int) -> tuple[Array, Array, Array]:
        begin = np.clip(z, low + margin, high - margin)
        search = ForwardDifferences(rows, sizes, high, steady, abreast)
        about = begin, low, high, search.jacobian, search.residual_alone
        accuracy: dict[str, Any] = {"ftol": precision, "xtol": 1e-6, "gtol": 1e-8}
        found = trust_region(search.residual, *about, **accuracy, max_nfev=count)
        return found.z, found.residual, found.jacobian

    def settled(z: Array, free: bool = False, near: StartStates | None = None) -> StartStates:
        return residuals.start_states(used(members, by_member(members, z)), free, step, near)

    margin = 1e-7 * np.maximum(1.0, np.minimum(high - low, 1.0))
    first = np.clip(np.concatenate(start), low + margin, high - margin)
    starts[0] = settled(first, near=known)
    if starts[0] is residuals.starts:
        z, left, slopes = descend(first, steps)
    else:
        quick = residuals.shaking and precision > PRECISION  # nearly the right angles will do
        z = first if quick else descend(first, STEPS_TO_START_STATES)[0]
        starts[0] = starts[0] if quick else settled(z, near=known)
        steps = steps // 2 if quick else steps
        z, left, slopes = descend(z, steps)
        rounds = 1 if quick else START_STATE_ROUNDS
        for turn in range(rounds if residuals.shaking else 0):
            # The start states were sought with other parameters: some may be a whole minimum off.
            last, old = (z, left, slopes), starts[0]
            starts[0] = settled(z, near=old if quick or known or turn else None)
            z, left, slopes = descend(z, steps)
            loss, had = float(left @ left), float(last[1] @ last[1])
            if loss > had:
                (z, left, slopes), starts[0] = last, old
            if loss > (1 - START_STATE_GAIN) * had:
                break
    sought = residuals.shaking or not any(p.at_rest for p in residuals.pieces)
    use = used(members, by_member(members, z))
    price, shown, apart = len(residuals.pieces) * THRESHOLDS.start_state_gain, 0.0, None
    begin = z
    if not sought and turns(residuals, use):
        shown = gain_of_angles(residuals, use, slopes[: residuals.size], step) / GAIN_IN_VIEW
        own_angles = least_from_any_angle(residuals, used(members, by_member(members, first)), step)
        if own_angles < float(left @ left) - price:
            # From one angle for all, the fit has gone astray: begin where each has its own.
            begin, shown = first, math.inf
    elif not sought and (states := states_of(use)):
        price = max(price * states, START_STATE_GAIN * float(left @ left))
        apart = settled(z, free=True)
        rest, shared_rest = residuals.of(use, step, apart), left[: residuals.size]
        shown = float(shared_rest @ shared_rest - rest @ rest)
    if shown > price:
        shared, kept = (z, left, slopes), starts[0]
        before = math.inf
        for turn in range(START_STATE_ROUNDS):
            near = starts[0] if turn else None
            starts[0] = apart if apart and not turn else settled(begin, free=True, near=near)
            begin, left, slopes = descend(begin, steps // 2)
            if float(left @ left) > (1 - START_STATE_GAIN) * before:
                break
            before = float(left @ left)
        z = begin
        if float(shared[1] @ shared[1] - left @ left) < price:
            (z, left, slopes), starts[0] = shared, kept
        else:  # angles that differ may all be one, which the phase of an effect is to be
            free, found = (z, left, slopes), starts[0]
            starts[0] = kept
            turned = _other_phases(members, z)
            if turned:
                losses = [float(r @ r) for r in rows(turned)]
                z, left, slopes = descend(turned[int(np.argmin(losses))], steps)
            if not turned or float(left @ left - free[1] @ free[1]) > price:
                (z, left, slopes), starts[0] = free, found
    return EffectFit(
        members,
        by_member(members, z),
        left[: residuals.size],
        slopes[: residuals.size],
        float(left @ left),
        own,
        starts[0],
    )
