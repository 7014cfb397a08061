"""A set of effects fitted to the residuals: all its parameters, by nonlinear least squares."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

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
# Of a coordinate, to begin with, beside an effect with blows: by shorter ones a fit stays where it
# begins. From the starts of a gear's play in four sealed cases, the best fits leave 5.7, 6.9, 5.6
# and 1.6 % of the loss; by 0.15 they leave 1.3, 6.5, 4.7 and 1.6, by 0.001 13, 9.1, 6.5 and 8.3.
LONG_DIFFERENCE = 0.05
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
        begun: what start states of its own, for each experiment, have to gain; 0 without.
    """

    members: tuple[Candidate, ...]
    z: tuple[Array, ...]
    residual: Array
    jacobian: Array
    loss: float
    own: int = 0
    starts: StartStates | None = None
    begun: float = 0.0

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
    search = _SetFit(residuals, tuple(members), own, step, precision)
    first = search.within(np.concatenate(start))
    found = search.together(first, steps, known)
    found = search.apart(found, first, steps)
    size = residuals.size
    return EffectFit(
        tuple(members),
        by_member(members, found.z),
        found.residual[:size],
        found.jacobian[:size],
        found.loss,
        own,
        found.starts,
        found.begun,
    )


class _Descended(NamedTuple):
    """Where a descent ended; the rows of the prior are among the residual's and the Jacobian's."""

    z: Array
    residual: Array
    jacobian: Array
    starts: StartStates
    begun: float = 0.0

    @property
    def loss(self) -> float:
        return float(self.residual @ self.residual)


class _SetFit:
    """Descents of one set's parameters, and the start states that go with them; as of `fit`."""

    def __init__(
        self,
        residuals: FreeRunResiduals,
        members: tuple[Candidate, ...],
        own: int,
        step: float,
        precision: float,
    ) -> None:
        self.residuals, self.members, self.step = residuals, members, step
        self.precision = precision
        self.prior = _prior_rows(members, own)
        self.low = np.concatenate([c.bounds[0] for c in members])
        self.high = np.concatenate([c.bounds[1] for c in members])
        self.margin = 1e-7 * np.maximum(1.0, np.minimum(self.high - self.low, 1.0))
        self.sizes = np.concatenate([c.differences for c in members])
        self.steady = np.concatenate([np.full(len(c), c.steady) for c in members])
        blows = ~self.steady & any(c.effect.blows for c in members)
        self.longest = np.where(blows, LONG_DIFFERENCE, self.sizes)
        alike = Counter((len(e), e.period) for e in residuals.experiments)
        self.abreast = WIDTH / max(alike.values(), default=1)

    def within(self, z: Array) -> Array:
        """The same coordinates, off the ends of the search."""
        return np.asarray(np.clip(z, self.low + self.margin, self.high - self.margin))

    def use(self, z: Array) -> list[Used]:
        return used(self.members, by_member(self.members, z))

    def rows(self, points: Sequence[Array], starts: StartStates) -> list[Array]:
        rests = self.residuals.of_all([self.use(z) for z in points], self.step, starts)
        return [np.concatenate([r, self.prior @ z]) for r, z in zip(rests, points, strict=True)]

    def settled(self, z: Array, free: bool = False, near: StartStates | None = None) -> StartStates:
        return self.residuals.start_states(self.use(z), free, self.step, near)

    def descended(self, z: Array, starts: StartStates, count: int) -> _Descended:
        def rows(points: list[Array]) -> list[Array]:
            return self.rows(points, starts)

        search = ForwardDifferences(
            rows, self.sizes, self.high, self.steady, self.abreast, self.longest
        )
        about = self.within(z), self.low, self.high, search.jacobian, search.residual_alone
        accuracy: dict[str, Any] = {"ftol": self.precision, "xtol": 1e-6, "gtol": 1e-8}
        found = trust_region(search.residual, *about, **accuracy, max_nfev=count)
        return _Descended(found.z, found.residual, found.jacobian, starts)

    def together(self, first: Array, steps: int, known: StartStates | None) -> _Descended:
        """From the start states that are usual, where machines at rest all stand at one angle."""
        starts = self.settled(first, near=known)
        if starts is self.residuals.starts:
            return self.descended(first, starts, steps)
        shaking = self.residuals.shaking
        quick = shaking and self.precision > PRECISION  # nearly the right angles will do
        z = first
        if not quick:
            z = self.descended(first, starts, STEPS_TO_START_STATES).z
            starts = self.settled(z, near=known)
        steps = steps // 2 if quick else steps
        found = self.descended(z, starts, steps)
        rounds = 1 if quick else START_STATE_ROUNDS
        for turn in range(rounds if shaking else 0):
            # The start states were sought with other parameters: some may be a whole minimum off.
            last = found
            starts = self.settled(last.z, near=last.starts if quick or known or turn else None)
            found = self.descended(last.z, starts, steps)
            loss, had = found.loss, last.loss
            if loss > had:
                found = last
            if loss > (1 - START_STATE_GAIN) * had:
                break
        return found

    def apart(self, shared: _Descended, first: Array, steps: int) -> _Descended:
        """The same where each experiment has start states of its own, if that pays."""
        residuals, step = self.residuals, self.step
        if residuals.shaking or not any(p.at_rest for p in residuals.pieces):
            return shared  # they were sought
        use, size = self.use(shared.z), residuals.size
        states = 0 if (turning := turns(residuals, use)) else states_of(use)
        begun = len(residuals.pieces) * THRESHOLDS.start_state_gain * max(states, 1)
        price, shown, begin = begun, 0.0, shared.z
        found: StartStates | None = None
        if turning:
            shown = gain_of_angles(residuals, use, shared.jacobian[:size], step) / GAIN_IN_VIEW
            if least_from_any_angle(residuals, self.use(first), step) < shared.loss - price:
                # From one angle for all, the fit has gone astray: begin where each has its own.
                begin, shown = first, math.inf
        elif states:
            price = max(price, START_STATE_GAIN * shared.loss)
            found = self.settled(shared.z, free=True)
            rest, shared_rest = residuals.of(use, step, found), shared.residual[:size]
            shown = float(shared_rest @ shared_rest - rest @ rest)
        if not shown > price:
            return shared
        free, before = shared, math.inf
        for turn in range(START_STATE_ROUNDS):
            near = free.starts if turn else None
            found = found if found and not turn else self.settled(begin, free=True, near=near)
            free = self.descended(begin, found, steps // 2)
            if free.loss > (1 - START_STATE_GAIN) * before:
                break
            begin, before = free.z, free.loss
        if shared.loss - free.loss < price:
            return shared
        # Angles that differ may all be one, which the phase of an effect is to be.
        if turned := _other_phases(self.members, free.z):
            losses = [float(r @ r) for r in self.rows(turned, shared.starts)]
            one = self.descended(turned[int(np.argmin(losses))], shared.starts, steps)
            if one.loss - free.loss <= price:
                return one
        return free._replace(begun=begun)
