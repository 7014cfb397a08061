"""How well the recordings determine an equivalent motor: the prior of a later diagnosis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ldt_core.base.experiment import Experiment
from ldt_core.calibration.calibration import Posterior
from ldt_core.calibration.calibration_runs import CalibrationRuns
from ldt_core.calibration.coordinates import Coordinate, Coordinates
from ldt_core.calibration.identifiability import NORMAL_95, uncertainty
from ldt_core.calibration.lack_of_fit import lack_of_fit
from ldt_core.calibration.prior_knowledge import UNSEEN
from ldt_core.machine.machine_file import Machine

FITTED = ("J", "K_t", "L")  # R and b are convention


def equivalent_posterior(
    machine: Machine, experiments: Sequence[Experiment], order: int
) -> Posterior | None:
    """What the recordings leave open of J, K_t and L, by the covariance of `identifiability`.

    L of a motor with one time constant does not show: its law is wide.

    Args:
        machine: the equivalent motor that was fitted to them.
        experiments: of which voltage and speed count.
        order: number of time constants that were fitted, 1 or 2.

    Returns:
        It, wider by how far the values imitate effects that the motor lacks; None where what is
        left is smooth and follows none.
    """
    values = machine.parameters
    runs = CalibrationRuns(machine.model, values, [replace(e, current=None) for e in experiments])
    for _ in range(2):  # the start states are weighed against the noise that is left
        runs.settle(values)
        runs.weigh(values)
    names = FITTED[: order + 1]
    known = {p.name: p for p in machine.model.parameters}
    coordinates = Coordinates([Coordinate(known[n], values[n], values[n]) for n in names], values)
    sensitivities = runs.sensitivities(coordinates, coordinates.nominal)
    lack = lack_of_fit(machine, runs, coordinates, coordinates.nominal, sensitivities)
    if lack.names is None:
        return None
    lengths = [len(e) for e in experiments]
    spread = uncertainty(sensitivities, runs.residuals(values), lengths, runs.unknowns)
    root = UNSEEN * np.eye(len(FITTED))
    count, wider = len(names), spread.quantile / NORMAL_95
    covariance = wider**2 * spread.covariance + lack.shifts.T @ lack.shifts
    size, directions = np.linalg.eigh(covariance)
    root[:count, :count] = directions * np.sqrt(np.maximum(size, 0.0))
    return Posterior(FITTED, root)
