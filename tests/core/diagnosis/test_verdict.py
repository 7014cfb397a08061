"""Claims about verdicts: none, an effect, several, a group, unknown; and what they come with."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from recorded_machines import MOTOR, NOISE, ROTOR, candidates, record, uses

from ldt_core.base.errors import BadInput, OptionError
from ldt_core.base.experiment import Experiment
from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.diagnosis.effect_set_search import EffectSetSearch
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.holdout import (
    closed,
    errors,
    free_run,
    noise_there,
    regimes,
    split_at_random,
)
from ldt_core.diagnosis.library import library
from ldt_core.diagnosis.nominal_prior import nominal_prior
from ldt_core.diagnosis.thresholds import THRESHOLDS
from ldt_core.diagnosis.verdict import decide, is_gap
from ldt_core.effects import EFFECTS, get_effect
from ldt_core.machine.machine_file import Machine
from ldt_core.physics.effect import Effect
from ldt_core.physics.parameter import Parameter

FEW = (
    "coulomb_friction",
    "viscous_friction",
    "inertia",
    "armature_resistance",
    "motor_constant",
    "constant_load",
    "sensor_bias",
)
FORWARD = (4.0, 14.0)  # V
#: What may stand for a cause of the tests of several causes: relatives, and what fits better alone.
OWN_NUMBERS = ("inertia", "motor_constant", "armature_resistance")
DRIVE = ("input_delay", "sensor_lag", "voltage_saturation", "current_limit", "magnetic_saturation")
FRICTION = ("coulomb_friction", "viscous_friction", "viscous_asymmetric", "quadratic_drag")
FOUNDATION = ("unbalance", "foundation_stiffness", "foundation_damping")
#: What looks like dry friction, or nearly, where a shaft turns one way.
ONE_WAY = [
    get_effect(name)
    for name in (
        *("coulomb_friction", "stribeck_friction", "asymmetric_friction", "load_friction"),
        *("input_deadzone", "brush_drop", "constant_load", "sensor_bias", "sensor_gain"),
        *("viscous_friction", "quadratic_drag", *OWN_NUMBERS),
    )
]


def verdict(*effects, names=FEW, machine=ROTOR, refit=None, **recording):
    """The diagnosis of a recorded machine, and the experiments."""
    experiments = record(machine, *effects, **{"count": 4, **recording})
    tried = [get_effect(n) if isinstance(n, str) else n for n in names]
    return diagnose(machine, experiments, effects=tried, refit=refit, workers=1), experiments


@pytest.fixture(scope="module")
def friction():
    return verdict("coulomb_friction:torque=0.1")


@pytest.fixture(scope="module")
def pair():
    return verdict("coulomb_friction:torque=0.1", "inertia:factor=1.2")


@pytest.fixture(scope="module")
def one_way():
    """Forward only: a load, friction, and a dead zone all pull alike."""
    names = ("coulomb_friction", "constant_load", "input_deadzone", "inertia")
    return verdict("coulomb_friction:torque=0.1", names=names, volts=FORWARD)


@pytest.fixture(scope="module")
def foreign():
    """A torque that swings with the clock, which no effect of the library does."""
    outside = Effect(
        name="swinging_torque",
        description="swings with the clock",
        equation="torque = -T sin(9 t)",
        parameters=(Parameter("torque", "N m", 0.0, default=0.0, description="T", scale=0.1),),
        typical={"torque": 0.3},
        torque=_swinging,
    )
    return verdict((outside, {"torque": 0.3}), volts=FORWARD)


def _swinging(t, theta, omega, current, voltage, p):
    return -p[0] * math.sin(9.0 * t)


@pytest.fixture(scope="module")
def nothing():
    return verdict()


@pytest.fixture(scope="module")
def all_of_them(friction, pair, one_way, foreign, nothing):
    return {
        "friction": friction[0],
        "pair": pair[0],
        "one_way": one_way[0],
        "foreign": foreign[0],
        "nothing": nothing[0],
    }


# ---- is there a gap


@pytest.mark.slow
@pytest.mark.parametrize(
    ("machine", "lead"), [(ROTOR, 0), (ROTOR, 200), (MOTOR, 0)], ids=["rest", "running", "motor"]
)
def test_where_there_is_no_gap_none_is_seen(machine, lead):
    """At most one false one in twenty."""
    seen = 0
    for seed in range(20):
        experiments = record(machine, count=3, samples=400, seed=seed, lead=lead)
        residuals = FreeRunResiduals(
            machine, experiments, workers=1, tolerance=THRESHOLDS.law_error
        )
        search = EffectSetSearch(residuals, candidates(machine, ["coulomb_friction", "inertia"]))
        found = search.found
        found.band.level = search.band.level = found.band.channel_noise(found.base)
        seen += is_gap(found, seed)
    assert seen <= 1


def test_a_small_gap_is_seen():
    """A friction that moves the speed by half the noise."""
    experiments = record(ROTOR, "coulomb_friction:torque=0.005")
    moved = [e.speed - free_run(ROTOR, e) for e in record(ROTOR, "coulomb_friction:torque=0.005")]
    assert float(np.std(np.concatenate(moved))) < 1.6 * NOISE
    residuals = FreeRunResiduals(ROTOR, experiments, workers=1, tolerance=THRESHOLDS.law_error)
    assert is_gap(
        EffectSetSearch(residuals, candidates(ROTOR, ["coulomb_friction", "inertia"])).found, 0
    )


# ---- verdicts


def test_a_better_minimum_that_turns_up_late_is_fitted_on_all_experiments(monkeypatch):
    """The set that was chosen by the poorer one is then still there to be judged."""
    experiments = record(MOTOR, "coulomb_friction:torque=0.01")
    residuals = FreeRunResiduals(MOTOR, experiments, workers=1, tolerance=THRESHOLDS.law_error)
    search = EffectSetSearch(residuals, candidates(MOTOR, ["coulomb_friction"]))

    def turned_up(base):
        search.found.fits.pop(frozenset(base.names))
        return []

    monkeypatch.setattr(search, "alternatives", turned_up)
    assert decide(search).acting == [["coulomb_friction"]]


def test_a_small_effect_beside_numbers_that_are_far_off_is_a_gap():
    """What a motor's own numbers leave is no error of their laws, however small beside the gap."""
    off = MOTOR.with_parameters(K_t=MOTOR.parameters["K_t"] * 1.07).with_deviations(
        {n: 0.05 * MOTOR.parameters[n] for n in ("J", "K_t", "R", "L", "b")}
    )
    experiments = record(MOTOR, "brush_drop:voltage=0.02", count=6, noise=0.02)
    found = diagnose(
        off, experiments, effects=[*map(get_effect, ("brush_drop", "coulomb_friction"))]
    )
    assert found.verdict.kind in ("effect", "ambiguous")
    assert "brush_drop" in found.verdict.effects


