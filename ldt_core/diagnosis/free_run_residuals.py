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

import contextlib
import copy
import functools
import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from ldt_core.base.arrays import Array
from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Experiment
from ldt_core.diagnosis.channel_noise import residual_noise
from ldt_core.diagnosis.simulated_experiments import (
    NO_OFFSET,
    SEARCH_STEP,
    PreparedExperiment,
    Simulated,
    StartStates,
    Use,
    corrections,
    motor_columns,
    states_of,
)
from ldt_core.diagnosis.start_states import searched_start_states, start_states_for
from ldt_core.estimation.free_run_start import AT_REST, first_current
from ldt_core.estimation.noise import ROUNDING, rounding_correlation, sensor_step
from ldt_core.estimation.variable_projection import basis_of, project_out
from ldt_core.machine.machine_file import Machine
from ldt_core.physics.base import ANGLE, CURRENT, MAX_STEP, NOT_TRACKED, SPEED, FreeRun, Work
from ldt_core.physics.effect import Effect
from ldt_core.physics.integrate import MAX_STEP_RATE
from ldt_core.physics.lanes import WIDTH
from ldt_core.physics.motor_driven import USUAL_ROUNDS
from ldt_core.physics.motor_rates import memory, motor_rate
from ldt_core.physics.parameter import Values

DIVERGED_SPEED = 1e4  # rad/s, in place of a free run that grows for ever
ANGLE_SHOWS = 1e-3  # noise deviations by which an effect that depends on the angle shows it
TERMINAL_PRICE = 4  # of a torque's steps that one of a voltage at the terminals takes: 34 and 8 ns
CHANNELS = ("speed", "current")
SHORTEST_STEP = 0.5e-3  # s, of the integration, whatever a fit tries: bounds the time it takes
SAMPLES_AT_ONCE = 1_000_000  # of runs side by side, about: bounds the memory, 16 bytes for each
STATES_SEEN = 64  # samples of a run at which the states of effects are looked at, about


