"""Recorded experiments beside simulations of the machine with any set of effects.

Residuals are measured minus simulated, in deviations of the noise, speed and (where it was
recorded) current of all experiments in one row, from start states that are projected out where the
machine was not at rest. They are those of a free run, with one exception: a rotor near capture
turns from one state of motion to another within a per cent of its eccentricity, and a free run on
the wrong side says nothing about what else is wrong. There the simulation follows the measured
speed through an observer, whose corrections are then taken back out by the linear motor: what
remains is a free run linearised about the measured motion, the same as the free run wherever that
is linear, and smooth in every parameter where it is not.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from ldt_core.cause.free_run import white_noise
from ldt_core.errors import LdtError
from ldt_core.experiment import Experiment
from ldt_core.physics.integrate import NOT_TRACKED, propagate

if TYPE_CHECKING:
    from ldt_core.effects.base import Effect
    from ldt_core.machine import Machine

Array = NDArray[np.float64]
Values = Mapping[str, float]
Use = Sequence[tuple["Effect", Values]]

DIVERGED = 1e4  # rad/s, in place of a free run that grows for ever
AT_REST = 4.0  # noise deviations: a first sample nearer to 0 than this is a machine at rest
NOISE_FLOOR = 1e-4  # of a channel's size: noise-free simulations must not divide by 0
COARSE = 2e-3  # s, integration step of a search
LEAST = 0.5e-3  # s, shortest step, whatever the search tries
MOTOR_NAMES = ("J", "K_t", "R", "L", "b")  # parameters that shake nothing
ROUNDS = 4  # Gauss-Newton steps for the start of a foundation in motion
STILL = 0.98  # of the sum of squares: a step that gains less was the last
NO_OFFSET = np.zeros(0)
ANGLES = 13  # tried of a turn; a prime, so that a ripple of few periods a turn is seen at each, and
ANGLE_FOUND = 2e-3  # rad, to which the best is then found
SENSITIVE = 0.1  # noise deviations: a start angle that moves no sample by more does not matter
START_STEP = 0.01  # rad, K, ...: of a start state, for difference quotients, and
MOTION = 0.01  # of that for a foundation's, in m and m/s
ANGLE, SPEED, CURRENT = range(3)


@dataclass(frozen=True, eq=False)
class Piece:
    """One experiment of the bench.

    Attributes:
        experiment: measured.
        rest: whether the machine stood still at the first sample.
        rows: where its residuals lie in the row of all.
        columns: (rows, s) change of the residuals per unknown first speed and current.
    """

    experiment: Experiment
    rest: bool
    rows: slice
    columns: Array


@dataclass(frozen=True, eq=False)
class Starts:
    """What is taken of the states at the first samples.

    Attributes:
        angles: (experiments,) [rad].
        bases: for each experiment (rows, s) orthonormal directions that an unknown start moves.
        offsets: for each experiment the change of the states at its first sample from what is
            guessed, foundation's and effects' included; empty where that is not estimated.
    """

    angles: Array
    bases: tuple[Array, ...]
    offsets: tuple[Array, ...]


class Bench:
    """Experiments and the machine that is thought to have made them.

    Args:
        machine: as its file knows it.
        experiments: measured.
        noise: standard deviations of speed [rad/s] and current [A]; None takes the white part of
            the measured signals.
        tolerance: part of each channel's gap, as root mean square, that counts as noise as well: no
            law is exactly a machine's, and a channel measured very well must not count for more.
        workers: threads among which the experiments are spread.
    """

    def __init__(
        self,
        machine: Machine,
        experiments: Sequence[Experiment],
        noise: tuple[float, float] | None = None,
        workers: int = 1,
        tolerance: float = 0.0,
    ) -> None:
        self.machine, self.experiments = machine, list(experiments)
        self.physics, self.values = machine.model, dict(machine.parameters)
        self.noise = noise or channel_noise(self.experiments)
        #: Noise of each channel in the deviations by which residuals are divided.
        self.level = (1.0, 1.0)
        self.workers = workers
        #: Simulations made so far, each of one experiment.
        self.simulated = 0
        v = self.values
        #: Time constant with which the motor forgets its speed [s].
        self.memory = v["R"] * v["J"] / (v["R"] * v["b"] + v["K_t"] ** 2)
        self.pieces: list[Piece] = []
        at = 0
        for e in self.experiments:
            rows = len(e) * (1 if e.current is None else 2)
            rest = abs(float(e.speed[0])) <= AT_REST * self.noise[0]
            columns = np.zeros((rows, 0)) if rest else self._motor_columns(e)
            self.pieces.append(Piece(e, rest, slice(at, at + rows), columns))
            at += rows
        #: Residuals in all.
        self.size = at
        #: Start states as they are known before any effect is.
        self.starts = Starts(
            np.zeros(len(self.pieces)),
            tuple(_basis(p.columns) for p in self.pieces),
            (NO_OFFSET,) * len(self.pieces),
        )
        #: Whether the machine shakes a foundation as its file knows it.
        self.shaking = not self.physics.is_linear(self.values)
        if self.shaking:
            self.starts = self._settled((), True, 0, True, True, COARSE)
        if tolerance > 0:
            self._tolerate(tolerance)

    def _tolerate(self, tolerance: float) -> None:
        """Take the noise to be as large as the laws' own errors are likely to be."""
        rest, gap, count = self.rest(), [0.0, 0.0], [0, 0]
        for piece in self.pieces:
            length = len(piece.experiment)
            for channel, begin in enumerate(range(piece.rows.start, piece.rows.stop, length)):
                part = rest[begin : begin + length]
                gap[channel] += float(part @ part) - length
                count[channel] += length
        wider = [
            math.sqrt(1.0 + tolerance**2 * max(g / max(n, 1), 0.0))
            for g, n in zip(gap, count, strict=True)
        ]
        self.noise = self.noise[0] * wider[0], self.noise[1] * wider[1]
        self.level = 1.0 / wider[0], 1.0 / wider[1]
        for piece in self.pieces:  # the columns' channels are weighed by the noise
            length = len(piece.experiment)
            piece.columns[:length] /= wider[0]
            piece.columns[length:] /= wider[1]
        bases = tuple(_basis(p.columns) for p in self.pieces)
        self.starts = Starts(self.starts.angles, bases, self.starts.offsets)
        if self.shaking:
            self.starts = self._settled((), True, 0, True, True, COARSE)

    def part(self, numbers: Sequence[int]) -> Bench:
        """The bench with some of the experiments only, by their place in the list."""
        chosen = [self.experiments[i] for i in numbers]
        part = Bench(self.machine, chosen, self.noise, self.workers)
        part.level = self.level
        return part

    def rest(self, use: Use = (), step: float = COARSE, starts: Starts | None = None) -> Array:
        """(size,) residuals with these effects, in noise deviations, start states projected out.

        Args:
            use: effects with all their values.
            step: longest integration step [s].
            starts: as `settle` found them for such effects; None takes the bench's.
        """
        begun = self.starts if starts is None else starts
        row = np.empty(self.size)

        def fill(i: int) -> None:
            rest = self._difference(i, use, step, float(begun.angles[i]), begun.offsets[i])
            row[self.pieces[i].rows] = rest - begun.bases[i] @ (begun.bases[i].T @ rest)

        self._each(fill)
        return row

    def settle(self, use: Use, free: bool = False, step: float = COARSE) -> Starts:
        """Start states for these effects, where more is unknown than a motor's speed and current.

        A machine that was running has a foundation in motion, a warm winding and the like, each of
        which moves the residuals in a direction of its own, and an angle that is sought.

        Args:
            use: effects with all their values.
            free: seek the angle of machines at rest as well; else it is 0.
            step: longest integration step [s].
        """
        values = self._values(use)
        if values is None:
            return self.starts
        shaken = any(v != self.values[n] for n, v in values.items() if n not in MOTOR_NAMES)
        states = sum(
            len(e.states) for e, _ in use if e.torque is not None or e.terminal is not None
        )
        # The angles that a shaking machine is known by were sought without the effects.
        free = free or self.shaking
        turning = bool(use) and (self.shaking or self.turns(use))
        running = any(not p.rest for p in self.pieces)
        if not ((running and (shaken or states or turning)) or (free and turning)):
            return self.starts
        moving = not self.physics.is_linear(values)
        return self._settled(use, moving, states, turning or (shaken and moving), free, step)

    def _settled(
        self, use: Use, moving: bool, states: int, turning: bool, free: bool, step: float
    ) -> Starts:
        angles, bases = self.starts.angles.copy(), list(self.starts.bases)
        offsets = list(self.starts.offsets)
        n = len(self.physics.states)
        # The states of a foundation in motion and of the effects, each with its difference step.
        unknown = {k: START_STEP * MOTION for k in range(CURRENT + 1, n)} if moving else {}
        unknown |= {k: START_STEP for k in range(n, n + states)}
        if turning:
            unknown[ANGLE] = START_STEP

        def work(i: int) -> None:
            piece = self.pieces[i]
            if turning and (free or not piece.rest):
                angles[i] = self._best_angle(i, use, step)
            if not piece.rest and unknown:
                rounds = ROUNDS if moving else 1
                found = self._start_of(i, use, step, float(angles[i]), unknown, n + states, rounds)
                offsets[i], bases[i] = found

        self._each(work)
        return Starts(angles, tuple(bases), tuple(offsets))

    def _start_of(
        self,
        i: int,
        use: Use,
        step: float,
        angle: float,
        unknown: Mapping[int, float],
        count: int,
        rounds: int,
    ) -> tuple[Array, Array]:
        """(offset of the start states, directions in which they move the residuals).

        Gauss-Newton steps from the guess, as long as they help; the first speed and current are
        left to the directions, in which they are linear.
        """
        piece, offset = self.pieces[i], np.zeros(count)
        names = list(unknown)
        best, basis, kept = math.inf, self.starts.bases[i], offset
        for _ in range(rounds):
            rest = self._difference(i, use, step, angle, offset)
            columns = np.empty((rest.size, len(names)))
            for j, state in enumerate(names):
                moved = offset.copy()
                moved[state] += unknown[state]
                columns[:, j] = self._difference(i, use, step, angle, moved) - rest
            both = np.column_stack([piece.columns, columns])
            directions = _basis(both)
            left = rest - directions @ (directions.T @ rest)
            motor = _basis(piece.columns)
            loss = float(rest @ rest - np.sum((motor.T @ rest) ** 2))
            if loss >= best * STILL:
                break
            best, basis, kept = loss, directions, offset
            if float(left @ left) > loss * STILL:
                break
            size = np.linalg.norm(both, axis=0) + 1e-300
            solved = np.linalg.lstsq(both / size, -rest, rcond=1e-8)[0] / size
            offset = offset.copy()
            for j, state in enumerate(names):
                offset[state] += solved[piece.columns.shape[1] + j] * unknown[state]
        return kept, basis

    def turns(self, use: Use) -> bool:
        """Whether the start angle makes a difference with these effects."""
        if not use or not self.pieces:
            return False
        one, other = (self._difference(0, use, COARSE, angle) for angle in (0.0, 1.0))
        return bool(np.max(np.abs(one - other)) > SENSITIVE)

    def _best_angle(self, i: int, use: Use, step: float) -> float:
        basis = self.starts.bases[i]

        def loss(angle: float) -> float:
            rest = self._difference(i, use, step, angle)
            along = basis.T @ rest
            return float(rest @ rest - along @ along)

        width = 2 * math.pi / ANGLES
        best = min((loss(k * width), k * width) for k in range(ANGLES))[1]
        near, exact = (best - width, best + width), {"xatol": ANGLE_FOUND}
        return float(minimize_scalar(loss, bounds=near, method="bounded", options=exact).x)

    def _values(self, use: Use) -> Values | None:
        """The machine's parameters with these effects; None where they are impossible."""
        values: Values = self.values
        try:
            for effect, given in use:
                values = effect.change_parameters(self.physics, values, given)
        except LdtError:
            return None
        return values

    def _each(self, work: object) -> None:
        count = range(len(self.pieces))
        if self.workers > 1 and len(count) > 1:
            with ThreadPoolExecutor(self.workers) as pool:
                list(pool.map(work, count))  # type: ignore[arg-type]
        else:
            for i in count:
                work(i)  # type: ignore[operator]

    def _difference(
        self, i: int, use: Use, step: float, angle: float, offset: Array = NO_OFFSET
    ) -> Array:
        """(rows,) measured minus simulated of one experiment, in noise deviations."""
        e = self.experiments[i]
        speed, current = self.outputs(i, use, step, angle, offset=offset)
        rest = (e.speed - speed) / self.noise[0]
        if e.current is not None:
            rest = np.concatenate([rest, (e.current - current) / self.noise[1]])
        limit = DIVERGED / self.noise[0]
        return np.clip(np.nan_to_num(rest, nan=limit, posinf=limit, neginf=-limit), -limit, limit)

    def outputs(
        self,
        i: int,
        use: Use,
        step: float = COARSE,
        angle: float = 0.0,
        follow: bool = True,
        offset: Array = NO_OFFSET,
    ) -> tuple[Array, Array]:
        """(L,) speed as the sensor shows it [rad/s] and (L,) current [A] of experiment i.

        Args:
            i: place of the experiment in the list.
            use: effects with all their values.
            step: longest integration step [s].
            angle: at the first sample [rad].
            follow: False makes it a free run whatever the machine is.
            offset: (states,) change of the states at the first sample, or none.
        """
        piece = self.pieces[i]
        e, physics = piece.experiment, self.physics
        self.simulated += 1
        try:
            values: Values = self.values
            for effect, given in use:
                values = effect.change_parameters(physics, values, given)
            seen = physics.behind_sensor(e.speed, e.period, use)
            first = 0.0 if piece.rest else float(seen[0])
            known = None if e.current is None else float(e.current[0])
            start = physics.initial_state(values, first, known)
            if not piece.rest and not physics.is_linear(values):
                start = physics.running_state(values, first, angle, known)
            start[ANGLE] = angle
            terms = [(x, p) for x, p in use if x.torque is not None or x.terminal is not None]
            own = [v for x, p in terms for v in x.first_states(start, p)]
            start = np.concatenate([start, own])
            if offset.size:
                start[: offset.size] += offset[: start.size]
            about = e.voltage, e.period, start, use, step
            if not follow or physics.is_linear(values):
                states = physics.simulate(self.values, *about, least_step=LEAST)
            else:
                gain = -math.expm1(-e.period / self.memory)
                states = physics.simulate(self.values, *about, (seen, gain), LEAST)
                states = states.copy()
                states[:, : CURRENT + 1] -= self._corrections(values, e, states, seen, gain)
        except LdtError:
            wild = np.full(len(e), DIVERGED)
            return wild, wild
        return physics.measure(states, e.period, use), states[:, CURRENT]

    def _corrections(
        self, values: Values, e: Experiment, states: Array, seen: Array, gain: float
    ) -> Array:
        """(L, 3) what the observer has added to angle, speed and current so far."""
        ad, _ = _motor(values, e.period)
        pushed = gain * (seen - states[:, SPEED])
        moved = propagate(ad, np.ascontiguousarray(ad[:, SPEED]), pushed, np.zeros(3), *NOT_TRACKED)
        moved[:, ANGLE] = 0.0
        return moved

    def _motor_columns(self, e: Experiment) -> Array:
        """(rows, 2) change of the residuals per unknown first speed and current."""
        ad, bd = _motor(self.values, e.period)
        columns = []
        for state in (SPEED, CURRENT):
            first = np.zeros(3)
            first[state] = 1.0
            moved = propagate(ad, bd, np.zeros(len(e)), first, *NOT_TRACKED)
            column = moved[:, SPEED] / self.noise[0]
            if e.current is not None:
                column = np.concatenate([column, moved[:, CURRENT] / self.noise[1]])
            columns.append(column)
        return np.column_stack(columns)


