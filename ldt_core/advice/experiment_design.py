"""The experiment that would teach most about the machine's parameters, outside the bands.

An experiment teaches how far it narrows what is known: with the parameters Gaussian about their
values and the speed linear in them, by half the logarithm of the determinants' ratio of the
information behind it and before it (Bayesian D-optimal design: K. Chaloner and I. Verdinelli,
"Bayesian experimental design: a review", Statistical Science 10, 1995), told in bits. The
information before it is that of a tenth of doubt about each parameter, and of the experiments that
were made.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ldt_core.advice.bands import in_bands, uncertain_bands
from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment, rms
from ldt_core.machine.machine_file import Machine

PRIOR_STD = 0.1  # relative deviation of a parameter of which nothing else is known
DIFFERENCE_STEP = 1e-3  # relative; the integrator is good to a hundredth of it
MAX_STEP = 2e-3  # s, integration step
DEFAULT_NOISE = 0.1  # rad/s, where nothing has been measured yet
VOLTAGE_RANGES = 4  # ranges of voltage that are told apart
LEVELS = 20  # steps in an experiment
DRAWS = 200  # voltages drawn, of which those within a band are left out


@dataclass(frozen=True, eq=False)
class DesignedExperiment:
    """An experiment that has not been made.

    Args:
        levels: voltages, each held equally long [V].
        hold: for which each is held [s].
        bits: of information on the parameters that it would add.
        sharpens: parameter whose deviation it would lower by the largest part.
    """

    name: str
    levels: tuple[float, ...]
    hold: float
    bits: float = 0.0
    sharpens: str = ""

    def volts(self, samples: int, period: float) -> Array:
        """(samples,) the voltage over time, each held for a period [s]."""
        index = np.floor(np.arange(samples) * period / self.hold + 1e-9).astype(np.int64)
        return np.array(self.levels)[np.minimum(index, len(self.levels) - 1)]


def most_informative(
    machine: Machine, values: Mapping[str, float], experiments: Sequence[Experiment] = ()
) -> DesignedExperiment | None:
    """The design with most bits; None where every one would be in a band.

    Args:
        experiments: that were made of the machine as it is. What the simulation leaves of one
            counts as its noise, so that what is not understood is not taken for knowledge.
    """
    names = [p.name for p in machine.model.parameters if values.get(p.name, 0.0) > 0]
    known = np.eye(len(names)) / PRIOR_STD**2
    noises = []
    for e in experiments:
        start = machine.model.initial_state(values, float(e.speed[0]))
        base, columns = _sensitivities(machine, values, names, e.voltage, e.period, start)
        noise = rms(e.speed - base) or DEFAULT_NOISE
        noises.append(noise)
        known = known + columns.T @ columns / noise**2
    noise = float(np.median(noises)) if noises else DEFAULT_NOISE
    best: DesignedExperiment | None = None
    reversed_before = any(e.voltage.min() < 0 < e.voltage.max() for e in experiments)
    for design in candidate_designs(machine, values, reversed_before):
        volts = design.volts(machine.samples, machine.sample_period)
        start = machine.model.initial_state(values, 0.0)
        try:
            _, columns = _sensitivities(machine, values, names, volts, machine.sample_period, start)
        except LdtError:
            continue  # a simulation that diverges teaches nothing
        after = known + columns.T @ columns / noise**2
        bits = 0.5 * (_log_det(after) - _log_det(known)) / math.log(2)
        narrowed = np.diag(np.linalg.inv(after)) / np.diag(np.linalg.inv(known))
        if best is None or bits > best.bits:
            sharpens = names[int(np.argmin(narrowed))]
            best = DesignedExperiment(design.name, design.levels, design.hold, bits, sharpens)
    return best


def candidate_designs(
    machine: Machine, values: Mapping[str, float], reverse: bool = False
) -> list[DesignedExperiment]:
    """Experiments within the limits that hold no voltage at which the rotor may be captured.

    Args:
        reverse: whether one may reverse it at full speed, which is hard on many machines.
    """
    low, high = machine.voltage_limits
    sign, most = (1.0, high) if high >= -low else (-1.0, -low)
    avoid = uncertain_bands(values, most)
    random = np.random.default_rng(0)
    hold = max(machine.duration / LEVELS, machine.sample_period)
    found = []

    def add(name: str, levels: Array) -> None:
        levels = np.round(levels, 3)
        kept = levels[~in_bands(levels, avoid)][:LEVELS]
        if kept.size == LEVELS:
            found.append(DesignedExperiment(name, tuple(kept.tolist()), hold))

    for a, b in [*voltage_ranges(most), (0.0, most)]:
        add(
            f"steps between {sign * a:.3g} and {sign * b:.3g} V", sign * random.uniform(a, b, DRAWS)
        )
    top = np.repeat(np.tile([most, 0.0], DRAWS), LEVELS // 4)
    add(f"running up at {sign * most:.3g} V and letting it run down, in turn", sign * top)
    if reverse and low < 0 < high:
        both = random.uniform(0.3, 1.0, DRAWS) * np.tile([high, low], DRAWS // 2)
        add(f"steps to and fro between {low:.3g} and {high:.3g} V", both)
    return found


def voltage_ranges(most: float) -> list[tuple[float, float]]:
    """Equal ranges of voltage up to the limit [V]."""
    return [
        (most * i / VOLTAGE_RANGES, most * (i + 1) / VOLTAGE_RANGES) for i in range(VOLTAGE_RANGES)
    ]


def least_covered(
    machine: Machine, experiments: Sequence[Experiment]
) -> tuple[float, float] | None:
    """The range of voltage, of either sign, in which the experiments spent least time [V]."""
    if not experiments:
        return None
    size = np.abs(np.concatenate([e.voltage for e in experiments]))
    most = max(map(abs, machine.voltage_limits))
    return min(voltage_ranges(most), key=lambda t: int(((t[0] <= size) & (size < t[1])).sum()))


def _sensitivities(
    machine: Machine,
    values: Mapping[str, float],
    names: Sequence[str],
    volts: Array,
    period: float,
    start: Array,
) -> tuple[Array, Array]:
    """The speed (L,), and (L, p) its change by the logarithm of each parameter [rad/s]."""

    def run(changed: Mapping[str, float]) -> Array:
        states = machine.model.simulate(changed, volts, period, start, max_step=MAX_STEP)
        return np.asarray(states[:, 1])

    base = run(values)
    moved = [run({**values, n: values[n] * (1 + DIFFERENCE_STEP)}) - base for n in names]
    return base, np.column_stack(moved) / DIFFERENCE_STEP


def _log_det(matrix: Array) -> float:
    return float(np.linalg.slogdet(matrix)[1])