def test_no_gap_is_the_verdict_none(nothing):
    found, _ = nothing
    assert found.verdict.kind == "none"
    assert list(found.verdict.effects) == []
    assert found.gap.closed_fraction is None
    assert list(found.effects) == []
    assert {c.rejected_because for c in found.candidates} == {"there is no gap to explain"}


def test_a_single_effect_is_named_with_its_amount(friction):
    found, _ = friction
    assert found.verdict.kind == "effect"
    assert list(found.verdict.effects) == ["coulomb_friction"]
    first = found.candidates[0]
    assert first.effect == "coulomb_friction"
    assert first.rejected_because is None
    low, high = first.parameters["torque"].ci95
    assert low <= 0.1 <= high
    assert high - low < 0.025  # no law is exactly right: a few per cent either way
    assert found.gap.closed_fraction > 0.95
    assert not found.remainder.structured


@pytest.mark.slow
def test_two_effects_that_act_together_are_both_named(pair):
    found, _ = pair
    assert found.verdict.kind == "effect"
    assert set(found.verdict.effects) == {"coulomb_friction", "inertia"}
    amounts = {c.effect: c.parameters for c in found.candidates}
    assert amounts["coulomb_friction"]["torque"].value == pytest.approx(0.1, rel=0.05)
    assert amounts["inertia"]["factor"].value == pytest.approx(1.2, rel=0.02)
    assert found.gap.closed_fraction > 0.95


