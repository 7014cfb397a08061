"""Calibrations one after the other, each from the file of the one before: no false interval.

The plant is a fan with its own equations: a rigid shaft that sticks, with drag and dry friction.
Voltage and speed alone leave the common scale of its torques open; only the file states it.
"""

from __future__ import annotations

import json

import numpy as np
import pytest

from ldt_core.base.experiment import Experiment
from ldt_core.calibration import calibrate
from ldt_core.calibration.calibration import COUNTED_TWICE
from ldt_core.calibration.identify import identify_machine
from ldt_core.calibration.machine_yaml import machine_file_text
from ldt_core.calibration.torque_balance import balanced_machine
from ldt_core.diagnosis.nominal_prior import nominal_prior
from ldt_core.effects import parse_effect
from ldt_core.machine.machine_file import machine_from_dict, parse_machine

TRUE = {
    "J": 2e-4,
    "K_t": 0.03,
    "R": 1.2,
    "L": 5e-4,
    "b": 2e-5,
    "quadratic_drag.c": 1.8e-6,
    "coulomb_friction.torque": 3e-3,
}
DRAG = parse_effect("quadratic_drag:c=1.7e-6")
FRICTION = parse_effect("coulomb_friction:torque=2.5e-3")
PERIOD, SAMPLES, STEPS = 0.01, 400, 40


