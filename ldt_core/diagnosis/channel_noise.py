"""The white noise of the measured channels, as they or their residuals show it."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment
from ldt_core.estimation.free_run_start import first_current
from ldt_core.estimation.noise import ROUNDING, sensor_step, white_noise
from ldt_core.machine.machine_file import Machine
from ldt_core.physics.base import CURRENT

NOISE_FLOOR = 1e-4  # of a channel's size: a simulation without noise must not divide by 0


def residual_noise(machine: Machine, experiments: Sequence[Experiment]) -> tuple[float, float]:
    """Deviations of the white noise on speed [rad/s] and current [A], from the less rough.

    The signals themselves, or what the machine file leaves of them: a voltage that moves at every
    sample makes the signals rough. No less than what a sensor with steps rounds off.
    """
    rest: tuple[list[Array], list[Array]] = ([], [])
    for e in experiments:
        first = float(e.speed[0]), first_current(e)
        start = machine.model.initial_state(machine.parameters, *first)
        with contextlib.suppress(LdtError):
            states = machine.model.simulate(machine.parameters, e.voltage, e.period, start)
            rest[0].append(e.speed - machine.model.measure(states, e.period, ()))
            rest[1].extend(() if e.current is None else [e.current - states[:, CURRENT]])
    currents = [e.current for e in experiments if e.current is not None]
    signals = [e.speed for e in experiments], currents
    speed, current = (
        min(seen, max(white_noise(left), ROUNDING * sensor_step(signal), least)) if left else seen
        for seen, least, left, signal in zip(
            channel_noise(experiments), noise_floor(experiments), rest, signals, strict=True
        )
    )
    return speed, current


def channel_noise(experiments: Sequence[Experiment]) -> tuple[float, float]:
    """Deviations of the white noise on speed [rad/s] and current [A], as measured."""
    speed, current = noise_floor(experiments)
    speed = max(white_noise(e.speed for e in experiments), speed)
    measured = [e.current for e in experiments if e.current is not None]
    return speed, max(white_noise(measured), current) if measured else current


def noise_floor(experiments: Sequence[Experiment]) -> tuple[float, float]:
    """The least deviations of noise on speed [rad/s] and current [A] that are believed."""
    speed = np.concatenate([e.speed for e in experiments])
    floor = NOISE_FLOOR * max(float(np.abs(speed).max()), 1e-6)
    current = [e.current for e in experiments if e.current is not None]
    if not current:
        return floor, 1.0
    return floor, NOISE_FLOOR * max(float(np.abs(np.concatenate(current)).max()), 1e-6)