def test_what_forward_running_cannot_tell_apart_is_ambiguous(one_way):
    """And the experiment that would settle it turns backward, or stands still."""
    found, _ = one_way
    assert found.verdict.kind == "ambiguous"
    assert "coulomb_friction" in found.verdict.effects
    assert "constant_load" in found.verdict.effects
    assert "inertia" not in found.verdict.effects
    assert found.next_experiment is not None
    assert " would tell " in found.next_experiment.why  # "small steps tells"
    assert min(found.next_experiment.voltage) <= 0.0


@pytest.mark.slow
def test_all_that_no_voltage_of_one_sign_tells_apart_is_named():
    """Relatives that were tried in two places took the room of what is alike."""
    recording = record(MOTOR, "coulomb_friction:torque=0.01", volts=(4.0, 12.0), samples=400)
    (group,) = diagnose(MOTOR, recording, effects=ONE_WAY, workers=1).verdict.acting
    assert {"coulomb_friction", "constant_load", "input_deadzone"} <= set(group)


def test_a_winding_and_a_supply_are_never_told_apart():
    """Their resistances are in series, whatever is measured but the terminals' voltage."""
    names = ("armature_resistance", "source_resistance", "coulomb_friction", "inertia")
    for effect in ("armature_resistance:factor=1.3", "source_resistance:resistance=0.3"):
        found, _ = verdict(effect, names=names, current=True)
        assert found.verdict.kind == "ambiguous"
        assert set(found.verdict.effects) == {"armature_resistance", "source_resistance"}


def test_only_the_current_tells_a_lower_supply_from_a_sensor_s_gain():
    """The speed of a machine without dry friction scales with either of them."""
    names = ("input_gain", "sensor_gain", "motor_constant", "inertia")
    for effect in ("input_gain:factor=0.9", "sensor_gain:factor=0.9"):
        found, _ = verdict(effect, names=names)
        assert found.verdict.acting == [["input_gain", "sensor_gain"]]
        found, _ = verdict(effect, names=names, current=True)
        assert found.verdict.acting == [[effect.partition(":")[0]]]


def test_the_current_tells_an_offset_of_the_supply_from_the_sensor_s():
    names = ("input_bias", "sensor_bias", "coulomb_friction", "inertia")
    for effect in ("input_bias:bias=0.3", "sensor_bias:bias=1"):
        true = effect.partition(":")[0]
        found, _ = verdict(effect, names=names)
        assert true in found.verdict.acting[0]
        found, _ = verdict(effect, names=names, current=True)
        assert found.verdict.acting == [[true]]


@pytest.mark.slow
def test_a_law_that_no_candidate_has_is_unknown(foreign):
    found, _ = foreign
    assert found.verdict.kind == "unknown"
    assert list(found.verdict.effects) == []
    assert list(found.effects) == []
    assert found.remainder.structured
    assert all(c.rejected_because for c in found.candidates)
    assert found.gap.after == found.gap.before


@pytest.mark.slow
def test_the_true_effect_left_out_of_the_candidates_is_not_replaced_by_another():
    """Commands come late, which is not among what is tried."""
    found, _ = verdict("input_delay:delay=0.1", names=[n for n in FEW if n != "inertia"])
    assert found.verdict.kind == "unknown"


@pytest.mark.slow
def test_nor_by_two_others_of_absurd_size():
    """A winding of a thirtieth and a shaft of fifty times the file's are no explanation."""
    found, _ = verdict("input_delay:delay=0.1")
    assert found.verdict.kind == "unknown"


@pytest.mark.parametrize("kind", ["friction", "pair", "one_way", "foreign", "nothing"])
@pytest.mark.slow
def test_every_verdict_keeps_its_word(all_of_them, kind):
    """Confidence in 0..1, a sentence, all candidates once, finite numbers or none."""
    found = all_of_them[kind]
    assert 0.0 <= found.verdict.confidence <= 1.0
    assert found.verdict.sentence.endswith(".")
    names = [c.effect for c in found.candidates]
    assert len(names) == len(set(names))
    assert found.verdict.effects == list(dict.fromkeys(n for g in found.verdict.acting for n in g))
    assert names[: len(found.verdict.effects)] == list(found.verdict.effects)
    assert not set(found.experiments["fit"]) & set(found.experiments["held_out"])
    for c in found.candidates:
        assert (c.rejected_because is None) == (c.effect in found.verdict.effects)
        for a in c.parameters.values():
            assert math.isfinite(a.value)
            assert a.ci95 is None or a.ci95[0] <= a.value <= a.ci95[1]


