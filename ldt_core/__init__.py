"""A learning digital twin, without ROS; `ldt docs python` shows how to use it.

Each name below is imported when it is first used, so that the package itself loads at once.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ldt_core.base.errors import BadInput, LdtError
    from ldt_core.base.experiment import (
        Action,
        Adaptation,
        Experiment,
        Level,
        Prediction,
        Signal,
        Step,
    )
    from ldt_core.detectors.base import Detector
    from ldt_core.machine.machine_file import Machine
    from ldt_core.models.base import Model
    from ldt_core.physics.base import Physics
    from ldt_core.physics.effect import Effect
    from ldt_core.physics.parameter import Parameter
    from ldt_core.python_api.fitted_machine import FittedMachine, calibrate
    from ldt_core.python_api.gap_diagnosis import GapDiagnosis, diagnose
    from ldt_core.python_api.recorded_experiments import Recording, read, write
    from ldt_core.python_api.simulated_experiments import simulate
    from ldt_core.python_api.twin_run import TwinRun, run
    from ldt_core.twin.loop import Twin

    __version__: str

__all__ = [
    "Action",
    "Adaptation",
    "BadInput",
    "Detector",
    "Effect",
    "Experiment",
    "FittedMachine",
    "GapDiagnosis",
    "LdtError",
    "Level",
    "Machine",
    "Model",
    "Parameter",
    "Physics",
    "Prediction",
    "Recording",
    "Signal",
    "Step",
    "Twin",
    "TwinRun",
    "calibrate",
    "diagnose",
    "read",
    "run",
    "simulate",
    "write",
]

#: Module → what is public of it.
_NAMES = {
    "base.errors": ("BadInput", "LdtError"),
    "base.experiment": (
        *("Action", "Adaptation", "Experiment", "Level", "Prediction", "Signal", "Step"),
    ),
    "detectors.base": ("Detector",),
    "machine.machine_file": ("Machine",),
    "models.base": ("Model",),
    "python_api.fitted_machine": ("FittedMachine", "calibrate"),
    "python_api.gap_diagnosis": ("GapDiagnosis", "diagnose"),
    "python_api.twin_run": ("TwinRun", "run"),
    "python_api.recorded_experiments": ("Recording", "read", "write"),
    "python_api.simulated_experiments": ("simulate",),
    "physics.base": ("Physics",),
    "physics.effect": ("Effect",),
    "physics.parameter": ("Parameter",),
    "twin.loop": ("Twin",),
}


if not TYPE_CHECKING:  # type checkers would take any name for one of ours

    def __getattr__(name: str) -> Any:
        if name == "__version__":
            from importlib import metadata  # takes longer to load than all the rest

            return metadata.version("ldt")
        for module, names in _NAMES.items():
            if name in names:
                found = getattr(import_module(f"ldt_core.{module}"), name)
                globals()[name] = found
                return found
        raise AttributeError(f"module 'ldt_core' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, "__version__"})
