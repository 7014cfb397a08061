"""One experiment of the rotor against `scipy.integrate.solve_ivp` at equal accuracy.

The same experiment (20 s, 100 Hz, a new level each second, e = 8.336 mm) with the same equations.
solve_ivp is called once for each held level, as it should be, and gets its best method and the
tolerance at which it is just not more accurate than we are, found by trying. Errors are the largest
speed error at the samples against our integrator with a sixteenth of its step.
"""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable

import numpy as np
from numba import njit
from scipy.integrate import odeint, solve_ivp

from ldt_core.machine.machine_file import load_machine
from ldt_core.physics.base import MAX_STEP
from tests.benchmarks.row import Row, best_of

SECONDS, RATE = 20, 100
METHODS = ("DOP853", "LSODA")  # RK45, RK23, BDF and Radau take longer at this accuracy
TOLERANCES = 10.0 ** -np.arange(6, 13, 0.5)
REPEATS = 30  # ours takes milliseconds, and other work on the machine must not hide that


def _equations(values: dict[str, float]) -> Callable[..., list[float]]:
    """The rotor's right-hand side in plain Python floats, as one would write it for solve_ivp."""
    m, mass, e, j = values["m"], values["M"] + values["m"], values["e"], values["J"]
    kx, ky, rx, ry = (values[n] for n in ("K_x", "K_y", "R_x", "R_y"))
    k, r, inductance, b = (values[n] for n in ("K_t", "R", "L", "b"))
    inertia = j + m * e**2 - (m * e) ** 2 / mass
    sin, cos = math.sin, math.cos

    def rates(_t, state, volts):
        theta, omega, current, x, vx, y, vy = state
        s, c = sin(theta), cos(theta)
        fx, fy = -rx * vx - kx * x, -ry * vy - ky * y
        alpha = (k * current - b * omega + m * e / mass * (fx * s - fy * c)) / inertia
        ax = (fx + m * e * (alpha * s + omega * omega * c)) / mass
        ay = (fy + m * e * (omega * omega * s - alpha * c)) / mass
        return [omega, alpha, (volts - r * current - k * omega) / inductance, vx, ax, vy, ay]

    return rates


def _solve(rates, levels, method: str, tolerance: float, lists: bool) -> np.ndarray:
    state, speed = np.zeros(7), []
    time = np.arange(RATE + 1) / RATE
    for level in levels:
        arguments = (level,)
        wrapped = (lambda t, y, v: rates(t, y.tolist(), v)) if lists else rates
        solution = solve_ivp(
            wrapped,
            (0, 1),
            state,
            method,
            time,
            args=arguments,
            rtol=tolerance,
            atol=tolerance * 1e-2,
        )
        speed.append(solution.y[1, :-1])
        state = solution.y[:, -1]
    return np.concatenate(speed)


def _odeint(rates, levels, tolerance: float) -> np.ndarray:
    """The same by the older of scipy's solvers, which calls a compiled function at once."""
    state, speed = np.zeros(7), []
    time = np.arange(RATE + 1) / RATE
    how = {"rtol": tolerance, "atol": tolerance * 1e-2, "tfirst": True, "mxstep": 100_000}
    for level in levels:
        states = odeint(rates, state, time, (level,), **how)
        speed.append(states[:-1, 1])
        state = states[-1]
    return np.concatenate(speed)


def _loosest(rates, levels, truth, ours: float) -> tuple[float, float]:
    """(tolerance, error) of `_odeint` at an accuracy just not above ours."""
    best = TOLERANCES[0], np.inf
    for tolerance in TOLERANCES:
        error = float(np.abs(_odeint(rates, levels, tolerance) - truth).max())
        if error < ours:
            break
        best = tolerance, error
    return best


def _tuned(rates, levels, truth, ours: float) -> tuple[str, float, float]:
    """(method, tolerance, error) of the fastest method at an accuracy just not above ours."""
    found = []
    for method in METHODS:
        for tolerance in TOLERANCES:
            begin = time.perf_counter()
            error = float(np.abs(_solve(rates, levels, method, tolerance, True) - truth).max())
            taken = time.perf_counter() - begin
            if error < ours:
                break
            best = (taken, method, tolerance, error)
        found.append(best)
    return min(found)[1:]


def run() -> list[Row]:
    """Three rows: the right-hand side in Python, and compiled by numba for either solver."""
    machine = load_machine("rotor").with_parameters(e=0.008336)
    physics, values = machine.model, dict(machine.parameters)
    levels = np.random.default_rng(0).uniform(6, 16, SECONDS)
    volts = np.repeat(levels, RATE)
    times = np.arange(volts.size) / RATE
    rest = np.zeros(7)
    truth = physics.integrate(values, times, (times, volts), rest, (), MAX_STEP / 16)[:, 1]

    def ours() -> np.ndarray:
        return physics.simulate(values, volts, 1 / RATE, rest)[:, 1]

    error = float(np.abs(ours() - truth).max())
    ours_s = best_of(REPEATS, ours)
    python = _equations(values)
    compiled = njit(_as_array(python))
    compiled(0.0, rest, 1.0)
    method, tolerance, peer_error = _tuned(python, levels, truth, error)
    rows = []
    for name, rates, lists in (("Python", python, True), ("numba", compiled, False)):
        rows.append(
            Row(
                f"plant, one experiment of {SECONDS} s",
                ours_s,
                f"solve_ivp {method} rtol={tolerance:.0e}, right-hand side in {name}",
                best_of(4, functools.partial(_solve, rates, levels, method, tolerance, lists)),
                "100×" if name == "Python" else "",
                f"largest speed error {error:.1e} rad/s, peer {peer_error:.1e}",
            )
        )
    tolerance, peer_error = _loosest(compiled, levels, truth, error)
    rows.append(
        Row(
            f"plant, one experiment of {SECONDS} s",
            ours_s,
            f"odeint rtol={tolerance:.0e}, right-hand side in numba",
            best_of(REPEATS, functools.partial(_odeint, compiled, levels, tolerance)),
            "",
            f"largest speed error {error:.1e} rad/s, peer {peer_error:.1e}",
        )
    )
    return rows


def _as_array(rates):
    inner = njit(rates)

    def compiled(t, state, volts):
        return np.array(
            inner(t, (state[0], state[1], state[2], state[3], state[4], state[5], state[6]), volts)
        )

    return compiled
