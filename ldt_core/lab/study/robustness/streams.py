"""The streams on which the twin has to be good, as data.

`STREAMS[name](seed, experiments)` is a stream: the machine as the twin's file knows it, the
experiments, and the references that know the truth. The seed decides when the machine changes, all
voltages, the noise, and where the file is off.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ldt_core.base.experiment import Experiment, Samples
from ldt_core.base.sentences import spoken
from ldt_core.lab.study.robustness.known_stream import KnownStream
from ldt_core.lab.study.robustness.true_plant import (
    SIZE,
    ChallengePlant,
    Condition,
    LibraryPlant,
    TruePlant,
    condition_of,
)
from ldt_core.machine.degradation import Schedule
from ldt_core.machine.excitation import excitation
from ldt_core.machine.machine_file import Machine, load_machine, machine_from_dict
from ldt_core.machine.plant import NOISE, START, VOLTAGE

FILE = 9  # random stream of what the machine file is off by, apart from those of `machine.plant`
SECOND_WEAR = 1_000_003  # between the seeds of things that wear together; any prime would do
FOUNDATION = ("m", "M", "K_x", "K_y", "R_x", "R_y")
#: Experiments of a stream unless it says more.
USUAL = 60


@dataclass(frozen=True)
class Wear:
    """One thing that changes, as in `machine.degradation`.

    Args:
        effect: of the library, or a law of the challenge's simulator.
        parameter: of the effect; `SIZE` of a law.
        begin, end: first and last value.
        kind: of `machine.degradation`; "none" stays at `begin`.
        steps: changes.
        every: experiments to a change in the mean, in place of `steps`; 0 for those.
    """

    effect: str
    parameter: str
    begin: float
    end: float = 0.0
    kind: str = "staircase"
    steps: int = 6
    every: int = 0

    def values(self, experiments: int, seed: int) -> tuple[float, ...]:
        """The value in each experiment."""
        steps = max(1, experiments // self.every) if self.every else self.steps
        names = (self.effect, self.parameter, self.begin, self.end, steps)
        return Schedule(self.kind, *names, experiments, seed).values


@dataclass(frozen=True)
class Aim:
    """How good the default has to be; None where nothing is asked.

    Args:
        late: mean maximum error over that of the reference *late*, at most.
        left: mean maximum error over the original's, at most.
        learned: the same without the first experiment, which nobody can have learned from.
    """

    late: float | None = None
    left: float | None = None
    learned: float | None = None


@dataclass(frozen=True)
class StreamKind:
    """A kind of stream; a call makes one.

    Args:
        about: what it is, for people.
        wears: what changes or is there from the first experiment on; nothing for a quiet stream.
        aim: how good the default has to be.
        experiments: how many it has, unless asked for others.
        machine: name of the twin's machine file.
        acts: (effect, parameter, value) that act in every experiment.
        off: the file's foundation is off by this share, up or down by the seed.
        noise: standard deviation on the speed [rad/s]; None takes the file's.
        random_start: whether each experiment starts at an angle of its own.
        constant_until: the first experiments are all driven by one constant voltage.
        simulator: whether the challenge's simulator makes it, by laws of its own.
        altered: (section, key, value) of the machine file that are otherwise, in plant and twin.
    """

    about: str
    wears: tuple[Wear, ...]
    aim: Aim
    experiments: int = USUAL
    machine: str = "rotor"
    acts: tuple[tuple[str, str, float], ...] = ()
    off: float = 0.0
    noise: float | None = None
    random_start: bool = False
    constant_until: int = 0
    simulator: bool = False
    altered: tuple[tuple[str, str, Any], ...] = ()

    def __call__(self, seed: int, experiments: int = 0) -> KnownStream:
        """One stream.

        Args:
            seed: of everything random.
            experiments: how many; 0 for the usual number.
        """
        count = experiments or self.experiments
        true = self._true()
        plant = (ChallengePlant if self.simulator else LibraryPlant)(true, seed)
        noise = float(true.simulation["noise"]) if self.noise is None else self.noise
        conditions = self._conditions(count, seed)
        made = tuple(
            self._experiment(plant, conditions[n - 1], seed, n, noise) for n in range(1, count + 1)
        )
        known = self._file(true, seed)
        return KnownStream(known, made, plant, conditions, noise, self.random_start)

    def _true(self) -> Machine:
        """The true machine, with nothing acting on it."""
        plain = load_machine(self.machine).as_dict()
        for section, key, value in self.altered:
            plain[section] = {**plain[section], key: value}
        return machine_from_dict(plain, f"{self.machine}.yaml")

    def _conditions(self, count: int, seed: int) -> tuple[Condition, ...]:
        rows = [wear.values(count, seed + i * SECOND_WEAR) for i, wear in enumerate(self.wears)]
        found = []
        for values in zip(*rows, strict=True) if rows else ((),) * count:
            acting: dict[str, dict[str, float]] = {}
            for effect, parameter, value in self.acts:
                acting.setdefault(effect, {})[parameter] = value
            for wear, value in zip(self.wears, values, strict=True):
                acting.setdefault(wear.effect, {})[wear.parameter] = value
            found.append(condition_of(acting))
        return tuple(found)

    def _experiment(
        self, plant: TruePlant, acting: Condition, seed: int, number: int, noise: float
    ) -> Experiment:
        machine = plant.machine
        count, period = machine.samples, machine.sample_period
        angle = 0.0
        if self.random_start:
            angle = float(_random(seed, number, START).uniform(0.0, 2 * np.pi))
        volts = self._voltage(machine, seed, number)
        speed = plant.speed(acting, volts, angle)
        speed = speed + _random(seed, number, NOISE).normal(0.0, noise, count)
        return Experiment(number, (number - 1) * count * period, period, volts, speed)

    def _voltage(self, machine: Machine, seed: int, number: int) -> Samples:
        steady = number <= self.constant_until
        drive = excitation(machine, "constant" if steady else "")
        # One number for all experiments at constant voltage: all have the same.
        drawn = np.random.SeedSequence([seed, 0 if steady else number, VOLTAGE])
        return drive.voltage(machine.samples, machine.sample_period, drawn)

    def _file(self, true: Machine, seed: int) -> Machine:
        """The machine as the twin's file knows it."""
        if not self.off:
            return true
        signs = _random(seed, 0, FILE).choice([-1.0, 1.0], len(FOUNDATION))
        given = {
            name: true.parameters[name] * (1 + self.off * sign)
            for name, sign in zip(FOUNDATION, signs.tolist(), strict=True)
        }
        return true.with_parameters(**given)


