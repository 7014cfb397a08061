"""The machine file of a case: what is known of its machine before anything acted on it.

It is made as a user would make it: numbers of a data sheet, off by their tolerances, calibrated on
noisy records of the healthy machine. So no number in it is exact.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ldt_core.base.errors import LdtError
from ldt_core.calibration.calibrate import calibrate
from ldt_core.lab.challenge.case_plan import CasePlan, rounded_numbers
from ldt_core.machine.machine_file import Machine, machine_from_dict

SHEET = 5  # independent random stream: errors of a data sheet


def known_file(plan: CasePlan) -> dict[str, Any]:
    """The keys of the machine file that goes with a case."""
    true = machine_from_dict(rounded_numbers(plan.machine), "case")
    sheet = _datasheet(true, plan.setting.random(0, SHEET))
    if plan.setting.file == "datasheet":
        return sheet.as_dict()
    try:
        found = calibrate(replace(sheet, deviations={}), list(plan.healthy()))
    except LdtError:  # records that determine nothing: the data sheet is all that is known
        return sheet.as_dict()
    named = found.with_recordings(["healthy"])
    # Where nothing has an interval, the tolerances of the data sheet are still there.
    complete = named.posterior is not None and named.lacking == []
    return (named.machine if complete else sheet).as_dict()


def _datasheet(true: Machine, random: np.random.Generator) -> Machine:
    """Numbers off by their usual tolerances, which it states."""
    shown = {n for n in ("J", "K_t", "R", "L", "b") if true.parameters[n] != 0}
    sizes = {n: s for n, s in true.tolerances.items() if n in shown}
    off = {n: true.parameters[n] * float(np.exp(random.normal(0.0, s))) for n, s in sizes.items()}
    values = {n: float(f"{v:.4g}") for n, v in off.items()}
    stated = true.with_parameters(**values)
    return stated.with_deviations({n: sizes[n] * values[n] for n in sizes})
