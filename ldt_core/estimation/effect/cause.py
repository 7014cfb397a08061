"""Free runs of a machine with one effect, from a start state that is only partly known."""

from __future__ import annotations

import contextlib
import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment
from ldt_core.estimation.effect.effect_coordinates import EffectCoordinates
from ldt_core.estimation.free_run_start import AT_REST, first_current
from ldt_core.physics.base import ANGLE, CURRENT, SPEED, FreeRun

if TYPE_CHECKING:
    from ldt_core.machine.machine_file import Machine
    from ldt_core.physics.effect import Effect


DIVERGED_SPEED = 1e6  # rad/s, that no fit accepts, in place of a free run that grows for ever
SENSOR_ROUNDS = 20  # of a fixed point for the speed behind a first sample; it converges in a few
PROBE_DURATION = 2.0  # s, of the run that shows whether the start angle matters: several turns
ROUNDING_SHARE = 1e-6  # of the largest speed: two free runs that differ by less are the same
MOTION_STEP = 1e-3  # s, longest integration step where only the size of a motion is asked for


@dataclass(frozen=True, eq=False)
class UncertainStart:
    """What is known of the state at an experiment's first sample.

    `rest`: whether the machine stood still; `spread`: (n,) deviation of each state about the
    nominal one, 0 where it is known.
    """

    rest: bool
    spread: Array


class CauseRun(NamedTuple):
    """One free run of a machine with its cause.

    Attributes:
        experiment: its voltage, its first speed and its first current.
        z: the effect's coordinates.
        offset: (n,) change of the nominal start state.
        rest: the machine stood still, whatever the first sample says.
    """

    experiment: Experiment
    z: Array
    offset: Array
    rest: bool = False


def finite_speed(speed: Array) -> Array:
    """A speed [rad/s] as it is, but `DIVERGED_SPEED` where no number says how large it is."""
    if math.isfinite(speed.sum()):
        return speed
    return np.nan_to_num(speed, nan=DIVERGED_SPEED, posinf=DIVERGED_SPEED, neginf=-DIVERGED_SPEED)


