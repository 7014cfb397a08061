"""Machine files from recordings: `ldt calibrate` and `ldt identify`.

- `calibrate.py` fits a known machine's parameters (`ldt calibrate`); `identifiability.py` says
  which of them the recordings determine, and how well; `calibration.py` puts it in sentences.
- `identify.py` finds the equivalent motor of an unknown machine (`ldt identify`).
- `machine_yaml.py` writes either result as a machine file.
"""

from ldt_core.calibration.calibrate import calibrate
from ldt_core.calibration.calibration import Calibration

__all__ = ["Calibration", "calibrate"]