def _random(seed: int, number: int, stream: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence([seed, number, stream]))


#: The paper's experiment: the rotor of the worked case wears.
ECCENTRICITY = Wear("unbalance", "e", 0.0, 0.012, "staircase", 12)
#: "Plant as known": all but what wears is as the file says.
KNOWN = Aim(late=1.25)
#: Where the file lacks or mistakes something beside.
UNKNOWN = Aim(learned=0.12)
TOGETHER = Aim(left=0.25)


def _staircase(length: int) -> StreamKind:
    return StreamKind(
        f"e grows in steps, {length} experiments", (ECCENTRICITY,), KNOWN, experiments=length
    )


def _e(about: str, kind: str, every: int = 0) -> StreamKind:
    wear = replace(ECCENTRICITY, kind=kind, every=every)
    return StreamKind(about, (wear,), KNOWN)


#: What else the plant has that the file lacks or mistakes, with its values.
BESIDE: dict[str, tuple[str, StreamKind]] = {
    "foundation_5": ("foundation 5 % off", StreamKind("", (), UNKNOWN, off=0.05)),
    "foundation_10": ("foundation 10 % off", StreamKind("", (), Aim(), off=0.10)),
    "coulomb": (
        "also Coulomb friction of 0.05 N m",
        StreamKind("", (), UNKNOWN, acts=(("coulomb_friction", "torque", 0.05),)),
    ),
    "drag": (
        "also quadratic drag of 2e-4 N m s^2",
        StreamKind("", (), UNKNOWN, acts=(("quadratic_drag", "c", 2e-4),)),
    ),
    "resistance": (
        "armature resistance 5 % higher",
        StreamKind("", (), UNKNOWN, acts=(("armature_resistance", "factor", 1.05),)),
    ),
}
#: How e is, where something else is beside it.
WITH_E = {
    "e6": ("e = 6 mm from the first experiment on", Wear("unbalance", "e", 0.006, kind="none"), 20),
    "e10": (
        "e = 10 mm from the first experiment on",
        Wear("unbalance", "e", 0.01, kind="none"),
        20,
    ),
    "staircase": ("e grows in steps", ECCENTRICITY, 40),
}


