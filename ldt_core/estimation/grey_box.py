"""A machine known only about, with effects of unknown size, fitted to experiments in free run.

A grey box has coordinates: the machine's uncertain parameters, each as the logarithm of its ratio
to the file's value in units of its tolerance, under a Gaussian prior; and the effects' parameters,
each as its distance from neutral in units of its scale, within its bounds. What is unknown of an
experiment's first state joins them: the shaft's angle of a machine at rest, the speed and the
current of one that was running. `grey_box_fit` fits them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment
from ldt_core.estimation.effect.cause import DIVERGED_SPEED, finite_speed
from ldt_core.estimation.effect.effect_coordinates import EffectCoordinates, Use
from ldt_core.estimation.free_run_start import AT_REST, first_current
from ldt_core.machine.machine_file import Machine
from ldt_core.machine.stated_posterior import stated_posterior
from ldt_core.physics.base import ANGLE, CURRENT, NOT_TRACKED, SPEED, FreeRun, Work
from ldt_core.physics.effect import Effect
from ldt_core.physics.machine_sizes import LIMITS, is_amount, is_limit, most_of
from ldt_core.physics.parameter import Values

#: Longest integration step [s] of the first, coarse fits, and of the last one. The speed of the
#: rotor is exact to 1e-3 and 7e-5 then, less than the noise of a sensor of 0.1 % class.
COARSE_STEP, FINE_STEP = 2e-3, 5e-4
#: Part of the longest step, or of a shorter sample period, that the shortest one is. No fit follows
#: what is faster, which no sample shows, and the time that a candidate takes has a bound.
SHORTEST = 0.25
#: Machine coordinates stay within so many tolerances; beyond, the file is of another machine.
WIDEST = 8.0
#: Of a tolerance: no combination of parameters is known better, so that the prior can be inverted.
BEST_KNOWN = 0.01
#: Start angles that are tried in what makes a difference of a turn.
ANGLES = 8
#: Gain of an observer that takes over the measured speed at each sample.
FOLLOWED = 1.0


class Case(NamedTuple):
    """One simulation of a grey box.

    Attributes:
        q: (n,) coordinates.
        experiment: its voltage, first speed and first current; with a gain all its speeds.
        rest: the machine stood still at the first sample, whatever that shows.
        start: (3,) change of angle [rad], speed [rad/s] and current [A] at the first sample.
    """

    q: Array
    experiment: Experiment
    rest: bool
    start: Array | None = None


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known of the machine's coordinates before a fit: a normal distribution.

    Args:
        mean: (k,) of the coordinates.
        precision: (k, k) inverse of their covariance.
    """

    mean: Array
    precision: Array

    @classmethod
    def apart(cls, count: int) -> Prior:
        """The file's values, each within its tolerance whatever the others are."""
        return cls(np.zeros(count), np.eye(count))

    @classmethod
    def of_file(cls, machine: Machine, names: Sequence[str]) -> Prior:
        """What the machine file says of these parameters: together, where it was calibrated.

        A calibration may know the time constant of a motor far better than its inertia.
        """
        found, stated = cls.apart(len(names)), stated_posterior(machine)
        if stated is None:
            return found
        together = [i for i, n in enumerate(names) if n in stated[0]]
        places = [stated[0].index(names[i]) for i in together]
        tolerance = np.array([machine.tolerances[names[i]] for i in together])
        root = stated[1][places] / tolerance[:, None]
        covariance = root @ root.T + BEST_KNOWN**2 * np.eye(len(together))
        found.precision[np.ix_(together, together)] = np.linalg.inv(covariance)
        return found

    def among(self, names: Sequence[str], others: Sequence[str]) -> Prior:
        """The same of other coordinates: of those that are gone whatever they are, and of new ones
        what the machine file says.

        Args:
            names: (k,) of the coordinates.
            others: of the other ones.
        """
        stay = [i for i, name in enumerate(names) if name in others]
        gone = [i for i, name in enumerate(names) if name not in others]
        p = self.precision
        beside = np.linalg.solve(p[np.ix_(gone, gone)], p[np.ix_(gone, stay)])
        place = [list(others).index(names[i]) for i in stay]
        found = Prior.apart(len(others))
        found.mean[place] = self.mean[stay]
        found.precision[np.ix_(place, place)] = (
            p[np.ix_(stay, stay)] - beside.T @ p[np.ix_(gone, stay)]
        )
        return found


