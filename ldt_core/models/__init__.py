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
        "auto": "ldt_core.models.diagnosed:DiagnosedModel",
    },
    "ldt.model",
)
#: What `auto` stands for beside its class: of all models, the one that left the least error in the
#: study (README) and is not told beforehand what will change.
AUTO = {"cause": "auto"}


def build_model(
    model: str | Model | type[Model], machine: Machine, settings: Mapping[str, Any]
) -> Model:
    """The model to begin with.

    Args:
        model: name of an untrained model, `path/to/file.py:Name`, a class, or a model as it is.
        machine: the machine as it is known beforehand.
        settings: those that the model's constructor names are taken.

    Raises:
        OptionError: an unknown model, or something that is none.
    """
    from ldt_core.models.base import Model

    if isinstance(model, Model):
        return model
    kind = _kind(model)
    return kind(machine, **_own(kind, model, settings))


def learns_by_diagnosis(settings: Mapping[str, Any]) -> bool:
    """Whether the model that the settings name asks for diagnoses at a positive."""
    return settings["model"] == "auto" or (
        settings["model"] == "diagnosed" and settings["cause"] == "auto"
    )


def restore_model(record: ModelRecord, machine: Machine, settings: Mapping[str, Any]) -> Model:
    """The model that a record describes, of the kind that the settings name.

    Raises:
        ModelError: a record of another kind, or parameters that cannot be this model's.
    """
    kind = _kind(settings["model"])
    return kind.from_record(record, machine, **_own(kind, settings["model"], settings))


def _kind(model: str | type[Model]) -> type[Model]:
    from ldt_core.models.base import Model

    kind = MODELS.get(model) if isinstance(model, str) else model
    if not (isinstance(kind, type) and issubclass(kind, Model)) or inspect.isabstract(kind):
        expected = "a subclass of ldt_core.models.base.Model"
        raise OptionError(f"model {model}", expected, repr(kind))
    return kind


def _own(
    kind: type[Model], model: str | type[Model], settings: Mapping[str, Any]
) -> dict[str, Any]:
    named = inspect.signature(kind).parameters
    known = {**settings, **AUTO} if model == "auto" else settings
    return {name: known[name] for name in named if name in known and name != "machine"}
