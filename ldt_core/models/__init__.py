"""Models that predict an experiment in free run."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ldt_core.base.errors import FAULTS, LdtError, OptionError, reason_of
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
        "grey_box": "ldt_core.models.grey_box:GreyBoxModel",
        "remainder": "ldt_core.models.remainder:RemainderModel",
        "auto": "ldt_core.models.grey_box:GreyBoxModel",
    },
    "ldt.model",
)
#: Models of all kinds compete (`ldt_core.twin.contest`), beginning with the machine's physics.
AUTO = "auto"


def build_model(
    model: str | Model | type[Model], machine: Machine, settings: Mapping[str, Any]
) -> Model:
    """The model to begin with.

    Args:
        model: name of an untrained model, `path/to/file.py:Name`, a class, or a model as it is.
        machine: the machine as it is known beforehand.
        settings: those that the model's constructor names are taken.

    Raises:
        OptionError: an unknown model, something that is none, or one that fails when it is made.
    """
    from ldt_core.models.base import Model

    if isinstance(model, Model):
        return model
    kind = _kind(model)
    try:
        return kind(machine, **_own(kind, settings))
    except LdtError:
        raise
    except FAULTS as error:  # of a model of the user's own
        raise OptionError(f"model {model}", "one that can be made", reason_of(error)) from error


def learns_by_diagnosis(settings: Mapping[str, Any]) -> bool:
    """Whether the model that the settings name asks for diagnoses at a positive."""
    return bool(settings["model"] == "diagnosed" and settings["cause"] == "auto")


def restore_model(record: ModelRecord, machine: Machine, settings: Mapping[str, Any]) -> Model:
    """The model that a record describes, of the kind that the settings name.

    With `auto` models of several kinds compete, and the record names its own.

    Raises:
        ModelError: a record of another kind, or parameters that cannot be this model's.
    """
    auto = settings["model"] == AUTO and record.kind in MODELS.builtin
    kind = _kind(record.kind if auto else settings["model"])
    return kind.from_record(record, machine, **_own(kind, settings))


def _kind(model: str | type[Model]) -> type[Model]:
    from ldt_core.models.base import Model

    kind = MODELS.get(model) if isinstance(model, str) else model
    if not (isinstance(kind, type) and issubclass(kind, Model)) or inspect.isabstract(kind):
        expected = "a subclass of ldt_core.models.base.Model"
        raise OptionError(f"model {model}", expected, repr(kind))
    return kind


def _own(kind: type[Model], settings: Mapping[str, Any]) -> dict[str, Any]:
    named = inspect.signature(kind).parameters
    return {name: settings[name] for name in named if name in settings and name != "machine"}
