"""A physics with the effects that are known to act on the machine.

Their parameters are the machine's own, named `effect.parameter`. So whatever simulates, fits or
records a machine's parameters has its known effects with them. An effect that is given to a
simulation takes the place of the known one of its name: its values are the whole effect, not what
has come on top.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence, Set
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError
from ldt_core.physics.base import (
    MAX_STEP,
    NOT_TRACKED,
    Effects,
    FreeRun,
    Physics,
    Tracked,
    first_states,
)
from ldt_core.physics.parameter import Values, own_name

if TYPE_CHECKING:
    from ldt_core.physics.effect import Effect


class PhysicsWithEffects(Physics):
    """A physics and effects that act in every simulation.

    Args:
        bare: the physics without them.
        known: (effect, all its values) in the order in which they act; the values hold wherever no
            others are given.
    """

    def __init__(self, bare: Physics, known: Effects) -> None:
        self.bare, self.known = bare, tuple(known)
        self.name, self.states, self.tolerances = bare.name, bare.states, bare.tolerances
        self.parameters = (
            *bare.parameters,
            *(
                replace(p, name=own_name(effect.name, p.name), default=None)
                for effect, _ in self.known
                for p in effect.parameters
            ),
        )
        self._nominal = {
            own_name(e.name, n): v for e, given in self.known for n, v in given.items()
        }

    def is_linear(self, values: Values) -> bool:
        """No known effect adds a torque or changes the voltage, and the machine is linear."""
        plain = all(
            not effect.terms and effect.on_voltage is None for effect, _ in self._acting(values)
        )
        return plain and self.bare.is_linear(self._changed(values))

    def shakes(self, values: Values) -> bool:
        """As the machine's own equations, with the parameters that known effects have changed."""
        return self.bare.shakes(self._changed(values))

    def state_space(self, values: Values) -> tuple[Array, Array, Array, Array]:
        """With the known effects on parameters; torques and voltages are left out."""
        return self.bare.state_space(self._changed(values))

    def initial_state(self, values: Values, speed: float, current: float | None = None) -> Array:
        """As `Physics.initial_state`, with the known effects on parameters."""
        return self.bare.initial_state(self._changed(values), speed, current)

    def running_state(
        self, values: Values, speed: float, angle: float, current: float | None = None
    ) -> Array:
        """As `Physics.running_state`, with the known effects on parameters."""
        return self.bare.running_state(self._changed(values), speed, angle, current)

    def folded(self, values: Values) -> Values:
        """The parameters with the known effects on them; those effects no longer act beside."""
        for effect, given in self._acting(values):
            if effect.is_folded:
                values = effect.change_parameters(self, values, given)
        return values

    def simulate(
        self,
        values: Values,
        voltage: ArrayLike,
        period: float,
        initial: ArrayLike,
        effects: Effects = (),
        max_step: float = MAX_STEP,
        tracked: Tracked = NOT_TRACKED,
        least_step: float = 0.0,
    ) -> Array:
        """Free run with the known effects, then those given; see `Physics.simulate`.

        `initial` may hold the states of all effects, or of those given alone.
        """
        run = self._bare_run(FreeRun(values, voltage, period, initial, effects, tracked))
        return self.bare.simulate(*run[:5], max_step, run.tracked, least_step)

    def simulate_all(
        self,
        runs: Sequence[FreeRun],
        max_step: float = MAX_STEP,
        least_step: float = 0.0,
        workers: int = 1,
    ) -> Iterator[tuple[int, Array | LdtError]]:
        """As `simulate`, many."""
        bare = [self._bare_run(run) for run in runs]
        return self.bare.simulate_all(bare, max_step, least_step, workers)

    def _bare_run(self, run: FreeRun) -> FreeRun:
        """The run with the known effects among those given."""
        known = self._beside(self._acting(run.values), run.effects)
        state = np.asarray(run.initial, dtype=np.float64)
        n, theirs = len(self.states), sum(len(e.states) for e, _ in run.effects)
        first = first_states(known, state)
        if first and theirs and state.size == n + theirs:
            state = np.concatenate([state[:n], first, state[n:]])
        plain, changed = self._plain(run.values), None
        if run.changed is not None and all(e.on_parameters is None for e, _ in known):
            changed = self._plain(run.changed)
        effects = [*known, *run.effects]
        return run._replace(values=plain, initial=state, effects=effects, changed=changed)

    def _plain(self, values: Values) -> Values:
        return {p.name: values[p.name] for p in self.bare.parameters}

    def measure(
        self, states: Array, period: float, effects: Effects = (), values: Values | None = None
    ) -> Array:
        """As `Physics.measure`, through the known effects on the sensor first."""
        known = self._beside(self._acting(self._nominal if values is None else values), effects)
        return self.bare.measure(states, period, [*known, *effects])

    def behind_sensor(
        self, shown: Array, period: float, effects: Effects = (), values: Values | None = None
    ) -> Array:
        """As `Physics.behind_sensor`, behind the known effects on the sensor too."""
        known = self._beside(self._acting(self._nominal if values is None else values), effects)
        return self.bare.behind_sensor(shown, period, [*known, *effects])

    def _acting(self, values: Values) -> list[tuple[Effect, Values]]:
        """The known effects with these values; one whose values are left out does not act."""
        found: list[tuple[Effect, Values]] = []
        for effect, _ in self.known:
            names = {p.name: own_name(effect.name, p.name) for p in effect.parameters}
            if all(own in values for own in names.values()):
                found.append((effect, {n: values[own] for n, own in names.items()}))
        return found

    def _beside(
        self, known: list[tuple[Effect, Values]], given: Effects
    ) -> list[tuple[Effect, Values]]:
        names = {effect.name for effect, _ in given}
        return [(effect, own) for effect, own in known if effect.name not in names]

    def _changed(self, values: Values) -> Values:
        return self.changed(values, self._acting(values))


def changed_numbers(physics: Physics, values: Values, open_ones: Set[str]) -> set[str]:
    """The machine's own numbers that a known effect changes, by one parameter each, and no more.

    A number and its change are one unknown. Taken as two, both would be as open as the number's
    tolerance, however well their product is known.

    Args:
        open_ones: names of what is not exact; of an effect that is, the number is the unknown.
    """
    found: set[str] = set()
    for effect, given in physics.known if isinstance(physics, PhysicsWithEffects) else ():
        if effect.is_folded and not open_ones.isdisjoint(own_name(effect.name, n) for n in given):
            with suppress(LdtError):  # a user's own, whose typical values this machine cannot have
                typical = effect.check(effect.typical)
                changed = effect.change_parameters(physics, values, typical)
                moved = {n for n, v in values.items() if n in changed and changed[n] != v}
                found |= moved if len(moved) == len(effect.parameters) else set()
    return found
