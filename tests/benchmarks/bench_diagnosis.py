"""The diagnosis against fitting every pair of its candidates, on the same recording."""

from __future__ import annotations

import itertools
import os
import time
from collections.abc import Iterator

import numpy as np

from ldt_core.base.settings import HOLDOUT
from ldt_core.diagnosis.candidate import Candidate
from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.diagnosis.effect_fit import fit
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.holdout import split_at_random
from ldt_core.diagnosis.library import library
from ldt_core.diagnosis.thresholds import THRESHOLDS
from ldt_core.effects import parse_effect
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine
from ldt_core.physics.machine_sizes import most_of
from tests.benchmarks.row import Row

EXPERIMENTS, CANDIDATES = 20, 20
TRIED = 6  # pairs of all, spread evenly; fitting all of them takes an hour
TRUTH = ("unbalance:e=0.005", "coulomb_friction:torque=0.05")


def run() -> Iterator[Row]:
    """One recording of 20 experiments with 2000 samples, two effects acting, 20 candidates."""
    machine = load_machine("rotor")
    acting = [parse_effect(text) for text in TRUTH]
    plant = Plant(
        machine, experiments=EXPERIMENTS, seed=1, effects=acting, degradation="none", noise=0.1
    )
    recorded = [plant.experiment(n) for n in range(1, EXPERIMENTS + 1)]
    acts = {effect.name for effect, _ in acting}
    others = [e for e in library(machine) if e.name not in acts]
    effects = [*(effect for effect, _ in acting), *others][:CANDIDATES]
    diagnose(machine, recorded[:4], effects=effects)  # compiled code is loaded
    begin = time.perf_counter()
    found = diagnose(machine, recorded, effects=effects)
    ours = time.perf_counter() - begin
    fitted, _ = split_at_random(recorded, HOLDOUT, 0)
    most = most_of(machine.parameters, max(float(np.abs(e.voltage).max()) for e in fitted))
    candidates = [Candidate(e, most) for e in effects]
    bench = FreeRunResiduals(
        machine, fitted, workers=os.cpu_count() or 1, tolerance=THRESHOLDS.law_error
    )
    pairs = list(itertools.combinations(candidates, 2))
    tried = pairs[:: len(pairs) // TRIED]
    begin = time.perf_counter()
    for pair in tried:
        fit(bench, pair, [c.coordinates(c.typical) for c in pair])
    peer = (time.perf_counter() - begin) * len(pairs) / len(tried)
    named = " and ".join(" or ".join(names) for names in found.verdict.acting)
    yield Row(
        name=f"diagnosis, {CANDIDATES} candidates with pairs, 20 experiments of 2000 samples",
        ours_s=ours,
        peer=f"scipy least_squares, once for each of {len(pairs)} pairs",
        peer_s=peer,
        aim="under 30 s",
        note=f"{os.cpu_count()} threads; peer extrapolated from {len(tried)} pairs; "
        f"answer: {named}",
    )
