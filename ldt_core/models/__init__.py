"""Models that predict an experiment in free run."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ldt_core.base.errors import OptionError
from ldt_core.base.registry import Registry

if TYPE_CHECKING:
    from ldt_core.base.experiment import ModelRecord
    from ldt_core.machine.machine_file import Machine
    from ldt_core.models.base import Model

MODELS = Registry(
    "model",
    {
        "physics": "ldt_core.models.physics:PhysicsModel",
        "linear": "ldt_core.models.linear:LinearModel",
        "hybrid": "ldt_core.models.hybrid:HybridModel",
        "diagnosed": "ldt_core.models.diagnosed:DiagnosedModel",
    },
    "ldt.model",
)


def build_model(name: str, machine: Machine, settings: Mapping[str, Any]) -> Model:
    """The untrained model of that name, with the settings that its constructor names.

    Raises:
        OptionError: an unknown model, or something that is none.
    """
    kind = _kind(name)
    return kind(machine, **_own(kind, settings))


def restore_model(record: ModelRecord, machine: Machine, settings: Mapping[str, Any]) -> Model:
    """The model that a record describes, of the kind that the settings name.

    Raises:
        ModelError: a record of another kind, or parameters that cannot be this model's.
    """
    kind = _kind(settings["model"])
    return kind.from_record(record, machine, **_own(kind, settings))


def _kind(name: str) -> type[Model]:
    from ldt_core.models.base import Model

    kind = MODELS.get(name)
    if not (isinstance(kind, type) and issubclass(kind, Model)):
        raise OptionError(f"model {name}", "a subclass of ldt_core.models.base.Model", repr(kind))
    return kind


def _own(kind: type[Model], settings: Mapping[str, Any]) -> dict[str, Any]:
    named = inspect.signature(kind).parameters
    return {name: settings[name] for name in named if name in settings and name != "machine"}
