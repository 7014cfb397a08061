"""A rigid motor shows its gain and its time constant: of what changes both, any two may have.

The plant is the exact solution of the first-order equation, not LDT's simulator.
"""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np
import pytest

from ldt_core.base.experiment import Experiment
from ldt_core.calibration.calibrate import calibrate
from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.estimation.grey_box import Prior
from ldt_core.machine.machine_file import machine_from_dict
from ldt_core.python_api.twin_run import run

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("one_core")]

RECORDS = 4
#: Name: parameters, supply [V], sample period [s], samples, samples for which a voltage holds.
MOTORS = {
    "flywheel": ({"R": 1.0, "L": 0.0, "K_t": 0.1, "J": 0.05, "b": 2e-4}, 24.0, 0.1, 200, 50),
    "motor": ({"R": 1.2, "L": 0.0, "K_t": 0.06, "J": 2e-4, "b": 1e-4}, 12.0, 0.01, 200, 20),
}


def records(name, seed, lag=0.0, **factors):
    """Experiments of a motor whose numbers are so many times its file's, behind a slow drive."""
    values, supply, period, samples, hold = MOTORS[name]
    p = {k: v * factors.get(k, 1.0) for k, v in values.items()}
    random, found = np.random.default_rng(seed), []
    rate = (p["b"] + p["K_t"] ** 2 / p["R"]) / p["J"]
    gain, noise = p["K_t"] / (p["R"] * p["J"] * rate), 0.003 * supply / values["K_t"]
    fine = 50  # steps of the drive's lag in a sample
    for number in range(1, RECORDS + 1):
        volts = np.repeat(random.uniform(-supply, supply, samples // hold + 1), hold)[:samples]
        speed, given, now = np.zeros(samples), 0.0, 0.0
        for k in range(samples - 1):
            for _ in range(fine if lag else 1):
                step = period / (fine if lag else 1)
                before, given = given, volts[k]
                if lag:
                    given = volts[k] + (before - volts[k]) * math.exp(-step / lag)
                mean = (before + given) / 2 if lag else given
                now += (gain * mean - now) * -math.expm1(-rate * step)
            speed[k + 1] = now
        shown = speed + random.normal(0, noise, samples)
        found.append(Experiment(number, 100.0 * number, period, volts, shown))
    return found


@functools.cache
def calibrated(name):
    """The motor's file, from a data sheet, after records of the healthy machine."""
    values, supply, period, samples, _ = MOTORS[name]
    random = np.random.default_rng(77)
    sheet = {k: float(v * random.uniform(0.95, 1.05)) for k, v in values.items()}
    about = {
        "name": name,
        "physics": "dc_motor",
        "parameters": sheet,
        "limits": {"voltage": [-supply, supply]},
        "experiment": {"duration": samples * period, "sample_period": period},
    }
    fit = calibrate(machine_from_dict(about, name), records(name, 11))
    return fit.with_recordings(["healthy"]).machine


def named(name, **changes):
    """The groups of names for what a calibrated motor's change is."""
    return diagnose(calibrated(name), records(name, 1011, **changes)).verdict


def test_any_two_numbers_that_change_both_are_told():
    """None is named alone that some of the sets as good lack."""
    found = named("motor", J=0.8, b=6.0)
    assert found.kind == "ambiguous"
    assert len(found.acting) == 2
    first, second = map(set, found.acting)
    assert {"inertia", "viscous_friction"} in ({a, b} for a in first for b in second)


def test_a_slow_drive_looks_like_a_slow_sensor():
    """Neither is named without the other, where no current tells them apart."""
    found = named("motor", lag=0.03)
    assert found.kind == "ambiguous"
    assert [set(group) for group in found.acting] == [{"input_lag", "sensor_lag"}]


@pytest.mark.parametrize("name", list(MOTORS))
def test_a_twin_names_no_single_number_that_two_have_changed(name):
    """What a calibration knows of the numbers together leaves none that explains both alone."""
    before, after = records(name, 500), records(name, 501, J=0.75, b=6.0)
    stream = [replace(e, number=k) for k, e in enumerate([*before, *after], start=1)]
    said = run(stream, calibrated(name)).summary.learned
    assert f"experiment {RECORDS + 1}" in said
    assert "not told apart" in said or "not known" in said


def test_what_a_calibration_knows_together_is_the_prior():
    """The time constant J R / K_t^2, ten times better than its numbers' tolerances leave it."""
    machine, powers = calibrated("motor"), {"J": 1, "R": 1, "K_t": -2}
    names = list(powers)
    slope = np.array([powers[n] * machine.tolerances[n] for n in names])
    together, apart = (
        math.sqrt(slope @ np.linalg.inv(prior.precision) @ slope)
        for prior in (Prior.of_file(machine, names), Prior.apart(len(names)))
    )
    assert together < 0.15 * apart
