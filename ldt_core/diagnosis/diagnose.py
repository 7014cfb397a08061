"""The diagnosis from end to end."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ldt_core.base.evenly_spread import evenly_spread
from ldt_core.base.experiment import Experiment
from ldt_core.base.settings import HOLDOUT
from ldt_core.base.threads import cores, one_thread
from ldt_core.diagnosis.candidate import Candidate
from ldt_core.diagnosis.diagnosis import Diagnosis
from ldt_core.diagnosis.effect_set_search import EffectSetSearch
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.holdout import split_at_random, without_fragments
from ldt_core.diagnosis.isolability import isolability
from ldt_core.diagnosis.library import library
from ldt_core.diagnosis.nominal_prior import known_colour, nominal_prior
from ldt_core.diagnosis.recorded_times import without_repeats
from ldt_core.diagnosis.standing import standing
from ldt_core.diagnosis.thresholds import THRESHOLDS
from ldt_core.diagnosis.verdict import decide
from ldt_core.diagnosis.verdict_report import VerdictReport
from ldt_core.effects import sizes_of
from ldt_core.machine.current_check import without_wrong_current
from ldt_core.machine.direction_check import swapped
from ldt_core.machine.machine_file import Machine
from ldt_core.machine.sensor_check import sound
from ldt_core.physics.effect import Effect
from ldt_core.physics.machine_sizes import machine_scales, most_of

NO_VOLTAGE = 1e-9  # of the machine's limit: it has no sizes to look for effects in, as at 0 V


def diagnose(
    machine: Machine,
    experiments: Sequence[Experiment],
    *,
    recordings: Sequence[str] = (),
    effects: Sequence[Effect] | None = None,
    refit: Sequence[str] | None = None,
    holdout: float = HOLDOUT,
    seed: int = 0,
    workers: int | None = None,
    tick: Callable[[str], None] = lambda doing: None,
) -> Diagnosis:
    """Where the gap between a machine and its file lies, what causes it, how far that closes it.

    The first experiment with a speed that no machine can have, and all after it, are left out.
    Where fewer than `trusted_experiments` came before it, the verdict is "unknown": what a faulty
    sensor shows is no effect of the machine. So is a current of another unit or sign.

    Args:
        effects: candidates; None takes the library. One that is known of the machine is a candidate
            for what has become of it.
        refit: parameters of the machine to fit with every set, see `nominal_prior`.
        workers: threads; None takes one for each core that it may use.

    Raises:
        BadInput: too little to go by.
    """
    workers = workers or cores()
    experiments, repeated = without_repeats(experiments)
    experiments, short = without_fragments(experiments)
    trusted, fault = sound(machine, experiments)
    experiments, odd = without_wrong_current(machine, experiments)
    only = len(trusted) < THRESHOLDS.trusted_experiments
    experiments, part = evenly_spread(trusted if fault and not only else experiments)
    beside = "; ".join(filter(None, [repeated, short, odd, part, swapped(experiments)]))
    fitted, held = split_at_random(experiments, holdout, seed)
    most = max(float(np.abs(e.voltage).max()) for e in fitted)
    if most < NO_VOLTAGE * max(map(abs, machine.voltage_limits)):
        most = 1.0
    sizes = machine_scales(machine.parameters, most)
    largest = most_of(machine.parameters, most)
    prior = nominal_prior(machine, refit, recordings)
    candidates = [
        Candidate(
            machine.effect(e.name) if e.name in machine.acting else e, largest, sizes_of(e, sizes)
        )
        for e in (library(machine) if effects is None else effects)
        if prior is None or e.name not in prior.swallowed
    ]
    with one_thread():  # matrices are small: more threads wait for each other, and round otherwise
        residuals = FreeRunResiduals(
            machine,
            fitted,
            workers=workers,
            tolerance=THRESHOLDS.law_error,
            colour=known_colour(machine, recordings),
        )
        search = EffectSetSearch(residuals, candidates, tick, prior)
        tick("what this recording can tell apart")
        silent, groups = isolability(search)
        search.twins = {
            n: {o for g in groups if n in g for o in g} - {n} for g in groups for n in g
        }
        decision = decide(search, seed, bool(fault) and only)
        stands = standing(machine, search, decision, fitted, held, seed)
        report = VerdictReport(
            machine, search, stands, fitted, held, recordings, seed, tick, fault, prior, beside
        )
        return report.diagnosis(silent, groups)