class GreyBox:
    """A machine and effects, as a function of coordinates.

    Args:
        machine: as its file knows it.
        effects: whose parameters are unknown.
        tolerances: relative standard deviations of the machine's parameters; those that are
            missing, or whose value is 0, are taken as exact.
    """

    def __init__(
        self, machine: Machine, effects: Sequence[Effect], tolerances: Mapping[str, float]
    ) -> None:
        self.machine, self.physics, self.effects = machine, machine.model, tuple(effects)
        self.nominal = dict(machine.parameters)
        #: Done for it so far.
        self.work = Work()
        #: Uncertain parameters of the machine, in the order of their coordinates.
        self.uncertain = [
            n for n, v in self.nominal.items() if v != 0 and tolerances.get(n, 0.0) > 0
        ]
        self.tolerance = np.array([tolerances[n] for n in self.uncertain])
        most_voltage = max(map(abs, machine.voltage_limits))
        self._most = most_of(self.nominal, most_voltage)
        self._own = EffectCoordinates(self.effects, self.nominal, most_voltage)
        self._bounds = {p.name: (p.low, p.high) for p in self.physics.parameters}
        ends = self._machine_ends()
        self.low = np.append(ends[:, 0], self._own.low)
        self.high = np.append(ends[:, 1], self._own.high)

    def _machine_ends(self) -> Array:
        """(k, 2) least and largest machine coordinates: no value is outside its bounds."""
        ends = np.tile([-WIDEST, WIDEST], (len(self.uncertain), 1))
        for row, name, tolerance in zip(ends, self.uncertain, self.tolerance, strict=True):
            value = self.nominal[name]
            near, far = sorted(end / value for end in self._bounds[name])
            if near > 0:
                row[0] = max(row[0], math.log(near) / tolerance)
            row[1] = min(row[1], math.log(far) / tolerance)
        return ends

    @property
    def size(self) -> int:
        """How many coordinates there are."""
        return self.low.size

    @property
    def sized(self) -> list[int]:
        """Coordinates of the effects' parameters but for angles within a turn."""
        k = len(self.uncertain)
        return [k + j for j, p in enumerate(self._own.parameters) if not p.cyclic]

    @property
    def amounts(self) -> NDArray[np.bool_]:
        """Which of the effects' coordinates say how much there is; the others, of what shape."""
        return np.array([is_amount(p) for p in self._own.parameters], dtype=bool)

    def values(self, q: Array) -> tuple[dict[str, float], Use]:
        """The machine's parameters, and the effects with all their values."""
        k = len(self.uncertain)
        machine = dict(self.nominal)
        for name, tolerance, x in zip(self.uncertain, self.tolerance, q[:k], strict=True):
            low, high = self._bounds[name]
            machine[name] = min(max(self.nominal[name] * math.exp(tolerance * x), low), high)
        return machine, self._own.given(q[k:])

    def coordinates(self, given: Mapping[str, Mapping[str, float]], machine: Array) -> Array:
        """(n,) coordinates of effects with these values, beside (k,) machine coordinates."""
        return np.concatenate([machine, self._own.at(given)])

    def farthest(self, q: Array) -> tuple[str, float]:
        """The machine's own parameter that is farthest from its file's, and by how many
        tolerances; ("", 0.0) where none is uncertain.
        """
        far = np.abs(q[: len(self.uncertain)])
        return max(
            zip(self.uncertain, far.tolist(), strict=True), key=lambda f: f[1], default=("", 0.0)
        )

    def far(self, q: Array, most: float) -> set[str]:
        """The machine's own parameters that are more tolerances than this from the file's."""
        beyond = np.abs(q[: len(self.uncertain)]) > most
        return {n for n, is_far in zip(self.uncertain, beyond, strict=True) if is_far}

    def changed_by(self, effect: Effect) -> set[str]:
        """The machine's own parameters that an effect changes, or takes the place of: those of a
        known effect of its name.
        """
        worn = effect.change_parameters(self.physics, self.nominal, effect.typical)
        return {n for n, value in self.nominal.items() if worn.get(n) != value}

    def at_rest(self, experiment: Experiment, noise: float) -> bool:
        """Whether the machine stood still at the first sample."""
        return abs(float(experiment.speed[0])) <= AT_REST * noise

    def speed(
        self,
        q: Array,
        experiment: Experiment,
        rest: bool,
        start: Array | None = None,
        gain: float = 0.0,
        step: float = FINE_STEP,
    ) -> Array:
        """(L,) speed that the sensor shows [rad/s]; `DIVERGED_SPEED` where it grows without bound.

        Args:
            q, experiment, rest, start: as in `Case`.
            gain: part of the innovation by which an observer corrects the speed; 0 is a free run.
            step: longest integration step [s].
        """
        try:
            states, run, use = self._simulated(Case(q, experiment, rest, start), gain, step)
        except LdtError:
            return np.full(len(experiment), DIVERGED_SPEED)
        return self._shown(states, experiment, use, run.values)

    def current_at_speed(self, q: Array, experiment: Experiment) -> Array:
        """(L,) current where the shaft turns as it was measured [A]; see `speed`."""
        try:
            states, _, _ = self._simulated(Case(q, experiment, False, None), FOLLOWED, FINE_STEP)
        except LdtError:
            return np.full(len(experiment), DIVERGED_SPEED)
        return np.asarray(states[:, CURRENT])

    def _simulated(self, case: Case, gain: float, step: float) -> tuple[Array, FreeRun, Use]:
        """(L, n) states, of what run, and the effects that act."""
        run, use = self._run(case, gain)
        shortest = _shortest(step, run.period)
        return self.physics.simulate(*run[:5], step, run.tracked, shortest), run, use

    def speeds(
        self, cases: Sequence[Case], gain: float = 0.0, step: float = FINE_STEP, workers: int = 1
    ) -> list[Array]:
        """The speed of each case, several at once among so many threads; see `speed`."""
        found = [np.full(len(case.experiment), DIVERGED_SPEED) for case in cases]
        for period in sorted({case.experiment.period for case in cases}):
            runs, uses, places = [], [], []
            for place, case in enumerate(cases):
                if case.experiment.period != period:
                    continue
                try:
                    run, use = self._run(case, gain)
                except LdtError:
                    continue
                runs.append(run)
                uses.append(use)
                places.append(place)
            steps = step, _shortest(step, period)
            for i, states in self.physics.simulate_all(runs, *steps, workers):
                if not isinstance(states, LdtError):
                    e = cases[places[i]].experiment
                    found[places[i]] = self._shown(states, e, uses[i], runs[i].values)
        return found

    def _run(self, case: Case, gain: float) -> tuple[FreeRun, Use]:
        """What is simulated, and the effects that act."""
        q, experiment, rest, start = case
        machine, use = self.values(q)
        changed = self.physics.changed(machine, use)
        seen = self.physics.behind_sensor(experiment.speed, experiment.period, use, machine)
        current = first_current(experiment)
        offset = np.zeros(CURRENT + 1) if start is None else start
        if rest:
            first = self.physics.initial_state(changed, 0.0, current)
            first[ANGLE] += offset[ANGLE]
        else:  # what the shaft shakes moves by its angle
            angle = float(offset[ANGLE])
            first = self.physics.running_state(changed, float(seen[0]), angle, current)
        first[SPEED] += offset[SPEED]
        first[CURRENT] += offset[CURRENT]
        tracked = (seen, gain) if gain > 0 else NOT_TRACKED
        about = machine, experiment.voltage, experiment.period, first, use, tracked
        return FreeRun(*about, changed, self.work), use

    def motor(self, q: Array) -> Values:
        """The parameters of the motor, with what the effects make of them."""
        return self.physics.folded(self.physics.changed(*self.values(q)))

    def _shown(self, states: Array, experiment: Experiment, use: Use, machine: Values) -> Array:
        try:
            speed = self.physics.measure(states, experiment.period, use, machine)
        except LdtError:
            return np.full(len(experiment), DIVERGED_SPEED)
        return finite_speed(speed)

    def turn(self, tried: Sequence[Array], experiment: Experiment, noise: float) -> float:
        """Angle [rad] by which the start may differ without any difference in speed.

        0 where the start angle moves the speed by less than the noise at any sample, half a turn
        for a vertical shaft on a symmetrical foundation, else a whole turn; of several coordinates
        the largest.

        Args:
            tried: (n,) coordinates each.
            experiment: with its first sample.
            noise: standard deviation of the measured speed [rad/s].
        """
        rest = self.at_rest(experiment, noise)
        starts = [np.array([angle, 0.0, 0.0]) for angle in (0.0, 1.0, math.pi)]
        cases = [Case(q, experiment, rest, start) for q in tried for start in starts]
        speeds = self.speeds(cases, step=COARSE_STEP)
        largest = 0.0
        for k in range(0, len(speeds), len(starts)):
            nominal, other, half = speeds[k : k + len(starts)]
            if float(np.abs(other - nominal).max()) > noise:
                alike = float(np.abs(half - nominal).max()) <= noise
                largest = max(largest, math.pi if alike else 2 * math.pi)
        return largest

    def first_guesses(
        self, known: Mapping[str, Mapping[str, float]], again: bool = False
    ) -> list[Array]:
        """Coordinates of the effects to begin with.

        One effect at a time begins at what its declaration names for a search, else at its typical
        size and at a third of it, on both sides of neutral where its bounds allow; the others where
        they are known, else neutral.

        Args:
            known: values of effects, which are a guess of their own.
            again: whether the known effects are also begun with anew.
        """
        middle = self._known_or_neutral(known)
        tried = [middle] if any(e.name in known for e in self.effects) else []
        for effect in self.effects:
            if effect.name in known and not again:
                continue
            tried += [
                {**middle, effect.name: {**middle[effect.name], **values}}
                for values in self._grid(effect)
            ]
        k = len(self.uncertain)
        found = [self.coordinates(given, np.zeros(k))[k:] for given in tried or [middle]]
        return [np.clip(q, self.low[k:], self.high[k:]) for q in found]

    def neutral_guess(self, known: Mapping[str, Mapping[str, float]]) -> Array:
        """Coordinates of the effects where they are known, else neutral."""
        k = len(self.uncertain)
        return self.coordinates(self._known_or_neutral(known), np.zeros(k))[k:]

    def _known_or_neutral(self, known: Mapping[str, Mapping[str, float]]) -> dict[str, Values]:
        return {e.name: {**e.neutral, **known.get(e.name, {})} for e in self.effects}

    def _grid(self, effect: Effect) -> list[dict[str, float]]:
        if effect.search:
            rows = itertools.product(*effect.search.values())
            sized = [
                self._own.sized(effect, dict(zip(effect.search, row, strict=True))) for row in rows
            ]
            return [{name: values[name] for name in effect.search} for values in sized]
        if len(effect.parameters) == 1 and is_limit(p := effect.parameters[0]):
            return [{p.name: part * self._most[p.unit]} for part in LIMITS[p.unit]]
        typical, neutral = self._own.sized(effect, effect.typical), effect.neutral
        both = all(p.low < neutral[p.name] for p in effect.parameters)
        parts = (1 / 3, 1.0, -1.0) if both else (1 / 3, 1.0)
        return [
            {n: neutral[n] + part * (typical[n] - neutral[n]) for n in neutral} for part in parts
        ]


def _shortest(step: float, period: float) -> float:
    return SHORTEST * min(step, period)