@pytest.mark.parametrize("kind", ["friction", "pair", "one_way"])
def test_the_members_shares_sum_to_1(all_of_them, kind):
    """Shapley's; nobody else has one."""
    found = all_of_them[kind]
    shares = {c.effect: c.shapley_share for c in found.candidates if c.shapley_share is not None}
    assert sum(shares.values()) == pytest.approx(1.0)
    assert set(shares) <= set(found.verdict.effects)
    assert len(shares) == len(found.verdict.acting)
    assert all(s > 0 for s in shares.values())


@pytest.mark.parametrize("kind", ["friction", "pair", "one_way", "foreign"])
def test_the_sentence_and_the_effects_are_of_the_same_set(all_of_them, kind):
    """What a prediction adds is one set, the best: a member of each group."""
    found = all_of_them[kind]
    added = [e["effect"] for e in found.effects]
    assert added == [group[0] for group in found.verdict.acting]
    for entry in found.effects:
        effect = get_effect(entry["effect"])
        assert effect.check(entry["parameters"]) == entry["parameters"]


def test_the_same_seed_gives_the_same_answer(friction):
    """To the last digit."""
    found, _ = friction
    again, _ = verdict("coulomb_friction:torque=0.1")
    assert again.as_dict() == found.as_dict()


# ---- what closes the gap, and where


def test_the_promise_is_that_of_the_predictions(pair):
    """Before and after are free runs of the held-out experiments by the very effects listed."""
    found, experiments = pair
    held = [e for e in experiments if e.number in found.experiments["held_out"]]
    assert held
    use = [(get_effect(e["effect"]), e["parameters"]) for e in found.effects]
    assert errors(held, [free_run(ROTOR, e) for e in held]) == found.gap.before
    after = errors(held, [free_run(ROTOR, e, use) for e in held])
    assert after.rmse == pytest.approx(found.gap.after.rmse, rel=1e-9)
    share = (found.gap.before.rmse**2 - after.rmse**2) / (
        found.gap.before.rmse**2 - found.gap.noise_std**2
    )
    assert found.gap.closed_fraction == pytest.approx(share, rel=1e-6)


def test_regimes_cover_the_recording_twice():
    """By speed, and by whether it rises: each sample is in one of each."""
    experiments = record(ROTOR, "coulomb_friction:torque=0.1")
    use = uses(["coulomb_friction:torque=0.1"])
    before = [free_run(ROTOR, e) for e in experiments]
    after = [free_run(ROTOR, e, use) for e in experiments]
    found = regimes(experiments, before, after, NOISE)
    assert len(found) == 6
    assert sum(r["samples"] for r in found) == 2 * sum(map(len, experiments))
    assert all(r["rmse_after"] < 1.2 * NOISE for r in found)
    assert all(r["closed_fraction"] is None or r["closed_fraction"] > 0.9 for r in found)
    whole, (low, high) = closed(experiments, before, after, NOISE)
    assert low <= whole <= high


# ---- what is tried


def test_the_machines_own_parameters_are_refitted_within_their_tolerances():
    """Its file has another inertia, as its tolerance lets it; what is found is the friction."""
    effects = ("inertia:factor=1.1", "coulomb_friction:torque=0.1")
    found, _ = verdict(*effects, refit=["J"])
    assert list(found.verdict.effects) == ["coulomb_friction"]
    named = {e["effect"]: e["parameters"] for e in found.effects}
    assert named["inertia"]["factor"] == pytest.approx(1.1, rel=0.03)


def test_a_machine_that_only_its_own_parameters_change_has_no_gap():
    """What the refit explains within the file's tolerance is no effect."""
    found, _ = verdict("inertia:factor=1.1", refit=["J"])
    assert found.verdict.kind == "none"
    assert found.verdict.sentence.startswith("No effect is needed: nominal parameters")
    assert found.candidates[-1].effect == "nominal_parameters"


