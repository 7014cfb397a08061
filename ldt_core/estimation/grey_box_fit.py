"""The fit of a grey box to experiments: from an observer to the free run.

Near a resonance that captures the shaft, the squared error of a free run has many minima. So the
fit begins with an observer, which corrects the simulated speed by the measured one at every sample:
the squared innovations have few minima, since no error lasts. Then the observer's gain falls to
zero, which is the free run, each fit starting from the last (a homotopy from prediction error to
simulation error: Ljung, "System Identification", 1999, section 7; Van Mulders et al., "Two
nonlinear optimization methods for black box identification compared", Automatica 46, 2010).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.pausable import Pausable
from ldt_core.estimation.effect.start_angle import FoundAngle
from ldt_core.estimation.grey_box import COARSE_STEP, FINE_STEP
from ldt_core.estimation.grey_box_problem import GreyBoxProblem
from ldt_core.estimation.misfit import noise_in

#: Observer gains of the homotopy: all of the innovation, then less, then the free run.
GAINS = (1.0, 0.3, 0.1, 0.03, 0.0)
#: Factor from gain to gain below these, where the free run is too far from the weakest observer.
#: They end where the observer remembers the whole experiment, which is a free run.
FINER = 0.3
#: Most steps under the strongest observer. It has to converge there, since all else follows from
#: where it ends: one parameter three tolerances away takes a dozen steps of at most one each.
FIRST_ROUNDS = 25
#: Guesses, the best by their cost under the observer, that are descended from at most, until the
#: residuals are noise.
TRIES = 2
#: Most steps at each further gain.
ROUNDS = 8
#: Steps at each further gain where even the strongest observer leaves more than noise: such a
#: structure cannot explain the machine, and only its size is of interest.
HOPELESS = 2


@dataclass(frozen=True, eq=False)
class GreyBoxFit:
    """Where a fit ended.

    Attributes:
        q: (n,) coordinates of machine and effects.
        starts: of each experiment its offset of the first state, see `GreyBox.speed`.
        cost: squared residuals in noise deviations, and the prior's.
        residuals: of each experiment (L,) measured minus simulated [rad/s].
        explained: whether these residuals are noise, in the samples that count.
        noise: deviation of the noise in them [rad/s], see `noise_in`.
        information: (n, n) of the coordinates, start states eliminated, for white noise.
        turn: angle [rad] by which a start at rest may differ without a difference; 0 for any.
        angles: start angles found.
    """

    q: Array
    starts: tuple[Array, ...]
    cost: float
    residuals: tuple[Array, ...]
    explained: bool
    noise: float
    information: Array
    turn: float = 0.0
    angles: tuple[FoundAngle, ...] = ()


def fit_grey_box(
    problem: GreyBoxProblem,
    guesses: Sequence[Array],
    near: Array | None = None,
    sized: bool = True,
) -> Pausable[GreyBoxFit]:
    """The best fit that the homotopy finds from some guesses, or the next one to a known fit.

    Args:
        problem: what to fit.
        guesses: (n,) coordinates of the grey box each.
        near: (n,) coordinates of what has explained other experiments of the same machine. Where
            the minimum next to them explains these too, nothing else is asked; without guesses,
            where it does not either.
        sized: whether the size of what is left is of interest where it is more than noise. Else a
            fit ends where an observer leaves more: a weaker one will not leave less.
    """
    problem = problem.turned(guesses if near is None else [near])
    if near is not None:
        x = problem.with_angles([near], GAINS[0])[0]
        known = _ended(problem, (yield from _released(problem, x, ROUNDS)))
        if known.explained or not len(guesses):
            return known
        problem = problem.turned(guesses)
    points = problem.with_angles(guesses, GAINS[0])
    costs = problem.costs(points, GAINS[0], COARSE_STEP)
    best: GreyBoxFit | None = None
    led: list[Array] = []
    for i in np.argsort(costs, kind="stable")[:TRIES]:
        led_to = problem.descend(points[i], GAINS[0], COARSE_STEP, FIRST_ROUNDS)
        x, _, information = yield from led_to
        # What the experiments cannot tell from where another guess has led goes the same way.
        apart = [float((x - other) @ information @ (x - other)) for other in led]
        if min(apart, default=math.inf) < 1.0:
            continue
        led.append(x)
        found = _ended(problem, (yield from _homotopy(problem, x, sized)))
        if best is None or found.cost < best.cost:
            best = found
        if best.explained:
            break
    if best is None:
        raise ValueError("no guess to begin with")
    return best


def _ended(problem: GreyBoxProblem, end: tuple[Array, float, Array]) -> GreyBoxFit:
    x, cost, information = end
    n, count = problem.box.size, range(len(problem.experiments))
    inner = of_first(information, n)  # start states eliminated
    rests = problem.residuals([(x, i) for i in count], 0.0, FINE_STEP)
    return GreyBoxFit(
        x[:n],
        tuple(problem.start(x, i) for i in count),
        cost,
        tuple(rests),
        problem.noise_alone([r[kept] for r, kept in zip(rests, problem.keep, strict=True)]),
        float(np.mean([noise_in(r, m) for r, m in zip(rests, problem.settings, strict=True)])),
        inner,
        problem.turn,
        problem.angles(x, information),
    )


def of_first(information: Array, count: int) -> Array:
    """(count, count) information of the first coordinates, those behind them unknown."""
    inner, cross = information[:count, :count], information[:count, count:]
    if cross.size == 0:
        return inner
    behind = np.linalg.pinv(information[count:, count:], hermitian=True)
    return np.asarray(inner - cross @ behind @ cross.T)


def _homotopy(
    problem: GreyBoxProblem, x: Array, sized: bool
) -> Pausable[tuple[Array, float, Array]]:
    """(coordinates, cost, information) of the free run, from a minimum under the observer."""
    gain = GAINS[0]
    led = problem.explains(x, gain, COARSE_STEP)
    rounds = ROUNDS if led else HOPELESS
    for gain in GAINS[1:-1]:
        if not sized and not led:
            return (yield from problem.descend(x, 0.0, COARSE_STEP, HOPELESS))
        x = (yield from problem.descend(x, gain, COARSE_STEP, rounds))[0]
        led = problem.explains(x, gain, COARSE_STEP)
    found = yield from _released(problem, x, rounds)
    if not led or problem.explains(found[0], 0.0, FINE_STEP):
        return found
    # Right as long as it is led: the last step, to the free run, was too long.
    longest = max(len(e) for e in problem.experiments)
    while gain * longest > 1:
        gain *= FINER
        x = (yield from problem.descend(x, gain, COARSE_STEP, rounds))[0]
        if not sized and not problem.explains(x, gain, COARSE_STEP):
            return found
    again = yield from _released(problem, x, rounds)
    return min(found, again, key=lambda end: end[1])


def _released(
    problem: GreyBoxProblem, x: Array, rounds: int
) -> Pausable[tuple[Array, float, Array]]:
    """(coordinates, cost, information) of the free run's minimum next to these coordinates."""
    x, cost, information = yield from problem.descend(x, 0.0, COARSE_STEP, rounds)
    if problem.coarse_is_enough(x):
        return x, cost, information
    return (yield from problem.descend(x, 0.0, FINE_STEP, rounds))
