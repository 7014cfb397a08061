"""What a machine file states of its parameters beforehand, joined with what was fitted.

Where a file states standard deviations, or a diagnosis' effects are fitted along, all tolerances of
the machine are prior knowledge: everything is fitted together, and what the recordings do not tell
apart stays within its tolerance. Else the largest set that they determine is fitted and the rest
keeps its values; within its tolerance it may be wrong, and what was fitted hangs on it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.calibration.calibration import DIGITS
from ldt_core.calibration.coordinates import Coordinate, Coordinates
from ldt_core.calibration.identifiability import (
    EXACT_TOLERANCE,
    Uncertainty,
)
from ldt_core.machine.machine_file import Machine
from ldt_core.machine.stated_posterior import stated_posterior

#: Relative standard deviation of what a diagnosis found: its amount is right to its size. It holds
#: what the recordings do not show.
DIAGNOSED = 1.0
#: The same of an L of which the recordings show little: its logarithm is right to a few times.
UNSEEN = 1.0
#: Of a coordinate: quotients of integrated runs are good to 5e-4 then, by an integrator that is
#: good to 5e-6. A shorter one would drown what tells parameters apart.
DIFFERENCE_BESIDE_PRIOR = 5e-3
#: Relative, of a value that is written with six digits.
ROUNDING = 0.5 * 10.0 ** (1 - DIGITS)
#: Of the largest singular value: twice that error.
DROWNED = 1e-3


class ToleranceLaw:
    """Normal laws about the file's values, of coordinates that have a tolerance.

    Args:
        coordinates: (p,) those fitted.
        tolerances: relative standard deviations by name; others have no prior.
        together: of some of these, names and the root of the covariance of their relative errors.
    """

    def __init__(
        self,
        coordinates: Coordinates,
        tolerances: Mapping[str, float],
        together: tuple[Sequence[str], Array] = ((), np.zeros((0, 0))),
    ) -> None:
        free = coordinates.free
        sizes = np.array([deviation(c, 1.0) for c in free])
        stds = np.array([tolerances.get(c.name, 0.0) for c in free])
        covariance = np.diag(stds**2)
        shared = [
            (j, together[0].index(c.name)) for j, c in enumerate(free) if c.name in together[0]
        ]
        if shared:
            own, told = (list(x) for x in zip(*shared, strict=True))
            covariance[np.ix_(own, own)] = _covariance(together[1][told])
        at = np.flatnonzero(np.diag(covariance) > 0)
        self.coordinates, self.centre = coordinates, coordinates.nominal
        #: (k, p) change of the residuals per coordinate.
        self.rows = np.zeros((len(at), len(free)))
        lower = np.linalg.cholesky(covariance[np.ix_(at, at)])
        self.rows[:, at] = np.linalg.inv(lower) / sizes[at]

    def residuals(self, z: Array) -> Array:
        """(k,) in standard deviations."""
        return np.asarray(-self.rows @ (z - self.centre))

    def informative(self, sensitivities: Sequence[Array], z: Array, exact: bool) -> list[Array]:
        """The (rows, p) sensitivities without the directions that their own errors drown.

        What a difference quotient shows of a direction weaker than its own error is not the
        machine, and would outweigh the prior.
        """
        sizes = self.coordinates.sizes(z)
        _, size, directions = np.linalg.svd(
            np.linalg.qr(np.vstack(sensitivities) * sizes, mode="r"), full_matrices=False
        )
        tolerance = EXACT_TOLERANCE if exact else DROWNED
        kept = directions[size > tolerance * size[0]]
        onto = sizes[:, None] * (kept.T @ kept) / sizes
        return [rows @ onto for rows in sensitivities]

    @property
    def precision(self) -> Array:
        """(p, p)."""
        return np.asarray(self.rows.T @ self.rows)


def _covariance(root: Array) -> Array:
    """(k, k) of relative errors by their (k, r) root, as far as such a law can be right.

    A law that is straight is off by half the square of its width, and values by their rounding.
    """
    width = np.linalg.norm(root, axis=1)
    return np.asarray(root @ root.T + np.diag((width**2 / 2) ** 2 + ROUNDING**2))


def known_together(machine: Machine, but: Sequence[str]) -> tuple[Sequence[str], Array]:
    """What a file's calibration says of its numbers together, see `ToleranceLaw`.

    What it shares, such as the scale of all torques, is known once. Standard deviations alone
    would count it once for each number.

    Args:
        machine: as its file states it.
        but: names that have got another value since.
    """
    told, calibration = stated_posterior(machine), machine.calibration
    if told is None or (calibration.get("lacking") != [] and not calibration.get("equivalent")):
        return (), np.zeros((0, 0))
    kept = [j for j, name in enumerate(told[0]) if name not in but]
    return tuple(told[0][j] for j in kept), told[1][kept]


def deviation(c: Coordinate, relative: float) -> float:
    """A relative standard deviation of a parameter, in its coordinate."""
    return relative * (1.0 if c.logarithmic or not c.nominal else abs(c.nominal / c.scale))


def recentred(c: Coordinate, z: float, relative: float) -> float:
    """The deviation of what was known beforehand, about another coordinate than the nominal one.

    A value that was fitted with a physics that lacks something has no law of its own. What the
    file states still holds, and the fit went astray by no more than it went from there.
    """
    centre = c.at(c.nominal) if c.nominal or not c.logarithmic else 0.0
    return math.hypot(deviation(c, relative), z - centre)


def widened(
    spread: Uncertainty,
    fitted: Sequence[Array],
    kept: Sequence[Array],
    deviations: Sequence[float],
    inside: Sequence[bool],
) -> tuple[Uncertainty, Array]:
    """The uncertainty when parameters that were kept may be wrong.

    Args:
        spread: of (p,) coordinates, were those kept right.
        fitted: (rows, q) of each experiment, sensitivities to those coordinates that may vary.
        kept: (rows, k) of each, to the parameters kept.
        deviations: (k,) of their coordinates.
        inside: (p,) which coordinates vary, q of them.

    Returns:
        It, and a (p + k, r) root of the covariance of all, those kept last.
    """
    count = len(inside)
    # What is not known at all has no interval, and no part in a law that could be told.
    values, vectors = np.linalg.eigh(np.nan_to_num(spread.covariance, posinf=0.0))
    own = vectors * np.sqrt(np.maximum(values, 0.0))
    root = np.zeros((count + len(deviations), count + len(deviations)))
    root[:count, :count] = own
    root[count:, count:] = np.diag(deviations)
    if not len(deviations) or not any(inside):
        return spread, root
    moves = np.linalg.lstsq(np.vstack(fitted), np.vstack(kept), rcond=None)[0]
    covariance = spread.covariance.copy()
    at = np.flatnonzero(inside)
    scaled = moves * np.asarray(deviations)
    covariance[np.ix_(at, at)] += scaled @ scaled.T
    root[np.ix_(at, np.arange(count, root.shape[1]))] = -scaled
    return replace(spread, covariance=covariance), root
