"""Compiled integration: exact recursion for linear machines, Runge-Kutta steps for all others.

One set of equations, the rotor's (see `rotor.py`), serves every machine: a motor alone is a rotor
without unbalance, and skips the foundation. The classical fourth-order Runge-Kutta method runs with
steps of fixed length between the switches of the voltage, so that no step ever crosses one: between
switches the right-hand side is smooth and the order holds. Effects join by `terms.py`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ldt_core.errors import BadInput, LdtError
from ldt_core.physics.terms import evaluate, gather

if TYPE_CHECKING:
    from ldt_core.effects.base import Effect
    from ldt_core.physics.base import Physics

Array = NDArray[np.float64]

MAX_STEP = 0.25e-3  # s; worst relative speed error 5e-6 over 300 random experiments of the rotor
MAX_STEP_RATE = 1.0  # step times fastest rate: RK4 is stable to 2.8, and accurate well below
MAX_STEPS = 2_000_000_000  # of one simulation: some minutes of computing; more is a mistake
STATES = 7


class Constants(NamedTuple):
    """Numbers of the equations, in SI units."""

    torque_constant: float
    friction: float
    resistance: float
    inductance: float
    inertia: float  # J + m e^2 - (m e)^2 / (M + m): what is left after solving for theta''
    unbalance: float  # m e
    mass: float  # M + m
    stiffness_x: float
    stiffness_y: float
    damping_x: float
    damping_y: float
    weight_torque: float  # m g e


@njit(cache=True)
def propagate(ad, bd, volts, initial):  # pragma: no cover - compiled
    """States of x[k+1] = ad x[k] + bd volts[k]: (L, n)."""
    length, n = volts.size, initial.size
    states = np.empty((length, n))
    for i in range(n):
        states[0, i] = initial[i]
    for k in range(length - 1):
        for i in range(n):
            total = bd[i] * volts[k]
            for j in range(n):
                total += ad[i, j] * states[k, j]
            states[k + 1, i] = total
    return states


@njit(cache=True)
def _rates(y, torque, volts, c, rigid):  # pragma: no cover - compiled
    theta, omega, current, x, vx, z, vz = y
    shaft = c.torque_constant * current - c.friction * omega + torque
    di = (volts - c.resistance * current - c.torque_constant * omega) / c.inductance
    if rigid:
        return omega, shaft / c.inertia, di, 0.0, 0.0, 0.0, 0.0
    s, o = math.sin(theta), math.cos(theta)
    fx = -c.damping_x * vx - c.stiffness_x * x
    fz = -c.damping_y * vz - c.stiffness_y * z
    lever = c.unbalance / c.mass
    alpha = (shaft - c.weight_torque * o + lever * (fx * s - fz * o)) / c.inertia
    spin = omega * omega
    ax = fx / c.mass + lever * (alpha * s + spin * o)
    az = fz / c.mass + lever * (spin * s - alpha * o)
    return omega, alpha, di, vx, ax, vz, az


@njit(cache=True)
def _moved(y, h, k):  # pragma: no cover - compiled
    return (
        y[0] + h * k[0],
        y[1] + h * k[1],
        y[2] + h * k[2],
        y[3] + h * k[3],
        y[4] + h * k[4],
        y[5] + h * k[5],
        y[6] + h * k[6],
    )


@njit(cache=True)
def _mean(a, b, c, d):  # pragma: no cover - compiled
    return (
        (a[0] + 2 * (b[0] + c[0]) + d[0]) / 6,
        (a[1] + 2 * (b[1] + c[1]) + d[1]) / 6,
        (a[2] + 2 * (b[2] + c[2]) + d[2]) / 6,
        (a[3] + 2 * (b[3] + c[3]) + d[3]) / 6,
        (a[4] + 2 * (b[4] + c[4]) + d[4]) / 6,
        (a[5] + 2 * (b[5] + c[5]) + d[5]) / 6,
        (a[6] + 2 * (b[6] + c[6]) + d[6]) / 6,
    )


@njit(cache=True)
def _run(edges, volts, steps, samples, start, c, rigid, states):  # pragma: no cover - compiled
    """Fill `states` (L, 7); return the index of the first sample that is not finite, or -1."""
    y = (start[0], start[1], start[2], start[3], start[4], start[5], start[6])
    for k in range(volts.size):
        v = volts[k]
        h = (edges[k + 1] - edges[k]) / steps[k]
        for _ in range(steps[k]):
            k1 = _rates(y, 0.0, v, c, rigid)
            k2 = _rates(_moved(y, h / 2, k1), 0.0, v, c, rigid)
            k3 = _rates(_moved(y, h / 2, k2), 0.0, v, c, rigid)
            k4 = _rates(_moved(y, h, k3), 0.0, v, c, rigid)
            y = _moved(y, h, _mean(k1, k2, k3, k4))
        at = samples[k + 1]
        if at >= 0:
            for i in range(7):
                states[at, i] = y[i]
            if not math.isfinite(y[0] + y[1] + y[2] + y[3] + y[4] + y[5] + y[6]):
                return at
    return -1


@njit(cache=True)
def _run_with_terms(
    edges, volts, steps, samples, start, c, rigid, states, terms
):  # pragma: no cover - compiled
    """As `_run`, with effects: their states are in columns 7 on of `states`, and in `start`."""
    y = (start[0], start[1], start[2], start[3], start[4], start[5], start[6])
    z = start[7:].copy()
    moved = z.copy()
    d1, d2, d3, d4 = z.copy(), z.copy(), z.copy(), z.copy()
    for k in range(volts.size):
        v = volts[k]
        h = (edges[k + 1] - edges[k]) / steps[k]
        for step in range(steps[k]):
            t = edges[k] + step * h
            torque, u = evaluate(terms, t, y, v, z, d1)
            k1 = _rates(y, torque, u, c, rigid)
            w = _moved(y, h / 2, k1)
            for i in range(z.size):
                moved[i] = z[i] + h / 2 * d1[i]
            torque, u = evaluate(terms, t + h / 2, w, v, moved, d2)
            k2 = _rates(w, torque, u, c, rigid)
            w = _moved(y, h / 2, k2)
            for i in range(z.size):
                moved[i] = z[i] + h / 2 * d2[i]
            torque, u = evaluate(terms, t + h / 2, w, v, moved, d3)
            k3 = _rates(w, torque, u, c, rigid)
            w = _moved(y, h, k3)
            for i in range(z.size):
                moved[i] = z[i] + h * d3[i]
            torque, u = evaluate(terms, t + h, w, v, moved, d4)
            k4 = _rates(w, torque, u, c, rigid)
            y = _moved(y, h, _mean(k1, k2, k3, k4))
            for i in range(z.size):
                z[i] += h * (d1[i] + 2 * (d2[i] + d3[i]) + d4[i]) / 6
        at = samples[k + 1]
        if at >= 0:
            for i in range(7):
                states[at, i] = y[i]
            for i in range(z.size):
                states[at, 7 + i] = z[i]
            total = y[0] + y[1] + y[2] + y[3] + y[4] + y[5] + y[6] + z.sum()
            if not math.isfinite(total):
                return at
    return -1


def integrate(
    physics: Physics,
    values: Mapping[str, float],
    times: Array,
    switches: tuple[Array, Array],
    initial: Array,
    terms: Sequence[tuple[Effect, Mapping[str, float]]] = (),
    max_step: float = MAX_STEP,
) -> Array:
    """States at the sample times by Runge-Kutta steps aligned with the voltage switches.

    Args:
        physics: whose constants and rates to take.
        values: the machine's parameters, effects on them included.
        times: (L,) sample times from 0 [s].
        switches: (S,) increasing times [s], the first at most 0 (-inf for a level that held before
            the experiment), and (S,) levels [V]: each level holds from its time to the next.
        initial: (n,) state at time 0, effects' states behind it or left out (then 0).
        terms: effects with a torque or terminal term.
        max_step: longest step [s]; made shorter for a stiffer machine.

    Returns:
        (L, n) states, effects' states in further columns.

    Raises:
        BadInput: so stiff that it would take more than MAX_STEPS steps.
        LdtError: the state grows without bound.
    """
    at, levels = switches
    c = physics.constants(values)
    rate = physics.rate(values, float(np.abs(levels).max()))
    for effect, given in terms:
        rate = max(rate, effect.rate(values, float(np.abs(levels).max()), given))
    step = min(max_step, MAX_STEP_RATE / rate)
    if times[-1] / step > MAX_STEPS:
        raise BadInput(
            "machine parameters",
            f"a fastest rate of at most {MAX_STEPS / times[-1]:.3g} 1/s (R/L, for instance)",
            f"{rate:.3g} 1/s, which takes steps of {step:.3g} s",
        )
    edges, volts, samples = _edges(times, at, levels)
    steps = np.maximum(1, np.ceil(np.diff(edges) / step - 1e-9)).astype(np.int64)
    n = len(physics.states)
    own = [s for effect, given in terms for s in effect.first_states(initial, given)]
    if initial.size > n:
        own = initial[n:]
    start = np.zeros(STATES + len(own))
    start[:n], start[STATES:] = initial[:n], own
    rigid = bool(c.unbalance == 0 and not start[3:STATES].any())
    states = np.empty((times.size, STATES + len(own)))
    states[0] = start
    if terms:
        compiled = gather(terms, values)
        failed = _run_with_terms(edges, volts, steps, samples, start, c, rigid, states, compiled)
    else:
        failed = _run(edges, volts, steps, samples, start, c, rigid, states)
    if failed >= 0:
        raise LdtError(
            f"the simulation of {physics.name} diverged: its state is not finite "
            f"{times[failed]:g} s after the start"
        )
    return np.concatenate([states[:, :n], states[:, STATES:]], axis=1)


def _edges(times: Array, at: Array, levels: Array) -> tuple[Array, Array, NDArray[np.int64]]:
    """Edges of the intervals of constant voltage, their levels, the sample at each edge or -1."""
    inside = at[(at > 0) & (at < times[-1])]
    edges = np.union1d(times, inside)
    volts = levels[np.searchsorted(at, edges[:-1], side="right") - 1]
    samples = np.full(edges.size, -1, dtype=np.int64)
    samples[np.searchsorted(edges, times)] = np.arange(times.size)
    return edges, np.ascontiguousarray(volts, dtype=np.float64), samples
