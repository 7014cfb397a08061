"""How often a turn a residual goes up and down, of a ripple that any number of teeth may cause.

A ripple acts at its order only, so a search that begins at another one never gets there. What a
torque at an order does to the speed is what the motor lets through of it: the residual is filtered
by the motor once, backwards (a matched filter), and then held against each order's wave over the
angle that the measured speed has turned through.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.diagnosis.candidate import Candidate
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.simulated_experiments import StartStates
from ldt_core.diagnosis.thresholds import THRESHOLDS
from ldt_core.physics.integrate import answered

ORDER = "periods"  # name of the parameter that is one
HIGHEST = 100  # order that is looked at: more teeth than a motor has
#: Of the samples, in which the shaft was slow enough to show an order. What is left near standstill
#: has many shapes: with a tenth, the double of an order came before it.
LEAST_SHOWN = 0.25
FOLLOWED = 3  # of the strongest orders: a law of the angle leaves some at its multiples
QUARTERS = 4  # of a turn, by which the phases differ that it begins with


class Ripple(NamedTuple):
    """A torque -T sin(n theta + phi): n, T [N m], phi [rad]."""

    order: int
    torque: float
    phase: float


def ripple_orders(residuals: FreeRunResiduals, rest: Array, starts: StartStates) -> list[Ripple]:
    """Whole orders at which these (size,) residuals go up and down, the strongest first.

    The torques that they are take the speed for what it is, so where a ripple holds the shaft they
    are no more than a beginning.
    """
    orders = np.arange(1, HIGHEST + 1)
    gain, wave = np.zeros(orders.size), np.zeros(orders.size, dtype=np.complex128)
    through, shown, samples = np.zeros(orders.size), np.zeros(orders.size), 0
    for i, piece in enumerate(residuals.pieces):
        e = piece.experiment
        kept = math.exp(-e.period / residuals.memory)
        speed = rest[piece.rows][: len(e)]
        backward = np.ascontiguousarray(speed[::-1, None])
        pushed = answered(backward, kept, 1.0, np.zeros(1))[::-1, 0]
        between = 0.5 * (e.speed[1:] + e.speed[:-1])
        angle = starts.angles[i] + np.concatenate([[0.0], np.cumsum(between)]) * e.period
        turned = np.abs(np.concatenate([between, e.speed[-1:]])) * e.period
        turn = (1.0 - kept) * residuals.memory / residuals.values["J"] / residuals.noise[0]
        for k, order in enumerate(orders):
            seen = order * turned < math.pi  # quicker than the samples, it cannot be followed
            found = complex(pushed[seen] @ np.exp(-1j * order * angle[seen]))
            passed = 1.0 / np.abs(1.0 - kept * np.exp(-1j * order * turned[seen])) ** 2
            shown[k] += np.count_nonzero(seen)
            power = float(passed.sum())
            gain[k] += 2.0 * abs(found) ** 2 / max(power, 1.0)
            wave[k] += turn * found
            through[k] += turn**2 * power
        samples += len(e)
    gain[shown < LEAST_SHOWN * samples] = 0.0
    # A shaft too heavy for any torque to move, as far as floating point goes, has no ripple.
    gain[through == 0] = 0.0
    loud = [k for k in np.argsort(-gain) if gain[k] > THRESHOLDS.chance_gain]
    # A torque -T sin(n theta + phi) is T cos(n theta + phi + pi / 2).
    return [
        Ripple(
            int(orders[k]),
            2.0 * float(abs(wave[k])) / float(through[k]),
            float(np.angle(wave[k])) - math.pi / 2,
        )
        for k in loud
    ]


def begun_at(
    candidate: Candidate, ripples: Sequence[Ripple], but: Collection[float] = ()
) -> list[Array]:
    """Coordinates of a law of the angle at the strongest, but for these orders; [] of another."""
    angles = [p for p in candidate.parameters if p.cyclic]
    if ORDER not in candidate.effect.neutral or not angles:
        return []
    (angle, *_), found = angles, []
    for ripple in (r for r in ripples[:FOLLOWED] if r.order not in but):
        for quarter in range(QUARTERS):
            phase = ripple.phase + quarter * 2 * math.pi / QUARTERS
            given = {
                candidate.parameters[0].name: ripple.torque,
                ORDER: float(ripple.order),
                angle.name: (phase + math.pi) % (2 * math.pi) - math.pi,
            }
            found.append(candidate.coordinates(candidate.effect.check(given)))
    return found