def recorded(seed: int, count: int = 6, **others: float) -> list[Experiment]:
    """Experiments of the fan, under steps that begin from standstill."""
    rng = np.random.default_rng(seed)
    j, k, r, el, b, c, dry = {**TRUE, **others}.values()
    volts = np.repeat(rng.uniform(-12, 12, (count, SAMPLES // 80)), 80, axis=1)
    w, i = np.zeros(count), np.zeros(count)
    speed, h = np.zeros((count, SAMPLES)), PERIOD / STEPS
    for n in range(SAMPLES):
        speed[:, n] = w
        for _ in range(STEPS):
            i = (i + h / el * (volts[:, n] - k * w)) / (1 + h * r / el)
            w = w + h / j * (k * i - b * w - c * w * np.abs(w))
            w = np.sign(w) * np.maximum(np.abs(w) - h * dry / j, 0.0)
    speed += rng.normal(0, 1.0, speed.shape)
    pairs = zip(volts, speed, strict=True)
    return [Experiment(n, 10.0 * n, PERIOD, v, s) for n, (v, s) in enumerate(pairs, start=1)]


def sheet(seed: int):
    """The fan's data sheet: its numbers are off by their tolerances, friction and drag missing."""
    rng, names = np.random.default_rng(seed), ("J", "K_t", "R", "L", "b")
    off = dict(zip(names, (0.05, 0.05, 0.05, 0.1, 0.2), strict=True))
    return machine_from_dict(
        {
            "name": "fan",
            "physics": "dc_motor",
            "parameters": {n: float(TRUE[n] * np.exp(rng.normal(0, off[n]))) for n in names},
            "limits": {"voltage": [-13, 13]},
            "experiment": {"duration": PERIOD * SAMPLES, "sample_period": PERIOD},
        },
        "fan.yaml",
    )


def written(found):
    """The machine as the next command reads it."""
    return parse_machine(machine_file_text(found), "fan.yaml")


@pytest.fixture(scope="module", params=[1, 3])
def chain(request):
    """A calibration with the drag alone, and from its file another with the friction as well."""
    measured = recorded(request.param)
    first = calibrate(sheet(request.param), measured, acting=[DRAG])
    return first, calibrate(written(first), measured, acting=[FRICTION])


def test_a_value_whose_interval_was_withheld_comes_back_as_uncertain(chain):
    """It was written without std, which is exact for an effect: all torques hung on that drag."""
    first, second = chain
    assert first.lacking
    file = written(first)
    assert set(file.deviations) == {e.name for e in first.estimates}
    for e in first.estimates:  # no less than was known, and as far as the fit went from there
        known = e.nominal * {**sheet(0).tolerances, "quadratic_drag.c": 1.0}[e.name]
        least = np.hypot(known, e.value - e.nominal)
        assert file.deviations[e.name] == pytest.approx(least, rel=0.3)  # of a factor and a number
    assert not second.fixed


def test_intervals_after_withheld_ones_hold_the_truth(chain):
    """J had 0.00018 within 0.7 %, where 0.0002 was right."""
    _, second = chain
    assert second.lacking == []
    off = {e.name: (e.value - TRUE[e.name]) / e.std for e in second.estimates}
    assert all(abs(o) < 2.6 for o in off.values()), off


def test_a_scale_that_only_the_file_states_stays_as_uncertain_as_it_was(chain):
    """Each calibration anew counted the deviation of J, R and every torque as knowledge of its own.

    After three the interval of J was 2.6 times too narrow.
    """
    _, second = chain
    file = written(second.with_recordings(["bench"]))
    third = calibrate(file, recorded(9))
    assert COUNTED_TWICE not in third.with_recordings(["another"]).notes
    assert COUNTED_TWICE in third.with_recordings(["bench"]).notes
    stds = [{e.name: e.std / e.value for e in found.estimates} for found in (second, third)]
    assert stds[0]["J"] > 0.03
    for name in ("J", "R", "quadratic_drag.c"):
        assert stds[1][name] > 0.9 * stds[0][name]


def test_a_diagnosis_still_reads_the_posterior_of_a_file_that_lacks_something():
    """The deviations beside it are the calibration's own, not those of another hand."""
    found = calibrate(sheet(1), recorded(1, **{"quadratic_drag.c": 0.0}))
    assert found.lacking
    assert found.machine.deviations
    told = nominal_prior(written(found)).deviations
    assert told == pytest.approx(found.posterior.deviations, rel=1e-4)
    edited = written(found).with_deviations({"K_t": 1e-4})
    assert nominal_prior(edited).deviations["K_t"] == pytest.approx(edited.tolerances["K_t"])


@pytest.fixture(scope="module")
def imitating():
    """A motor that imitates drag and friction, its numbers far off, and the fan's experiments."""
    numbers = {"J": 3.5e-4, "K_t": 0.0437, "R": 1.0, "L": 1e-4, "b": 0.0}
    return machine_from_dict({**sheet(1).as_dict(), "parameters": numbers}, "fan.yaml"), recorded(1)


def test_a_fit_begins_as_well_where_the_diagnosis_has_moved_the_file_s_numbers(imitating):
    """From the file's own numbers it ended where the friction is none, with more left."""
    machine, measured = imitating
    along = [parse_effect("inertia:factor=0.7"), parse_effect("motor_constant:factor=0.7")]
    alone = calibrate(machine, measured, acting=[FRICTION, DRAG])
    found = calibrate(machine, measured, acting=[FRICTION, DRAG], along=along)
    torque = {e.name: e for e in found.estimates}["coulomb_friction.torque"]
    scale = 1.2 / found.machine.parameters["R"]  # by convention, of all torques
    assert torque.value == pytest.approx(3e-3 * scale, rel=0.2)
    assert found.errors["fit"][1].rmse < 0.95 * alone.errors["fit"][1].rmse
    assert found.lacking == []


def test_an_effect_that_the_file_has_is_not_said_to_be_lacking(imitating):
    """Its torque is exact and far too small: what is left is more of it."""
    machine, measured = sheet(1).with_effects([DRAG]), recorded(2)
    known = machine.with_effects([parse_effect("coulomb_friction:torque=1e-3")])
    found = calibrate(known, measured)
    assert "coulomb_friction" in found.lacking
    (said,) = (n for n in found.notes if n.startswith("What is left looks like"))
    assert "The machine file has coulomb friction" in said
    assert "lacks" not in said


def test_an_inductance_of_which_the_accelerations_say_nothing_is_open():
    """It was written as 1e-3 of a sample period times R, known to 10 %; no fit could leave it."""
    measured = recorded(4, **{"quadratic_drag.c": 0.0, "L": 6e-3})
    start = balanced_machine(measured, ["coulomb_friction"], "fan")
    assert start.tolerances["L"] >= 1.0
    found = calibrate(parse_machine(json.dumps(start.as_dict()), "fan.yaml"), measured)
    assert found.errors["fit"][1].rmse < 1.1  # the noise is 1 rad/s
    assert found.lacking == []
    inductance = {e.name: e for e in found.estimates}["L"]
    low, high = inductance.ci95
    assert low < 5e-3 * found.machine.parameters["R"] < high
    assert inductance.std < 0.3 * inductance.value


def test_an_inductance_that_no_sample_shows_is_no_knowledge():
    """The law of an identified motor held its L, a hundredth of a sample period, to 10 %."""
    measured = recorded(5, **{"quadratic_drag.c": 0.0, "coulomb_friction.torque": 0.0})
    found = identify_machine(measured, "fan")
    assert found.form.order == 1
    assert found.posterior.deviations["L"] >= 1.0


def test_an_interval_that_the_search_has_cut_off_is_none():
    """L ran to a thousandth of the file's, does not show there, and was "at most" the file's."""
    measured = recorded(22)
    first = calibrate(sheet(22), measured)
    found = calibrate(written(first), measured, acting=[DRAG, FRICTION])
    assert found.lacking == []
    assert [e.name for e in found.estimates if e.ci95 is None] == ["L"]
    assert found.machine.tolerances["L"] > 5
