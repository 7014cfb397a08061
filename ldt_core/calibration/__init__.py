"""Calibration: a machine file's nominal parameters from recordings, with what is not determined."""

from ldt_core.calibration.calibrate import calibrate
from ldt_core.calibration.calibration import Calibration, Estimate

__all__ = ["Calibration", "Estimate", "calibrate"]
