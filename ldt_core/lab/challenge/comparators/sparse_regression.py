"""Sparse regression on the residual torque, as the discrepancy models of the SINDy family do.

Kaheman, Kaiser, Strom, Kutz, Brunton, Learning discrepancy models from experimental data (2019);
the regression is PySINDy's sequentially thresholded least squares. Each term stands for the effect
whose law it is, or is nearest to.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.holdout import free_run
from ldt_core.diagnosis.residual_torque import TorqueEstimator, residual_torque
from ldt_core.lab.challenge.comparators.compare import ComparatorAnswer, Data
from ldt_core.lab.challenge.comparators.selection import block_errors, improves
from ldt_core.machine.machine_file import Machine
from ldt_core.models.hybrid import HybridModel
from ldt_core.physics.motor_rates import memory

Signals = Mapping[str, Array]

SIGN_SPEED = 0.5  # rad/s, over which a sign turns
SIGN_CURRENT = 0.05  # A, likewise
STRIBECK_SPEED = 5.0  # rad/s, below which friction rises towards rest
LIMIT_SHARE = 0.75  # of the largest voltage, beyond which a drive may be at its end
THRESHOLDS = tuple(float(t) for t in np.geomspace(0.02, 0.6, 12))  # of the torque's deviation
RIDGE = 1e-6
FOLDS = 4
DIVERGED_SPEED = 500.0  # rad/s; a prediction that is faster has diverged


@dataclass(frozen=True)
class Term:
    """A column of the regression.

    Attributes:
        effect: that it stands for.
        sign: of its coefficient if physics allows only one; 0 for either.
        of: signals to (L,) values.
    """

    effect: str
    sign: int
    of: Callable[[Signals], Array]


def _sign(w: Array) -> Array:
    return np.tanh(w / SIGN_SPEED)


TERMS = (
    Term("coulomb_friction", -1, lambda s: _sign(s["w"])),
    Term(
        "stribeck_friction", -1, lambda s: _sign(s["w"]) * np.exp(-((s["w"] / STRIBECK_SPEED) ** 2))
    ),
    Term("load_friction", -1, lambda s: _sign(s["w"]) * np.abs(s["i"])),
    Term("viscous_friction", 0, lambda s: s["w"]),
    Term("quadratic_drag", -1, lambda s: s["w"] * np.abs(s["w"])),
    Term("constant_load", -1, lambda s: np.ones_like(s["w"])),
    Term("inertia", 0, lambda s: s["dw"]),
    Term("armature_resistance", 0, lambda s: s["i"]),
    Term("brush_drop", -1, lambda s: np.tanh(s["i"] / SIGN_CURRENT)),
    Term("motor_constant", 0, lambda s: s["V"]),
    Term("voltage_saturation", -1, lambda s: _beyond(s["V"], LIMIT_SHARE * s["most"])),
    Term("input_delay", 0, lambda s: s["dV"]),
    Term("gravity_imbalance", 0, lambda s: np.cos(s["a"])),
    Term("gravity_imbalance", 0, lambda s: np.sin(s["a"])),
    Term("unbalance", 0, lambda s: s["w"] ** 2 * np.sin(2 * s["a"])),
)


def _beyond(volts: Array, limit: Array) -> Array:
    return np.asarray(np.sign(volts) * np.maximum(np.abs(volts) - limit, 0.0))


def sparse_regression(data: Data) -> ComparatorAnswer:
    """Terms of the residual torque; the sparsest threshold within one error of the best.

    Terms of measured signals share their noise with the torque, those of simulated ones are wrong
    by the gap: both are tried, and taken is what predicts the held-out experiments better, if it
    does so better than no term at all.

    Raises:
        LdtError: PySINDy is not installed.
    """
    if not installed():
        raise LdtError("sparse regression needs PySINDy: pip install 'ldt[challenge]'")
    torque = residual_torque(FreeRunResiduals(data.machine, data.fitted)).torque
    edges = np.cumsum([len(e) for e in data.fitted])[:-1]
    allowed = {e.name for e in data.effects}
    terms = [t for t in TERMS if t.effect in allowed]
    chosen, error = ComparatorAnswer((), None, {}), None
    nothing = block_errors(data.held, lambda e: free_run(data.machine, e))
    for simulated in (False, True):
        signals = [_signals(data.machine, e, simulated) for e in data.fitted]
        columns = [np.column_stack([t.of(s) for t in terms]) for s in signals]
        known = _select(terms, columns, np.split(torque, edges))
        used = [(terms[j], float(known[j])) for j in np.flatnonzero(known)]
        if not used:
            continue
        model = _Added(data.machine, used)
        errors = block_errors(data.held, model.predict)
        if improves(nothing, errors) and (error is None or errors.sum() < error):
            names = tuple(dict.fromkeys(term.effect for term, _ in used))
            chosen, error = ComparatorAnswer(names, model.predict, {}), errors.sum()
    return chosen


def installed() -> bool:
    """Whether PySINDy is there."""
    try:
        import pysindy  # noqa: F401
    except ImportError:
        return False
    return True


def _signals(machine: Machine, e: Experiment, simulated: bool) -> dict[str, Array]:
    """What terms are made of, measured or by the machine file's free run.

    The current is that of the motor in slow motion where it is not recorded.
    """
    v = machine.parameters
    turn = TorqueEstimator(v["J"], memory(v), e.period, len(e))
    speed = np.nan_to_num(free_run(machine, e)) if simulated else e.speed
    w, volts = turn.smooth(speed), np.asarray(e.voltage)
    current = (volts - v["K_t"] * w) / v["R"] if e.current is None else turn.smooth(e.current)
    return {
        "w": w,
        "dw": turn.smooth(speed, 1),
        "V": volts,
        "dV": np.gradient(turn.smooth(volts), e.period),
        "i": np.asarray(current),
        "a": np.concatenate([[0.0], np.cumsum(0.5 * (w[1:] + w[:-1])) * e.period]),
        "most": np.full(len(e), float(np.abs(volts).max())),
    }


def _select(terms: Sequence[Term], columns: Sequence[Array], torque: Sequence[Array]) -> Array:
    """(terms,) coefficients of the sparsest fit that is within one standard error of the best."""
    folds = [list(range(k, len(torque), FOLDS)) for k in range(min(FOLDS, len(torque)))]
    errors = np.empty((len(THRESHOLDS) + 1, len(folds)))
    for k, held in enumerate(folds):
        rest = [i for i in range(len(torque)) if i not in held] or held
        x, y = (np.concatenate([part[i] for i in rest]) for part in (columns, torque))
        against = np.concatenate([columns[i] for i in held])
        true = np.concatenate([torque[i] for i in held])
        errors[-1, k] = np.mean(true**2)
        for j, threshold in enumerate(THRESHOLDS):
            errors[j, k] = np.mean((true - against @ _sparse(terms, x, y, threshold)) ** 2)
    mean = errors.mean(axis=1)
    best = int(np.argmin(mean))
    spread = errors[best].std(ddof=1) / math.sqrt(len(folds)) if len(folds) > 1 else 0.0
    sparsest = int(np.flatnonzero(mean <= mean[best] + spread)[-1])
    if sparsest == len(THRESHOLDS):
        return np.zeros(len(terms))
    return _sparse(terms, np.concatenate(columns), np.concatenate(torque), THRESHOLDS[sparsest])


def _sparse(terms: Sequence[Term], x: Array, y: Array, threshold: float) -> Array:
    """(terms,) coefficients, those of a sign that physics forbids taken out in turn."""
    from pysindy import STLSQ

    scale = np.linalg.norm(x, axis=0) / math.sqrt(len(x))
    size = float(np.std(y)) or 1.0
    found = np.zeros(len(terms))
    use = np.flatnonzero(scale > 1e-9)
    while use.size:
        solver = STLSQ(threshold=threshold, alpha=RIDGE)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that no term is left is an answer
            solver.fit(x[:, use] / scale[use], y / size)
        solved = np.asarray(solver.coef_).ravel()
        wrong = [k for k, j in enumerate(use.tolist()) if terms[j].sign * solved[k] < 0]
        if not wrong:
            found[use] = solved * size / scale[use]
            break
        worst = max(wrong, key=lambda k: abs(solved[k]))
        use = np.delete(use, worst)
    return found


class _Added:
    """A free run of the motor with the terms' torque, held over each sample."""

    def __init__(self, machine: Machine, torque: Sequence[tuple[Term, float]]) -> None:
        self.machine, self.torque = machine, torque

    def predict(self, e: Experiment) -> Array:
        """(L,) speed [rad/s]; nan behind the moment at which it diverges."""
        motor = HybridModel(self.machine)
        ad, bd, gd = motor.motor(e.period)
        gd = gd / self.machine.parameters["J"]
        volts = np.asarray(e.voltage)
        slope = np.gradient(volts, e.period)
        most = np.array([float(np.abs(volts).max())])
        state, angle, acceleration = motor.start(e), 0.0, 0.0
        speed = np.full(len(e), np.nan)
        for k in range(len(e)):
            speed[k] = state[1]
            if not abs(state[1]) < DIVERGED_SPEED:
                break
            w, i = state[1:], state[:1]
            now = {"w": w, "dw": np.array([acceleration]), "V": volts[k : k + 1], "i": i}
            now |= {"dV": slope[k : k + 1], "a": np.array([angle]), "most": most}
            force = sum(c * float(term.of(now)[0]) for term, c in self.torque)
            moved = ad @ state + bd * volts[k] + gd * force
            acceleration = (moved[1] - state[1]) / e.period
            angle += 0.5 * (moved[1] + state[1]) * e.period
            state = moved
        return speed