def test_a_file_from_another_recording_is_never_refitted_freely():
    """A brake, switched on after the calibration, is no other motor constant."""
    told = dict.fromkeys(("J", "K_t", "R"), 0.03)
    machine = ROTOR.with_deviations({n: s * ROTOR.parameters[n] for n, s in told.items()})
    names = ["viscous_friction", "coulomb_friction", "motor_constant", "inertia"]
    found, _ = verdict("viscous_friction:b=0.05", names=names, machine=machine)
    assert list(found.verdict.effects) == ["viscous_friction"]
    moved = {r.parameter: r.factor for r in found.refit}
    assert set(moved) == set(told)
    assert all(abs(factor - 1) < 3 * 0.03 for factor in moved.values())


def test_a_file_that_was_fitted_to_the_recording_knows_nothing_beside_it():
    """Its values have made up for what it lacks; those of another recording are a prior."""
    machine = replace(ROTOR, calibration={"free": {"J": {}}, "recordings": ["a/bag"]})
    same, other = (nominal_prior(machine, None, [r]) for r in ("bag", "b/other"))
    assert same.swallowed == {"inertia"}
    assert not other.swallowed
    assert other.deviations["J"] == pytest.approx(ROTOR.tolerances["J"])


def test_no_refit_can_be_asked_for():
    assert nominal_prior(ROTOR, ["none"]) is None
    assert nominal_prior(ROTOR) is None
    assert nominal_prior(ROTOR, ["J", "b"]).names == ("J", "b")
    with pytest.raises(OptionError, match="refit"):
        nominal_prior(MOTOR, ["e"])


def test_effects_can_be_left_out_and_a_machine_has_only_those_that_it_can_have():
    """A motor has no foundation."""
    assert {e.name for e in library(ROTOR)} == set(EFFECTS.names())
    motor = {e.name for e in library(MOTOR)}
    assert motor == set(EFFECTS.names()) - {
        "unbalance",
        "foundation_stiffness",
        "foundation_damping",
    }
    left = {e.name for e in library(MOTOR, without=["inertia", "unbalance"])}
    assert left == motor - {"inertia"}
    with pytest.raises(OptionError):
        library(MOTOR, without=["inertai"])


@pytest.mark.parametrize("holdout", [0.1, 0.25, 0.5, 0.9])
@pytest.mark.parametrize("count", [1, 2, 3, 4, 9])
def test_experiments_are_split_into_two_parts_that_are_not_empty(count, holdout):
    """Nothing is in both; a few experiments are cut into parts first."""
    experiments = record(ROTOR, count=count, samples=900)
    fit, held = split_at_random(experiments, holdout, 0)
    assert fit
    assert held
    assert sum(map(len, fit)) + sum(map(len, held)) == sum(map(len, experiments))
    assert not {id(e) for e in fit} & {id(e) for e in held}


def test_too_little_to_go_by_is_refused():
    with pytest.raises(BadInput, match="at least 400 samples"):
        split_at_random(record(ROTOR, count=1, samples=300), 0.25, 0)
    with pytest.raises(BadInput, match="holdout"):
        split_at_random(record(ROTOR), 2.0, 0)


def test_the_noise_is_what_it_was_in_these_experiments():
    """Louder by chance is measured above the band; a wrong level by far is not believed."""
    experiments = record(MOTOR, samples=2000, count=3)
    still = [np.full(len(e), 0.0) for e in experiments]
    flat = [
        type(e)(e.number, e.start, e.period, e.voltage, 1.01 * NOISE * noise)
        for e, noise in zip(
            experiments, np.random.default_rng(3).standard_normal((3, 2000)), strict=True
        )
    ]
    found = noise_there(flat, still, NOISE, 5.0)
    true = math.sqrt(np.mean([e.speed**2 for e in flat]))
    assert abs(found - true) < 0.3 * abs(NOISE - true) + 1e-4
    chance = 3.0 / math.sqrt(2 * 6000)
    assert noise_there(flat, still, NOISE / 2, 5.0) == pytest.approx(NOISE / 2 * (1 + chance))
    assert noise_there(flat, [s * math.nan for s in still], NOISE, 5.0) == NOISE


def test_a_closed_part_is_a_part():
    """Chance does not promise more than all of a gap, nor less than none."""
    experiments = record(MOTOR)
    before = [e.speed + NOISE for e in experiments]
    after = [np.array(e.speed) for e in experiments]
    assert closed(experiments, before, after, 0.9 * NOISE)[0] == 1.0
    worse = [e.speed + 2 * NOISE for e in experiments]
    part, interval = closed(experiments, before, worse, 0.5 * NOISE)
    assert part == 0.0
    assert interval == (0.0, 0.0)


