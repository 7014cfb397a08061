"""The fit: bounded nonlinear least squares of free runs, start states eliminated.

Rounds of `scipy.optimize.least_squares` (trust region, logarithms of the positive parameters), with
the start states and the channels' noise estimated anew between them, until nothing moves.

Where the machine is not linear the sum of squares can have several minima: near a critical speed
the free run is either captured or not, and turns from one to the other within a per cent of e. So
an optional parameter (e, g) that is freed is first scanned over two decades, and the fit starts
from the best few values. Other parameters of a nonlinear machine start from the file's values
alone: a foundation's stiffness must be near enough that its critical speed is passed about when it
is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment
from ldt_core.calibration.coordinates import Array, Coordinate, Coordinates
from ldt_core.calibration.free_runs import FreeRuns
from ldt_core.physics.base import Physics
from ldt_core.physics.parameter import Parameter

ROUNDS = 12
STILL = 1e-3  # standard errors: a round that moves nothing by more than this was the last
STILL_ALSO = 1e-9  # of a coordinate: the same for data without noise
EVALUATIONS = 60  # of one round
VISIBLE = 0.01  # of the speed: an effect this large gives a parameter at 0 its typical size
SIZES = 10.0 ** np.arange(-8, 5, 0.25)  # sizes tried for that, in the parameter's unit
SCAN = np.geomspace(0.2, 20, 25)  # of the typical size
STARTS = 3  # minima of the scan from which to fit


@dataclass(frozen=True)
class ParameterFit:
    """Where a fit ended.

    Attributes:
        z: (p,) coordinates.
        cost: half the sum of squares, in noise deviations of the last round.
        converged: whether the last round moved nothing.
    """

    z: Array
    cost: float
    converged: bool


def fit(runs: FreeRuns, coordinates: Coordinates, z: Array) -> ParameterFit:
    """Fit the free parameters.

    Args:
        runs: the experiments; their start states and noise are left as the fit has found them.
        coordinates: the free parameters.
        z: (p,) where to start.

    Raises:
        LdtError: the machine cannot be simulated where the fit starts.
    """
    from scipy.optimize import least_squares

    def residual(z: Array) -> Array:
        return np.concatenate(runs.residuals(coordinates.values(z)))

    def jacobian(z: Array) -> Array:
        return -np.vstack(runs.sensitivities(coordinates, z))

    z, converged, cost = coordinates.inside(z), False, np.inf
    runs.settle(coordinates.values(z), estimate=False)
    for _ in range(ROUNDS):
        runs.weigh(coordinates.values(z))
        solved = least_squares(
            residual,
            z,
            jacobian,
            bounds=coordinates.bounds,
            xtol=1e-10,
            ftol=1e-10,
            gtol=1e-10,
            max_nfev=EVALUATIONS,
        )
        if not np.all(np.isfinite(solved.x)):
            raise LdtError("calibration failed: the fit left the finite numbers")
        moved = np.abs(solved.x - z)
        z, cost = solved.x, float(solved.cost)
        runs.settle(coordinates.values(z))
        information = solved.jac.T @ solved.jac
        errors = 1 / np.sqrt(np.maximum(np.diag(information), 1e-300))
        if np.all(moved <= np.maximum(STILL * errors, STILL_ALSO)):
            converged = True
            break
    z = coordinates.snapped(z)
    runs.settle(coordinates.values(z))
    runs.weigh(coordinates.values(z))
    return ParameterFit(z, cost, converged)


def typical(
    physics: Physics, values: Mapping[str, float], name: str, parts: Sequence[Experiment]
) -> float:
    """The size at which a parameter that is 0 in the file moves the speed by one per cent.

    Raises:
        LdtError: no size does.
    """
    e = max(parts, key=lambda e: float(np.ptp(e.speed)))
    start = physics.initial_state(values, float(e.speed[0]))
    base = physics.simulate(values, e.voltage, e.period, start)[:, 1]
    size = float(np.sqrt(np.mean(base**2)))
    for tried in SIZES:
        try:
            moved = physics.simulate({**values, name: tried}, e.voltage, e.period, start)[:, 1]
        except LdtError:
            break
        if np.sqrt(np.mean((moved - base) ** 2)) > VISIBLE * size > 0:
            return float(tried)
    raise LdtError(f"{name} cannot be calibrated: no value of it shows in the free run")


def coordinate(
    physics: Physics, values: Mapping[str, float], parameter: Parameter, parts: Sequence[Experiment]
) -> Coordinate:
    """The coordinate of a parameter; one that is 0 in the file gets its typical size."""
    nominal = values[parameter.name]
    scale = nominal or parameter.scale or typical(physics, values, parameter.name, parts)
    return Coordinate(parameter, nominal, scale)


def starts(physics: Physics, coordinates: Coordinates, runs: FreeRuns) -> list[Array]:
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
