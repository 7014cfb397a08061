"""The linear model against subspace identification by others: time, and fit in free run.

Same records for all: a simulated motor, 2000 samples, second order, unknown start state. The fit is
that of another experiment without noise, in free run from rest. The peers know no offset, so the
records have none, which ours still estimates. They are no dependencies of LDT: a peer that cannot
be imported has no row.

pip install sippy-unipi nfoursid
"""

from __future__ import annotations

import importlib
from collections.abc import Callable

import numpy as np

from ldt_core.base.experiment import Experiment
from ldt_core.estimation.linear import StateSpace, identify
from tests.benchmarks.row import Row, best_of

PERIOD, SAMPLES, HOLD = 0.01, 2000, 50
RECORDS = 15  # of each noise; the median fit is given
REPEATS = 7
NOISES = {"1 % white": (0.01, 0.0), "10 % coloured": (0.1, 0.8)}
BLOCK_ROWS = 20  # of the peers: sippy's own default, and what serves nfoursid best here
MOTOR = StateSpace([[-50.0, -15.0], [15.0, -0.5]], [50.0, 0.0], [0.0, 1.0])

Discrete = tuple[np.ndarray, np.ndarray, np.ndarray]
Peer = Callable[[np.ndarray, np.ndarray], Discrete]


def record(seed: int, level: float, colour: float) -> Experiment:
    """A motor experiment from an unknown state; noise AR(1), relative to the speed's deviation."""
    rng = np.random.default_rng(seed)
    voltage = np.repeat(rng.uniform(6, 16, SAMPLES // HOLD), HOLD)
    noise = rng.normal(size=SAMPLES)
    for k in range(1, SAMPLES):
        noise[k] = colour * noise[k - 1] + np.sqrt(1 - colour**2) * noise[k]
    start = rng.normal(size=2) * [3, 9] if level else np.zeros(2)
    speed = MOTOR.simulate(voltage, PERIOD, start)
    return Experiment(seed + 1, 0.0, PERIOD, voltage, speed + level * speed.std() * noise)


def fit_percent(measured: np.ndarray, run: np.ndarray) -> float:
    """As MATLAB's compare."""
    return 100 * (1 - np.linalg.norm(measured - run) / np.linalg.norm(measured - measured.mean()))


def our_fit(e: Experiment, other: Experiment) -> float:
    """Ours on another experiment."""
    found = identify([e], 2)
    return fit_percent(
        other.speed, found.simulate(other.voltage, PERIOD, found.equilibrium(other.speed[0]))
    )


def their_fit(peer: Peer, e: Experiment, other: Experiment) -> float:
    """A peer's discrete model on another experiment, from rest."""
    A, B, C = peer(e.voltage, e.speed)
    state = np.zeros(len(A))
    run = np.empty(SAMPLES)
    for k in range(SAMPLES):
        run[k] = C @ state
        state = A @ state + B * other.voltage[k]
    return fit_percent(other.speed, run)


def sippy(method: str) -> Peer | None:
    """sippy-unipi by that method, order 2."""
    try:
        identification = importlib.import_module("sippy_unipi").system_identification
    except ImportError:
        return None

    def work(u: np.ndarray, y: np.ndarray) -> Discrete:
        m = identification(
            y[None],
            u[None],
            method,
            SS_fixed_order=2,
            SS_f=BLOCK_ROWS,
            SS_p=BLOCK_ROWS,
        )
        return np.asarray(m.A), np.ravel(m.B), np.ravel(m.C)

    return work


def nfoursid() -> Peer | None:
    """nfoursid, order 2."""
    try:
        solver = importlib.import_module("nfoursid.nfoursid").NFourSID
        frame = importlib.import_module("pandas").DataFrame
    except ImportError:
        return None

    def work(u: np.ndarray, y: np.ndarray) -> Discrete:
        n = solver(frame({"u": u, "y": y}), ["y"], ["u"], num_block_rows=BLOCK_ROWS)
        n.subspace_identification()
        m, _ = n.system_identification(rank=2)
        return np.asarray(m.a), np.ravel(m.b), np.ravel(m.c)

    return work


def run() -> list[Row]:
    """One row for each peer that is installed."""
    peers = {
        "sippy-unipi N4SID": sippy("N4SID"),
        "sippy-unipi PARSIM-K": sippy("PARSIM-K"),
        "nfoursid": nfoursid(),
    }
    peers = {name: peer for name, peer in peers.items() if peer is not None}
    if not peers:
        return []
    other = record(1000, 0.0, 0.0)
    records = {name: [record(s, *how) for s in range(RECORDS)] for name, how in NOISES.items()}
    ours = [np.median([our_fit(e, other) for e in es]) for es in records.values()]
    first = records["1 % white"][0]
    ours_s = best_of(REPEATS, lambda: identify([first], 2))
    rows = []
    for name, peer in peers.items():
        theirs = [np.median([their_fit(peer, e, other) for e in es]) for es in records.values()]
        peer_s = best_of(REPEATS, lambda peer=peer: peer(first.voltage, first.speed))
        fits = "; ".join(
            f"{noise} {a:.2f} %, peer {b:.2f} %"
            for noise, a, b in zip(NOISES, ours, theirs, strict=True)
        )
        note = f"{SAMPLES} samples, order 2; fit on other data under {fits}"
        rows.append(Row("identification, linear", ours_s, name, peer_s, "1×", note))
    return rows
