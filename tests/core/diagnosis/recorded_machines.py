"""Recordings of machines whose truth is known, short ones for the tests of the diagnosis."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ldt_core.base.experiment import Experiment
from ldt_core.diagnosis.candidate import Candidate
from ldt_core.effects import get_effect, parse_effect
from ldt_core.machine.machine_file import Machine, load_machine
from ldt_core.physics.effect import Effect
from ldt_core.physics.machine_sizes import machine_scales, most_of

ROTOR, MOTOR = load_machine("rotor"), load_machine("dc_motor")
PERIOD = 0.01  # s
NOISE = 0.05  # rad/s
CURRENT_NOISE = 0.02  # A


def uses(effects: Sequence) -> list:
    """Effects with their values, from what one would write on a command line or from a pair."""
    return [parse_effect(e) if isinstance(e, str) else e for e in effects]


def steps(random, samples: int, low: float, high: float, hold: int) -> np.ndarray:
    """(samples,) random levels [V], each held for so many samples."""
    return np.repeat(random.uniform(low, high, -(-samples // hold)), hold)[:samples]


def record(
    machine: Machine,
    *effects: str | tuple[Effect, dict[str, float]],
    count: int = 3,
    samples: int = 500,
    volts: tuple[float, float] = (-12.0, 12.0),
    hold: int = 60,
    noise: float = NOISE,
    current: bool = False,
    lead: int = 0,
    seed: int = 1,
    levels: Sequence[np.ndarray] | None = None,
) -> list[Experiment]:
    """Experiments of a machine with these effects, by random steps of voltage.

    Args:
        machine: as its file knows it.
        effects: that act besides.
        count: of experiments.
        samples: of each.
        volts: range of the levels [V].
        hold: samples of a level.
        noise: deviation on the speed [rad/s].
        current: record it as well.
        lead: samples that the machine had run already when the recording began.
        seed: of levels and noise.
        levels: (lead + samples,) [V] of each experiment, in place of random ones.
    """
    random, use = np.random.default_rng(seed), uses(effects)
    physics, values = machine.model, machine.parameters
    found = []
    for k in range(count):
        u = steps(random, lead + samples, *volts, hold) if levels is None else levels[k]
        states = physics.simulate(values, u, PERIOD, physics.initial_state(values, 0.0), use)
        speed = physics.measure(states, PERIOD, use) + noise * random.standard_normal(u.size)
        amperes = states[:, 2] + CURRENT_NOISE * random.standard_normal(u.size)
        kept = slice(lead, None)
        found.append(
            Experiment(
                k + 1, 100.0 * k, PERIOD, u[kept], speed[kept], amperes[kept] if current else None
            )
        )
    return found


def candidates(machine: Machine, names: Sequence[str | Effect], most: float = 12.0) -> list:
    """Candidates of a machine, by name or as effects of one's own."""
    sizes = machine_scales(machine.parameters, most)
    effects = [get_effect(n) if isinstance(n, str) else n for n in names]
    largest = most_of(machine.parameters, most)
    return [Candidate(e, largest, sizes) for e in effects]
