"""What a machine that is no motor may be instead, by the balance of its accelerations.

The speed's change over a few samples is a sum of what the voltage, the speed and each kind of
torque add to it, so that least squares tell which of them are there (inverse dynamic
identification: Gautier, Khalil, "Exciting trajectories for the identification of base inertial
parameters of robots", Int. J. Robotics Research 11, 1992). The angle is the integral of the speed.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.errors import BadInput, LdtError, OptionError, did_you_mean
from ldt_core.base.experiment import Experiment, rms
from ldt_core.base.sentences import listed
from ldt_core.calibration.calibration import free_run_error, padded_range, rounded
from ldt_core.calibration.prior_knowledge import UNSEEN
from ldt_core.effects import get_effect
from ldt_core.estimation.linear.identification import (
    LEAST_F,
    SAMPLES_PER_UNKNOWN,
    refuse_undetermined,
)
from ldt_core.estimation.variable_projection import basis_of, least_squares_step, project_out
from ldt_core.machine.machine_file import Machine
from ldt_core.physics.effect import Effect

#: Effect to what a machine with it is, for a person.
KINDS = {
    "gravity_imbalance": "a pendulum (gravity on an eccentric mass)",
    "coulomb_friction": "dry friction",
}
CHANCE = "the voltage explains no more of the speed's changes than chance would"
#: Samples over which the speed's change is taken: single differences show noise, long ones nothing
#: that is over by then. The span in which the effects tell most from a motor is taken.
SPANS = (4, 8, 16, 32)
SHORTEST = 2  # samples, of which one change of speed comes: shorter ones say nothing
#: Part of the squared remainder that a kind must take away: what a motor leaves of any excitation
#: has a little of every column in it.
LEAST_GAIN = 0.1
#: Most that a kind may leave of what a motor leaves: real pendulums leave 0.47 to 0.62, cogging
#: torques, delays and other frictions, which it imitates, 0.82 to 0.94.
MOST_LEFT = 0.75
RESISTANCE = 1.0  # Ohm, by convention: speed and voltage say nothing of it
CONVENTION = (
    f"Equivalent motor: R = {RESISTANCE:g} Ohm and b = 0 by convention. Torques and currents are "
    "on the scale of this motor, not of the machine; only their ratios count."
)
#: L / R over the sample period: at the first none shows, at the last a span of changes is still
#: not over. Each is tried in free run, since the balance says nothing of it.
ELECTRIC = np.geomspace(1e-3, SPANS[0], 8)
LOOSE = 0.3  # relative deviation of what the balance says: enough for a fit in free run to go on


@dataclass(frozen=True, eq=False)
class Balance:
    """Accelerations by their causes.

    Attributes:
        effects: names of the effects beside the motor, none of them for the motor alone.
        gain: acceleration for each volt [rad/s^2/V].
        damping: rate at which the speed falls [1/s].
        amounts: effect to its parameters, torques over the inertia [1/s^2].
        left: root mean square of what is left of the speed's changes [rad/s].
        without_voltage: of what would be left, did the voltage do nothing [rad/s].
        span: samples over which these are taken.
    """

    effects: tuple[str, ...]
    gain: float
    damping: float
    amounts: Mapping[str, Mapping[str, float]]
    left: float
    without_voltage: float
    span: int

    @property
    def possible(self) -> bool:
        """Whether the speed rises with the voltage, and no torque would have to drive it."""
        return self.gain > 0 and all(given["torque"] > 0 for given in self.amounts.values())


def balance(
    experiments: Sequence[Experiment], effects: Sequence[str], span: int = SPANS[0]
) -> Balance:
    """The balance of a motor with these effects, names of `KINDS`.

    Raises:
        BadInput: all experiments are too short to show a change of speed.
    """
    experiments = [e for e in experiments if len(e) > SHORTEST]
    if not experiments:
        raise BadInput("the recording", f"experiments of more than {SHORTEST} samples", "none")
    parts = [_columns(e, effects, span) for e in experiments]
    projected = [[project_out(x, basis_of(own)) for x in (c, t)] for c, own, t in parts]
    whole, target = (np.concatenate(x) for x in zip(*projected, strict=True))
    found = np.linalg.lstsq(whole, target, rcond=None)[0]
    others = whole[:, 1:]
    still = rms(target - others @ np.linalg.lstsq(others, target, rcond=None)[0])
    rest = [t - c @ found for c, _, t in parts]
    amounts: dict[str, dict[str, float]] = {}
    if "coulomb_friction" in effects:
        amounts["coulomb_friction"] = {"torque": max(-float(found[2]), 0.0)}
    if "gravity_imbalance" in effects:
        turns = [least_squares_step(own, r) for (_, own, _), r in zip(parts, rest, strict=True)]
        sizes = np.hypot(*np.transpose(turns))
        size = float(np.median(sizes))  # a machine has one torque, whatever the angle
        shares = size / np.maximum(sizes, np.finfo(float).tiny)
        for i, (_, own, _) in enumerate(parts):
            rest[i] = rest[i] - own @ (shares[i] * turns[i])
        # omega' = -T/J cos(theta + phi); the phase is that of the first experiment.
        phase = math.atan2(float(turns[0][0]), -float(turns[0][1]))
        amounts["gravity_imbalance"] = {"torque": size, "phase": phase}
    left = rms(np.concatenate(rest))
    gain, damping = float(found[0]), -float(found[1])
    return Balance(tuple(effects), gain, damping, amounts, left, still, span)


def _columns(e: Experiment, effects: Sequence[str], span: int) -> tuple[Array, Array, Array]:
    """(n, 2 or 3) what all have in common, (n, 0 or 2) of its own angle, (n,) changes of speed.

    Angles begin anew with each experiment. Their columns are taken out of it alone (Frisch, Waugh):
    beside those of all others, work and memory would grow by the square of the experiments.
    """
    common, own = [e.voltage[:-1], _mean(e.speed)], []
    if "coulomb_friction" in effects:
        # A shaft that friction holds does not change its speed, whatever the voltage is.
        turns = (e.speed[1:] != 0) | (e.speed[:-1] != 0)
        common = [c * turns for c in (*common, _mean(np.sign(e.speed)))]
    if "gravity_imbalance" in effects:
        angle = np.concatenate([[0.0], np.cumsum(_mean(e.speed) * e.period)])
        own = [_mean(np.sin(angle)), _mean(np.cos(angle))]
    ones = np.ones(min(span, len(e) - 1))
    rows = np.array([np.convolve(c * e.period, ones, "valid") for c in (*common, *own)]).T
    target = e.speed[ones.size :] - e.speed[: -ones.size]
    return rows[:, : len(common)], rows[:, len(common) :], target


def fitting(experiments: Sequence[Experiment]) -> Balance | None:
    """The effects without which these accelerations are not explained; None where a motor will do.

    Each must take away a stated part of what is left without it. None, too, where none explains
    most of it: something else acts.
    """
    found = []
    for span in SPANS:
        best = motor = balance(experiments, (), span)
        for count in range(1, len(KINDS) + 1):
            sets = [
                s for s in itertools.combinations(KINDS, count) if _enough(experiments, s, span)
            ]
            if not sets:
                break
            tried = [b for names in sets if (b := balance(experiments, names, span)).possible]
            new = min(tried, key=lambda b: b.left, default=best)
            if new.left**2 < (1 - LEAST_GAIN) * best.left**2:
                best = new
        if best.left < MOST_LEFT * motor.left:
            found.append((best.left / motor.left, best))
    return min(found, key=lambda f: f[0])[1] if found else None


def guidance(experiments: Sequence[Experiment]) -> str:
    """What would fit in place of a motor, as the end of a sentence; "" where nothing is found."""
    found = fitting(experiments) if any(len(e) > SHORTEST for e in experiments) else None
    if found is None:
        return ""
    left, motor = found.left, balance(experiments, (), found.span).left
    what = listed(KINDS[n] for n in found.effects)
    fits = (
        f"; a motor with {what} fits the changes of its speed ({left:.2g} rad/s left of them, "
        f"{motor:.2g} without)"
    )
    if _by_chance(found, experiments):
        return f"{fits}, but {CHANCE}: record experiments that the voltage drives"
    return f"{fits}: ldt identify RECORDING --effects {','.join(found.effects)} --out FILE"


def balanced_machine(
    experiments: Sequence[Experiment],
    effects: Sequence[str],
    name: str,
    limits: tuple[float, float] | None = None,
) -> Machine:
    """The machine that `balanced_start` makes of a balance which these experiments determine.

    Raises:
        OptionError: an effect that no balance knows.
        BadInput: experiments of different sample periods, or too large or small to compute with.
        LdtError: they do not determine it, or the speed does not rise with the voltage.
    """
    check_balanced(effects)
    if all(len(e) <= SHORTEST for e in experiments):
        raise BadInput("the recording", f"experiments of more than {SHORTEST} samples", "none")
    what = f"a motor with {listed(KINDS[n] for n in dict.fromkeys(effects))}"
    unknowns = _unknowns(experiments, effects)
    refuse_undetermined(experiments, unknowns, what)
    if not _enough(experiments, effects, SPANS[0]):
        needed, samples = SAMPLES_PER_UNKNOWN * unknowns * SPANS[0], sum(map(len, experiments))
        raise LdtError(f"{samples} samples cannot determine {what}: about {needed} are needed")
    found = _over_the_best_span(experiments, effects)
    if _by_chance(found, experiments):
        raise LdtError(f"the recording cannot determine {what}: {CHANCE}")
    low = min(float(e.voltage.min()) for e in experiments)
    high = max(float(e.voltage.max()) for e in experiments)
    return balanced_start(found, name, experiments, limits or padded_range(low, high))


def _over_the_best_span(experiments: Sequence[Experiment], effects: Sequence[str]) -> Balance:
    """The balance in the span in which `fitting` would take it."""
    tried = [balance(experiments, effects, n) for n in SPANS if _enough(experiments, effects, n)]
    possible = [b for b in tried if b.possible]
    return min(possible or tried, key=lambda b: b.left / balance(experiments, (), b.span).left)


def _by_chance(found: Balance, experiments: Sequence[Experiment]) -> bool:
    """Whether the voltage explains no more of the speed's changes than noise would."""
    unknowns = _unknowns(experiments, found.effects)
    apart = sum(len(e) for e in experiments) / found.span - unknowns  # changes, none in another
    gained = found.without_voltage**2 - found.left**2
    return gained < LEAST_F * found.left**2 / max(apart, 1.0)