class FreeRunResiduals:
    """Experiments and the machine that is thought to have made them.

    Args:
        noise: standard deviations of speed [rad/s] and current [A]; None takes the white part of
            the measured signals, or of their residuals where that is less: a voltage that moves at
            every sample makes the signals themselves rough.
        tolerance: part of each channel's gap, as root mean square, that counts as noise as well: no
            law is exactly a machine's, and a channel measured very well must not count for more.
        colour: of a channel's noise that is not white, see `nominal_prior.known_colour`.
        running: an experiment that belongs to these began in motion.
    """

    def __init__(
        self,
        machine: Machine,
        experiments: Sequence[Experiment],
        noise: tuple[float, float] | None = None,
        workers: int = 1,
        tolerance: float = 0.0,
        colour: Mapping[str, Sequence[float]] | None = None,
        running: bool = False,
    ) -> None:
        self.machine, self.experiments = machine, list(experiments)
        self.physics, self.values = machine.model, dict(machine.parameters)
        self.noise = noise or residual_noise(self.machine, self.experiments)
        #: Noise of each channel in the deviations by which residuals are divided.
        self.level = (1.0, 1.0)
        #: Of these, what the noise is sample by sample: less where steps of a sensor repeat.
        self.whiteness = (1.0, 1.0)
        #: Power of what the steps of a speed sensor round off, in deviations of the noise.
        self.rounding = 0.0
        self.workers = workers
        #: Done so far, of runs side by side; shared by all parts of a recording.
        self.work, self.price = Work(), self._price()
        #: Time constant with which the motor forgets its speed [s].
        self.memory = memory(self.physics.folded(self.values))
        slow = [abs(float(e.speed[0])) <= AT_REST * self.noise[0] for e in self.experiments]
        #: Whether any of them began in motion: then one that began near 0 may have passed it.
        self.running = running or not all(slow)
        self.pieces: list[PreparedExperiment] = []
        at = 0
        for e, rest in zip(self.experiments, slow, strict=True):
            flows = (CURRENT,) if first_current(e) is not None else ()
            unknown = (SPEED, CURRENT) if self.running else flows
            columns = motor_columns(self.physics.folded(self.values), e, unknown, self.noise)
            self.pieces.append(PreparedExperiment(e, rest, slice(at, at + len(columns)), columns))
            at += len(columns)
        #: Residuals in all.
        self.size = at
        #: Start states as they are known before any effect is.
        self.starts = StartStates(
            np.zeros(len(self.pieces)),
            tuple(basis_of(p.columns) for p in self.pieces),
            (NO_OFFSET,) * len(self.pieces),
        )
        self._angles: dict[str, bool] = {}
        self._always_led = False
        #: Whether the machine shakes a foundation as its file knows it.
        self.shaking = self.physics.shakes(self.values)
        self._begin()
        if noise is None:
            self._repeat()
        self._colour(colour or {})
        if tolerance > 0:
            self._tolerate(tolerance)

    def _repeat(self) -> None:
        """Take the noise for as large as white noise that tells as little as repeated steps."""
        current = [e.current for e in self.experiments if e.current is not None]
        steps = sensor_step([e.speed for e in self.experiments]), sensor_step(current)
        if not any(steps):
            return
        runs = [Simulated(i, (), float(a)) for i, a in enumerate(self.starts.angles)]
        shown = self.simulated(runs, SEARCH_STEP)
        wider = [
            math.sqrt(rounding_correlation([np.nan_to_num(run[k]) for run in shown], step, noise))
            for k, (step, noise) in enumerate(zip(steps, self.noise, strict=True))
        ]
        self.whiteness = 1.0 / wider[0], 1.0 / wider[1]
        self._widen(*wider)
        samples = sum(len(e) for e in self.experiments)
        self.rounding = samples * (ROUNDING * steps[0] / self.noise[0]) ** 2

    def _colour(self, colour: Mapping[str, Sequence[float]]) -> None:
        """Take the noise for as large as white noise that is as strong at low frequencies."""
        white = [1.0, 1.0]
        for channel, name in enumerate(CHANNELS):
            if name in colour and self.whiteness[channel] == 1.0:
                rough, whole, slow = colour[name]
                wider = [1.0, 1.0]
                wider[channel], white[channel] = slow / rough, whole / slow
                self._widen(*wider)
        self.whiteness = self.whiteness[0] * white[0], self.whiteness[1] * white[1]

    def _price(self) -> int:
        """A motor's steps for a sample, as far as the machine without any effect tells."""
        period = max((e.period for e in self.experiments), default=SEARCH_STEP)
        rate = motor_rate(self.physics.folded(self.values))
        if rate * MAX_STEP > MAX_STEP_RATE:
            return USUAL_ROUNDS * math.ceil(period / SEARCH_STEP)
        return math.ceil(period / min(SEARCH_STEP, MAX_STEP_RATE / rate))

    def _tolerate(self, tolerance: float) -> None:
        """Take the noise to be as large as the laws' own errors are likely to be."""
        rest, gap, count = self.of(), [0.0, 0.0], [0, 0]
        for piece in self.pieces:
            for channel, rows in enumerate(piece.channels):
                part = rest[rows]
                gap[channel] += float(part @ part) - part.size
                count[channel] += part.size
        speed, current = (max(g / max(n, 1), 0.0) for g, n in zip(gap, count, strict=True))
        wider = [math.sqrt(1.0 + tolerance**2 * power) for power in (speed, current)]
        # The speed is what is to be predicted: a current measured well adds to what is known of
        # it, but its gap does not outweigh the speed's.
        wider[1] = max(wider[1], math.sqrt(current / max(speed / wider[0] ** 2, 1.0)))
        self.level = 1.0 / wider[0], 1.0 / wider[1]
        self._widen(*wider)

    def _widen(self, speed: float, current: float) -> None:
        """Multiply the deviations by which residuals are divided."""
        if speed == current == 1.0:
            return
        self.noise = self.noise[0] * speed, self.noise[1] * current
        self.rounding /= speed**2
        for piece in self.pieces:  # the columns' channels are weighed by the noise
            length = len(piece.experiment)
            piece.columns[:length] /= speed
            piece.columns[length:] /= current
        bases = tuple(basis_of(p.columns) for p in self.pieces)
        self.starts = StartStates(self.starts.angles, bases, self.starts.offsets)
        self._begin()

    def _begin(self) -> None:
        """Seek the start states of the machine without any effect, where they are not linear."""
        if self.shaking:
            self.starts = searched_start_states(self, (), True, True, True, SEARCH_STEP)
        elif self.machine.effects:
            self.starts = self.start_states(())

    def part(self, numbers: Sequence[int]) -> FreeRunResiduals:
        """The residuals with some of the experiments only, by their place in the list."""
        return self.of_only([self.experiments[i] for i in numbers], self.workers)

    def of_only(self, experiments: Sequence[Experiment], workers: int) -> FreeRunResiduals:
        """The residuals of some of the experiments, or of parts of them."""
        known = self.machine, experiments, self.noise, workers
        part = FreeRunResiduals(*known, running=self.running)
        part.level, part.whiteness = self.level, self.whiteness
        self.work.add(part.work.steps)
        part.work = self.work
        return part

    def of(
        self, use: Use = (), step: float = SEARCH_STEP, starts: StartStates | None = None
    ) -> Array:
        """(size,) residuals with these effects, in noise deviations, start states projected out.

        Args:
            step: longest integration step [s].
            starts: as `start_states` found them for such effects; None takes `self.starts`.
        """
        return next(self.of_all([use], step, starts))

    def of_all(
        self, uses: Sequence[Use], step: float = SEARCH_STEP, starts: StartStates | None = None
    ) -> Iterator[Array]:
        """The same with each of these sets of effects, several simulations at once."""
        begun = self.starts if starts is None else starts
        angles, asked = begun.angles.tolist(), itertools.product(uses, range(len(self.pieces)))
        runs = [Simulated(i, use, angles[i], begun.offsets[i]) for use, i in asked]
        left = self.differences(runs, step)
        for _ in uses:
            row = np.empty(self.size)
            for piece, basis in zip(self.pieces, begun.bases, strict=True):
                row[piece.rows] = project_out(next(left), basis)
            yield row

    def start_states(
        self,
        use: Use,
        free: bool = False,
        step: float = SEARCH_STEP,
        near: StartStates | None = None,
    ) -> StartStates:
        """Start states for these effects; see `start_states_for`."""
        return start_states_for(self, use, free, step, near)

    def changed(self, use: Use) -> Values | None:
        """The machine's parameters with these effects; None where they are impossible."""
        try:
            return self.physics.changed(self.values, use)
        except LdtError:
            return None

    def differences(self, runs: Sequence[Simulated], step: float) -> Iterator[Array]:
        """(rows,) measured minus simulated of each, in noise deviations."""
        limit, longest = DIVERGED_SPEED / self.noise[0], max(len(e) for e in self.experiments)
        some = math.ceil(SAMPLES_AT_ONCE / (WIDTH * longest)) * WIDTH
        parts = (self.simulated(runs[i : i + some], step) for i in range(0, len(runs), some))
        for run, (speed, current) in zip(runs, itertools.chain.from_iterable(parts), strict=True):
            e = self.experiments[run.place]
            rest = (e.speed - speed) / self.noise[0]
            if e.current is not None:
                rest = np.concatenate([rest, (e.current - current) / self.noise[1]])
            np.clip(rest, -limit, limit, out=rest)
            if math.isnan(rest.sum()):
                rest[np.isnan(rest)] = limit
            yield rest

    def own_states(self, runs: Sequence[Simulated], step: float) -> list[Array]:
        """Of each, at some samples up to the last, (samples, states) of the effects.

        They are less what the effects would begin with there; zeros where no run is possible. All
        runs are of the same effects.
        """
        use = runs[0].use if runs else ()
        count = states_of(use)
        found, values = [np.zeros((1, count)) for _ in runs], self.changed(use)
        begun = [] if values is None else [self._free_run(run, values) for run in runs]
        for k, states in self.physics.simulate_all(begun, step, SHORTEST_STEP, self.workers):
            if not isinstance(states, LdtError) and np.all(np.isfinite(states)):
                some = states[:: -max(1, len(states) // STATES_SEEN)][::-1]
                first = [[v for x, p in use for v in x.first_states(state, p)] for state in some]
                found[k] = some[:, states.shape[1] - count :] - np.array(first)
        return found

    def can_simulate(self, use: Use) -> bool:
        """Whether the machine with these effects has a free run of the first experiment at all."""
        return bool(np.all(np.abs(self.outputs(0, use, follow=False)[0]) < DIVERGED_SPEED))

    def outputs(
        self,
        i: int,
        use: Use,
        step: float = SEARCH_STEP,
        angle: float = 0.0,
        follow: bool = True,
    ) -> tuple[Array, Array]:
        """Speed and current of one simulation; see `simulated`, and `Simulated` for the rest."""
        return self.simulated([Simulated(i, use, angle, follow=follow)], step)[0]

    def simulated(self, runs: Sequence[Simulated], step: float) -> list[tuple[Array, Array]]:
        """Of each (L,) speed as the sensor shows it [rad/s] and (L,) current [A].

        Args:
            step: longest integration step [s].
        """
        found, begun, about = [], [], []
        of_use: dict[int, Values | None] = {}  # all experiments are asked about the same object
        for place, asked in enumerate(runs):
            wild = np.full(len(self.experiments[asked.place]), DIVERGED_SPEED)
            found.append((wild, wild))
            if id(asked.use) not in of_use:
                of_use[id(asked.use)] = self.changed(asked.use)
            values = of_use[id(asked.use)]
            with contextlib.suppress(LdtError):
                if values is not None:
                    begun.append(self._free_run(asked, values))
                    about.append((place, values))
        costly = [r for r in begun if r.tracked[1] > 0 or any(e.terms for e, _ in r.effects)]
        prices = (TERMINAL_PRICE if any(e.terminal for e, _ in r.effects) else 1 for r in costly)
        steps = sum(np.size(r.voltage) * price for r, price in zip(costly, prices, strict=True))
        self.work.add(self.price * steps)
        for k, states in self.physics.simulate_all(begun, step, SHORTEST_STEP, self.workers):
            run, (place, values) = begun[k], about[k]
            if isinstance(states, LdtError):
                continue
            with contextlib.suppress(LdtError):
                if run.tracked[1] > 0:
                    states[:, : CURRENT + 1] -= corrections(self.physics, values, run, states)
                speed = self.physics.measure(states, run.period, run.effects)
                found[place] = speed, states[:, CURRENT].copy()
        return found

    def _free_run(self, run: Simulated, values: Values) -> FreeRun:
        """What is simulated of a machine with these parameters, changed by the effects."""
        piece, use = self.pieces[run.place], run.use
        e, physics = piece.experiment, self.physics
        seen = physics.behind_sensor(e.speed, e.period, use)
        first, known = 0.0 if piece.at_rest else float(seen[0]), first_current(e)
        start = physics.initial_state(values, first, known)
        if not piece.at_rest and physics.shakes(values):
            start = physics.running_state(values, first, run.angle, known)
        start[ANGLE] = run.angle
        start = np.concatenate([start, *(x.first_states(start, p) for x, p in use)])
        if run.offset.size:
            start[: run.offset.size] += run.offset[: start.size]
        followed = run.follow and (self._always_led or self.led(use, values))
        tracked = (seen, -math.expm1(-e.period / self.memory)) if followed else NOT_TRACKED
        return FreeRun(self.values, e.voltage, e.period, start, use, tracked, values, self.work)

    def led(self, use: Use, values: Values | None = None) -> bool:
        """Whether simulations with these effects follow the measured speed.

        Args:
            values: of the machine's parameters with them, where they are known.
        """
        values = self.changed(use) if values is None else values
        shakes = values is not None and self.physics.shakes(values)
        return shakes or self.angular(effect for effect, _ in (*self.machine.effects, *use))

    def always_led(self) -> FreeRunResiduals:
        """The same, where simulations follow the measured speed whatever acts."""
        found = copy.copy(self)
        found._always_led = True
        return found

    def angular(self, effects: Iterable[Effect]) -> bool:
        """Whether what one of the effects does depends on the angle.

        A free run's angle leaves the machine's within a few turns of a small error in speed.
        """
        for effect in effects:
            if effect.name not in self._angles:
                moved = self._turned([(effect, effect.check(effect.typical))])
                self._angles[effect.name] = moved > ANGLE_SHOWS * self.noise[0]
            if self._angles[effect.name]:
                return True
        return False

    def may_turn(self, use: Use) -> bool:
        """Whether the shaft's angle may matter: to the machine, or to what an effect reads."""
        if any("theta" in t.reads for e, _ in (*self.machine.effects, *use) for t in e.terms):
            return True
        values = self.changed(use)
        return values is None or self.physics.shakes(values) or self._turned_alone > 0

    @functools.cached_property
    def _turned_alone(self) -> float:
        return self._turned(())

    def _turned(self, use: Use) -> float:
        """By how much another start angle moves the speed [rad/s]."""
        asked = [Simulated(0, use, angle, follow=False) for angle in (0.0, 1.0)]
        (one, _), (other, _) = self.simulated(asked, SEARCH_STEP)
        return float(np.max(np.abs(one - other)))
