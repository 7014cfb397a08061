"""Detectors of drift between prediction and measurement, one algorithm a file."""

from ldt_core.registry import Registry

DETECTORS = Registry(
    "detector",
    {
        "threshold": "ldt_core.detectors.threshold:Threshold",
        "lddm": "ldt_core.detectors.lddm:LDDM",
        "window": "ldt_core.detectors.window:Window",
        "never": "ldt_core.detectors.never:Never",
    },
    "ldt.detector",
)
