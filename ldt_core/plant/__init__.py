"""The simulated machine: the physics, its excitation, its wear, and the effects in it."""

from ldt_core.plant.plant import Plant

__all__ = ["Plant"]
