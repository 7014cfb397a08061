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
LEAST = 0.8e-3  # s, shortest step, whatever the search tries
ANGLE, SPEED, CURRENT = range(3)


@dataclass(frozen=True, eq=False)
class Piece:
    """One experiment of the bench.

    Attributes:
        experiment: measured.
        rest: whether the machine stood still at the first sample.
        rows: where its residuals lie in the row of all.
        basis: (rows, s) orthonormal directions in which the unknown start state moves them.
    """

    experiment: Experiment
    rest: bool
    rows: slice
    basis: Array


class Bench:
    """Experiments and the machine that is thought to have made them.

    Args:
        machine: as its file knows it.
        experiments: measured.
        noise: standard deviations of speed [rad/s] and current [A]; None takes the white part of
            the measured signals.
        workers: threads among which the experiments are spread.
    """

    def __init__(
        self,
        machine: Machine,
        experiments: Sequence[Experiment],
        noise: tuple[float, float] | None = None,
        workers: int = 1,
    ) -> None:
        self.machine, self.experiments = machine, list(experiments)
        self.physics, self.values = machine.model, dict(machine.parameters)
        self.noise = noise or channel_noise(self.experiments)
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
            basis = np.zeros((rows, 0)) if rest else self._start_basis(e)
            self.pieces.append(Piece(e, rest, slice(at, at + rows), basis))
            at += rows
        #: Residuals in all.
        self.size = at
        #: Start angle of each experiment [rad].
        self.angles = np.zeros(len(self.experiments))

    def part(self, numbers: Sequence[int]) -> Bench:
        """The bench with some of the experiments only, by their place in the list."""
        chosen = Bench(
            self.machine, [self.experiments[i] for i in numbers], self.noise, self.workers
        )
        chosen.angles = self.angles[list(numbers)]
        return chosen

    def rest(self, use: Use = (), step: float = COARSE, angles: Array | None = None) -> Array:
        """(size,) residuals with these effects, in noise deviations, start states projected out.

        Args:
            use: effects with all their values.
            step: longest integration step [s].
            angles: (experiments,) start angles [rad], if others than the bench's.
        """
        turned = self.angles if angles is None else angles
        row = np.empty(self.size)

        def fill(i: int) -> None:
            row[self.pieces[i].rows] = self.piece(i, use, step, float(turned[i]))

        self._each(fill)
        return row

    def _each(self, work: object) -> None:
        count = range(len(self.pieces))
        if self.workers > 1 and len(count) > 1:
            with ThreadPoolExecutor(self.workers) as pool:
                list(pool.map(work, count))  # type: ignore[arg-type]
        else:
            for i in count:
                work(i)  # type: ignore[operator]

    def piece(self, i: int, use: Use, step: float = COARSE, angle: float = 0.0) -> Array:
        """(rows,) residuals of one experiment."""
        piece = self.pieces[i]
        e = piece.experiment
        speed, current = self.outputs(i, use, step, angle)
        rest = (e.speed - speed) / self.noise[0]
        if e.current is not None:
            rest = np.concatenate([rest, (e.current - current) / self.noise[1]])
        limit = DIVERGED / self.noise[0]
        rest = np.clip(np.nan_to_num(rest, nan=limit, posinf=limit, neginf=-limit), -limit, limit)
        return rest - piece.basis @ (piece.basis.T @ rest)

    def outputs(
        self, i: int, use: Use, step: float = COARSE, angle: float = 0.0, follow: bool = True
    ) -> tuple[Array, Array]:
        """(L,) speed as the sensor shows it [rad/s] and (L,) current [A] of experiment i.

        Args:
            i: place of the experiment in the list.
            use: effects with all their values.
            step: longest integration step [s].
            angle: at the first sample [rad].
            follow: False makes it a free run whatever the machine is.
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

    def _start_basis(self, e: Experiment) -> Array:
        """Orthonormal directions of an unknown first speed and (where not measured) current."""
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
        return np.asarray(np.linalg.qr(np.column_stack(columns))[0])


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
