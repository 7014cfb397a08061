"""A gear whose teeth have play, by the challenge's plant: contact that stiffens, full damping."""

from __future__ import annotations

import numpy as np
import pytest
from recorded_machines import candidates

from ldt_core.base.experiment import Experiment
from ldt_core.diagnosis.effect_set_search import EffectSetSearch
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.lab.challenge.case_plant import ideal
from ldt_core.lab.challenge.simulation import Drive, motion_from_rest
from ldt_core.machine.machine_file import machine_from_dict

PERIOD, SAMPLES, NOISE = 1e-3, 1000, 0.02
NAMES = ["backlash", "torsional_compliance", "inertia", "motor_constant", "armature_resistance"]
NUMBERS = {"J": 1.04e-3, "K_t": 0.338, "R": 0.88, "L": 2.06e-3, "b": 0.0104}


def driven(plant, number, random):
    volts = np.repeat(random.uniform(-24, 24, 5), SAMPLES // 5)
    moved = motion_from_rest(plant, Drive(volts, 0, PERIOD), random)
    shown = moved.speed + random.normal(0, NOISE, SAMPLES)
    return Experiment(number, 2.0 * number, PERIOD, volts, shown)


def test_a_gear_with_play_is_found_beside_another_change():
    """It was an elastic coupling, or unknown."""
    data = {
        "name": "geared",
        "physics": "dc_motor",
        "parameters": NUMBERS,
        "limits": {"voltage": [-24, 24]},
        "experiment": {"duration": SAMPLES * PERIOD, "sample_period": PERIOD},
    }
    machine = machine_from_dict(data, "geared.yaml")
    plant = ideal(machine.parameters)
    plant["K"] *= 0.9
    plant["far"] = 0.44 * NUMBERS["J"]
    plant["J"] -= plant["far"]
    plant["coupling"], plant["coupling_damping"], plant["coupling_cubic"] = 40.0, 0.016, 11.0
    plant["backlash"] = 0.25
    random = np.random.default_rng(3)
    residuals = FreeRunResiduals(machine, [driven(plant, k, random) for k in (1, 2)])
    found = EffectSetSearch(residuals, candidates(machine, NAMES)).run()
    best = found.of_size(2)[0]
    assert best.names == ("backlash", "motor_constant")
    left = found.band.excess(best.residual)
    assert left < 0.1 * found.excess  # 3 %; 27 % before, by fits that stayed where they began
    (slack,) = (given["slack"] for effect, given in best.use if effect.name == "backlash")
    assert slack == pytest.approx(0.5, rel=0.1)