def _basis(columns: Array) -> Array:
    """Orthonormal directions that span the columns; those that show nothing are left out."""
    if columns.shape[1] == 0:
        return columns
    left, size, _ = np.linalg.svd(
        columns / (np.linalg.norm(columns, axis=0) + 1e-300), full_matrices=False
    )
    return np.asarray(left[:, size > 1e-6])


def _motor(values: Values, period: float) -> tuple[Array, Array]:
    from ldt_core.physics.base import _discretise
    from ldt_core.physics.motor import MOTOR

    return _discretise(MOTOR, tuple(values[p.name] for p in MOTOR.parameters), period)


def channel_noise(experiments: Sequence[Experiment]) -> tuple[float, float]:
    """Deviations of the white noise on speed [rad/s] and current [A], as measured."""
    speed = np.concatenate([e.speed for e in experiments])
    floor = NOISE_FLOOR * max(float(np.abs(speed).max()), 1e-6)
    noise = max(white_noise(experiments), floor)
    current = [e.current for e in experiments if e.current is not None]
    if not current:
        return noise, 1.0
    as_speed = [
        Experiment(e.number, e.start, e.period, e.voltage, e.current)
        for e in experiments
        if e.current is not None
    ]
    floor = NOISE_FLOOR * max(float(np.abs(np.concatenate(current)).max()), 1e-6)
    return noise, max(white_noise(as_speed), floor)
