"""Many free runs at once against the same runs one by one, and how equal the two are.

What a fit asks for: one experiment of the rotor (20 s, 100 Hz) with as many slightly different
machines as the processor takes at once, alone and with a law that acts on the shaft.
"""

from __future__ import annotations

import numpy as np

from ldt_core.effects import parse_effect
from ldt_core.machine.machine_file import load_machine
from ldt_core.physics.base import FreeRun
from tests.benchmarks.row import Row, best_of

SECONDS, RATE, RUNS = 20, 100, 8
STEP = 0.5e-3  # s, of the last fits
LAWS = ("", "stribeck_friction", "cogging_torque", "torsional_compliance")


def run() -> list[Row]:
    """A row for a rotor that shakes its foundation, and one for each law on a rigid one."""
    return [_row(law) for law in LAWS]


def _row(law: str) -> Row:
    machine = load_machine("rotor").with_parameters(e=0.0 if law else 0.005)
    random = np.random.default_rng(0)
    volts = np.repeat(random.uniform(6, 16, SECONDS), RATE)
    effects = [parse_effect(law)] if law else []
    runs = []
    for _ in range(RUNS):
        values = {n: v * random.uniform(0.99, 1.01) for n, v in machine.parameters.items()}
        runs.append(FreeRun(values, volts, 1 / RATE, np.zeros(7), effects))

    def together() -> dict[int, np.ndarray]:
        return dict(machine.model.simulate_all(runs, STEP))

    def one_by_one() -> list[np.ndarray]:
        return [machine.model.simulate(*run[:5], STEP) for run in runs]

    found = together()
    off = max(float(np.abs(found[i] - s)[:, 1].max()) for i, s in enumerate(one_by_one()))
    return Row(
        f"{RUNS} free runs of {SECONDS} s at once, {law or 'unbalance'}",
        best_of(20, together),
        "the same, one after the other",
        best_of(10, one_by_one),
        "4×",
        f"largest difference in speed {off:.1e} rad/s",
    )
