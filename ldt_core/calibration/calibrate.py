"""`calibrate`: which parameters to fit, the fit, and what may be said of the result."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from ldt_core.base.arrays import Array
from ldt_core.base.errors import ExperimentError, LdtError, OptionError, did_you_mean
from ldt_core.base.experiment import Experiment
from ldt_core.base.metrics import FreeRunError
from ldt_core.calibration.calibration import (
    Calibration,
    ParameterEstimate,
    Reason,
    bound_notes,
    excitation_notes,
    free_run_error,
    notes,
    nothing_determined,
    rounded,
)
from ldt_core.calibration.coordinates import Coordinates
from ldt_core.calibration.identifiability import (
    MOST_ERROR,
    Identifiability,
    Uncertainty,
    examine,
    uncertainty,
)
from ldt_core.calibration.parameter_fit import CalibrationRuns, coordinate, fit, starts
from ldt_core.machine.machine_file import Machine

HOLDOUT = 0.25  # share of the experiments to judge by, unless said otherwise
LEAST_TO_HOLD_OUT = 4  # experiments; fewer are all needed for the fit
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
    tick: Callable[[str], None] = lambda doing: None,
) -> Calibration:
    """Fit a machine's parameters to experiments, in free run.

    The largest set that the experiments determine is fitted, the rest stays at the machine file's
    values. Of parameters named in `free`, those whose values hang on others' have no interval.

    Args:
        machine: nominal values, bounds from its physics.
        experiments: measured; each a free run of its own.
        free: names to fit.
        fixed: names that stay; not together with `free`.
        holdout: share of the experiments to judge by, None for a quarter when there are at least 4.
        tick: called often with what is being done, for a progress display.

    Raises:
        OptionError: an unknown name, both lists, or nothing left to fit.
        ExperimentError: an experiment outside the machine's limits or too short.
        LdtError: the experiments determine nothing, or the fit failed.
    """
    check_names(machine, free, fixed)
    for e in experiments:
        machine.check(e)
        if len(e) < FEWEST_SAMPLES:
            raise ExperimentError(
                f"experiment {e.number}", f"{FEWEST_SAMPLES} samples or more", len(e)
            )
    kept, held_out = split(experiments, holdout)
    with threadpool_limits(1):  # sums in one order: the same numbers on every run
        return _Work(machine, kept, list(free), list(fixed), tick).result(held_out)


def split(
    experiments: Sequence[Experiment], holdout: float | None
) -> tuple[list[Experiment], list[Experiment]]:
    """Experiments to fit, and those held out: every so many-th, so that both cover all."""
    count = len(experiments)
    if not count:
        raise OptionError("calibration", "one experiment or more", "none")
    if holdout is None:
        holdout = HOLDOUT if count >= LEAST_TO_HOLD_OUT else 0.0
    if not 0 <= holdout < 1:
        raise OptionError("--holdout", "a share from 0 to below 1", f"{holdout:g}")
    number = math.ceil(holdout * count)
    if number >= count:
        raise OptionError("--holdout", f"a share that leaves one of {count} to fit", f"{holdout:g}")
    chosen = {int((i + 0.5) * count / number) for i in range(number)}
    return (
        [e for i, e in enumerate(experiments) if i not in chosen],
        [e for i, e in enumerate(experiments) if i in chosen],
    )


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


@dataclass
class _State:
    whole: Coordinates
    coordinates: Coordinates
    runs: CalibrationRuns
    z: Array
    converged: bool
    seen: Identifiability
    uncertainty: Uncertainty

    @property
    def values(self) -> dict[str, float]:
        return self.coordinates.values(self.z)


class _Work:
    def __init__(
        self,
        machine: Machine,
        experiments: list[Experiment],
        free: list[str],
        fixed: list[str],
        tick: Callable[[str], None],
    ) -> None:
        self.machine, self.physics, self.experiments = machine, machine.model, experiments
        self.named = free
        self.values: Mapping[str, float] = machine.parameters
        self.reasons: dict[str, str] = {}
        for p in self.physics.parameters:
            if free and p.name not in free:
                self.reasons[p.name] = Reason.NOT_NAMED
            elif p.name in fixed:
                self.reasons[p.name] = Reason.AS_ASKED
            elif not free and (p.default is not None or self.values[p.name] == 0):
                self.reasons[p.name] = Reason.OPTIONAL
        self._doing = "looking at what the recording determines"
        self._tick = tick

    def tick(self) -> None:
        self._tick(self._doing)

    def result(self, held_out: list[Experiment]) -> Calibration:
        state = self._fitted()
        estimates, machine = self._estimates(state)
        if not state.seen.determined:
            nominal = free_run_error(self.machine, self.experiments)
            if free_run_error(machine, self.experiments).rmse < GAIN_RATIO * nominal.rmse:
                raise LdtError(nothing_determined(self.experiments))
            estimates = [replace(e, value=e.nominal) for e in estimates]
            machine = self.machine
        fixed = dict(self.reasons)
        for name in state.seen.names:
            if name not in state.coordinates.names and not self.named:
                fixed[name] = Reason.SILENT if name in state.seen.silent else Reason.GROUPED
        order = [p.name for p in self.physics.parameters if p.name in fixed]
        errors: dict[str, tuple[FreeRunError, FreeRunError]] = {}
        numbers: dict[str, list[int]] = {}
        for part, experiments in (("fit", self.experiments), ("held_out", held_out)):
            if experiments:
                before = free_run_error(self.machine, experiments)
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
        noise = {"speed": state.runs.noise[0]}
        if state.runs.has_current:
            noise["current"] = state.runs.noise[1]
        calibration = Calibration(
            nominal=self.machine,
            machine=machine,
            estimates=tuple(estimates),
            fixed={n: fixed[n] for n in order},
            undetermined=state.seen.clusters + vague,
            noise=noise,
            intervals=state.uncertainty.method,
            errors=errors,
            experiments=numbers,
            notes=(),
        )
        told = notes(calibration, state.seen, state.runs.white, GAIN_RATIO)
        told += bound_notes(state.coordinates, state.z)
        told += excitation_notes(self.experiments)
        if not state.converged:
            told.append(
                "The fit had not quite settled when it was stopped; the values may still move a "
                "little."
            )
        return replace(calibration, notes=tuple(told)).with_recordings(())

    def _start_explains(self, state: _State) -> bool:
        """Whether the fit went down and only the noise of the first samples says otherwise."""
        nominal = CalibrationRuns(self.physics, self.machine.parameters, self.experiments)
        nominal.noise = list(state.runs.noise)
        nominal.settle(self.machine.parameters)
        before = np.concatenate(nominal.residuals(self.machine.parameters))
        after = np.concatenate(state.runs.residuals(state.values))
        return float(after @ after) <= float(before @ before)

    def _fitted(self) -> _State:
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
            if self.named or errors[worst] <= MOST_ERROR or last:
                return state
            self.reasons[state.coordinates.names[worst]] = Reason.VAGUE
            prefer, values = (), self.values
        raise AssertionError  # the last pass returns

    def _fit_once(self, values: Mapping[str, float], prefer: tuple[str, ...]) -> _State:
        self._doing = "looking at what the recording determines"
        parameters = [p for p in self.physics.parameters if p.name not in self.reasons]
        if not parameters:
            raise LdtError(nothing_determined(self.experiments))
        whole = Coordinates(
            [coordinate(self.physics, self.values, p, self.experiments) for p in parameters],
            self.values,
        )
        if values is self.values:
            runs = CalibrationRuns(self.physics, self.values, self.experiments, self.tick)
            candidates = starts(self.physics, whole, runs)
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
        best: tuple[Array, bool, CalibrationRuns] | None = None
        for number, start in enumerate(candidates, start=1):
            self._doing = "fitting " + ", ".join(inner.names)
            if len(candidates) > 1:
                self._doing += f" (start {number} of {len(candidates)})"
            fresh = CalibrationRuns(self.physics, at, self.experiments, self.tick)
            done = fit(fresh, inner, start[picked])
            if best is None or math.prod(fresh.noise) < math.prod(best[2].noise):
                best = *done, fresh
        assert best is not None
        z, converged, runs = best
        self._doing = "estimating the intervals"
        solution = whole.at(inner.values(z))
        seen, sensitivities = self._examine(runs, whole, solution, tuple(inner.names))
        bound = {c.name for c in inner.on_bound(z)}
        seen = seen.with_settled(bound)
        free = [j for j, name in zip(picked, inner.names, strict=True) if name not in bound]
        spread = uncertainty(
            [s[:, free] for s in sensitivities],
            runs.residuals(inner.values(z)),
            [len(e) for e in self.experiments],
            runs.unknowns,
        ).among([name not in bound for name in inner.names])
        return _State(whole, inner, runs, z, converged, seen, spread)

    def _examine(
        self, runs: CalibrationRuns, whole: Coordinates, z: Array, prefer: tuple[str, ...]
    ) -> tuple[Identifiability, list[Array]]:
        sensitivities = runs.sensitivities(whole, whole.inside(z))
        exact = self.physics.is_linear(whole.values(z))
        rows = np.vstack(sensitivities) * whole.sizes(z)
        return examine(whole.names, rows, exact, prefer), sensitivities

    def _estimates(self, state: _State) -> tuple[list[ParameterEstimate], Machine]:
        estimates = []
        found = dict(zip(state.coordinates.names, state.z, strict=True))
        half = dict(zip(state.coordinates.names, state.uncertainty.half_widths, strict=True))
        unsure = state.seen.unsure if self.named else set()
        unsure |= {c.name for c in state.coordinates.on_bound(state.z)}
        for c in state.whole.free:
            if c.name not in found:
                if self.named:
                    estimates.append(
                        ParameterEstimate(c.name, c.parameter.unit, c.nominal, c.nominal, None)
                    )
                continue
            z, width, (low, high) = float(found[c.name]), float(half[c.name]), c.bounds
            interval = None
            if c.name not in unsure and width < high - low:
                ends = max(z - width, low), min(z + width, high)
                interval = (rounded(c.value(ends[0])), rounded(c.value(ends[1])))
            value = rounded(c.value(z))
            estimates.append(
                ParameterEstimate(c.name, c.parameter.unit, c.nominal, value, interval)
            )
        return estimates, self.machine.with_parameters(**{e.name: e.value for e in estimates})