def _unknowns(experiments: Sequence[Experiment], effects: Sequence[str]) -> int:
    """Numbers that a balance finds; of a pendulum, each experiment's first angle is its own."""
    turned = "gravity_imbalance" in effects
    return 2 + ("coulomb_friction" in effects) + 2 * turned * len(experiments)


def _enough(experiments: Sequence[Experiment], effects: Sequence[str], span: int) -> bool:
    """Whether there are changes enough that share no sample."""
    needed = SAMPLES_PER_UNKNOWN * _unknowns(experiments, effects)
    return sum(len(e) // span for e in experiments) >= needed


def check_balanced(names: Sequence[str]) -> None:
    """Refuse (OptionError) effects that no balance knows."""
    for name in names:
        if name not in KINDS:
            raise OptionError("--effects", did_you_mean(name, KINDS), repr(name))


def balanced_start(
    found: Balance, name: str, experiments: Sequence[Experiment], limits: tuple[float, float]
) -> Machine:
    """An equivalent motor with the effects that act on it, from where a fit in free run begins.

    By convention R = 1 Ohm and b = 0: only ratios of torques mean something. What the balance has
    estimated has a deviation, so that `ldt calibrate` fits it.

    Raises:
        LdtError: the speed does not rise with the voltage, or an effect would have to drive it.
    """
    if found.gain <= 0:
        raise LdtError("the recording shows no such machine: its speed falls as the voltage rises")
    if not found.possible:
        idle = listed(KINDS[n] for n, given in found.amounts.items() if not given["torque"] > 0)
        raise LdtError(
            f"the recording shows no {idle}, which would have to drive the machine: leave it out "
            "of --effects"
        )
    damping = max(found.damping, 1e-3 * found.gain)
    constant = damping / found.gain
    inertia = constant / (found.gain * RESISTANCE)
    period = experiments[0].period
    known = {"R": RESISTANCE, "L": ELECTRIC[0] * RESISTANCE * period, "b": 0.0}
    values = {"J": rounded(inertia), "K_t": rounded(constant), **known}
    machine = Machine(
        name=name,
        physics="dc_motor",
        parameters=values,
        voltage_limits=limits,
        duration=max(len(e) for e in experiments) * period,
        sample_period=period,
        deviations={n: LOOSE * values[n] for n in ("J", "K_t")},
    )
    acting: list[tuple[Effect, dict[str, float]]] = []
    for effect_name, given in found.amounts.items():
        effect = get_effect(effect_name)
        torques = {n: v * inertia if n == "torque" else v for n, v in given.items()}
        acting.append((effect, effect.check({n: rounded(v) for n, v in torques.items()})))
    whole = machine.with_effects(acting)
    tried = [
        whole.with_parameters(L=rounded(float(share) * RESISTANCE * period)) for share in ELECTRIC
    ]
    whole = min(tried, key=lambda m: free_run_error(m, experiments).rmse)
    torques = {n: LOOSE * value for n, value in whole.parameters.items() if n.endswith(".torque")}
    return whole.with_deviations({**torques, "L": UNSEEN * whole.parameters["L"]})


def _mean(x: Array) -> Array:
    """(L - 1,) between two samples each."""
    return 0.5 * (x[1:] + x[:-1])
