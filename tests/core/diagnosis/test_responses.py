"""Claims about what responses tell before anything is fitted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recorded_machines import MOTOR, candidates, record

from ldt_core.diagnosis.effect_fit import EffectFit, fit
from ldt_core.diagnosis.effect_set_search import EffectSetSearch
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.model_selection import worth_more
from ldt_core.diagnosis.responses import Responses, simulate_all
from ldt_core.diagnosis.set_fits import TriedSet

TRIED = ("coulomb_friction", "viscous_friction", "quadratic_drag", "inertia", "sensor_gain")
SAMPLES = 30


def left_by(rows: np.ndarray, left: np.ndarray) -> float:
    """Sum of squares that the best combination of rows leaves."""
    weights = np.linalg.lstsq(rows.T, left, rcond=None)[0]
    return float(np.sum((left - rows.T @ weights) ** 2))


@given(st.integers(0, 10_000))
@settings(max_examples=30)
def test_what_one_and_two_explain_is_what_least_squares_takes(seed):
    """Of any responses, beside what the set's own parameter can follow, by any amount."""
    random = np.random.default_rng(seed)
    members = tuple(candidates(MOTOR, TRIED))
    owner = np.array([1, 1, 2, 2, 3, 4])
    rows, left = random.normal(size=(owner.size, SAMPLES)), random.normal(size=SAMPLES)
    slope = 10 * random.normal(size=(SAMPLES, 1))
    base = EffectFit(members[:1], (members[0].starts()[0],), left, slope, float(left @ left))
    z = [np.zeros(1)] * owner.size
    responses = Responses(None, members, owner, z, rows, rows @ rows.T, left)
    alone = left_by(slope.T, left)
    one = min(left_by(np.vstack([slope.T, r]), left) for r in rows)
    two = min(
        left_by(np.vstack([slope.T, rows[[i, j]]]), left)
        for i in range(owner.size)
        for j in range(i)
        if owner[i] != owner[j]
    )
    assert responses.explained_beside(base) == pytest.approx((alone - one, alone - two))


@pytest.fixture(scope="module")
def wavering():
    """Experiments of a motor with a brake, and a sine of ten noises that no effect gives."""
    measured = record(MOTOR, "coulomb_friction:torque=0.2", count=4, samples=600)
    return [replace(e, speed=e.speed + 0.5 * np.sin(20 * e.time)) for e in measured]


def sizes_tried(experiments) -> set[int]:
    """Numbers of effects of the sets that were fitted."""
    residuals = FreeRunResiduals(MOTOR, experiments)
    search = EffectSetSearch(residuals, candidates(MOTOR, TRIED))
    search.run()
    return {len(names) for names in search.found.scouted}


def test_no_further_effect_is_fitted_where_none_can_explain_what_is_left(wavering):
    """Sets of two take most of the time, and were fitted to any trifle of an inexact law."""
    assert sizes_tried(wavering) == {0, 1}


def test_a_further_effect_is_fitted_where_one_can_explain_what_is_left():
    """However little that is."""
    effects = "coulomb_friction:torque=0.2", "viscous_friction:b=0.0005"
    measured = record(MOTOR, *effects, count=2, noise=0.02)
    assert 2 in sizes_tried(measured)


@pytest.mark.parametrize(
    ("name", "parameter", "neutral", "size"),
    [
        ("sensor_gain", "factor", 1.0, 0.001),
        ("inertia", "factor", 1.0, -0.002),
        ("coulomb_friction", "torque", 0.0, 0.0002),
    ],
)
def test_an_effect_is_promised_at_its_own_size_however_small(name, parameter, neutral, size):
    """A search's starts are hundreds of times as strong; a good sensor shows far less."""
    noise, value = 1e-4, neutral + size
    measured = record(MOTOR, f"{name}:{parameter}={value}", noise=noise)
    search = EffectSetSearch(FreeRunResiduals(MOTOR, measured), candidates(MOTOR, TRIED))
    promised = search.responses.promised_beside(search.found.scouted[frozenset()])
    effect, z, gain = next(p for p in promised if p[0].name == name)
    assert gain > 0
    assert effect.given(z)[parameter] - neutral == pytest.approx(size, rel=0.3)


def test_a_twin_beside_a_plainer_law_competes_too():
    """It differs from the set in two members; it was fitted and then left out."""
    effects = "armature_resistance:factor=1.5", "coulomb_friction:torque=0.2"
    names = ("armature_resistance", "source_resistance", "coulomb_friction", "stribeck_friction")
    measured = record(MOTOR, *effects, count=2, samples=300)
    search = EffectSetSearch(FreeRunResiduals(MOTOR, measured), candidates(MOTOR, names))
    search.twins = {names[0]: {names[1]}, names[1]: {names[0]}}
    search.run()
    known = {c.name: c for c in search.candidates}
    members = [known[names[0]], known[names[3]]]
    (base,) = search._scout([TriedSet(members, [c.starts()[-1] for c in members])])
    found = [frozenset(f.names) for f in search.alternatives(base)]
    assert frozenset([names[1], names[2]]) in found
    assert len(found) == len(set(found))


@pytest.fixture(scope="module")
def limited():
    """A search on a motor of more resistance whose current is limited, and fits of the limit."""
    effects = "current_limit:limit=2", "armature_resistance:factor=1.3"
    residuals = FreeRunResiduals(MOTOR, record(MOTOR, *effects, count=2, hold=30))
    search = EffectSetSearch(residuals, candidates(MOTOR, ["current_limit", "gravity_imbalance"]))
    limit, gravity = search.candidates
    nothing = gravity.coordinates({"torque": 1e-9, "phase": 0.0})
    alone = fit(residuals, [limit], [limit.coordinates({"limit": 1.8})])
    both = fit(residuals, [limit, gravity], [alone.z[0], nothing])
    return search, alone, both, nothing


def test_what_following_the_speed_alone_changes_is_no_response(limited):
    """An effect of the angle that is as good as none does nothing beside a law that is off."""
    search, alone, _, nothing = limited
    gravity = search.candidates[1:]
    about = simulate_all(search.residuals, gravity, own=alone, begun=lambda c: [nothing])
    led = search.residuals.always_led().of(alone.use)
    assert np.linalg.norm(led - alone.residual) > 10  # deviations of the noise
    assert np.trace(about.gram) < 1e-6


def test_an_effect_of_the_angle_earns_no_name_by_following_the_speed(limited):
    """Beside a law that is off, any such effect leaves less, however small it is."""
    search, alone, both, _ = limited
    found = search.found
    assert both.loss < 0.9 * alone.loss
    assert found.simulated_as(alone, both).loss < 1.05 * both.loss
    assert not worth_more(found, alone, both, found.excess)
