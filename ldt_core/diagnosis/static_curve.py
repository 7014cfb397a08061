"""How well the machine file with one free curve follows a machine: a law of one quantity, unnamed.

Each effect of a set has few parameters, and a set of two or three imitates many a law that the
library lacks. A curve of the voltage at the terminals has as much freedom as any supply, and none
besides. Where it follows experiments that it was not fitted to far better than a set does, the
machine has such a law, and the set is not its cause. Unless such a curve beside the set follows as
well, and is small: then the set's own law is only off, and its name is right.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.signal import lfilter

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment
from ldt_core.diagnosis.effect_fit import EffectFit
from ldt_core.diagnosis.holdout import free_run
from ldt_core.diagnosis.thresholds import THRESHOLDS
from ldt_core.diagnosis.torque_curve import BLOCK, KNOTS, hats, likeliest
from ldt_core.estimation.linear.state_space import discretise
from ldt_core.machine.machine_file import Machine

VOLTS = "the machine file with another voltage at the terminals for each"
#: What a curve may depend on, and how it is told.
CURVES = {
    "voltage": f"{VOLTS} voltage",
    "current": f"{VOLTS} current",
    "speed": "the machine file with another torque for each speed",
    "sensor": "the machine file with a sensor that is off by another amount at each speed",
}


@dataclass(eq=False)
class StaticCurve:
    """A voltage, a torque or a sensor's error that depends on one quantity alone, in any way.

    Args:
        of: one of `CURVES`.
        fitted, held: experiments that it is fitted to, and those that it is judged on.
    """

    machine: Machine
    of: str
    fitted: Sequence[Experiment]
    held: Sequence[Experiment]

    def __post_init__(self) -> None:
        a, b, *_ = self.machine.model.state_space(self.machine.parameters)
        self._a, self._volts = a, b[:, 0]
        quantities = [self._quantity(e) for e in self.fitted]
        low, high = min(map(np.min, quantities)), max(map(np.max, quantities))
        self._knots = np.linspace(low, high, KNOTS)
        self._gram = np.zeros((KNOTS, KNOTS))
        for e in self.fitted:
            for _, moved in self._responses(e):
                self._gram += moved.T @ moved

    def left(self, fitted: Sequence[Array], held: Sequence[Array]) -> float:
        """Mean square of what it leaves of (L,) speeds in each experiment held out [rad^2/s^2].

        Args:
            fitted: (L,) speeds to follow in each experiment that it is fitted to [rad/s].
        """
        along = np.zeros(KNOTS)
        for e, speed in zip(self.fitted, fitted, strict=True):
            for part, moved in self._responses(e):
                along += moved.T @ speed[part]
        power = sum(float(s @ s) for s in fitted)
        weights, *_ = likeliest(self._gram, along, power, sum(map(len, fitted)))
        total = 0.0
        for e, speed in zip(self.held, held, strict=True):
            for part, moved in self._responses(e):
                total += float(np.sum((speed[part] - moved @ weights) ** 2))
        return total / sum(map(len, held))

    def _quantity(self, e: Experiment) -> Array:
        """(L,) what it depends on."""
        if self.of == "sensor":
            return free_run(self.machine, e)
        if self.of != "current":
            return np.asarray(e.voltage if self.of == "voltage" else e.speed)
        if e.current is not None:
            return np.asarray(e.current)
        # The voltage and the measured speed drive it: L i' = V - R i - K_t omega.
        (loss, emf), gain = self._a[0], self._volts[0]
        keep, push = discretise(np.array([[loss]]), np.array([1.0]), e.period)
        drive = gain * np.asarray(e.voltage) + emf * np.asarray(e.speed)
        return np.asarray(lfilter([0.0, push[0]], [1.0, -keep[0, 0]], drive))

    def _responses(self, e: Experiment) -> Iterator[tuple[slice, Array]]:
        """Parts of an experiment, and the (n, K) speed there by each knot alone."""
        if self.of == "sensor":
            shown = self._quantity(e)
            for begin in range(0, len(shown), BLOCK):
                part = slice(begin, begin + BLOCK)
                yield part, hats(shown[part], self._knots)
            return
        into = np.array([0.0, 1.0]) if self.of == "speed" else self._volts
        (keep, push), quantity = discretise(self._a, into, e.period), self._quantity(e)
        # Speed by input of current and speed, as a filter in the samples.
        above = [0.0, push[1], keep[1, 0] * push[0] - keep[0, 0] * push[1]]
        below = [1.0, -np.trace(keep), np.linalg.det(keep)]
        state = np.zeros((2, KNOTS))
        for begin in range(0, len(quantity), BLOCK):
            part = slice(begin, begin + BLOCK)
            moved, state = lfilter(above, below, hats(quantity[part], self._knots), 0, state)
            yield part, np.asarray(moved)


@dataclass(eq=False)
class FreeCurves:
    """All curves, asked about one set after the other; what no set changes is computed once.

    Args:
        fitted, held: experiments that sets are fitted to, and those that they are judged on.
        before: (L,) free runs of the latter without any set [rad/s].
    """

    machine: Machine
    fitted: Sequence[Experiment]
    held: Sequence[Experiment]
    before: list[Array]
    _known: dict[str, tuple[StaticCurve, float]] = field(default_factory=dict)

    def instead(self, best: EffectFit, after: Sequence[Array], noise: float) -> str:
        """Which curve leaves so much less than a set that this is not the cause; "" for none.

        Both are judged on the same samples, whose noise then takes no part in how they differ.

        Args:
            best: the set.
            after: (L,) free runs of the held-out experiments with it [rad/s].
            noise: deviation of the sensor's there [rad/s].
        """
        runs = [free_run(self.machine, e, best.use) for e in self.fitted]
        beside = _errors(self.fitted, runs), _errors(self.held, after)
        if not all(np.isfinite(np.concatenate(part)).all() for part in (*self._alone, *beside)):
            return ""
        power = _power(beside[1])
        acts = _power([now - was for now, was in zip(after, self.before, strict=True)])
        # By so much the right law may be off, or noise favour a curve.
        chance = THRESHOLDS.visible_change * noise**2 / sum(map(len, self.held))
        least = max(THRESHOLDS.law_error**2 * acts, chance)

        for of, told in CURVES.items():
            try:
                curve, left = self._curve(of)
            except LdtError:  # a motor that no linear model samples
                return ""
            rest = max(left - noise**2, 0.0)
            if power - left <= max(least, (THRESHOLDS.behind_reference - 1) * rest):
                continue
            # Beside the set, a curve is what the set's own law is off by; that may be a little, and
            # then it takes away most of what the set leaves.
            gain = power - curve.left(*beside)
            most = THRESHOLDS.further_effect_of_remainder * (power - noise**2)
            if not most < gain <= THRESHOLDS.departure_of_law * acts:
                return f"{told} leaves {left**0.5:.3g}"
        return ""

    @functools.cached_property
    def _alone(self) -> tuple[list[Array], list[Array]]:
        """Errors without any set, fitted and held out."""
        runs = [free_run(self.machine, e) for e in self.fitted]
        return _errors(self.fitted, runs), _errors(self.held, self.before)

    def _curve(self, of: str) -> tuple[StaticCurve, float]:
        """A curve, and the mean square that it leaves without any set."""
        if of not in self._known:
            curve = StaticCurve(self.machine, of, self.fitted, self.held)
            self._known[of] = curve, curve.left(*self._alone)
        return self._known[of]


def _errors(experiments: Sequence[Experiment], runs: Sequence[Array]) -> list[Array]:
    return [e.speed - run for e, run in zip(experiments, runs, strict=True)]


def _power(runs: Sequence[Array]) -> float:
    return float(np.mean(np.concatenate(runs) ** 2))
