"""Measured experiments beside free runs of a machine, with unknown start states eliminated.

What state the machine had at an experiment's first sample is known only through noise, or not at
all. Start states are projected out of every residual and sensitivity
(`estimation.variable_projection`), so that they cost the parameters the information that they
should. They and the channels' noise are estimated anew between rounds, until nothing moves.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment, rms
from ldt_core.calibration.coordinates import Coordinates
from ldt_core.estimation.noise import white_noise
from ldt_core.estimation.variable_projection import least_squares_step, project_out
from ldt_core.physics.base import ANGLE, CURRENT, SPEED, Effects, FreeRun, Physics

DIFFERENCE_LINEAR = 1e-4  # of a coordinate: quotients of the exact solution are good to 1e-8
DIFFERENCE_INTEGRATED = 5e-4  # of a coordinate: the integrator's error of 5e-6 enters it
DIFFERENCE_OF_START = 1e-3  # of a start state's spread, for its difference quotient
START_STEPS = 4  # Gauss-Newton steps for the start states; a linear machine needs one
LEAST_GAIN = 1e-6  # of the loss: a step of the start states that gains less is the last
ANGLE_SPREAD = math.pi / math.sqrt(3)  # rad, standard deviation of an angle nobody knows
NOISE_FLOOR = 1e-6  # of a channel's size: a simulation without noise must not divide by 0
DIVERGED = 1e6  # noise deviations: a residual that no fit will accept
RESPONSE_STEP = 0.5e-3  # s, of the integration of a small effect, however fast dry friction turns


class _Run(NamedTuple):
    """A free run: the place of its experiment, parameters, (n,) start state, effects."""

    place: int
    values: Mapping[str, float]
    start: Array
    use: Effects = ()


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

    @property
    def log_noise(self) -> float:
        """Of all samples, summed: minus the logarithm of how likely they are, but a constant."""
        counts = [sum(map(len, self.experiments))]
        counts += [sum(len(e) for e in self.experiments if e.current is not None)]
        return sum(n * math.log(size) for n, size in zip(counts, self.noise, strict=True))

    def residuals(self, values: Mapping[str, float]) -> list[Array]:
        """What is left of each experiment in noise deviations: (rows,) a piece.

        Rows: speed, current if measured, then one that holds each start state to its guess.
        """
        self.tick()
        runs = self._runs([_Run(i, values, s) for i, s in enumerate(self.starts)])
        return [
            self._eliminate(i, self._measured(i) - run, self._pull(i)) for i, run in enumerate(runs)
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
        count = len(coordinates)
        below, above = np.tile(z, (count, 1)), np.tile(z, (count, 1))
        for j in range(count):
            below[j, j], above[j, j] = max(z[j] - step, low[j]), min(z[j] + step, high[j])
        found = []
        for i, start in enumerate(self.starts):
            self.tick()
            runs = self._runs([_Run(i, coordinates.values(at), start) for at in (*below, *above)])
            columns = [
                (more - less) / (above[j, j] - below[j, j])
                for j, (less, more) in enumerate(zip(runs[:count], runs[count:], strict=True))
            ]
            found.append(self._eliminate(i, np.column_stack(columns)))
        return found

    def settle(self, values: Mapping[str, float], estimate: bool = True) -> None:
        """Estimate the start states for these parameters, and how they move the free runs.

        `estimate` False leaves the start states: parameters that are far off would distort them.
        """
        self._bases = []
        for i in range(len(self.experiments)):
            linear = self.physics.is_linear(values)
            best = self._loss(i, self.starts[i], self.free_run(i, values))
            for _ in range((1 if linear else START_STEPS) if estimate else 0):
                step = self._start_step(i, values)
                tried = self.starts[i].copy()
                tried[self._unknown[i]] += step
                loss = self._loss(i, tried, self._runs([_Run(i, values, tried)])[0])
                if not loss < best:
                    break
                done = best - loss < LEAST_GAIN * best
                self.starts[i], best = tried, loss
                if done:
                    break
            stacked = self._stacked(i, self._start_sensitivities(i, values)[1])
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
        return self._runs([_Run(i, values, self.starts[i])])[0]

    def change(self, i: int, values: Mapping[str, float], use: Effects, base: Array) -> float:
        """By how much effects change a free run (rows,), as a part of its size."""
        self.tick()
        size = float(np.linalg.norm(self._measured(i))) or 1.0
        run = self._runs([_Run(i, values, self.starts[i], use)])[0]
        moved = np.clip(run - base, -DIVERGED, DIVERGED)
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
        asked = [_Run(i, values, self.starts[i], use) for i in chosen]
        return [
            self._eliminate(i, moved - run)
            for i, moved, run in zip(chosen, self._runs(asked), base, strict=True)
        ]

    def loss(self, values: Mapping[str, float]) -> float:
        """Sum of squares from the present start states, in noise deviations."""
        self.tick()
        runs = self._runs([_Run(i, values, s) for i, s in enumerate(self.starts)])
        return sum(self._loss(i, self.starts[i], run) for i, run in enumerate(runs))

    def _loss(self, i: int, start: Array, run: Array) -> float:
        rest = self._measured(i) - run
        unknown = self._unknown[i]
        pull = (start - self._guess[i])[unknown] / self._spread[i][unknown]
        return float(rest @ rest + pull @ pull)

    def _start_step(self, i: int, values: Mapping[str, float]) -> Array:
        base, columns = self._start_sensitivities(i, values)
        rest = np.concatenate([self._measured(i) - base, self._pull(i)])
        return least_squares_step(self._stacked(i, columns), rest)

    def _start_sensitivities(self, i: int, values: Mapping[str, float]) -> tuple[Array, Array]:
        """(rows,) free run of experiment i, and (rows, unknown) its change per start state."""
        unknown, spread = self._unknown[i], self._spread[i][self._unknown[i]]
        steps = DIFFERENCE_OF_START * np.where(np.isfinite(spread), spread, self._sizes[0])
        begun = np.tile(self.starts[i], (1 + len(unknown), 1))
        begun[1 + np.arange(len(unknown)), unknown] += steps
        base, *moved = self._runs([_Run(i, values, start) for start in begun])
        columns = [(run - base) / step for run, step in zip(moved, steps, strict=True)]
        return base, np.reshape(columns, (-1, base.size)).T

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

    def _runs(self, asked: Sequence[_Run]) -> list[Array]:
        """Of each (rows,) its free run in noise deviations, several simulated at once."""
        found = []
        for run in asked:
            e = self.experiments[run.place]
            found.append(np.full(len(e) * (1 if e.current is None else 2), DIVERGED))
        begun = [
            FreeRun(r.values, e.voltage, e.period, r.start, r.use)
            for r, e in ((r, self.experiments[r.place]) for r in asked)
        ]
        least = RESPONSE_STEP if any(r.use for r in asked) else 0.0
        for k, states in self.physics.simulate_all(begun, least_step=least):
            run, e = asked[k], self.experiments[asked[k].place]
            if isinstance(states, LdtError):
                continue
            speed = self.physics.measure(states, e.period, run.use, run.values) / self.noise[0]
            found[k][: len(e)] = speed
            found[k][len(e) :] = states[:, CURRENT] / self.noise[1] if e.current is not None else ()
        return found


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
