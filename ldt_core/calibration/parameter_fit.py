"""Bounded nonlinear least squares of free runs, with their unknown start states eliminated.

What state the machine had at an experiment's first sample is known only through noise, or not at
all. Start states are projected out of every residual and sensitivity
(`estimation.variable_projection`), so that they cost the parameters the information that they
should. They and the channels' noise are estimated anew between rounds, until nothing moves.

Where the machine is not linear the sum of squares can have several minima: near a critical speed
the free run is either captured or not, and turns from one to the other within a per cent of e. So
an optional parameter (e, g) that is freed is first scanned over two decades, and the fit starts
from the best few values. Other parameters start from the file's values alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment, rms
from ldt_core.calibration.coordinates import Coordinate, Coordinates
from ldt_core.calibration.prior_knowledge import DIFFERENCE_BESIDE_PRIOR, ToleranceLaw
from ldt_core.estimation.least_squares import trust_region
from ldt_core.estimation.noise import white_noise
from ldt_core.estimation.variable_projection import least_squares_step, project_out
from ldt_core.physics.base import ANGLE, CURRENT, SPEED, Effects, Physics
from ldt_core.physics.parameter import Parameter

DIFFERENCE_LINEAR = 1e-4  # of a coordinate: quotients of the exact solution are good to 1e-8
DIFFERENCE_INTEGRATED = 5e-4  # of a coordinate: the integrator's error of 5e-6 enters it
DIFFERENCE_OF_START = 1e-3  # of a start state's spread, for its difference quotient
START_STEPS = 4  # Gauss-Newton steps for the start states; a linear machine needs one
LEAST_GAIN = 1e-6  # of the loss: a step of the start states that gains less is the last
ANGLE_SPREAD = math.pi / math.sqrt(3)  # rad, standard deviation of an angle nobody knows
NOISE_FLOOR = 1e-6  # of a channel's size: a simulation without noise must not divide by 0
DIVERGED = 1e6  # noise deviations: a residual that no fit will accept
ROUNDS = 12  # of fit, start states and noise in turn; a fit that is not still by then creeps
LEAST_MOVE = 1e-3  # standard errors: a round that moves no coordinate by more was the last
LEAST_EXACT_MOVE = 1e-9  # of a coordinate: the same for data without noise
TOLERANCE = 1e-10  # relative, of cost, coordinates and gradient: a round ends at its minimum
EVALUATIONS = 60  # of the free runs in one round
VISIBLE_CHANGE = 0.01  # of the speed: one this large gives a parameter at 0 its typical size
SIZES = 10.0 ** np.arange(-8, 5, 0.25)  # in the parameter's unit, tried for that
SCAN = np.geomspace(0.2, 20, 25)  # of the typical size: two decades about it, 12 points a decade
RESPONSE_STEP = 0.5e-3  # s, of the integration of a small effect, however fast dry friction turns
STARTS = 3  # minima of the scan from which to fit; a rotor has two, captured or not


class CalibrationRuns:
    """Measured experiments beside the free runs of a machine.

    Args:
        physics, values: the equations, and the parameters about which start states are guessed.
        experiments: measured; the current is used where it was.
        tick: called before each simulation of all experiments, to show that work goes on.
    """

    def __init__(
        self,
        physics: Physics,
        values: Mapping[str, float],
        experiments: Sequence[Experiment],
        tick: Callable[[], None] = lambda: None,
    ) -> None:
        self.physics, self.experiments, self.tick = physics, list(experiments), tick
        speed = np.concatenate([e.speed for e in self.experiments])
        current = [e.current for e in self.experiments if e.current is not None]
        self.has_current = bool(current)
        self._sizes = [_size(speed), _size(np.concatenate(current)) if current else 1.0]
        #: Standard deviation of what is left in speed [rad/s] and current [A].
        self.noise = [
            max(white_noise(e.speed for e in self.experiments), NOISE_FLOOR * self._sizes[0]),
            max(white_noise(current), NOISE_FLOOR * self._sizes[1]) if current else 1.0,
        ]
        #: White part of the speed's noise, judged from the measurement alone [rad/s].
        self.white = self.noise[0]
        self._guess = [_guess(physics, values, e) for e in self.experiments]
        self.starts = [g.copy() for g in self._guess]
        self._spread = [
            _spread(physics, values, e, g)
            for e, g in zip(self.experiments, self._guess, strict=True)
        ]
        self._unknown = [np.flatnonzero(s > 0) for s in self._spread]
        self._bases: list[Array] = []

    @property
    def unknowns(self) -> int:
        """Start states that are estimated, of all experiments together."""
        return sum(len(u) for u in self._unknown)

    def residuals(self, values: Mapping[str, float]) -> list[Array]:
        """What is left of each experiment in noise deviations: (rows,) a piece.

        Rows: speed, current if measured, then one that holds each start state to its guess.
        """
        self.tick()
        return [
            self._eliminate(
                i, self._measured(i) - self._run(i, values, self.starts[i]), self._pull(i)
            )
            for i in range(len(self.experiments))
        ]

    def sensitivities(
        self, coordinates: Coordinates, z: Array, step: float = DIFFERENCE_INTEGRATED
    ) -> list[Array]:
        """Change of each experiment's free run per coordinate: (rows, p), as in `residuals`.

        `step` is that of the differences of integrated runs, in a coordinate.
        """
        linear = self.physics.is_linear(coordinates.values(z))
        step = DIFFERENCE_LINEAR if linear else step
        low, high = coordinates.bounds
        columns: list[list[Array]] = [[] for _ in self.experiments]
        for j in range(len(coordinates)):
            self.tick()
            a, b = z.copy(), z.copy()
            a[j], b[j] = max(z[j] - step, low[j]), min(z[j] + step, high[j])
            below, above = coordinates.values(a), coordinates.values(b)
            for i, start in enumerate(self.starts):
                change = self._run(i, above, start) - self._run(i, below, start)
                columns[i].append(change / (b[j] - a[j]))
        return [self._eliminate(i, np.column_stack(c)) for i, c in enumerate(columns)]

    def settle(self, values: Mapping[str, float], estimate: bool = True) -> None:
        """Estimate the start states for these parameters, and how they move the free runs.

        `estimate` False leaves the start states: parameters that are far off would distort them.
        """
        self._bases = []
        for i in range(len(self.experiments)):
            linear = self.physics.is_linear(values)
            best = self._loss(i, values, self.starts[i])
            for _ in range((1 if linear else START_STEPS) if estimate else 0):
                step = self._start_step(i, values)
                tried = self.starts[i].copy()
                tried[self._unknown[i]] += step
                loss = self._loss(i, values, tried)
                if not loss < best:
                    break
                done = best - loss < LEAST_GAIN * best
                self.starts[i], best = tried, loss
                if done:
                    break
            stacked = self._stacked(i, self._start_sensitivities(i, values))
            self._bases.append(np.linalg.qr(stacked)[0])

    def weigh(self, values: Mapping[str, float]) -> None:
        """Take what is left in each channel as its noise, so that both count by their precision."""
        squares, counts = [0.0, 0.0], [0, 0]
        for i, rest in enumerate(self.residuals(values)):
            length = len(self.experiments[i])
            for channel in range(2 if self.experiments[i].current is not None else 1):
                part = rest[channel * length : (channel + 1) * length] * self.noise[channel]
                squares[channel] += float(part @ part)
                counts[channel] += length - (len(self._unknown[i]) if channel == 0 else 0)
        for channel in range(2 if self.has_current else 1):
            found = math.sqrt(squares[channel] / max(counts[channel], 1))
            self.noise[channel] = max(found, NOISE_FLOOR * self._sizes[channel])

    def free_run(self, i: int, values: Mapping[str, float]) -> Array:
        """(rows,) free run of experiment i in noise deviations, from its start state."""
        return self._run(i, values, self.starts[i])

    def change(self, i: int, values: Mapping[str, float], use: Effects, base: Array) -> float:
        """By how much effects change a free run (rows,), as a part of its size."""
        self.tick()
        size = float(np.linalg.norm(self._measured(i))) or 1.0
        start = self.starts[i]
        moved = np.clip(self._run(i, values, start, use) - base, -DIVERGED, DIVERGED)
        return float(np.linalg.norm(np.nan_to_num(moved, nan=DIVERGED))) / size

    def responses(
        self,
        values: Mapping[str, float],
        use: Effects,
        chosen: Sequence[int],
        base: Sequence[Array],
    ) -> list[Array]:
        """Change of the chosen experiments' free runs by effects: (rows,), as in `residuals`."""
        self.tick()
        return [
            self._eliminate(i, self._run(i, values, self.starts[i], use) - run)
            for i, run in zip(chosen, base, strict=True)
        ]

    def loss(self, values: Mapping[str, float]) -> float:
        """Sum of squares from the present start states, in noise deviations."""
        self.tick()
        return sum(self._loss(i, values, s) for i, s in enumerate(self.starts))

    def _loss(self, i: int, values: Mapping[str, float], start: Array) -> float:
        rest = self._measured(i) - self._run(i, values, start)
        unknown = self._unknown[i]
        pull = (start - self._guess[i])[unknown] / self._spread[i][unknown]
        return float(rest @ rest + pull @ pull)

    def _start_step(self, i: int, values: Mapping[str, float]) -> Array:
        rest = self._measured(i) - self._run(i, values, self.starts[i])
        stacked = self._stacked(i, self._start_sensitivities(i, values))
        return least_squares_step(stacked, np.concatenate([rest, self._pull(i)]))

    def _start_sensitivities(self, i: int, values: Mapping[str, float]) -> Array:
        base = self._run(i, values, self.starts[i])
        columns = np.empty((base.size, len(self._unknown[i])))
        for column, state in enumerate(self._unknown[i]):
            spread = self._spread[i][state]
            step = DIFFERENCE_OF_START * (spread if math.isfinite(spread) else self._sizes[0])
            moved = self.starts[i].copy()
            moved[state] += step
            columns[:, column] = (self._run(i, values, moved) - base) / step
        return columns

    def _stacked(self, i: int, columns: Array) -> Array:
        return np.vstack([columns, np.diag(1 / self._spread[i][self._unknown[i]])])

    def _pull(self, i: int) -> Array:
        unknown = self._unknown[i]
        return -(self.starts[i] - self._guess[i])[unknown] / self._spread[i][unknown]

    def _eliminate(self, i: int, rows: Array, below: Array | None = None) -> Array:
        extra = np.zeros((len(self._unknown[i]), *rows.shape[1:])) if below is None else below
        return project_out(np.concatenate([rows, extra]), self._bases[i])

    def _measured(self, i: int) -> Array:
        e = self.experiments[i]
        speed = e.speed / self.noise[0]
        return speed if e.current is None else np.concatenate([speed, e.current / self.noise[1]])

    def _run(self, i: int, values: Mapping[str, float], start: Array, use: Effects = ()) -> Array:
        e = self.experiments[i]
        try:
            least = RESPONSE_STEP if use else 0.0
            states = self.physics.simulate(
                values, e.voltage, e.period, start, use, least_step=least
            )
        except LdtError:
            return np.full(len(e) * (1 if e.current is None else 2), DIVERGED)
        speed = self.physics.measure(states, e.period, use, values) / self.noise[0]
        return (
            speed
            if e.current is None
            else np.concatenate([speed, states[:, CURRENT] / self.noise[1]])
        )


