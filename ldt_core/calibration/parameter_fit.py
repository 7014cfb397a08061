"""Bounded nonlinear least squares of free runs, see `CalibrationRuns`.

Where the machine is not linear the sum of squares can have several minima: near a critical speed
the free run is either captured or not, and turns from one to the other within a per cent of e. So
an optional parameter (e, g) that is freed is first scanned over two decades, and the fit starts
from the best few values. Other parameters start from the file's values alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment, rms
from ldt_core.calibration.calibration_runs import CalibrationRuns
from ldt_core.calibration.coordinates import Coordinate, Coordinates
from ldt_core.calibration.prior_knowledge import DIFFERENCE_BESIDE_PRIOR, ToleranceLaw
from ldt_core.estimation.least_squares import trust_region
from ldt_core.physics.base import SPEED, Physics
from ldt_core.physics.parameter import Parameter

ROUNDS = 12  # of fit, start states and noise in turn; a fit that is not still by then creeps
LEAST_MOVE = 1e-3  # standard errors: a round that moves no coordinate by more was the last
LEAST_EXACT_MOVE = 1e-9  # of a coordinate: the same for data without noise
TOLERANCE = 1e-10  # relative, of cost, coordinates and gradient: a round ends at its minimum
EVALUATIONS = 60  # of the free runs in one round
VISIBLE_CHANGE = 0.01  # of the speed: one this large gives a parameter at 0 its typical size
SIZES = 10.0 ** np.arange(-8, 5, 0.25)  # in the parameter's unit, tried for that
SCAN = np.geomspace(0.2, 20, 25)  # of the typical size: two decades about it, 12 points a decade
STARTS = 3  # minima of the scan from which to fit; a rotor has two, captured or not


def fit(
    runs: CalibrationRuns, coordinates: Coordinates, z: Array, prior: ToleranceLaw | None = None
) -> tuple[Array, bool]:
    """Fit the free parameters from z (p,); the runs keep the start states and noise found.

    Args:
        prior: what is known of them beforehand.

    Returns:
        (p,) coordinates, and whether the last round moved nothing.

    Raises:
        LdtError: the machine cannot be simulated where the fit starts.
    """

    def residual(z: Array) -> Array:
        rest = runs.residuals(coordinates.values(z))
        return np.concatenate(rest if prior is None else [*rest, prior.residuals(z)])

    def jacobian(z: Array) -> Array:
        if prior is None:
            return -np.vstack(runs.sensitivities(coordinates, z))
        rows = runs.sensitivities(coordinates, z, DIFFERENCE_BESIDE_PRIOR)
        exact = runs.physics.is_linear(coordinates.values(z))
        return -np.vstack([*prior.informative(rows, z, exact), prior.rows])

    z, converged = coordinates.inside(z), False
    runs.settle(coordinates.values(z), estimate=False)
    for _ in range(ROUNDS):
        runs.weigh(coordinates.values(z))
        solved = trust_region(
            residual,
            z,
            *coordinates.bounds,
            jacobian,
            xtol=TOLERANCE,
            ftol=TOLERANCE,
            gtol=TOLERANCE,
            max_nfev=EVALUATIONS,
        )
        moved = np.abs(solved.z - z)
        z = solved.z
        runs.settle(coordinates.values(z))
        information = solved.jacobian.T @ solved.jacobian
        errors = 1 / np.sqrt(np.maximum(np.diag(information), 1e-300))
        if np.all(moved <= np.maximum(LEAST_MOVE * errors, LEAST_EXACT_MOVE)):
            converged = True
            break
    z = coordinates.snapped(z)
    runs.settle(coordinates.values(z))
    runs.weigh(coordinates.values(z))
    return z, converged


def typical(
    physics: Physics, values: Mapping[str, float], name: str, parts: Sequence[Experiment]
) -> float:
    """The size at which a parameter that is 0 in the file moves the speed by one per cent.

    Raises:
        LdtError: no size does.
    """
    e = max(parts, key=lambda e: float(np.ptp(e.speed)))
    start = physics.initial_state(values, float(e.speed[0]))
    base = physics.simulate(values, e.voltage, e.period, start)[:, SPEED]
    size = rms(base)
    for tried in SIZES:
        try:
            moved = physics.simulate({**values, name: tried}, e.voltage, e.period, start)[:, SPEED]
        except LdtError:
            break
        if rms(moved - base) > VISIBLE_CHANGE * size > 0:
            return float(tried)
    raise LdtError(f"{name} cannot be calibrated: no value of it shows in the free run")


def coordinate(
    physics: Physics, values: Mapping[str, float], parameter: Parameter, parts: Sequence[Experiment]
) -> Coordinate:
    """The coordinate of a parameter; one that is 0 in the file gets its typical size."""
    nominal = values[parameter.name]
    scale = abs(nominal) or parameter.scale or typical(physics, values, parameter.name, parts)
    return Coordinate(parameter, nominal, scale)


def starts(physics: Physics, coordinates: Coordinates, runs: CalibrationRuns) -> list[Array]:
    """Coordinates from which to fit: the file's values, and the best of the scans."""
    found = [coordinates.nominal]
    for j, c in enumerate(coordinates.free):
        if c.nominal == 0:
            found[0][j] = 1.0 if not c.logarithmic else 0.0
    for j, c in enumerate(coordinates.free):
        if c.parameter.default is None:
            continue
        tried = []
        for z in SCAN:
            at = found[0].copy()
            at[j] = z
            values = coordinates.values(coordinates.inside(at))
            if physics.is_linear(values):
                break
            tried.append((runs.loss(values), at))
        minima = [
            (loss, at)
            for i, (loss, at) in enumerate(tried)
            if all(loss <= tried[k][0] for k in (i - 1, i + 1) if 0 <= k < len(tried))
        ]
        best = [at for _, at in sorted(minima, key=lambda m: m[0])[:STARTS]]
        if best:
            found = best if c.nominal == 0 else [*best, found[0]]
    return found