# ---- several causes


@pytest.mark.slow
def test_what_acts_only_together_is_found():
    """A softer foundation shows nothing without unbalance, which alone explains nothing here."""
    effects = ("unbalance:e=0.004", "foundation_stiffness:x=0.5,y=0.6")
    names = (*FOUNDATION, "inertia", "coulomb_friction", "gravity_imbalance")
    found, _ = verdict(*effects, names=names, samples=800, volts=(3.0, 14.0), hold=100)
    assert set(found.verdict.effects) == {"unbalance", "foundation_stiffness"}
    assert found.gap.after.rmse < 1.1 * NOISE
    (amount,) = (c.parameters["e"] for c in found.candidates if c.effect == "unbalance")
    assert amount.value == pytest.approx(0.004, rel=0.03)


@pytest.mark.slow
def test_a_foundation_that_is_known_roughly_gets_no_name_beside_the_unbalance():
    """Its numbers show only once there is an unbalance, and are off as the file says they may be.

    A mass shows as the stiffness, damping and e that stand for it, so e is as uncertain as it is.
    """
    off = {"m": 1.05, "M": 0.95, "K_x": 1.05, "K_y": 0.95, "R_x": 1.2, "R_y": 0.8}
    spread = {n: abs(f - 1) * ROTOR.parameters[n] for n, f in off.items()}
    own = replace(ROTOR, parameters={n: v * off.get(n, 1) for n, v in ROTOR.parameters.items()})
    recording = record(own, "unbalance:e=0.006", count=5, samples=2000, volts=(6, 16), hold=100)
    tried = [get_effect(n) for n in (*FOUNDATION, *OWN_NUMBERS, "coulomb_friction")]
    found = diagnose(ROTOR.with_deviations(spread), recording, effects=tried, workers=1)
    assert found.verdict.acting == [["unbalance"]]
    assert found.gap.after.rmse < 1.1 * NOISE
    (amount,) = (c.parameters["e"] for c in found.candidates if c.effect == "unbalance")
    low, high = amount.ci95
    assert low < 0.006 < high
    assert high - low < 0.002


@pytest.mark.slow
def test_three_causes_are_named_though_other_pairs_fit_better():
    """The best pair holds but one of them; its members are exchanged."""
    effects = ("motor_constant:factor=0.9", "coulomb_friction:torque=0.1", "input_delay:delay=0.03")
    names = (*OWN_NUMBERS, *DRIVE[:3], *FRICTION[:2], "constant_load", "input_deadzone")
    found, _ = verdict(*effects, names=names, samples=1000)
    named = {"motor_constant", "coulomb_friction", "input_delay"}
    assert {group[0] for group in found.verdict.acting} == named


@pytest.mark.slow
def test_a_limit_that_one_experiment_reaches_is_found_beside_a_delay():
    """Its steps are few, so that the delay's gap is small there, and others are looked at first."""
    random = np.random.default_rng(4)
    holds = (20, 25, 300, 40, 50, 60, 30, 100)
    levels = [np.resize(np.repeat(random.uniform(-8, 8, 200), h), 2000) for h in holds]
    levels[2] = 1.3 * levels[2]
    effects = "input_delay:delay=0.08", "voltage_saturation:limit=8.5"
    names = (*OWN_NUMBERS, *DRIVE, "coulomb_friction", "armature_inductance")
    recording = {"count": 8, "samples": 2000, "levels": levels}
    found, _ = verdict(*effects, names=names, machine=MOTOR, **recording)
    assert found.verdict.acting == [["input_delay"], ["voltage_saturation"]]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effects", "named", "noted"),
    [
        (("coulomb_friction:torque=0.2", "viscous_friction:b=0.0005"), 2, False),
        (("quadratic_drag:c=0.001", "viscous_friction:b=0.001"), 1, True),
    ],
)
def test_a_second_law_that_leaves_noise_alone_is_named_or_noted(effects, named, noted):
    """A small one passed for a departure of the first, at a hundred times the noise.

    A relative may be the first one's own law: it is noted.
    """
    names = (*FRICTION, "inertia", "constant_load")
    found, _ = verdict(*effects, names=names, machine=MOTOR, samples=400, noise=0.02)
    assert len(found.verdict.acting) == named
    assert any("only noise is left" in note for note in found.notes) is noted