class Cause:
    """A machine and the one effect that is to explain its changes.

    The effect's parameters are handled as `EffectCoordinates` z.

    Args:
        machine: as it is known beforehand.
        values: the machine's parameters.
        effect: of `ldt_core.effects`, one that the machine can have.
    """

    def __init__(self, machine: Machine, values: Mapping[str, float], effect: Effect) -> None:
        self.machine, self.values, self.effect = machine, dict(values), effect
        self.physics = machine.model
        self.names = [p.name for p in effect.parameters]
        most_voltage = max(map(abs, machine.voltage_limits))
        self._own = EffectCoordinates([effect], self.values, most_voltage)
        self.scale, self.low, self.high = self._own.scale, self._own.low, self._own.high
        #: Coordinates of the effect at its typical size.
        self.typical = self.coordinates(self._own.sized(effect, effect.typical))

    def given(self, z: Array) -> dict[str, float]:
        """The effect's parameters at coordinates z (d,), within their bounds."""
        ((_, given),) = self._own.given(z)
        return given

    def coordinates(self, given: Mapping[str, float]) -> Array:
        """(d,) coordinates of these parameters."""
        return self._own.at({self.effect.name: given})

    @functools.cached_property
    def turn(self) -> float:
        """Angle [rad] by which a start may differ without any difference in speed.

        0 where the start angle does not matter, half a turn for a vertical shaft on a symmetrical
        foundation, else a whole turn. Found by free runs of the effect at its typical size.
        """
        high = max(abs(v) for v in self.machine.voltage_limits)
        period = self.machine.sample_period
        rest = np.zeros(max(3, round(PROBE_DURATION / period)))
        probe = Experiment(1, 0.0, period, rest + high, rest)
        z = self.typical
        nominal, *turned = (
            self.speed(probe, z, self.offset(angle)) for angle in (0.0, 1.0, math.pi)
        )
        limit = ROUNDING_SHARE * max(1.0, float(np.abs(nominal).max()))
        other, half = (float(np.abs(t - nominal).max()) <= limit for t in turned)
        return 0.0 if other and half else math.pi if half else 2 * math.pi

    def offset(self, angle: float) -> Array:
        """(n,) change of the nominal start state: at this angle [rad]."""
        offset = np.zeros(len(self.physics.states))
        offset[ANGLE] = angle
        return offset

    def start(
        self, experiment: Experiment, noise: float, z: Array, lively: Array | None = None
    ) -> UncertainStart:
        """What is known of the start.

        A first sample within the noise of 0 means a machine at rest: then only the angle is
        unknown. Otherwise the speed is known to the noise, the current (unless it was measured)
        within what the voltage can drive, and the foundation within the motion that it has in the
        run.

        Args:
            experiment: whose first samples count.
            noise: standard deviation of the measured speed [rad/s].
            z: the effect's coordinates, for what the sensor makes of the speed.
            lively: coordinates for the foundation's motion; None takes the effect's typical size.
        """
        spread = np.zeros(len(self.physics.states))
        spread[ANGLE] = self.turn / math.sqrt(12)
        rest = abs(self._first_speed(experiment, z)) <= AT_REST * noise
        if not rest:
            spread[SPEED] = noise
            if experiment.current is None:
                spread[CURRENT] = float(np.abs(experiment.voltage).max()) / self.values["R"]
            lively = self.typical if lively is None else lively
            if self.turn > 0 and spread.size > CURRENT + 1:
                states = self._states(experiment, lively, self.offset(0.0), rest, MOTION_STEP)
                moved = states[:, CURRENT + 1 : spread.size]
                spread[CURRENT + 1 :] = np.sqrt(np.mean(moved**2, axis=0))
        return UncertainStart(rest, spread)

    def speed(
        self,
        experiment: Experiment,
        z: Array,
        offset: Array,
        rest: bool = False,
        max_step: float | None = None,
    ) -> Array:
        """(L,) speed of the free run [rad/s].

        Args:
            experiment, z, offset, rest: as in `CauseRun`.
            max_step: of the integration [s]; None is as exact as the physics model.
        """
        states = self._states(experiment, z, offset, rest, max_step)
        return self._shown(states, experiment, z)

    def speeds(self, runs: Sequence[CauseRun], max_step: float) -> list[Array]:
        """The same of many free runs, several at once."""
        found = [np.full(len(run.experiment), DIVERGED_SPEED) for run in runs]
        begun, places = [], []
        for place, run in enumerate(runs):
            with contextlib.suppress(LdtError):
                begun.append(self._run(*run))
                places.append(place)
        for i, states in self.physics.simulate_all(begun, max_step):
            place = places[i]
            if not isinstance(states, LdtError):
                found[place] = self._shown(states, runs[place].experiment, runs[place].z)
        return found

    def _shown(self, states: Array, experiment: Experiment, z: Array) -> Array:
        given = [(self.effect, self.given(z))]
        return finite_speed(self.physics.measure(states, experiment.period, given))

    def _states(
        self,
        experiment: Experiment,
        z: Array,
        offset: Array,
        rest: bool,
        max_step: float | None,
    ) -> Array:
        step: dict[str, Any] = {} if max_step is None else {"max_step": max_step}
        try:
            return self.physics.simulate(*self._run(experiment, z, offset, rest)[:5], **step)
        except LdtError:
            return np.full((len(experiment), len(self.physics.states)), DIVERGED_SPEED)

    def _run(self, experiment: Experiment, z: Array, offset: Array, rest: bool) -> FreeRun:
        given = self.given(z)
        speed = 0.0 if rest else self._first_speed(experiment, z)
        current = first_current(experiment)
        worn = self.effect.change_parameters(self.physics, self.values, given)
        initial = self.physics.running_state(worn, speed, float(offset[ANGLE]), current)
        initial[SPEED:] += offset[SPEED:]
        about = self.values, experiment.voltage, experiment.period, initial
        return FreeRun(*about, [(self.effect, given)])

    def _first_speed(self, experiment: Experiment, z: Array) -> float:
        """The shaft's speed when a settled sensor, with the effect, shows the first sample."""
        shown = float(experiment.speed[0])
        if self.effect.on_measurement is None:
            return shown
        given, speed = [(self.effect, self.given(z))], shown
        for _ in range(SENSOR_ROUNDS):
            states = np.zeros((2, len(self.physics.states)))
            states[:, SPEED] = speed
            seen = float(self.physics.measure(states, experiment.period, given)[0])
            speed += shown - seen
        return speed if math.isfinite(speed) else shown
