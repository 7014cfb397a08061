"""What is known of a machine, and what its measurements can be.

`machine_file` is the machine file; `plant` simulates the machine of one, with its excitation and
wear (`degradation`). The modules `*_check`, `speed_jumps` and `experiment_limits` say which
measurements no such machine can have made.
"""

from ldt_core.machine.plant import Plant

__all__ = ["Plant"]
