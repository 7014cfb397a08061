"""Whether a calibrated machine has an effect that its physics lacks.

An interval says how far noise moves a parameter. An effect that the physics lacks moves it farther:
the parameters imitate it, and their intervals are narrow about wrong values. So each effect that
the machine may have is held against what the calibration leaves, by the score test for an omitted
variable (R. Engle, "Wald, likelihood ratio, and Lagrange multiplier tests in econometrics",
Handbook of Econometrics II, 1984): the free run's response to the effect joins the sensitivities,
and its coefficient over its standard error is Student's t. The standard error is that of
`identifiability.uncertainty`, with what is left after the effect has been added, so that noise with
a memory is not taken for an effect.

How far an effect that is left out moves the parameters is the bias of an omitted variable: what the
parameters do as well as the effect's response, times its coefficient (W. Greene, "Econometric
Analysis", chapter on specification).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import stdtr

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError
from ldt_core.calibration.calibration import MOST_NOISE_RATIO
from ldt_core.calibration.calibration_runs import CalibrationRuns
from ldt_core.calibration.coordinates import Coordinates
from ldt_core.calibration.identifiability import uncertainty
from ldt_core.machine.machine_file import Machine
from ldt_core.physics.effect import Effect

FALSE_ALARM = 0.05  # of a complete physics: the share of calibrations that lose their intervals
MOST_TESTED = 24  # experiments, evenly spread: they bound the time on a long recording
LEAST_DIRECTION = 1e-9  # of the largest singular value: rounding
LEAST_APART = 1e-3  # of a response: what the fitted parameters do not do as well
SMALL_CHANGE = 0.003, 0.1  # of the runs' size: a response so large is still nearly linear
FOLLOWING = 6  # steps of the parameters; a bend of a quarter is below `LEAST_APART` by then
TRIES = 12  # of an effect's size, each time a factor of 4


class Lack(NamedTuple):
    """What the physics plainly lacks.

    Attributes:
        names: of the effects that are in what the calibration leaves, the clearest first; None
            where something without a name is, which follows no effect and is smooth. Empty where
            nothing is.
        shifts: (n, p) by how much the fitted parameters' coordinates imitate each of them.
    """

    names: tuple[str, ...] | None
    shifts: Array


def lack_of_fit(
    machine: Machine,
    runs: CalibrationRuns,
    coordinates: Coordinates,
    z: Array,
    sensitivities: Sequence[Array],
    known: Array | None = None,
) -> Lack:
    """What is plainly in what the calibration leaves, and is not the sensor's noise.

    Args:
        machine: whose file was calibrated.
        runs: with the start states and the noise of the fit.
        coordinates, z: the fitted parameters, and (p,) where they ended.
        sensitivities: (rows, p) of each experiment to them there.
        known: (k, p) rows of what was known of those beforehand, in its deviations.
    """
    count, values = len(runs.experiments), coordinates.values(z)
    chosen = np.unique(np.linspace(0, count - 1, min(count, MOST_TESTED)).astype(int)).tolist()
    residuals = runs.residuals(values)
    rest, moved = [residuals[i] for i in chosen], [sensitivities[i] for i in chosen]
    basis = _basis(moved)
    lengths = [len(runs.experiments[i]) for i in chosen]
    unknowns = round(runs.unknowns * len(chosen) / count)
    base = [runs.free_run(i, values) for i in chosen]
    found = []
    for effect in machine.possible_effects():
        given = _small(runs, values, effect, chosen, base)
        if given is None:
            continue
        response = runs.responses(values, [(effect, given)], chosen, base)
        tested = _tested(basis, response, rest, lengths, unknowns)
        if tested is not None:
            own = {**values, **effect.change_parameters(machine.model, values, given)}
            found.append((tested, effect.name, response, coordinates.at(own) - z))
    whole = np.vstack(moved if known is None else [*moved, known])

    def followed(by: Array) -> list[Array]:
        return runs.responses(coordinates.values(coordinates.inside(z + by)), (), chosen, base)

    def seen(tested: _Test | None) -> bool:
        return tested is not None and tested.chance * len(found) < FALSE_ALARM

    plain = []
    for tested, name, response, begin in found:
        if seen(tested):
            left = _beside(whole, response, begin, followed)
            if seen(_tested(basis, left, rest, lengths, unknowns, response)):
                plain.append((tested.chance, name, tested.coefficient, response))
    plain.sort(key=lambda t: t[:2])
    imitated = np.zeros((len(whole), len(plain)))
    for column, (_, _, coefficient, response) in zip(imitated.T, plain, strict=True):
        row = np.concatenate(response)
        column[: row.size] = -coefficient * row
    shifts = np.linalg.lstsq(whole, imitated, rcond=None)[0].T
    names = tuple(name for _, name, *_ in plain)
    smooth = runs.noise[0] > MOST_NOISE_RATIO * runs.white
    return Lack(names or (None if smooth else ()), shifts)


def _basis(sensitivities: Sequence[Array]) -> list[Array]:
    """The (rows, p) of each experiment as orthonormal columns of all, without empty directions."""
    columns, size, _ = np.linalg.svd(np.vstack(sensitivities), full_matrices=False)
    kept = columns[:, size > LEAST_DIRECTION * size.max(initial=0.0)]
    return np.split(kept, np.cumsum([len(s) for s in sensitivities])[:-1])


def _small(
    runs: CalibrationRuns,
    values: Mapping[str, float],
    effect: Effect,
    chosen: Sequence[int],
    base: Sequence[Array],
) -> Mapping[str, float] | None:
    """An effect's values with which the free runs change a little; None where it has no such."""
    neutral, typical = effect.neutral, effect.check(effect.typical)
    longest = max(chosen, key=lambda i: float(np.abs(runs.experiments[i].voltage).sum()))
    part, low, high = 1.0, 0.0, np.inf
    for _ in range(TRIES):
        given = {n: neutral[n] + part * (typical[n] - neutral[n]) for n in neutral}
        try:
            given = effect.check(given)
        except LdtError:  # beyond its bounds
            return None
        size = runs.change(longest, values, [(effect, given)], base[chosen.index(longest)])
        if size > SMALL_CHANGE[1]:
            high = part
        elif size < SMALL_CHANGE[0]:
            low = part
        else:
            return given
        if low and high < np.inf:  # one that sets in at a size
            return None
        part *= 0.25 if size > SMALL_CHANGE[1] else 4.0
    return None


