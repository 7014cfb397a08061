"""How to come to a speed that lies past voltages at which the rotor may be captured."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from ldt_core.advice.bands import (
    any_eccentricity,
    build_up_time,
    in_bands,
    uncertain_bands,
    voltage_bands,
)
from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError, OptionError
from ldt_core.machine.machine_file import Machine
from ldt_core.physics.base import SPEED, Effects
from ldt_core.physics.steady_state import steady_voltage

RUN_UP_VOLTAGES = 5  # voltages of a run-up that are tried, from just above the band to the limit
SPEED_TOLERANCE = 0.02  # of the speed: nearer, it has been reached
TRIAL_PERIOD = 0.02  # s, of the trials
LONGEST_RUN_UP = 20.0  # s, longest run-up
SETTLING_TIMES = 8.0  # build-up times of the foundation after which a kept speed is final
VOLTAGE_TOLERANCE = 1e-3  # of the limit, to which the voltage that holds a speed is found


@dataclass(frozen=True)
class RunUp:
    """A way to a speed from rest.

    Args:
        speed: to be reached [rad/s].
        voltage: that holds it [V].
        through: voltage to begin with [V]; None where `voltage` may be set at once.
        seconds: for which `through` is held [s].
        captured: whether the foundation may hold the rotor up where `voltage` is set at once.
    """

    speed: float
    voltage: float
    through: float | None = None
    seconds: float = 0.0
    captured: bool = False

    def volts(self, samples: int, period: float) -> Array:
        """(samples,) the voltage over time, each held for a period [s]."""
        first = self.voltage if self.through is None else self.through
        early = np.arange(samples) * period < self.seconds - period / 2
        return np.where(early, first, self.voltage)

    def describe(self) -> str:
        """In words."""
        if self.through is None:
            return f"Set {self.voltage:.3g} V for {self.speed:.3g} rad/s."
        alone = "may leave the rotor captured" if self.captured else "does not lead there"
        return (
            f"To run at {self.speed:.3g} rad/s, hold {self.through:.3g} V for "
            f"{self.seconds:.2g} s from rest, then {self.voltage:.3g} V: from below, that voltage "
            f"alone {alone}."
        )


def plan_run_up(
    machine: Machine, values: Mapping[str, float], speed: float, effects: Effects = ()
) -> RunUp:
    """A way to hold a speed that does not end in capture, tried in simulation.

    Past a band the lowest voltage is taken that comes through with e larger or smaller by the
    uncertainty there is about it (`bands.E_UNCERTAINTY`). So it is where a friction holds the shaft
    that would go on turning.

    Args:
        values: the machine's parameters, with the effects on them.
        speed: [rad/s], above 0.
        effects: that act beside those of the machine file, with all their values.

    Raises:
        OptionError: a speed that no voltage within the limits holds stably, or to which no voltage
            leads past the resonance.
    """
    limit = machine.voltage_limits[1]
    if not 0 < speed < math.inf:
        raise OptionError("--reach", "a finite speed above 0 rad/s", f"{speed:g}")
    trial = _Trial(machine, effects)
    voltage = trial.holds(values, speed)
    if voltage is None or voltage > limit:
        takes = "" if voltage is None else f", which takes {voltage:.3g} V or more"
        raise OptionError("--reach", f"a speed that {limit:g} V can hold", f"{speed:g}{takes}")
    bands = voltage_bands(values, limit)
    for band in bands:
        if band.held[0] <= speed <= band.free[0]:
            beside = f"below {band.held[0]:.3g} or above {band.free[0]:.3g} rad/s"
            got = f"{speed:g}, where the foundation takes the motor's power"
            raise OptionError("--reach", beside, got)
    doubtful = [s for s in uncertain_bands(values, limit) if in_bands(np.array([voltage]), [s])[0]]
    if not doubtful and trial.reaches(values, speed, voltage):
        return RunUp(speed, voltage)
    edge = doubtful[-1][1] if doubtful else voltage
    for through in np.linspace(edge, limit, RUN_UP_VOLTAGES + 1)[1:] if edge < limit else ():
        run_up = trial.through(RunUp(speed, voltage, float(through), 0.0, bool(doubtful)), values)
        if run_up is not None:
            return run_up
    got = f"{speed:g}, beyond a resonance" if doubtful else f"{speed:g}, not reached from rest"
    raise OptionError("--reach", f"a speed to which {limit:g} V lead for certain", got)


class _Trial:
    """Simulations of a machine with all that acts in it."""

    def __init__(self, machine: Machine, effects: Effects) -> None:
        self.machine, self.effects = machine, effects
        #: Whether the parameters are all that acts: then an explicit function has the voltage.
        self.bare = not effects and all(e.is_folded for e, _ in machine.effects)

    def run(self, values: Mapping[str, float], volts: Array, speed: float = 0.0) -> Array:
        """(L,) speed from a speed on [rad/s]; zeros where it diverges."""
        model = self.machine.model
        initial = model.initial_state(values, speed)
        try:
            found = model.simulate(values, volts, TRIAL_PERIOD, initial, self.effects)
        except LdtError:
            return np.zeros(volts.size)
        return np.asarray(found[:, SPEED])

    def _end(self, values: Mapping[str, float], volts: Array, speed: float = 0.0) -> float:
        """Mean speed of the last second [rad/s]."""
        return float(self.run(values, volts, speed)[-round(1 / TRIAL_PERIOD) :].mean())

    def holds(self, values: Mapping[str, float], speed: float) -> float | None:
        """Voltage at which a shaft at this speed keeps it [V]; None where no permitted one does."""
        low, limit = self.machine.voltage_limits
        if self.bare:
            least = values["K_t"] * speed  # against no torque at all
            return float(steady_voltage(values, speed)) if least <= limit else least

        def gains(voltage: float) -> float:
            volts = np.full(round(LONGEST_RUN_UP / TRIAL_PERIOD), voltage)
            return self._end(values, volts, speed) - speed

        if gains(limit) < 0 or gains(low) > 0:
            return None
        return float(brentq(gains, low, limit, xtol=VOLTAGE_TOLERANCE * limit))

    def reaches(self, values: Mapping[str, float], speed: float, voltage: float) -> bool:
        """Whether the voltage leads there from rest."""
        if self.bare:
            return True
        held = np.full(round(LONGEST_RUN_UP / TRIAL_PERIOD), voltage)
        return self._end(values, held) >= (1 - SPEED_TOLERANCE) * speed

    def through(self, way: RunUp, values: Mapping[str, float]) -> RunUp | None:
        """The way by its run-up voltage with the time it takes, if it ends there whatever e is."""
        speed, voltage = way.speed, way.voltage
        spread = any_eccentricity(values) if values.get("e") else [values]
        held = np.full(round(LONGEST_RUN_UP / TRIAL_PERIOD), way.through or voltage)
        needed = 0.0
        for believed in spread:
            there = np.flatnonzero(self.run(believed, held) >= speed)
            if not there.size:
                return None
            needed = max(needed, float(there[0]) * TRIAL_PERIOD)
        run_up = replace(way, seconds=needed)
        rest = SETTLING_TIMES * build_up_time(values) if values.get("e") else LONGEST_RUN_UP
        samples = round((needed + rest) / TRIAL_PERIOD)
        for believed in spread:
            end = self._end(believed, run_up.volts(samples, TRIAL_PERIOD))
            holds = self.holds(believed, speed)
            # What another e does to the speed at this voltage is no capture.
            other = math.inf if holds is None else abs(holds - voltage) / values["K_t"]
            if abs(end - speed) > SPEED_TOLERANCE * speed + other:
                return None
        return run_up