def _size(samples: Array) -> float:
    return rms(samples) or 1.0


def _guess(physics: Physics, values: Mapping[str, float], e: Experiment) -> Array:
    current = None if e.current is None else float(e.current[0])
    return physics.initial_state(values, float(e.speed[0]), current)


def _spread(physics: Physics, values: Mapping[str, float], e: Experiment, guess: Array) -> Array:
    """(n,) how far each start state may be from its guess; 0 where it is known or does not matter.

    The speed is free; the current within what the voltage can drive. States of the foundation may
    be as large as in the run when the machine starts at full speed; at rest they are 0.
    """
    spread = np.zeros(guess.size)
    spread[SPEED] = math.inf
    spread[CURRENT] = max(float(np.abs(e.voltage).max()), 1e-3) / values["R"]
    if physics.is_linear(values):
        return spread
    spread[ANGLE] = ANGLE_SPREAD
    states = physics.simulate(values, e.voltage, e.period, guess)
    running = min(1.0, abs(float(e.speed[0])) / _size(e.speed))
    moved = states[:, CURRENT + 1 : spread.size]
    spread[CURRENT + 1 :] = running * np.sqrt(np.mean(moved**2, axis=0))
    return spread


def fit(
    runs: CalibrationRuns, coordinates: Coordinates, z: Array, prior: ToleranceLaw | None = None
) -> tuple[Array, bool]:
    """Fit the free parameters from z (p,); the runs keep the start states and noise found.

    Args:
        prior: what is known of them beforehand.

    Returns:
        (p,) coordinates, and whether the last round moved nothing.

    Raises:
        LdtError: the machine cannot be simulated where the fit starts.
    """

    def residual(z: Array) -> Array:
        rest = runs.residuals(coordinates.values(z))
        return np.concatenate(rest if prior is None else [*rest, prior.residuals(z)])

    def jacobian(z: Array) -> Array:
        if prior is None:
            return -np.vstack(runs.sensitivities(coordinates, z))
        rows = runs.sensitivities(coordinates, z, DIFFERENCE_BESIDE_PRIOR)
        exact = runs.physics.is_linear(coordinates.values(z))
        return -np.vstack([*prior.informative(rows, z, exact), prior.rows])

    z, converged = coordinates.inside(z), False
    runs.settle(coordinates.values(z), estimate=False)
    for _ in range(ROUNDS):
        runs.weigh(coordinates.values(z))
        solved = trust_region(
            residual,
            z,
            *coordinates.bounds,
            jacobian,
            xtol=TOLERANCE,
            ftol=TOLERANCE,
            gtol=TOLERANCE,
            max_nfev=EVALUATIONS,
        )
        moved = np.abs(solved.z - z)
        z = solved.z
        runs.settle(coordinates.values(z))
        information = solved.jacobian.T @ solved.jacobian
        errors = 1 / np.sqrt(np.maximum(np.diag(information), 1e-300))
        if np.all(moved <= np.maximum(LEAST_MOVE * errors, LEAST_EXACT_MOVE)):
            converged = True
            break
    z = coordinates.snapped(z)
    runs.settle(coordinates.values(z))
    runs.weigh(coordinates.values(z))
    return z, converged