def _beside(
    whole: Array,
    response: Sequence[Array],
    begin: Array,
    moved: Callable[[Array], list[Array]],
) -> list[Array]:
    """What of an effect's response the fitted parameters leave once they follow it.

    Sensitivities alone leave how a response of some per cent bends, also of an effect on a fitted
    parameter, which that parameter does exactly. Such a bend fits much that is smooth.

    Args:
        whole: (rows, p) sensitivities, and what was known beforehand.
        begin: (p,) move of the parameters by the effect itself.
        moved: change of the runs by a (p,) move of the parameters.
    """
    by, left, ends = np.zeros(len(begin)), list(response), np.cumsum([len(r) for r in response])
    for turn in range(FOLLOWING):
        row = np.zeros(len(whole))
        row[: ends[-1]] = np.concatenate(left)
        own = turn == 0 and begin.any()
        tried = begin if own else by + np.linalg.lstsq(whole, row, rcond=None)[0]
        rest = np.concatenate(response) - np.concatenate(moved(tried))
        if float(np.linalg.norm(rest)) < float(np.linalg.norm(row)):
            by, left = tried, np.split(rest, ends[:-1])
        elif not own:
            break
    return left


class _Test(NamedTuple):
    """Probability of a coefficient as large without the effect, and the coefficient."""

    chance: float
    coefficient: float


def _tested(
    known: Sequence[Array],
    response: Sequence[Array],
    rest: Sequence[Array],
    lengths: Sequence[int],
    unknowns: int,
    all_of_it: Sequence[Array] | None = None,
) -> _Test | None:
    """Whether a response is in what is left; None where nothing tells it from the parameters.

    Args:
        all_of_it: the response before the parameters followed it, if they have.
    """
    whole, row, left = np.vstack(known), np.concatenate(response), np.concatenate(rest)
    apart = row - whole @ (whole.T @ row)
    size, ends = float(np.linalg.norm(apart)), np.cumsum([len(r) for r in response])[:-1]
    if not size > LEAST_APART * float(np.linalg.norm(np.concatenate(all_of_it or response))):
        return None
    joined = [
        np.column_stack([s, r]) for s, r in zip(known, np.split(apart / size, ends), strict=True)
    ]
    moved = np.linalg.lstsq(np.vstack(joined), left, rcond=None)[0]
    after = [r - s @ moved for s, r in zip(joined, rest, strict=True)]
    spread = uncertainty(joined, after, lengths, unknowns)
    coefficient, error = float(moved[-1]), float(spread.errors[-1])
    chance = 2 * float(stdtr(spread.freedom, -abs(coefficient) / error)) if error > 0 else 0.0
    return _Test(chance, coefficient / size)
