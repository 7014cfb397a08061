"""What of a residual may be that a set's laws are not exactly the machine's.

A law of the library is a machine's only nearly. The friction that a brake has, say, is the law's
times 1 + g, where g varies a little with the speed, the friction's own size, or the time. What such
a g adds to the simulated speed is known from the set alone, without any data. So departures take
part in a set's residual as a model discrepancy with a prior (Kennedy, O'Hagan, "Bayesian
calibration of computer models", 2001), beside which the set's parameters may follow. What they
explain speaks for no further effect.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Sequence

import numpy as np
from scipy.linalg import solve_banded, solve_triangular
from scipy.optimize import lsq_linear

from ldt_core.base.arrays import Array
from ldt_core.diagnosis.effect_fit import EffectFit, used
from ldt_core.diagnosis.free_run_residuals import DIVERGED_SPEED, FreeRunResiduals
from ldt_core.diagnosis.simulated_experiments import (
    SEARCH_STEP,
    PreparedExperiment,
    Simulated,
    Used,
)
from ldt_core.diagnosis.thresholds import THRESHOLDS
from ldt_core.estimation.variable_projection import project_out
from ldt_core.physics.effect import Effect

#: Deviation of a departure of one shape, as a part of what the law itself does to the speed. What
#: the shapes take away is nearly the same from 0.05 to 0.2.
DEPARTURE = 0.1
#: Of the prior of departures: stiffer, until a law departs by no more than a cause may leave.
STIFFNESSES = tuple(10.0 ** (k / 4) for k in range(33))
LEAST_SHAPE = 1e-9  # of the size of its departure: a shape that changes less changes nothing
LEAST = 1e-9  # of a coordinate: room that a parameter at a bound is left
SLOW = 0.15  # of the largest speed: below, friction laws differ most


class LawDepartures:
    """Departures of the laws of sets that are fitted to the same residuals.

    Args:
        base: (size,) residuals without any effect.
    """

    def __init__(self, residuals: FreeRunResiduals, base: Array) -> None:
        self.residuals = residuals
        #: Sum of squares of the speed's residuals without any effect.
        self.gap = sum(float(np.sum(base[p.channels[0]] ** 2)) for p in residuals.pieces)
        self._taken: dict[EffectFit, float] = {}

    def taken(self, fitted: EffectFit) -> float:
        """Loss in the speed that departures take away from a set, less what their freedom costs.

        That is twice the logarithm of the Bayes factor between laws that depart and laws that do
        not; 0 where it does not speak for departures.
        """
        if fitted not in self._taken:
            self._taken[fitted] = max(self._explained(fitted), 0.0) if fitted.effects else 0.0
        return self._taken[fitted]

    def _explained(self, fitted: EffectFit) -> float:
        found = self._changes(fitted)
        system = found and self._system(fitted, *found)
        if system is None or not all(np.isfinite(part).all() for part in system):
            return 0.0
        gram, target, power = system
        z, own = np.concatenate(fitted.z), len(fitted.prior_rows)
        target[z.size - own : z.size] += z[z.size - own :]
        low, high = (np.concatenate([c.bounds[k] for c in fitted.members]) - z for k in (0, 1))

        def moved_at(k: int) -> tuple[Array, Array]:
            # Each departure and each number of the machine file has a prior of deviation 1; a
            # parameter of an effect may move by about its own size, as far as the slopes hold.
            stiff = np.full(len(target) - z.size, STIFFNESSES[k])
            whole = gram + np.diag(np.concatenate([np.ones(z.size), stiff]))
            return _bounded(whole, target, low, high), whole

        def is_small(k: int) -> bool:
            shapes = moved_at(k)[0][z.size :].reshape(len(power), -1)
            sizes = [
                float(a @ gram[at : at + a.size, at : at + a.size] @ a)
                for at, a in zip(range(z.size, len(target), shapes.shape[1]), shapes, strict=True)
            ]
            return bool((np.array(sizes) <= THRESHOLDS.departure_of_law * power).all())

        stiffest = len(STIFFNESSES) - 1  # the stiffer, the less a law departs
        least = bisect.bisect_left(range(stiffest), True, key=is_small)
        (moved, whole), stiffness = moved_at(least), STIFFNESSES[least]
        gain = -float(moved @ whole @ moved + 2 * target @ moved)
        part = whole[: z.size, : z.size]
        free = np.linalg.slogdet(whole)[1] - np.linalg.slogdet(part)[1]
        return gain - float(free - (len(target) - z.size) * math.log(stiffness))

    def _system(
        self,
        fitted: EffectFit,
        motion: Sequence[tuple[Array, Array]],
        changes: Sequence[Sequence[Array]],
    ) -> tuple[Array, Array, Array]:
        """Inner products of parameters' and departures' columns, and theirs with the residual.

        Also the power of what each effect changes, of the gap's at most: two may cancel each other.

        Args:
            motion: speed and current of the set, in each experiment.
            changes: what each effect does to the speed.
        """
        pieces, noise = self.residuals.pieces, self.residuals.noise[0]
        starts, count = fitted.starts or self.residuals.starts, fitted.jacobian.shape[1]
        forgets = [[self._forgets(c.effect, p) for p in pieces] for c in fitted.effects]
        pushes = [
            [_push(*each) for each in zip(own, keeps, strict=True)]
            for own, keeps in zip(changes, forgets, strict=True)
        ]
        states = [(speed, current, np.cumsum(speed)) for speed, current in motion]
        most = [max(float(np.abs(s[k]).max()) for s in states) or 1.0 for k in range(3)]
        sizes = [math.sqrt(np.mean(np.concatenate(p) ** 2)) or 1.0 for p in pushes]
        power = [sum(float(np.sum((c / noise) ** 2)) for c in own) for own in changes]
        gram: Array = np.zeros(())
        target: Array = np.zeros(())
        for i, piece in enumerate(pieces):
            columns = [fitted.jacobian[piece.channels[0]]]
            for push, keep, size in zip(pushes, forgets, sizes, strict=True):
                speed, current, turned = (s / by for s, by in zip(states[i], most, strict=True))
                shapes = _shapes(push[i], speed, current, turned, size)
                moved = _moved(shapes, keep[i]) / noise
                columns.append(project_out(moved, starts.bases[i][: len(moved)]))
            together = np.column_stack(columns)
            gram = gram + together.T @ together
            target = target + together.T @ fitted.residual[piece.channels[0]]
        wanted = DEPARTURE * np.sqrt(np.minimum(power, self.gap))
        sized = np.repeat(wanted, (len(target) - count) // len(changes))
        length = np.sqrt(np.diag(gram)[count:])
        seen = length > LEAST_SHAPE * sized
        scale = np.ones(len(target))
        scale[count:] = np.where(seen, sized / np.where(seen, length, 1.0), 0.0)
        return gram * np.outer(scale, scale), target * scale, np.minimum(power, self.gap)

    def _forgets(self, effect: Effect, piece: PreparedExperiment) -> float:
        """Part of its speed that the motor keeps from one sample to the next; 0 for a sensor's."""
        sensed = effect.on_measurement is not None
        return 0.0 if sensed else math.exp(-piece.experiment.period / self.residuals.memory)

    def _changes(
        self, fitted: EffectFit
    ) -> tuple[list[tuple[Array, Array]], list[list[Array]]] | None:
        """(motion of the set, for each effect what it does to the speed); None if it diverges."""
        starts, count = fitted.starts or self.residuals.starts, len(self.residuals.pieces)
        kept = [
            [k for k in range(len(fitted.members)) if k != i] for i in range(len(fitted.effects))
        ]
        uses = [fitted.use] + [
            used([fitted.members[k] for k in among], [fitted.z[k] for k in among]) for among in kept
        ]
        runs = [
            Simulated(i, use, float(starts.angles[i]), starts.offsets[i])
            for use in uses
            for i in range(count)
        ]
        found = self.residuals.simulated(runs, SEARCH_STEP)
        if not all(np.abs(s).max() < DIVERGED_SPEED for s, _ in found):  # nan is not below either
            return None
        motion = found[:count]
        without = (found[k : k + count] for k in range(count, len(found), count))
        return motion, [[a - b for (a, _), (b, _) in zip(motion, w, strict=True)] for w in without]


