"""A fit, and the estimates and the machine that come of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from ldt_core.base.arrays import Array
from ldt_core.calibration.calibration import ParameterEstimate, Posterior, rounded
from ldt_core.calibration.calibration_runs import CalibrationRuns
from ldt_core.calibration.coordinates import Coordinates
from ldt_core.calibration.identifiability import NORMAL_95, Identifiability, Uncertainty
from ldt_core.calibration.prior_knowledge import DIAGNOSED, ToleranceLaw, recentred
from ldt_core.machine.machine_file import Machine


@dataclass
class Fitted:
    """A fit, with what was seen of its coordinates."""

    whole: Coordinates
    coordinates: Coordinates
    runs: CalibrationRuns
    z: Array
    converged: bool
    seen: Identifiability
    uncertainty: Uncertainty
    sensitivities: list[Array]
    known: Posterior
    #: What was known beforehand of the coordinates.
    prior: ToleranceLaw | None
    #: Effects that are plainly in what is left; None where something without a name is.
    lacking: tuple[str, ...] | None = ()

    @property
    def values(self) -> dict[str, float]:
        """All parameters of the machine."""
        return self.coordinates.values(self.z)


def estimates_of(
    fitted: Fitted, machine: Machine, prior: Mapping[str, float], named: bool
) -> tuple[list[ParameterEstimate], Machine, bool]:
    """The estimates, the machine with them, and whether all are determined.

    Args:
        machine: before.
        prior: relative standard deviations of what was known beforehand, by name.
        named: whether the free parameters were named.
    """
    estimates, determined = [], True
    found = dict(zip(fitted.coordinates.names, fitted.z, strict=True))
    half = dict(zip(fitted.coordinates.names, fitted.uncertainty.half_widths, strict=True))
    unsure = fitted.seen.unsure if named else set()
    unsure |= {c.name for c in fitted.coordinates.on_bound(fitted.z)}
    for c in fitted.whole.free:
        untouched = ParameterEstimate(c.name, c.parameter.unit, c.nominal, c.nominal, None)
        if c.name not in found:
            if named:
                determined = False
                estimates.append(untouched)
            continue
        z, width, (low, high) = float(found[c.name]), float(half[c.name]), c.bounds
        interval, value = None, rounded(c.value(z))
        spread = recentred(c, z, prior.get(c.name, DIAGNOSED))
        ends = max(z - width, low), min(z + width, high)
        # An interval that the search has cut off says nothing of what lies beyond.
        cut = [end for end in ends if end in (low, high)]
        physical = {c.parameter.low, c.parameter.high}
        sure = c.name not in unsure and width < high - low
        sure = sure and all(c.value(end) in physical for end in cut)
        determined = determined and sure and value != 0
        if fitted.lacking == () and sure:
            interval = (rounded(c.value(ends[0])), rounded(c.value(ends[1])))
            spread = width / NORMAL_95
        std = rounded(spread * (abs(value) if c.logarithmic else abs(c.scale))) if value else None
        estimates.append(replace(untouched, value=value, ci95=interval, std=std))
    kept = {n: s for n, s in machine.deviations.items() if n not in found}
    kept |= {e.name: e.std for e in estimates if e.std}
    after = replace(machine, deviations={})
    after = after.with_parameters(**{e.name: e.value for e in estimates})
    return estimates, replace(after, deviations=kept), determined
