"""What a machine file's calibration says of its numbers together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import PurePath

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.machine.machine_file import Machine

SAME = 1e-3  # relative: a number of the file that differs by less is the calibrated one
ALIKE = 0.3  # relative, of deviations: those in the file allow for few experiments as well


def stated_posterior(machine: Machine) -> tuple[tuple[str, ...], Array] | None:
    """The key `calibration.posterior`; None where the file has none, or was edited since.

    Returns:
        Names of k parameters, and the (k, r) root of the covariance of their relative errors.
    """
    told, free = (machine.calibration.get(key) for key in ("posterior", "free"))
    try:
        names = tuple(str(n) for n in told["parameters"])  # type: ignore[index]
        root = np.array(told["root"], dtype=np.float64)  # type: ignore[index]
        values = {str(n): float(e["value"]) for n, e in free.items()}  # type: ignore[union-attr]
        stds = {str(n): float(e.get("std") or 0.0) for n, e in free.items()}  # type: ignore[union-attr]
    except (KeyError, TypeError, ValueError, AttributeError):
        return None
    if root.ndim != 2 or root.shape[0] != len(names) or not root.size:
        return None
    parameters = machine.parameters
    if not np.isfinite(root).all() or not {*names, *values} <= set(parameters):
        return None
    same = all(math.isclose(parameters[n], v, rel_tol=SAME) for n, v in values.items())
    if machine.calibration.get("equivalent") or machine.calibration.get("lacking"):
        # What such a file states is for a calibration to come: it is wider than the posterior.
        alike = all(
            math.isclose(s, stds.get(n, 0.0), rel_tol=SAME) for n, s in machine.deviations.items()
        )
    else:
        told_of = machine.tolerances
        known = dict(zip(names, np.linalg.norm(root, axis=1).tolist(), strict=True))
        alike = all(
            math.isclose(told_of.get(n, 0.0), known.get(n, 0.0), rel_tol=ALIKE) for n in values
        )
    return (names, root) if same and alike else None


def fitted_to(machine: Machine, recordings: Sequence[str]) -> bool:
    """Whether the file says that it was fitted to one of these recordings, by their names."""
    listed = machine.calibration.get("recordings")
    told = [str(r) for r in listed] if isinstance(listed, list) else []
    return bool({PurePath(r).name for r in told} & {PurePath(r).name for r in recordings})
