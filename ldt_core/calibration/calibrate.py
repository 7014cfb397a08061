"""`calibrate`: which parameters to fit, the fit, and what may be said of the result."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from ldt_core.base.arrays import Array
from ldt_core.base.errors import ExperimentError, LdtError, OptionError, did_you_mean
from ldt_core.base.experiment import Experiment
from ldt_core.base.metrics import FreeRunError
from ldt_core.calibration.calibration import (
    WITHHELD,
    Calibration,
    Posterior,
    Reason,
    bound_notes,
    doubtful,
    free_run_error,
    notes,
    nothing_determined,
    recording_notes,
    refuse_absurd,
)
from ldt_core.calibration.calibration_runs import DIFFERENCE_INTEGRATED, CalibrationRuns
from ldt_core.calibration.coordinates import Coordinate, Coordinates
from ldt_core.calibration.fitted import Fitted, estimates_of
from ldt_core.calibration.held_out import split_evenly
from ldt_core.calibration.identifiability import (
    MOST_ERROR,
    Identifiability,
    coloured,
    identifiability,
    uncertainty,
)
from ldt_core.calibration.lack_of_fit import lack_of_fit
from ldt_core.calibration.parameter_fit import coordinate, fit, starts
from ldt_core.calibration.prior_knowledge import (
    DIAGNOSED,
    DIFFERENCE_BESIDE_PRIOR,
    ToleranceLaw,
    deviation,
    known_together,
    widened,
)
from ldt_core.machine.current_check import wrong_current
from ldt_core.machine.machine_file import Machine
from ldt_core.physics.effect import Effect
from ldt_core.physics.known_effects import changed_numbers
from ldt_core.physics.parameter import Parameter, is_own, own_name

FEWEST_SAMPLES = 10  # of an experiment: fewer do not even show its start state
PASSES = 6  # fits with another set of free parameters, should one not hold at its own solution
FAILURE_RATIO = 1.001  # of the error to the one before: a fit that ends above it has failed
GAIN_RATIO = 0.99  # of the error to the one before: above it the file's values were as good


def calibrate(
    machine: Machine,
    experiments: Sequence[Experiment],
    *,
    free: Sequence[str] = (),
    fixed: Sequence[str] = (),
    holdout: float | None = None,
    acting: Sequence[tuple[Effect, Mapping[str, float]]] = (),
    along: Sequence[tuple[Effect, Mapping[str, float]]] = (),
    tick: Callable[[str], None] = lambda doing: None,
) -> Calibration:
    """Fit a machine's parameters to experiments, in free run.

    The largest set that the experiments determine is fitted, the rest stays at the machine file's
    values. Of parameters named in `free`, those whose values hang on others' have no interval.
    Where the file states standard deviations, or with `acting`, all parameters are fitted within
    their tolerances instead (`prior_knowledge`). Where the physics plainly lacks something, nothing
    has an interval (`lack_of_fit`).

    Args:
        machine: nominal values, bounds from its physics.
        experiments: measured; each a free run of its own.
        free: names to fit.
        fixed: names that stay; not together with `free`.
        holdout: share of the experiments to judge by, None for a quarter when there are at least 4.
        acting: effects to take into the machine file and to fit along, from these values.
        along: changes of the file's own numbers, from where another fit begins; the better counts.
        tick: called often with what is being done, for a progress display.

    Raises:
        OptionError: an unknown name, both lists, or nothing left to fit.
        MachineFileError: an effect that the machine cannot have, or one of a user's own file.
        ExperimentError: an experiment outside the machine's limits or too short.
        LdtError: the experiments determine nothing, or the fit failed.
    """
    before, machine = machine, machine.with_effects(acting) if acting else machine
    check_names(machine, free, fixed)
    for e in experiments:
        machine.check(e)
        if len(e) < FEWEST_SAMPLES:
            raise ExperimentError(
                f"experiment {e.number}", f"{FEWEST_SAMPLES} samples or more", len(e)
            )
    if words := wrong_current(machine, experiments):
        expected = "the motor's (check its unit and sign, and R in the machine file)"
        raise ExperimentError("the recording, current", expected, words)
    kept, held_out, part = split_evenly(experiments, holdout)
    if any(e.voltage.any() for e in kept) and not any(e.speed.any() for e in kept):
        raise LdtError("nothing to calibrate: the speed is 0 rad/s throughout; check the sensor")
    with threadpool_limits(1):  # sums in one order: the same numbers on every run
        taken = [own_name(e.name, p.name) for e, _ in acting for p in e.parameters]
        work = _Work(before, machine, kept, list(free), list(fixed), taken, tick)
        work.begin_also(along)
        try:
            return work.result(held_out, part)
        except LdtError as error:
            raise doubtful(error, before, kept) from error


def check_names(machine: Machine, free: Sequence[str], fixed: Sequence[str]) -> None:
    """Refuse names that the machine lacks, and both lists at once, with an OptionError."""
    if free and fixed:
        raise OptionError("--free", "either the free parameters or the fixed ones", "both")
    known = [p.name for p in machine.model.parameters]
    for option, names in (("--free", free), ("--fixed", fixed)):
        for name in names:
            if name not in known:
                raise OptionError(option, did_you_mean(name, known), repr(name))
    if set(known) <= set(fixed):
        raise OptionError("--fixed", "a list that leaves a parameter free", "all of them")


class _Work:
    def __init__(
        self,
        before: Machine,
        machine: Machine,
        experiments: list[Experiment],
        free: list[str],
        fixed: list[str],
        taken: list[str],
        tick: Callable[[str], None],
    ) -> None:
        open_ones = machine.deviations.keys() | taken
        changed = set() if free else changed_numbers(machine.model, machine.parameters, open_ones)
        kept = {n: std for n, std in machine.deviations.items() if n not in changed}
        self.machine = machine = replace(machine, deviations=kept)
        self.physics, self.experiments = machine.model, experiments
        self.before = before
        #: Relative standard deviations that count as known; None fits without any.
        self.prior = {**machine.tolerances, **dict.fromkeys(taken, DIAGNOSED)}
        self.joint = bool(taken or machine.deviations)
        self.together = known_together(before, taken)
        self.named = free = [*free, *(n for n in taken if n not in free)] if free else []
        self.values: Mapping[str, float] = machine.parameters
        self.other_starts: list[Mapping[str, float]] = []
        self.reasons: dict[str, str] = {}
        for p in self.physics.parameters:
            if free and p.name not in free:
                self.reasons[p.name] = Reason.NOT_NAMED
            elif p.name in fixed:
                self.reasons[p.name] = Reason.AS_ASKED
            elif free or p.name in taken:
                continue
            elif p.name in changed:
                self.reasons[p.name] = Reason.CHANGED
            elif is_own(p.name) and p.name not in machine.deviations:
                self.reasons[p.name] = Reason.EXACT
            elif p.default is not None or self.values[p.name] == 0:
                self.reasons[p.name] = Reason.OPTIONAL
        self._doing = "looking at what the recording determines"
        self._tick = tick

    def begin_also(self, changes: Sequence[tuple[Effect, Mapping[str, float]]]) -> None:
        """Begin another fit from the file's values with these changes."""
        values = self.values
        for effect, given in changes:
            values = effect.change_parameters(self.physics, values, given)
        self.other_starts += [values] if changes else []

    def tick(self) -> None:
        self._tick(self._doing)

    def result(self, held_out: list[Experiment], beside: list[str]) -> Calibration:
        state = self._fitted()
        self._doing = "looking for what the physics lacks"
        beforehand = state.prior.rows if state.prior else None
        lack = lack_of_fit(
            self.machine, state.runs, state.coordinates, state.z, state.sensitivities, beforehand
        )
        state.lacking = lack.names
        imitated = lack.shifts / state.coordinates.sizes(state.z)
        known = state.known.widened(state.coordinates.names, imitated)
        estimates, machine, determined = estimates_of(
            state, self.machine, self.prior, bool(self.named)
        )
        if not state.seen.determined:
            nominal = free_run_error(self.before, self.experiments)
            if free_run_error(machine, self.experiments).rmse < GAIN_RATIO * nominal.rmse:
                raise LdtError(nothing_determined(self.experiments))
            estimates = [replace(e, value=e.nominal, std=None) for e in estimates]
            machine = self.before
        fixed = dict(self.reasons)
        for name in state.seen.names:
            if name not in state.coordinates.names and not self.named:
                fixed[name] = Reason.SILENT if name in state.seen.silent else Reason.GROUPED
        errors: dict[str, tuple[FreeRunError, FreeRunError]] = {}
        numbers: dict[str, list[int]] = {}
        for part, experiments in (("fit", self.experiments), ("held_out", held_out)):
            if experiments:
                before = free_run_error(self.before, experiments)
                errors[part] = (before, free_run_error(machine, experiments))
                numbers[part] = [e.number for e in experiments]
        before, after = errors["fit"]
        if after.rmse > FAILURE_RATIO * before.rmse and not self._start_explains(state):
            raise LdtError(
                f"calibration failed: the free-run error did not go down ({before.rmse:.4g} rad/s "
                f"before, {after.rmse:.4g} rad/s after); "
                "free other parameters or check the machine file"
            )
        vague = [[n] for n, reason in self.reasons.items() if reason == Reason.VAGUE]
        if state.lacking != ():
            refuse_absurd(state.coordinates, state.z, after, self.experiments)
        noise = {"speed": state.runs.noise[0]}
        if state.runs.has_current:
            noise["current"] = state.runs.noise[1]
        calibration = Calibration(
            nominal=self.machine,
            machine=machine,
            estimates=tuple(estimates),
            fixed={p.name: fixed[p.name] for p in self.physics.parameters if p.name in fixed},
            undetermined=state.seen.clusters + vague,
            noise=noise,
            coloured=coloured(noise, state.runs.residuals(state.values), self.experiments),
            posterior=known if determined and lack.names is not None else None,
            intervals=WITHHELD if state.lacking != () else state.uncertainty.method,
            lacking=None if state.lacking is None else list(state.lacking),
            errors=errors,
            experiments=numbers,
            notes=(),
        )
        told = beside + notes(calibration, state.seen, state.runs.white, GAIN_RATIO)
        told += bound_notes(state.coordinates, state.z)
        told += recording_notes(self.machine, self.experiments)
        if not state.converged:
            told.append(
                "The fit had not quite settled when it was stopped; the values may still move a "
                "little."
            )
        return replace(calibration, notes=tuple(told)).with_recordings(())

    def _start_explains(self, state: Fitted) -> bool:
        """Whether the fit went down and only the noise of the first samples says otherwise."""
        nominal = CalibrationRuns(self.physics, self.machine.parameters, self.experiments)
        nominal.noise = list(state.runs.noise)
        nominal.settle(self.machine.parameters)
        before = np.concatenate(nominal.residuals(self.machine.parameters))
        after = np.concatenate(state.runs.residuals(state.values))
        return float(after @ after) <= float(before @ before)

    def _fitted(self) -> Fitted:
        """Fit, and again with other parameters free until the set holds at its own solution."""
        prefer: tuple[str, ...] = ()
        values: Mapping[str, float] = self.values
        for last in (False,) * (PASSES - 1) + (True,):
            state = self._fit_once(values, prefer)
            if not state.seen.determined:
                return state
            if set(state.seen.determined) != set(state.coordinates.names) and not last:
                prefer, values = state.seen.determined, state.values
                continue
            errors = state.uncertainty.errors / state.coordinates.sizes(state.z)
            worst = int(np.argmax(errors))
            if self.joint or self.named or errors[worst] <= MOST_ERROR or last:
                return state
            self.reasons[state.coordinates.names[worst]] = Reason.VAGUE
            prefer, values = (), self.values
        raise AssertionError  # the last pass returns

    def _fit_once(self, values: Mapping[str, float], prefer: tuple[str, ...]) -> Fitted:
        self._doing = "looking at what the recording determines"
        parameters = [p for p in self.physics.parameters if p.name not in self.reasons]
        if not parameters:
            raise LdtError(nothing_determined(self.experiments))
        whole = Coordinates([self._coordinate(p) for p in parameters], self.values)
        if values is self.values:
            runs = CalibrationRuns(self.physics, self.values, self.experiments, self.tick)
            candidates = starts(self.physics, whole, runs)
            candidates += [whole.inside(whole.at(start)) for start in self.other_starts]
        else:
            candidates = [whole.at(values)]
        at = whole.values(whole.inside(candidates[0]))
        runs = CalibrationRuns(self.physics, at, self.experiments, self.tick)
        runs.settle(at, estimate=False)
        seen, _ = self._examine(runs, whole, candidates[0], prefer)
        if not seen.determined:
            raise LdtError(nothing_determined(self.experiments))
        inner = Coordinates([c for c in whole.free if c.name in seen.determined], self.values)
        picked = [whole.names.index(n) for n in inner.names]
        prior = ToleranceLaw(inner, self.prior, self.together) if self.joint else None
        best: tuple[Array, bool, CalibrationRuns] | None = None
        least = math.inf
        for number, start in enumerate(candidates, start=1):
            self._doing = "fitting " + ", ".join(inner.names)
            if len(candidates) > 1:
                self._doing += f" (start {number} of {len(candidates)})"
            fresh = CalibrationRuns(self.physics, at, self.experiments, self.tick)
            done = fit(fresh, inner, start[picked], prior)
            off = prior.residuals(done[0]) if prior else np.zeros(0)
            loss = fresh.log_noise + 0.5 * float(off @ off)
            if best is None or loss < least:
                best, least = (*done, fresh), loss
        assert best is not None
        z, converged, runs = best
        self._doing = "estimating the intervals"
        solution = whole.at(inner.values(z))
        seen, sensitivities = self._examine(runs, whole, solution, tuple(inner.names))
        raw = [s[:, [whole.names.index(n) for n in inner.names]] for s in sensitivities]
        if prior:
            exact = self.physics.is_linear(inner.values(z))
            sensitivities = prior.informative(sensitivities, z, exact)
        bound = {c.name for c in inner.on_bound(z)}
        seen = seen.with_settled(bound)
        free = [j for j, name in zip(picked, inner.names, strict=True) if name not in bound]
        varying = [j for j, name in enumerate(inner.names) if name not in bound]
        spread = uncertainty(
            [s[:, free] for s in sensitivities],
            runs.residuals(inner.values(z)),
            [len(e) for e in self.experiments],
            runs.unknowns,
            prior.precision[np.ix_(varying, varying)] if prior else None,
        ).among([name not in bound for name in inner.names])
        picked_out = [s[:, free] for s in sensitivities]
        kept = [c for c in whole.free if c.name not in inner.names]
        vague = {n for n, reason in self.reasons.items() if reason == Reason.VAGUE}
        kept += [self._coordinate(p) for p in self.physics.parameters if p.name in vague]
        tolerances = self.machine.tolerances
        kept = [c for c in kept if tolerances.get(c.name) and c.nominal]
        others = Coordinates(kept, inner.values(z))
        spread, root = widened(
            spread,
            picked_out,
            runs.sensitivities(others, others.nominal) if kept else [],
            [deviation(c, tolerances[c.name]) for c in kept],
            [name not in bound for name in inner.names],
        )
        sizes = np.concatenate([inner.sizes(z), others.sizes(others.nominal)])
        names = (*inner.names, *others.names)
        shown = [j for j, name in enumerate(names) if name not in seen.silent]
        root = (root / sizes[:, None])[shown]
        root = root[:, np.abs(root).max(axis=0, initial=0.0) > 0]
        known = Posterior(tuple(names[j] for j in shown), root)
        return Fitted(whole, inner, runs, z, converged, seen, spread, raw, known, prior)

    def _coordinate(self, parameter: Parameter) -> Coordinate:
        return coordinate(self.physics, self.values, parameter, self.experiments)

    def _examine(
        self, runs: CalibrationRuns, whole: Coordinates, z: Array, prefer: tuple[str, ...]
    ) -> tuple[Identifiability, list[Array]]:
        step = DIFFERENCE_BESIDE_PRIOR if self.joint else DIFFERENCE_INTEGRATED
        sensitivities = runs.sensitivities(whole, whole.inside(z), step)
        exact = self.physics.is_linear(whole.values(z))
        if self.joint:  # what the data do not tell apart, the prior does
            return Identifiability(tuple(whole.names), tuple(whole.names), {}, ()), sensitivities
        rows = np.vstack(sensitivities) * whole.sizes(z)
        return identifiability(whole.names, rows, exact, prefer), sensitivities