@pytest.mark.slow
def test_a_small_cause_far_out_of_the_noise_is_named_beside_a_large_one():
    """It is a thousandth of the gap, and takes away all that the large one leaves."""
    effects = ("motor_constant:factor=0.8", "gravity_imbalance:torque=0.02")
    names = (*OWN_NUMBERS, *FRICTION, "gravity_imbalance", "cogging_torque", "constant_load")
    found, _ = verdict(*effects, names=names, samples=600)
    assert set(found.verdict.effects) == {"motor_constant", "gravity_imbalance"}
    assert found.gap.after.rmse < 1.1 * NOISE


def test_noise_as_large_as_the_motion_is_no_proof_that_all_is_well():
    """Speeds from one end to the other at every sample, too wild for any candidate."""
    volts = np.repeat(np.random.default_rng(3).uniform(2, 10, 8), 25)
    turns = 7e5 * (-1.0) ** np.arange(volts.size)
    wild = [Experiment(i, float(100 * i), 0.01, volts, turns) for i in range(1, 5)]
    found = diagnose(MOTOR, wild)
    assert found.verdict.kind == "unknown"
    assert "no less than a shaft that stands still" in found.verdict.sentence


def test_torques_of_an_equivalent_motor_are_said_to_be_on_its_scale():
    """Whoever asks: of a file with the machine's own numbers nothing of the kind is said."""
    own, equivalent = MOTOR, replace(MOTOR, calibration={"equivalent": {"gain": 1.0}})
    effects = [get_effect("coulomb_friction")]
    shown = record(MOTOR, count=4)
    said = [diagnose(m, shown, effects=effects, workers=1).notes for m in (own, equivalent)]
    assert [any("on its scale" in note for note in notes) for notes in said] == [False, True]


@pytest.mark.slow
def test_before_something_new_a_known_effect_has_changed():
    """Runs one way tell friction, a load and a dead zone not apart; friction is what there is."""
    known = Machine(with_friction(0.02))
    changed = Machine(with_friction(0.04))
    measured = record(changed, count=6, volts=(4.0, 20.0), hold=50, samples=400, noise=0.1)
    found = diagnose(known, measured, effects=ONE_WAY, workers=1)
    (group,) = found.verdict.acting
    assert group[0] == "coulomb_friction"
    assert len(group) > 1


def with_friction(torque: float) -> dict:
    """Keys of a machine file with dry friction [N m]."""
    data = MOTOR.as_dict()
    return {
        **data,
        "parameters": {"J": 1e-3, "K_t": 0.05, "R": 1.0, "L": 1e-3, "b": 1e-4},
        "effects": [{"name": "coulomb_friction", "parameters": {"torque": torque}}],
    }


@pytest.mark.slow
def test_a_plainer_law_that_leaves_far_more_than_noise_is_not_taken_for_the_right_one():
    """Beside a spring a resistance leaves little of a huge gap; a winding's heat leaves noise."""
    effects = ("spring_load:stiffness=0.02", "winding_heating:thermal_resistance=1,time_constant=5")
    names = ("spring_load", "winding_heating", *OWN_NUMBERS, "source_resistance")
    about = {"machine": MOTOR, "samples": 500, "count": 4, "hold": 100}
    found, _ = verdict(*effects, names=names, **about)
    assert sorted(found.verdict.effects) == ["spring_load", "winding_heating"]


def test_a_law_with_more_parameters_does_not_hide_the_rivals_of_a_plainer_one():
    """A file is off beside a dry friction: two of three effects could each say how."""
    true = MOTOR.with_parameters(J=1e-4, b=1e-5)
    file = true.with_parameters(J=0.983e-4, K_t=0.0524, R=0.982)
    of = {"count": 5, "samples": 300, "hold": 40, "noise": 0.5, "volts": (-10.0, 10.0)}
    experiments = record(true, "coulomb_friction:torque=0.015", **of)
    names = ("coulomb_friction", "inertia", "motor_constant", "sensor_gain", "asymmetric_friction")
    found = diagnose(file, experiments, effects=[get_effect(n) for n in names], workers=1)
    friction, *others = found.verdict.acting
    assert friction == ["coulomb_friction"]
    assert all("motor_constant" in group for group in others)
