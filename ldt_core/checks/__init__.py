"""Suites for detectors, effects and physics that a user adds; LDT's own go through the same.

    from ldt_core.checks import check_detector
    check_detector(MyDetector(limit=3.0))

raises AssertionError with a sentence at the first promise that is not kept.
"""

from ldt_core.checks.detector_checks import check_detector
from ldt_core.checks.effect_checks import check_effect
from ldt_core.checks.physics_checks import check_physics

__all__ = ["check_detector", "check_effect", "check_physics"]
