"""The machines' equations of motion, and their free run."""

from ldt_core.base.memory_limit import hold_room
from ldt_core.base.registry import Registry

PHYSICS = Registry(
    "physics",
    {
        "dc_motor_rotor": "ldt_core.physics.rotor:ROTOR",
        "dc_motor": "ldt_core.physics.motor:MOTOR",
    },
    "ldt.physics",
)

hold_room()  # here, since the modules of this package load the compiler
