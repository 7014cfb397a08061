"""The simulated machine: the physics plus what its file does not know.

The machine file's optional section `simulation` says how it is driven and worn; without it, or for
keys that it lacks, the values in brackets hold:

    voltage:        see `excitation.py`                                 [steps in the middle range]
    start:          rest, random or continue                                                 [rest]
    noise:          standard deviation of the white noise on the measured speed [rad/s]         [0]
    current_noise:  the same on the measured current [A]                                        [0]
    degradation:    see `degradation.py`                                                     [none]

Everything random comes from (seed, number of the experiment): with start `rest` or `random` an
experiment is a function of these two and the settings alone, so a plant that is restarted in the
middle of a run goes on with the same numbers. With `continue` each begins in the state in which the
last one ended, and an experiment asked for out of order is computed from the first one on.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Self

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.clock import computer_time
from ldt_core.base.errors import MachineFileError, did_you_mean
from ldt_core.base.experiment import Experiment
from ldt_core.base.own_process import undivided
from ldt_core.base.settings import FROM_FILE
from ldt_core.effects import parse_effect, refuse_repeated
from ldt_core.machine.degradation import schedule
from ldt_core.machine.excitation import Excitation, Given, excitation
from ldt_core.machine.file_values import check_keys, real_number
from ldt_core.machine.machine_file import Machine
from ldt_core.physics.base import ANGLE, CURRENT
from ldt_core.physics.effect import Effect

KEYS = ("voltage", "start", "noise", "current_noise", "degradation")
STARTS = ("rest", "random", "continue")
VOLTAGE, NOISE, START, CURRENT_NOISE = range(4)  # independent random streams of one experiment

EffectUse = tuple[Effect, Mapping[str, float]]


class Plant:
    """A machine to run twins against.

    Args:
        machine: as it is known beforehand.
        experiments: in the run; the degradation is spread over them.
        seed: of everything random.
        effects: (effect, all its values) that act in every experiment, as from `parse_effect`.
        degradation: kind, see `degradation.py`; "" takes the machine file's.
        degradation_to: last value of what wears; None takes the machine file's.
        noise: standard deviation on the speed [rad/s]; None takes the machine file's.
        voltage: kind, see `excitation.py`; "" takes the machine file's.
        start: rest, random (at rest at a random angle) or continue; "" takes the machine file's.
        start_time: of the first sample [s since the epoch]; experiments follow without a gap.
        measure_current: record the current as well.

    Raises:
        MachineFileError: a section `simulation` that cannot be used.
        OptionError: an effect that this machine cannot have, or one that is given twice.
    """

    def __init__(
        self,
        machine: Machine,
        *,
        experiments: int = 200,
        seed: int = 0,
        effects: Sequence[EffectUse] = (),
        degradation: str = "",
        degradation_to: float | None = None,
        noise: float | None = None,
        voltage: str = "",
        start: str = "",
        start_time: float = 0.0,
        measure_current: bool = False,
    ) -> None:
        where = f"{machine.source}, simulation"
        check_keys(where, machine.simulation, (), KEYS)
        self.machine = machine
        self.physics = machine.model
        self.seed = seed
        self.effects = tuple(effects)
        refuse_repeated(self.effects)
        self.schedule = schedule(machine, experiments, seed, degradation, degradation_to)
        self.excitation: Excitation | Given = excitation(machine, voltage)
        self.start = start or machine.simulation.get("start", "rest")
        if self.start not in STARTS:
            expected = did_you_mean(str(self.start), STARTS)
            raise MachineFileError(f"{where}.start", expected, repr(self.start))
        own = _deviation(f"{where}.noise", machine.simulation.get("noise", 0.0))
        self.noise = own if noise is None else _deviation("noise", noise)
        self.current_noise = _deviation(
            f"{where}.current_noise", machine.simulation.get("current_noise", 0.0)
        )
        self.start_time = start_time
        self.measure_current = measure_current
        # With `continue`: the last experiment simulated, and the state in which it ended.
        self._ended: tuple[int, Array] | None = None
        for number in (1, experiments):
            for effect, given in self.acting(number):
                effect.change_parameters(self.physics, machine.parameters, given)

    @classmethod
    def from_settings(
        cls, machine: Machine, settings: Mapping[str, Any], effects: Sequence[EffectUse] = ()
    ) -> Self:
        """The plant that parameters of the groups plant and run describe (`parameters.yaml`).

        `effects` are further ones beside those of the settings.

        Raises:
            MachineFileError: a section `simulation` that cannot be used.
            OptionError: an effect that is unknown or that this machine cannot have.
        """
        to, noise, begin = (settings[n] for n in ("degradation_to", "noise", "start_time"))
        return cls(
            machine,
            experiments=settings["experiments"],
            seed=settings["seed"],
            effects=[*(parse_effect(text, machine.law) for text in settings["effect"]), *effects],
            degradation=settings["degradation"],
            degradation_to=None if to == FROM_FILE else to,
            noise=None if noise == FROM_FILE else noise,
            voltage=settings["voltage"],
            start=settings["start"],
            start_time=computer_time() if begin == FROM_FILE else begin,
            measure_current=settings["measure_current"],
        )

    def acting(self, number: int) -> list[EffectUse]:
        """The effects in experiment `number`; wear takes the place of a value given for it."""
        if self.schedule.kind == "none":
            return list(self.effects)
        name, worn = self.schedule.effect, {self.schedule.parameter: self.schedule.value(number)}
        used = [(e, {**p, **worn} if e.name == name else p) for e, p in self.effects]
        if any(effect.name == name for effect, _ in used):
            return used
        effect = self.machine.law(name)
        known: Mapping[str, float] = {}
        for other, given in self.machine.effects:
            known = given if other.name == name else known
        return [*used, effect.used({**known, **worn})]

    def truth(self, number: int) -> dict[str, dict[str, float]]:
        """Effect → its values in experiment `number`."""
        return {effect.name: dict(given) for effect, given in self.acting(number)}

    @undivided()
    def experiment(self, number: int) -> Experiment:
        """Experiment `number` (from 1).

        Raises:
            LdtError: the simulated state grows without bound.
        """
        machine, samples, period = self.machine, self.machine.samples, self.machine.sample_period
        volts, states = self._simulate(number)
        speed = self.physics.measure(states[:samples], period, self.acting(number))
        if self.noise > 0:
            speed = speed + self._random(number, NOISE).normal(0.0, self.noise, samples)
        current = None
        if self.measure_current:
            random = self._random(number, CURRENT_NOISE)
            current = states[:samples, CURRENT] + random.normal(0.0, self.current_noise, samples)
        start = self.start_time + (number - 1) * samples * period
        return Experiment(number, start, machine.sample_period, volts, speed, current)

    def describe(self) -> list[str]:
        """What this plant has that its machine file does not, in words."""
        known = {effect.name: (effect, given) for effect, given in self.machine.effects}
        words = []
        for effect, given in self.effects:
            own = effect.describe(given)
            if effect.name in known:
                file = known[effect.name][0].describe(known[effect.name][1])
                own += f" in place of the machine file's {file}"
            words.append(own)
        if (s := self.schedule).kind != "none":
            words.append(f"{s.kind} of {s.effect}.{s.parameter} from {s.begin:g} to {s.end:g}")
        return [*words, f"noise {self.noise:g} rad/s"]

    def _random(self, number: int, stream: int) -> np.random.Generator:
        return np.random.default_rng(np.random.SeedSequence([self.seed, number, stream]))

    def _simulate(self, number: int) -> tuple[Array, Array]:
        """(voltage (L,), states (L + 1, n)): the last state is where the experiment ends."""
        samples, period = self.machine.samples, self.machine.sample_period
        seed = np.random.SeedSequence([self.seed, number, VOLTAGE])
        volts = self.excitation.voltage(samples, period, seed)
        values = self.machine.parameters
        initial = self._first_state(number)
        held = np.append(volts, volts[-1])
        states = self.physics.simulate(values, held, period, initial, self.acting(number))
        self._ended = number, states[-1]
        return volts, states

    def _first_state(self, number: int) -> Array:
        state = self.physics.initial_state(self.machine.parameters, 0.0)
        if self.start == "random":
            state[ANGLE] = self._random(number, START).uniform(0.0, 2 * math.pi)
        if self.start != "continue" or number == 1:
            return state
        if self._ended is None or self._ended[0] >= number:
            self._ended = None
            self._simulate(1)
        while self._ended is not None and self._ended[0] < number - 1:
            self._simulate(self._ended[0] + 1)
        assert self._ended is not None
        return self._ended[1]


def _deviation(where: str, value: Any) -> float:
    number = real_number(where, value)
    if number < 0:
        raise MachineFileError(where, "a standard deviation of at least 0", f"{number:g}")
    return number
