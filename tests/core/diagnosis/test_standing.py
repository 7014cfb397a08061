"""Verdicts that stand by themselves, and numbers that lie between sensible ends."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from recorded_machines import MOTOR, NOISE, candidates, record

from ldt_core.base.experiment import Experiment
from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.diagnosis.diagnosis import HeldOutErrors
from ldt_core.diagnosis.effect_fit import EffectFit
from ldt_core.diagnosis.effect_set_search import EffectSetSearch
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.holdout import errors, free_run
from ldt_core.diagnosis.nominal import beyond
from ldt_core.diagnosis.nominal_prior import NominalPrior
from ldt_core.diagnosis.standing import astray, objection
from ldt_core.diagnosis.thresholds import THRESHOLDS
from ldt_core.diagnosis.verdict import is_gap
from ldt_core.effects import get_effect
from ldt_core.physics.effect import Effect
from ldt_core.physics.parameter import Parameter


def _pushing(t, theta, omega, current, voltage, p):
    return p[0] * omega * omega * omega


PUSH = Effect(
    name="cubic_push",
    description="drives itself, ever faster",
    equation="torque = c omega^3",
    parameters=(Parameter("c", "N m s^3", 0.0, default=0.0, description="c", scale=1e3),),
    typical={"c": 1e3},
    search={"c": (1e2, 1e3)},
    torque=_pushing,
)


def numbers(content):
    """All numbers of a diagnosis under a key that is a share."""
    if isinstance(content, dict):
        for key, value in content.items():
            shares = ("score", "closed_fraction", "share_of_gap", "shapley_share", "confidence")
            if key in shares and value is not None:
                yield value
            yield from numbers(value)
    elif isinstance(content, list):
        for value in content:
            yield from numbers(value)


def test_a_candidate_that_cannot_be_simulated_says_so():
    """No score, and no "explains nothing"; every share lies from 0 to 1."""
    effects = [PUSH, get_effect("constant_load"), get_effect("inertia")]
    found = diagnose(
        MOTOR, record(MOTOR, "constant_load:torque=0.02", count=4), effects=effects, workers=1
    )
    pushed = next(c for c in found.candidates if c.effect == PUSH.name)
    assert pushed.rejected_because == "could not be simulated"
    assert pushed.score is None
    assert found.verdict.effects == ["constant_load"]
    assert all(0 <= n <= 1 for n in numbers(found.as_dict()))
    assert not any("-" in (c.rejected_because or "") for c in found.candidates)


@pytest.mark.slow
def test_a_shaft_that_stands_still_is_no_explanation():
    """Friction that stops the shaft closes nearly all of the gap, and explains no motion."""
    random = np.random.default_rng(0)
    experiments = [
        replace(
            e,
            speed=3.5 * np.sin(9 * np.arange(len(e)) * e.period) + random.normal(0, NOISE, len(e)),
        )
        for e in record(MOTOR, count=4)
    ]
    effects = [get_effect("coulomb_friction"), get_effect("viscous_friction")]
    found = diagnose(MOTOR, experiments, effects=effects, workers=1)
    assert found.verdict.kind == "unknown"
    assert found.effects == []
    assert found.gap.after == found.gap.before
    assert "where a shaft that stands still leaves" in found.verdict.sentence


def test_a_gap_far_below_the_noise_gets_no_verdict():
    """A twentieth of the noise, which so many samples would show."""
    experiments = record(MOTOR, f"sensor_bias:bias={0.05 * NOISE}", count=8, samples=4000)
    residuals = FreeRunResiduals(MOTOR, experiments, workers=1, tolerance=THRESHOLDS.law_error)
    search = EffectSetSearch(residuals, candidates(MOTOR, ["sensor_bias", "inertia"]))
    assert not is_gap(search.found, 0)


@pytest.mark.parametrize(
    ("effect", "z", "before", "after", "said"),
    [
        ("inertia", 0.3, 0.578, 0.668, "where 0.578 were without it"),
        ("inertia", 0.3, 0.578, math.nan, "cannot be simulated"),
        ("inertia", math.log(20.0), 5.0, 0.11, "limit of the search (factor of inertia)"),
        ("inertia", 0.3, 300.0, 200.0, "stands still leaves"),
        ("inertia", 0.3, 5.0, 4.0, "a linear model without physics"),
        ("inertia", 0.3, 0.11, 0.1, "leaves 0.1 of 0.11 rad/s on held-out experiments"),
        ("inertia", 0.3, 0.0505, 0.0504, ""),  # a gap that noise may have made
        ("inertia", 0.3, 5.0, 0.11, ""),
        ("coulomb_friction", 0.0, 5.0, 0.11, ""),  # none is a machine, and no limit of a search
    ],
)
def test_what_was_named_is_held_against_the_signal(effect, z, before, after, said):
    """By errors on the held-out experiments of a machine that a linear model predicts."""
    own = tuple(candidates(MOTOR, [effect]))
    fit = EffectFit(own, (np.array([z]),), np.zeros(1), np.zeros((1, 1)), 0.0)
    experiments = record(MOTOR, count=4)
    was, now = (HeldOutErrors(x, x) for x in (before, after))
    got = objection(MOTOR, fit, experiments[:3], experiments[3:], was, now, NOISE)
    assert (said in got) if said else got == ""


@pytest.mark.parametrize(("factor", "far"), [(1.05, False), (1.6, True)])
def test_what_nominal_parameters_close_is_told(factor, far):
    """A row with its prior; beyond three deviations of it the sentence says so."""
    found = diagnose(
        MOTOR,
        record(MOTOR, f"motor_constant:factor={factor}", count=4),
        effects=[get_effect(n) for n in ("coulomb_friction", "inertia", "motor_constant")],
        refit=["K_t"],
        workers=1,
    )
    (row,) = found.as_dict()["refit"]
    assert row["parameter"] == "K_t"
    assert row["factor"] == pytest.approx(factor, rel=0.01)
    low, high = row["ci95"]
    assert low < row["factor"] < high
    assert row["prior_std"] == MOTOR.tolerances["K_t"]
    assert (row["closed_fraction"] > 0.99) != far
    said = found.verdict.sentence
    assert said.startswith("No effect is needed: nominal parameters") != far
    assert (list(found.verdict.effects) == ["motor_constant"]) == far
    assert ("K_t is not 0.05 N m/A any more but 0.08" in said) == far


def test_what_the_laws_are_off_by_is_no_finding_about_the_machines_own_numbers():
    """It pulls at narrow priors; once it counts as an error, they stay where they are."""
    root = 1e-3 * np.array([[1.0, 0.0], [0.9, 0.436]])
    prior = NominalPrior(MOTOR, ("K_t", "R"), root)
    own, z = prior.candidate(), np.array([3.0, 3.0])
    columns, residual = np.eye(10, 2), np.zeros(10)
    residual[:2] = -2.9  # the data want both at 5.9
    fitted = EffectFit((own,), (z,), residual, columns, 0.0, own=1)
    assert beyond(prior, fitted, 0.0, 0.0) == {"R": pytest.approx(2.95 * 1.336, rel=1e-3)}
    assert beyond(prior, fitted, left=30.0, excess=1e4) == {}
    assert beyond(replace(prior, known=False), fitted, 0.0, 0.0) == {}


# ---- recordings of which some or all are of no machine


def test_no_gap_is_said_only_where_those_held_out_show_none():
    """One of six in another unit, which happens to be held out: the others alone hold."""
    experiments = record(MOTOR, count=6)
    held = diagnose(MOTOR, experiments, effects=[]).experiments["held_out"][0]
    spoilt = [replace(e, speed=e.speed * (1e3 if e.number == held else 1)) for e in experiments]
    verdict = diagnose(MOTOR, spoilt, effects=[get_effect("coulomb_friction")]).verdict
    assert verdict.kind == "unknown"
    assert f"most on experiment {held}" in verdict.sentence


@pytest.mark.parametrize("speed", [17.3, 5e-324])
def test_a_speed_without_any_noise_is_diagnosed(speed):
    """Nothing of what it leaves lies above the band, and nothing depends on it."""
    experiments = [
        replace(e, voltage=0 * e.voltage + 5.0, speed=0 * e.speed + speed, current=None)
        for e in record(MOTOR, count=6)
    ]
    found = diagnose(MOTOR, experiments, effects=[get_effect("coulomb_friction")])
    assert found.verdict.kind != "none"


def test_pieces_of_one_record_of_a_sound_machine_are_no_gap():
    """Each begins with a current that nobody has measured."""
    slow = replace(MOTOR, parameters={**MOTOR.parameters, "L": 0.5})
    spread = {n: 0.05 * abs(v) for n, v in slow.parameters.items()}
    pieces = []
    for at in range(6):  # one record, cut where the voltage has just been reversed
        (piece,) = record(slow, count=1, samples=100, lead=301, hold=301, seed=at)
        pieces.append(replace(piece, number=at + 1, start=3.0 * at))
    file = replace(slow, parameters={**slow.parameters, "J": 1.03 * slow.parameters["J"]})
    assert diagnose(file.with_deviations(spread), pieces, workers=1).verdict.kind == "none"


def test_a_gap_larger_than_all_that_moves_is_not_closed_by_what_hardly_follows_the_motion():
    """Another machine's record: 99.9 % of the gap, and half of the motion's deviation are left."""
    time = np.arange(6000) * 0.01
    volts, speed = 8 + 4 * np.sign(np.sin(time)), 25 + 10 * np.sin(time - 0.3)
    cut = [slice(k, k + 1000) for k in range(0, 6000, 1000)]
    experiments = [
        replace(e, voltage=volts[::-1][s], speed=speed[::-1][s])
        for e, s in zip(record(MOTOR, count=6, samples=1000), cut, strict=True)
    ]
    effects = [get_effect(n) for n in ("quadratic_drag", "viscous_friction", "motor_constant")]
    found = diagnose(MOTOR, experiments, effects=effects, workers=1)
    assert found.verdict.kind == "unknown"


def test_an_effect_that_hardly_acts_in_what_is_held_out_is_not_refuted():
    """A soft limit that those held out just reach, and the fitted ones plainly."""
    limit = get_effect("voltage_saturation")
    experiments = record(MOTOR, "voltage_saturation:limit=6", count=6)
    held = [replace(e, voltage=0.4 * e.voltage) for e in record(MOTOR, count=6)[4:]]
    for k, e in enumerate(held):
        run = free_run(MOTOR, e, [(get_effect("sensor_gain"), {"factor": 0.995})])
        noise = np.random.default_rng(k).normal(0, NOISE, len(e))
        held[k] = replace(e, speed=run + noise)
    (own,) = candidates(MOTOR, ["voltage_saturation"])
    z = own.coordinates({"limit": 6.0})
    fit = EffectFit((own,), (z,), np.zeros(1), np.zeros((1, 1)), 0.0)
    was = errors(held, [free_run(MOTOR, e) for e in held])
    now = errors(held, [free_run(MOTOR, e, [(limit, {"limit": 6.0})]) for e in held])
    assert now.rmse >= was.rmse > NOISE
    assert objection(MOTOR, fit, experiments[:4], held, was, now, NOISE) == ""


def test_amounts_that_two_effects_may_exchange_are_not_told_as_known():
    """A light motor behind a slow sensor answers as a heavy one behind a fast sensor does."""
    made = record(MOTOR, "inertia:factor=2.2", "sensor_lag:time_constant=0.04", count=4)
    effects = [get_effect(n) for n in ("inertia", "sensor_lag", "viscous_friction")]
    found = diagnose(MOTOR, made, effects=effects, workers=1)
    assert sorted(found.verdict.effects) == ["inertia", "sensor_lag"]
    told = {c.effect: c.parameters for c in found.candidates}
    assert told["inertia"]["factor"].ci95 is None
    assert told["sensor_lag"]["time_constant"].ci95 is None
    assert any(note.startswith("other amounts explain as much: inertia") for note in found.notes)
    factors = [
        {e["effect"]: e["parameters"] for e in use}["inertia"]["factor"]
        for use in (found.effects, *found.alternatives)
    ]
    assert max(factors) == pytest.approx(2.2, rel=0.1)
    assert min(factors) < 0.5


@pytest.mark.parametrize(
    ("supplied", "shown", "names"),
    [
        (1.0, 0.9, ["armature_inductance", "inertia"]),  # another sensor of the current
        (0.92, 1.0, ["sensor_gain", "inertia"]),  # another voltage, which the speed takes for that
    ],
)
def test_a_set_that_leaves_what_the_current_shows_is_no_cause(supplied, shown, names):
    """Whatever it explains of the speed; even where the speed shows no gap at all."""
    experiments = [
        replace(e, voltage=e.voltage / supplied, current=e.current * shown)
        for e in record(MOTOR, count=4, current=True)
    ]
    found = diagnose(MOTOR, experiments, effects=[get_effect(n) for n in names], workers=1)
    assert (found.verdict.kind, found.effects) == ("unknown", [])
    assert "leaves most of what the current shows" in found.verdict.sentence
    assert "need not have changed" not in found.verdict.sentence


def test_an_amount_far_from_none_is_told_however_wide_its_interval():
    """A drag that closed 117 rad/s to the noise was "near 0.0002, but not determined"."""
    made = record(MOTOR, "quadratic_drag:c=2e-4", count=4)
    effects = [get_effect(n) for n in ("quadratic_drag", "viscous_friction", "inertia")]
    found = diagnose(MOTOR, made, effects=effects, workers=1)
    told = {c.effect: c.parameters for c in found.candidates}["quadratic_drag"]["c"]
    assert told.ci95 is not None
    assert 0 < told.ci95[0] < 2e-4 < told.ci95[1]


def test_a_start_state_that_follows_anything_explains_nothing():
    """From the usual start, of a far end that nobody saw, the runs left 428 rad/s of 157."""
    volts = np.ones(50)
    held = [Experiment(k, float(k), 0.1, volts, 100 + 0 * volts) for k in (1, 2)]
    file, wild, other = ([e.speed + d for e in held] for d in (40.0, 400.0, 60.0))
    assert "400 rad/s, where a shaft that stands still leaves 100" in astray(held, file, wild)
    assert astray(held, file, other) == ""
    assert astray(held, wild, wild) == ""  # the file's own runs say no more
