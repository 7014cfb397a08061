"""What is known of a machine, and what its measurements can be.

`plant` simulates the machine of a machine file; the modules `*_check`, `speed_jumps` and
`experiment_limits` say what no such machine can have made.
"""

from ldt_core.machine.plant import Plant

__all__ = ["Plant"]
