"""Models that predict an experiment in free run."""

from ldt_core.registry import Registry

MODELS = Registry(
    "model",
    {
        "physics": "ldt_core.models.physics:PhysicsModel",
        "linear": "ldt_core.models.linear:LinearModel",
        "hybrid": "ldt_core.models.hybrid:HybridModel",
    },
    "ldt.model",
)
