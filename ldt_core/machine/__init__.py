"""The simulated machine: the physics, its excitation, its wear, and the effects in it."""

from ldt_core.machine.plant import Plant

__all__ = ["Plant"]