def typical(
    physics: Physics, values: Mapping[str, float], name: str, parts: Sequence[Experiment]
) -> float:
    """The size at which a parameter that is 0 in the file moves the speed by one per cent.

    Raises:
        LdtError: no size does.
    """
    e = max(parts, key=lambda e: float(np.ptp(e.speed)))
    start = physics.initial_state(values, float(e.speed[0]))
    base = physics.simulate(values, e.voltage, e.period, start)[:, SPEED]
    size = rms(base)
    for tried in SIZES:
        try:
            moved = physics.simulate({**values, name: tried}, e.voltage, e.period, start)[:, SPEED]
        except LdtError:
            break
        if rms(moved - base) > VISIBLE_CHANGE * size > 0:
            return float(tried)
    raise LdtError(f"{name} cannot be calibrated: no value of it shows in the free run")


def coordinate(
    physics: Physics, values: Mapping[str, float], parameter: Parameter, parts: Sequence[Experiment]
) -> Coordinate:
    """The coordinate of a parameter; one that is 0 in the file gets its typical size."""
    nominal = values[parameter.name]
    scale = abs(nominal) or parameter.scale or typical(physics, values, parameter.name, parts)
    return Coordinate(parameter, nominal, scale)


def starts(physics: Physics, coordinates: Coordinates, runs: CalibrationRuns) -> list[Array]:
    """Coordinates from which to fit: the file's values, and the best of the scans."""
    found = [coordinates.nominal]
    for j, c in enumerate(coordinates.free):
        if c.nominal == 0:
            found[0][j] = 1.0 if not c.logarithmic else 0.0
    for j, c in enumerate(coordinates.free):
        if c.parameter.default is None:
            continue
        tried = []
        for z in SCAN:
            at = found[0].copy()
            at[j] = z
            values = coordinates.values(coordinates.inside(at))
            if physics.is_linear(values):
                break
            tried.append((runs.loss(values), at))
        minima = [
            (loss, at)
            for i, (loss, at) in enumerate(tried)
            if all(loss <= tried[k][0] for k in (i - 1, i + 1) if 0 <= k < len(tried))
        ]
        best = [at for _, at in sorted(minima, key=lambda m: m[0])[:STARTS]]
        if best:
            found = best if c.nominal == 0 else [*best, found[0]]
    return found