def _beside() -> dict[str, StreamKind]:
    found = {}
    for name, (what, kind) in BESIDE.items():
        for how, (e, wear, count) in WITH_E.items():
            aim = kind.aim if wear.kind == "none" else Aim()
            about = f"{what}, {e}"
            more = replace(kind, about=about, wears=(wear,), aim=aim, experiments=count)
            found[f"{name}_{how}"] = more
    return found


#: What drifts in place of e, the cause not told.
OTHERS = {
    "friction": Wear("coulomb_friction", "torque", 0.0, 0.1),
    "load": Wear("constant_load", "torque", 0.0, 0.1),
    "drag": Wear("quadratic_drag", "c", 0.0, 4e-4),
    "resistance": Wear("armature_resistance", "factor", 1.0, 1.3),
}

STREAMS: dict[str, StreamKind] = {
    "staircase": replace(_staircase(40), aim=Aim(late=1.25, left=0.30)),
    "staircase_60": _staircase(60),
    "staircase_200": _staircase(200),
    "noise_0.02": replace(_staircase(40), about="the same with a noise of 0.02 rad/s", noise=0.02),
    "noise_0.5": replace(_staircase(40), about="the same with a noise of 0.5 rad/s", noise=0.5),
    "abrupt": _e("e jumps once", "abrupt"),
    "recurring": _e("e comes and goes", "recurring"),
    "recurring_fast": _e("e comes or goes about every second experiment", "recurring", every=2),
    "repaired": _e("e grows and is repaired", "repaired"),
    "ramp": _e("e grows in every experiment", "ramp"),
    "off_5mm": StreamKind(
        "e = 5 mm from the first experiment on",
        (replace(ECCENTRICITY, begin=0.005, kind="none"),),
        KNOWN,
        experiments=20,
    ),
    "random_start": replace(
        _staircase(40), about="e grows in steps, any start angle", random_start=True
    ),
    "constant_first": StreamKind(
        "e = 6 mm, one constant voltage for 30 experiments and then steps",
        (replace(ECCENTRICITY, begin=0.006, kind="none"),),
        KNOWN,
        constant_until=30,
    ),
    **{
        f"{name}_drifts": StreamKind(f"{spoken(wear.effect)} grows in steps", (wear,), KNOWN)
        for name, wear in OTHERS.items()
    },
    "e_and_friction": StreamKind(
        "e and Coulomb friction grow", (ECCENTRICITY, OTHERS["friction"]), TOGETHER
    ),
    "drag_and_resistance": StreamKind(
        "drag and armature resistance grow", (OTHERS["drag"], OTHERS["resistance"]), TOGETHER
    ),
    **_beside(),
    "own_law": StreamKind(
        "another simulator, a law that the library lacks grows: a torque in a band of speeds",
        (Wear("resonance_band", SIZE, 0.0, 0.5),),
        Aim(),
        simulator=True,
    ),
    "own_hysteresis": StreamKind(
        "another simulator, a law that the library lacks grows: a hysteresis of the speed",
        (Wear("speed_hysteresis", SIZE, 0.0, 0.3),),
        Aim(),
        simulator=True,
    ),
    "other_engine_motor": StreamKind(
        "another simulator, a motor's dry friction (bristle model) doubles",
        (Wear("coulomb_friction", SIZE, 0.05, 0.1, "abrupt"),),
        Aim(),
        machine="dc_motor",
        simulator=True,
    ),
    "motor": StreamKind(
        "a DC motor whose Coulomb friction grows",
        (Wear("coulomb_friction", "torque", 0.0, 0.1, steps=5),),
        KNOWN,
        machine="dc_motor",
    ),
    "quiet": StreamKind("nothing changes", (), Aim(), experiments=100),
}