def own_laws(residuals: FreeRunResiduals) -> float:
    """Power in the speed by which the laws that the machine file knows of may be off.

    They are no more exact than those to come. 0 where the file's calibration has left nothing but
    noise with them: then they have been put to the test.
    """
    machine, count = residuals.machine, len(residuals.pieces)
    if not machine.acting or machine.calibration.get("lacking", []) == []:
        return 0.0
    uses: list[list[Used]] = [[]]
    for effect in map(machine.effect, machine.acting):
        uses.append([(effect, effect.check(machine.law(effect.name).neutral))])
    runs = [Simulated(i, use) for use in uses for i in range(count)]
    speeds = [speed for speed, _ in residuals.simulated(runs, SEARCH_STEP)]
    power = 0.0
    for i, piece in enumerate(residuals.pieces):
        signal = float(piece.experiment.speed @ piece.experiment.speed)
        for without in speeds[count + i :: count]:
            moved = speeds[i] - without
            power += min(float(moved @ moved), signal)
    return THRESHOLDS.law_error**2 * power / residuals.noise[0] ** 2


def _bounded(gram: Array, target: Array, low: Array, high: Array) -> Array:
    """What minimises x' gram x + 2 target' x, its first elements between these ends."""
    root = np.linalg.cholesky(gram)
    ends = np.full((2, len(target)), math.inf)
    ends[0, : low.size], ends[1, : high.size] = np.maximum(-low, LEAST), np.maximum(high, LEAST)
    wanted = -solve_triangular(root, target, lower=True)
    free = solve_triangular(root, wanted, lower=True, trans="T")
    if np.all((-ends[0] <= free) & (free <= ends[1])):
        return np.asarray(free)
    return np.asarray(lsq_linear(root.T, wanted, (-ends[0], ends[1])).x)


def _push(change: Array, forgets: float) -> Array:
    """(L,) what pushes the speed so that it changes by (L,), as the change in one sample."""
    found = change.copy()
    if forgets:
        found[:-1] = change[1:] - forgets * change[:-1]
        found[-1] = found[-2]
    return found


def _moved(pushes: Array, forgets: float) -> Array:
    """(L, n) changes of the speed by (L, n) pushes: the other way round."""
    if not forgets:
        return pushes
    found = np.zeros_like(pushes)
    bands = np.full((2, len(pushes) - 1), -forgets)
    bands[0] = 1.0
    found[1:] = solve_banded((1, 0), bands, pushes[:-1])
    return found


def _shapes(push: Array, speed: Array, current: Array, turned: Array, size: float) -> Array:
    """(L, shapes) departures of what an effect pushes with.

    It comes later. It depends on the speed, its size or direction, standstill, the angle turned,
    the current (each in parts of the largest), its own size (beside its root mean square) or the
    time in the experiment.
    """
    loud, time = np.tanh(push / (2 * size)), np.linspace(-1.0, 1.0, push.size)
    still = np.exp(-((speed / SLOW) ** 2))
    by = (
        *(speed, np.abs(speed), speed**2, speed**3, np.sign(speed), still),
        *(turned, np.abs(turned)),
        *(np.abs(current), current**2),
        *(loud, loud**2, time),
    )
    return np.column_stack([np.gradient(push), *(push * b for b in by)])
