"""Of a machine of which several things act, one changes: what is told of it, and of the rest."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from ldt_core.base.experiment import Action, Experiment
from ldt_core.twin.loop import Twin
from tests.motors import motor_file

pytestmark = pytest.mark.usefixtures("one_core")

PERIOD, SAMPLES, NOISE = 0.01, 200, 0.3  # s, of an experiment, rad/s
#: True numbers, then what somebody has identified: a motor without friction and fan.
TRUE = {"R": 0.9, "L": 2e-3, "K": 0.055, "J": 9e-4, "b": 4e-4, "dry": 0.02, "fan": 1.2e-6}
IDENTIFIED = {
    "J": {"value": 1.0e-3, "std": 2.6e-5},
    "K_t": {"value": 0.0679, "std": 1.6e-3},
    "R": 1.0,
    "L": {"value": 2.6e-3, "std": 2.0e-3},
    "b": 0.0,
}
#: A data sheet that knows all but the friction and the fan.
SHEET = {"J": 9e-4, "K_t": 0.055, "R": 0.9, "L": 2e-3, "b": 4e-4}
#: A data sheet a few per cent off, of a motor with more friction and fan.
OFF = {"J": 8.8e-4, "K_t": 0.0535, "R": 0.93, "L": 2e-3, "b": 4e-4}
MORE = {1: {"dry": 0.05, "fan": 3e-6}}
BOTH_WAYS = {"low": -18.0, "noise_std": 1.0}
CHANGED = 16  # the first experiment of the changed machine


def run(
    seed: int,
    file: dict,
    count: int,
    changes: dict[int, dict[str, float]],
    low: float = 3.0,
    noise_std: float = NOISE,
    mixed: bool = False,
) -> list:
    """Steps of a twin beside a motor of another engine that never stops.

    Args:
        changes: from which experiment on the motor has which other numbers.
        low: lowest voltage [V]; the highest is 18.
        noise_std: of the speed [rad/s].
        mixed: whether two of three experiments are a sweep, and one step after another.
    """
    noise, levels = np.random.default_rng(seed), np.random.default_rng(seed + 100)
    p, twin, found = dict(TRUE), Twin(motor_file(file, SAMPLES, PERIOD)), []
    i, w, h = 0.0, 0.0, PERIOD / 10  # current, speed, step

    # Plain numbers: by arrays of two the machine took as long as its twin.
    def rate(i, w, u):
        load = p["b"] * w + p["dry"] * math.tanh(w / 0.5) + p["fan"] * w * abs(w)
        return (u - p["R"] * i - p["K"] * w) / p["L"], (p["K"] * i - load) / p["J"]

    for k in range(1, count + 1):
        p |= changes.get(k, {})
        volts = np.repeat(levels.uniform(low, 18.0, SAMPLES // 50), 50)
        if mixed and k % 3:
            sweep = np.sin(np.cumsum(np.linspace(0.01, 0.2, SAMPLES)))
            volts = volts[0] * (sweep if k % 3 == 1 else np.repeat([1.0, 0.4], SAMPLES // 2))
        speed = np.empty(SAMPLES)
        for n, u in enumerate(volts.tolist()):
            speed[n] = w
            for _ in range(10):
                ai, aw = rate(i, w, u)
                bi, bw = rate(i + h / 2 * ai, w + h / 2 * aw, u)
                ci, cw = rate(i + h / 2 * bi, w + h / 2 * bw, u)
                di, dw = rate(i + h * ci, w + h * cw, u)
                i += h / 6 * (ai + 2 * bi + 2 * ci + di)
                w += h / 6 * (aw + 2 * bw + 2 * cw + dw)
        speed += noise_std * noise.standard_normal(SAMPLES)
        found.append(twin.step(Experiment(k, 2.0 * k, PERIOD, voltage=volts, speed=speed)))
    return found


@pytest.mark.slow
def test_an_inertia_that_halves_is_named_and_nothing_else_has_gone():
    """The file's own numbers could follow it, eight tolerances off; friction and fan are there.

    In the speed alone, half the resistance is the same with all torques doubled.
    """
    steps = run(3, IDENTIFIED, 26, {CHANGED: {"J": TRUE["J"] / 2}})
    after = " ".join(s.adaptation.reason for s in steps[CHANGED - 1 :])
    named = r"(inertia|armature resistance) has fallen to a factor of ([0-9.]+)([^;]*)"
    found = re.findall(named, after)
    assert found
    for name, factor, others in found:
        assert float(factor) == pytest.approx(0.5, abs=0.08)
        assert name == "inertia" or "inertia" in others
    assert "has gone" not in after
    errors = [s.signal.max_error for s in steps]
    assert np.mean(errors[CHANGED + 2 :]) < 1.2 * np.mean(errors[CHANGED - 8 : CHANGED - 1])


@pytest.mark.slow
def test_a_number_of_the_file_that_would_explain_as_much_is_told():
    """Weaker magnets: the motor constant, or K_t far from what the file says."""
    steps = run(5, IDENTIFIED, 18, {CHANGED: {"K": 0.85 * TRUE["K"]}})
    told = steps[CHANGED - 1].adaptation.reason
    found = re.search(r"motor constant has fallen to a factor of ([0-9.]+).*\(or K_t", told)
    assert found
    assert float(found[1]) == pytest.approx(0.85, abs=0.06)


@pytest.mark.slow
def test_what_may_act_as_before_has_not_gone():
    """One experiment is explained without the fan as well, which is no proof that it is off."""
    steps = run(3, IDENTIFIED, 10, {})
    told = " ".join(s.adaptation.reason for s in steps)
    assert "quadratic drag has grown" in told
    assert "has gone" not in told
    assert {s.signal.state for s in steps[3:]} == {"holds"}


@pytest.mark.slow
def test_what_is_taken_off_has_gone():
    """A fan that was mounted, and is taken off again, of a motor that is known well."""
    plain, fan = {"dry": 0.0, "fan": 0.0}, {"fan": 4e-6}
    steps = run(4, SHEET, 14, {1: plain, 4: fan, 9: plain})
    told = [s.adaptation.reason for s in steps]
    assert "quadratic drag has grown" in " ".join(told[3:8])
    assert "quadratic drag has gone" in " ".join(told[8:])


@pytest.mark.slow
def test_what_the_sheet_lacks_has_not_grown_and_what_doubles_is_told_alone():
    """The fan "has grown" in the fourth experiment; with a heavier disc, "friction has fallen"."""
    told = [
        s.adaptation.reason
        for s in run(2, OFF, 12, {**MORE, 12: {"J": 2 * TRUE["J"]}}, **BOTH_WAYS)
    ]
    first = " ".join(told[:11])
    assert "since experiment 1 or before, unlike the machine file" in first
    assert "quadratic drag is" in first
    assert "has grown" not in first
    factor = re.search(r"since experiment 12: inertia has grown to a factor of ([0-9.]+)", told[11])
    assert factor
    assert float(factor[1]) == pytest.approx(2.0, abs=0.3)
    assert "friction" not in told[11]


@pytest.mark.slow
def test_one_machine_is_found_where_each_experiment_alone_is_explained_otherwise():
    """Of a fan that the file lacks, each experiment made another friction and damping."""
    steps = run(7, OFF, 20, MORE, mixed=True, **BOTH_WAYS)
    assert all(s.signal.state == "holds" for s in steps[5:])
    assert sum(s.adaptation.action is Action.ADAPTED for s in steps) <= 2
