"""Claims about residuals: white for a right model, whatever is not known of the start."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recorded_machines import MOTOR, NOISE, PERIOD, ROTOR, candidates, record, steps, uses
from scipy.stats import chi2

from ldt_core.base.experiment import Experiment
from ldt_core.diagnosis.channel_noise import channel_noise
from ldt_core.diagnosis.effect_fit import fit
from ldt_core.diagnosis.free_run_residuals import FreeRunResiduals
from ldt_core.diagnosis.simulated_experiments import SEARCH_STEP
from ldt_core.diagnosis.start_angles import gain_of_angles
from ldt_core.diagnosis.start_states import _far_apart, directions
from ldt_core.estimation.free_run_start import AT_REST
from ldt_core.estimation.variable_projection import basis_of, project_out

FASTER = (6.0, 16.0)  # V: through the resonance of the foundation
UNBALANCED = ROTOR.with_parameters(e=0.006)
CHANCE = 1e-4  # of each test to fail a right residuals


def white(rest, unknown=0):
    """Whether (N,) numbers are noise of deviation 1: by their power and their neighbours."""
    free = rest.size - unknown
    low, high = chi2.ppf([CHANCE / 2, 1 - CHANCE / 2], free)
    neighbours = float(rest[1:] @ rest[:-1]) / float(rest @ rest)
    return low < float(rest @ rest) < high and abs(neighbours) < 4 / np.sqrt(free)


def unknown(starts):
    return sum(basis.shape[1] for basis in starts.bases)


RIGHT = {
    "motor": (MOTOR, []),
    "motor with friction": (MOTOR, ["coulomb_friction:torque=0.005"]),
    "rotor": (ROTOR, []),
    "rotor with a heavier shaft": (ROTOR, ["inertia:factor=1.4"]),
    "rotor with compliance": (ROTOR, ["torsional_compliance"]),
    "unbalanced rotor": (ROTOR, ["unbalance:e=0.006"]),
    "rotor unbalanced as in its file": (UNBALANCED, []),
    "the same with a softer foundation": (UNBALANCED, ["foundation_stiffness"]),
    "the same with friction": (UNBALANCED, ["coulomb_friction:torque=0.3"]),
}


@pytest.mark.parametrize("volts", [FASTER, (-16.0, 16.0)])
@pytest.mark.parametrize("name", sorted(RIGHT))
def test_a_right_model_leaves_white_noise_of_deviation_1(name, volts):
    """From rest, with the effects' true values."""
    machine, effects = RIGHT[name]
    residuals = FreeRunResiduals(machine, record(machine, *effects, volts=volts), (NOISE, 1.0))
    use = uses(effects)
    starts = residuals.start_states(use)
    assert white(residuals.of(use, starts=starts), unknown(starts))


def test_the_current_counts_in_its_own_deviations():
    """Two channels in one row, each white."""
    experiments = record(ROTOR, "inertia", current=True)
    residuals = FreeRunResiduals(ROTOR, experiments, (NOISE, 0.02))
    rest = residuals.of(uses(["inertia"]))
    assert residuals.size == rest.size == 2 * sum(map(len, experiments))
    for piece in residuals.pieces:
        speed, current = np.split(rest[piece.rows], 2)
        assert white(speed)
        assert white(current)


def test_a_current_measured_well_does_not_outweigh_the_speed():
    """Its gap counts for as much as the speed's at most, and for less only if it is smaller."""
    late = record(ROTOR, "input_delay:delay=0.01", current=True)
    power = []
    for tolerance in (0.0, 0.03):
        residuals = FreeRunResiduals(ROTOR, late, tolerance=tolerance)
        rest = residuals.of()
        both = sum(np.sum(rest[p.rows].reshape(2, -1) ** 2, axis=1) for p in residuals.pieces)
        power.append(both.tolist())
    assert power[0][1] > 5 * power[0][0]  # as measured, the current would decide alone
    assert power[1][1] == pytest.approx(power[1][0], rel=0.02)


def test_the_noise_is_found_from_the_signals():
    """Within a tenth, though the speed moves a thousand times as far."""
    speed, current = channel_noise(record(ROTOR, samples=2000, hold=200, current=True))
    assert speed == pytest.approx(NOISE, rel=0.1)
    assert current == pytest.approx(0.02, rel=0.1)


def test_a_voltage_that_moves_at_every_sample_is_no_noise():
    """The speed's own roughness was told as nine times the sensor's noise."""
    experiments = record(MOTOR, samples=500, hold=1, noise=0.02, current=True)
    speed, current = FreeRunResiduals(MOTOR, experiments).noise
    assert channel_noise(experiments)[0] > 3 * 0.02
    assert speed == pytest.approx(0.02, rel=0.1)
    assert current == pytest.approx(0.02, rel=0.1)


def test_a_free_run_and_a_followed_one_agree_for_a_linear_machine():
    """A linear machine's corrections come back out whole, also where the effect is wrong."""
    experiments = record(ROTOR, "inertia:factor=1.3")
    residuals = FreeRunResiduals(ROTOR, experiments, (NOISE, 1.0))
    for use in ([], uses(["inertia:factor=1.3"]), uses(["viscous_friction"])):
        free, followed = (residuals.outputs(0, use, follow=f)[0] for f in (False, True))
        np.testing.assert_allclose(followed, free, atol=1e-9)


def test_they_agree_for_a_rotor_that_is_not_captured():
    """Below the resonance: to a fiftieth of what the foundation takes."""
    experiments = record(ROTOR, "unbalance:e=0.002", volts=(5.0, 6.0), samples=800)
    residuals = FreeRunResiduals(ROTOR, experiments, (NOISE, 1.0))
    use = uses(["unbalance:e=0.002"])
    assert residuals.physics.is_linear(ROTOR.parameters)
    free, followed = (residuals.outputs(0, use, follow=f)[0] for f in (False, True))
    still, _ = residuals.outputs(0, [], follow=False)
    taken = np.abs(free - still).max()
    assert taken > 5 * NOISE
    np.testing.assert_allclose(followed, free, atol=taken / 50)


RUNNING = {
    "motor": (MOTOR, [], 0.0),
    "rotor with a heavier shaft": (ROTOR, ["inertia:factor=1.4"], 0.0),
    "rotor with compliance": (ROTOR, ["torsional_compliance"], 0.0),
    "warm winding": (ROTOR, ["winding_heating"], 0.0),
    "turned gravity": (ROTOR, ["gravity_imbalance:torque=0.1"], 0.1),
    "foundation in motion": (ROTOR, ["unbalance:e=0.003"], 0.1),
    "foundation in motion as in the file": (ROTOR.with_parameters(e=0.003), [], 0.1),
}


@pytest.mark.parametrize("name", sorted(RUNNING))
def test_what_is_not_known_of_a_running_machine_is_projected_out(name):
    """Speed, current, angle, temperature, foundation: what is left is as if they were known.

    Where they move the speed otherwise than in proportion, a tenth more than the noise may be left.
    """
    machine, effects, more = RUNNING[name]
    experiments = record(machine, *effects, volts=(6.0, 9.0), samples=600, lead=333, hold=111)
    residuals = FreeRunResiduals(machine, experiments, (NOISE, 1.0))
    use = uses(effects)
    starts = residuals.start_states(use)
    assert not any(p.at_rest for p in residuals.pieces)
    rest = residuals.of(use, starts=starts)
    if more:
        assert float(rest @ rest) < (1 + more) * chi2.ppf(1 - CHANCE, residuals.size)
    else:
        assert white(rest, unknown(starts))
    free = [b[:, np.linalg.norm(b, axis=0) > 1 - 1e-9] for b in starts.bases]  # else a little known
    along = [b.T @ rest[p.rows] for b, p in zip(free, residuals.pieces, strict=True)]
    assert max(np.abs(a).max() for a in along) < 1e-6


@pytest.mark.parametrize(
    ("effect", "most"),
    [
        ("winding_heating", 1.1),
        ("torsional_compliance", 1.1),
        ("backlash:share=0.5,slack=0.2", 1.3),
    ],
)
def test_states_of_effects_are_found_that_no_slope_leads_to(effect, most):
    """A winding that ran hot, a far end anywhere in its play; 200 and 5 times the noise were left.

    A far end that meets the other a little later may be left in another minimum.
    """
    experiments = record(MOTOR, effect, samples=600, lead=350, count=4)
    residuals = FreeRunResiduals(MOTOR, experiments, (NOISE, 1.0))
    use = uses([effect])
    rest = residuals.of(use, starts=residuals.start_states(use))
    assert float(rest @ rest) < most * residuals.size


@pytest.mark.parametrize("warm", [0.0, 60.0])
def test_a_winding_may_be_warm_where_a_machine_stands(warm):
    """Experiments in a row leave it so; where it is cold each time, nothing is sought."""
    random, true = np.random.default_rng(3), {"thermal_resistance": 2.0, "time_constant": 20.0}
    (heating,) = candidates(MOTOR, ["winding_heating"])
    recorded = []
    for k in range(5):
        u = steps(random, 600, -12.0, 12.0, 60)
        first = np.append(MOTOR.model.initial_state(MOTOR.parameters, 0.0), warm * random.random())
        states = MOTOR.model.simulate(MOTOR.parameters, u, PERIOD, first, [(heating.effect, true)])
        speed = states[:, 1] + NOISE * random.standard_normal(u.size)
        recorded.append(Experiment(k + 1, 100.0 * k, PERIOD, u, speed))
    residuals = FreeRunResiduals(MOTOR, recorded, (NOISE, 1.0))
    begin = heating.coordinates({"thermal_resistance": 1.5, "time_constant": 15.0})
    found = fit(residuals, [heating], [begin])
    assert found.loss < 1.1 * residuals.size
    assert heating.given(found.z[0]) == pytest.approx(true, rel=0.05)
    assert any(np.any(offset) for offset in found.starts.offsets) == bool(warm)


@given(st.integers(0, 10_000), st.floats(0.0, 100.0))
def test_a_start_state_known_a_little_is_noise_like_any_other(seed, deviation):
    """What is left has the size that it has relative to the deviation of both together."""
    random = np.random.default_rng(seed)
    columns, rest = random.normal(size=(12, 3)), random.normal(size=12)
    deviations = np.array([np.inf, deviation, 2 * deviation])
    left = project_out(rest, directions(columns, deviations))
    free = basis_of(columns[:, :1])
    known = project_out(columns[:, 1:], free) * deviations[1:]
    both = np.eye(12) + known @ known.T
    away = project_out(rest, free)
    assert float(left @ left) == pytest.approx(float(away @ np.linalg.solve(both, away)), rel=1e-6)


def test_a_start_state_whose_run_explodes_explains_all_in_its_direction():
    """Its square was beyond the largest number, and a warning stood in the terminal."""
    columns = np.array([[1e200], [0.0], [0.0]])
    left = project_out(np.ones(3), directions(columns, np.array([1.0])))
    np.testing.assert_allclose(left, [0.0, 1.0, 1.0])


def test_the_size_of_states_that_explode_is_a_number():
    """Beside a cogging torque, a far end's did; the deviation of all was beyond the largest."""
    rows = np.array([[0.0, 1e200], [1.0, 2.0], [5.0, -1e250], [2.0, 0.0]])
    assert _far_apart(rows, 1).tolist() == [[5.0, -1e250]]


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 4])
@pytest.mark.parametrize("hold", [60, 150])
def test_a_fit_goes_on_down_to_the_noise_while_its_foundation_moves_at_the_start(seed, hold):
    """The start's motion was sought from rest in each round, and fits ended far above the noise."""
    law = "foundation_damping:x=0.3,y=0.3"
    how = {"volts": (4.0, 16.0), "samples": 500, "lead": 333, "count": 4}
    residuals = FreeRunResiduals(UNBALANCED, record(UNBALANCED, law, hold=hold, seed=seed, **how))
    (effect,) = candidates(UNBALANCED, ["foundation_damping"])
    found = fit(residuals, [effect], [effect.coordinates({"x": 0.8, "y": 0.8})])
    assert found.loss < 1.1 * residuals.size
    assert effect.given(found.z[0]) == pytest.approx({"x": 0.3, "y": 0.3}, rel=0.05)


def test_a_first_sample_that_is_far_off_does_no_harm():
    """A start taken from it would be wrong for a memory of the motor."""
    (good,) = record(ROTOR, volts=(6.0, 12.0), lead=307, count=1)
    speed = np.array(good.speed)
    speed[0] += 40 * NOISE
    residuals = FreeRunResiduals(ROTOR, [replace(good, speed=speed)], (NOISE, 1.0))
    wrong = (speed - residuals.outputs(0, [])[0]) / NOISE
    assert float(wrong[1:] @ wrong[1:]) > 5 * residuals.size
    left = residuals.of()[1:]
    # The one sample itself pulls at two unknowns, less than as if it were all that they move.
    assert float(left @ left) < 40**2
    assert white(residuals.of()[200:])


def test_noise_of_the_first_current_is_no_current_of_a_machine_at_rest():
    """A winding of 0.4 s would keep it for as long: an inertia was named of a healthy motor."""
    slow = MOTOR.with_parameters(J=0.017, K_t=0.39, R=1.36, L=0.57, b=0.01)
    experiments = record(slow, samples=800, count=8, current=True, seed=5)
    residuals = FreeRunResiduals(slow, experiments)
    assert all(p.at_rest and p.columns.shape[1] == 0 for p in residuals.pieces)
    rest = residuals.of()
    assert float(rest @ rest) < chi2.ppf(1 - CHANCE, residuals.size)
    kept = [replace(e, speed=e.speed, current=e.current + 3.0) for e in experiments]
    assert all(p.columns.shape[1] == 1 for p in FreeRunResiduals(slow, kept).pieces)


@pytest.mark.parametrize("effect", ["armature_inductance:factor=1.5", "inertia:factor=1.3"])
def test_what_an_unknown_current_moves_is_that_of_the_changed_machine(effect):
    """A winding of 0.23 s that runs: by the file's numbers, a right model left a gap."""
    slow = MOTOR.with_parameters(J=0.017, K_t=0.39, R=1.36, L=0.32, b=0.01)
    experiments = record(slow, effect, lead=431, samples=600, count=6)
    residuals, use = FreeRunResiduals(slow, experiments, (NOISE, 1.0)), uses([effect])
    by_the_file = residuals.of(use)
    starts = residuals.start_states(use)
    rest = residuals.of(use, starts=starts)
    assert white(rest, unknown(starts))
    assert float(by_the_file @ by_the_file) > 1.5 * residuals.size
    assert residuals.start_states(()) is residuals.starts


def test_rest_is_told_from_running_by_the_noise():
    """A first sample within four deviations of 0 is rest."""
    experiments = record(ROTOR) + record(ROTOR, lead=400, volts=FASTER)
    residuals = FreeRunResiduals(ROTOR, experiments, (NOISE, 1.0))
    assert [p.at_rest for p in residuals.pieces] == [True] * 3 + [False] * 3
    first = [abs(float(e.speed[0])) for e in experiments]
    assert max(first[:3]) <= AT_REST * NOISE < min(first[3:])


def test_a_speed_near_0_is_no_rest_where_others_begin_in_motion():
    """A healthy motor was `unknown`: a recording was cut where the shaft turned back."""
    slow = MOTOR.with_parameters(J=0.017, K_t=0.39, R=1.36, L=0.32, b=0.01)
    running, turning = record(slow, lead=431, samples=900, count=2, noise=0.0, seed=4)
    at = int(np.argmin(np.abs(turning.speed[:300])))
    random = np.random.default_rng(0)

    def seen(e, first):
        speed = e.speed[first:] + NOISE * random.standard_normal(len(e) - first)
        return replace(e, voltage=e.voltage[first:], speed=speed)

    alone = FreeRunResiduals(slow, [seen(turning, at)], (NOISE, 1.0))
    assert not white(alone.of())  # nothing tells that it was not at rest
    both = FreeRunResiduals(slow, [seen(running, 0), seen(turning, at)], (NOISE, 1.0))
    assert [p.at_rest for p in both.pieces] == [False, True]
    assert white(both.of(), unknown(both.starts))
    assert white(both.part([1]).of(), 2)


@pytest.fixture(scope="module")
def captured():
    """A rotor that is caught in the resonance in some experiments and passes it in others."""
    experiments = record(ROTOR, "unbalance:e=0.006", volts=(9.0, 16.0), samples=800, hold=100)
    return FreeRunResiduals(ROTOR, experiments, (NOISE, 1.0))


def test_the_followed_loss_has_one_minimum_in_the_eccentricity(captured):
    """From 2 to 12 mm, at the truth; that of the free run has several."""
    grid = np.arange(2.0, 12.01, 0.25)

    def losses(follow):
        found = []
        for e in grid:
            use = uses([f"unbalance:e={e / 1000}"])
            rest = [
                x.speed - captured.outputs(i, use, follow=follow)[0]
                for i, x in enumerate(captured.experiments)
            ]
            found.append(float(np.sum(np.square(rest))))
        return np.array(found)

    def minima(loss):
        return [
            float(grid[k])
            for k in range(1, grid.size - 1)
            if loss[k] < min(loss[k - 1], loss[k + 1])
        ]

    assert minima(losses(True)) == [6.0]
    assert len(minima(losses(False))) > 1


@settings(max_examples=15)
@given(st.floats(0.0, 0.01), st.floats(2.0, 16.0), st.integers(0, 100))
def test_a_gain_of_0_is_a_free_run_and_of_1_follows(e, level, seed):
    """To the bit, and from one sample to the next."""
    physics, values = ROTOR.model, ROTOR.with_parameters(e=e).parameters
    random = np.random.default_rng(seed)
    volts = np.full(150, level)
    other = np.cumsum(random.standard_normal(150))
    start = physics.initial_state(values, 0.0)
    free = physics.simulate(values, volts, PERIOD, start)
    none = physics.simulate(values, volts, PERIOD, start, tracked=(other, 0.0))
    np.testing.assert_array_equal(none, free)
    whole = physics.simulate(values, volts, PERIOD, start, tracked=(other, 1.0))
    # A prediction from one sample to the next begins at the speed that was given there.
    for k in (40, 90):
        state = whole[k].copy()
        state[1] = other[k]
        one = physics.simulate(values, volts[k : k + 2], PERIOD, state)
        np.testing.assert_allclose(one[1], whole[k + 1], rtol=1e-6, atol=1e-9)
    same = physics.simulate(values, volts, PERIOD, start, tracked=(free[:, 1], 1.0))
    np.testing.assert_allclose(same, free, rtol=1e-6, atol=1e-9)


def test_a_part_of_the_experiments_leaves_the_same(captured):
    """Experiments do not touch each other."""
    use = uses(["unbalance:e=0.005"])
    part = captured.part([1])
    np.testing.assert_allclose(part.of(use), captured.of(use)[captured.pieces[1].rows])


def test_threads_change_nothing():
    """Each experiment is its own piece of work."""
    experiments = record(ROTOR, "unbalance:e=0.006", volts=FASTER, lead=200, count=4)
    use = uses(["unbalance:e=0.006"])
    one, four = (FreeRunResiduals(ROTOR, experiments, (NOISE, 1.0), workers=w) for w in (1, 4))
    np.testing.assert_array_equal(
        one.of(use, starts=one.start_states(use)), four.of(use, starts=four.start_states(use))
    )


def test_impossible_values_are_a_very_wrong_answer_not_an_error():
    """A search that comes by them turns back."""
    residuals = FreeRunResiduals(ROTOR, record(ROTOR), (NOISE, 1.0))
    rest = residuals.of(uses(["viscous_friction:b=-0.5"]))
    assert np.isfinite(rest).all()
    assert float(rest @ rest) > 1e6 * residuals.size


@pytest.mark.slow
def test_a_torque_is_found_whatever_the_angles_at_which_the_machine_stood():
    """Angles are sought anew as the fit moves on: kept, they would hold it back."""
    random = np.random.default_rng(5)
    recorded = []
    for k, phase in enumerate(random.uniform(-np.pi, np.pi, 6)):
        (e,) = record(
            ROTOR, f"gravity_imbalance:torque=0.14,phase={phase}", samples=1000, count=1, seed=k,
            volts=(-6.0, 6.0),
        )  # fmt: skip
        recorded.append(replace(e, number=k + 1))
    (gravity,) = candidates(ROTOR, ["gravity_imbalance"])
    residuals = FreeRunResiduals(ROTOR, recorded, (NOISE, 1.0))
    start = gravity.coordinates({"torque": 0.09, "phase": 0.0})
    found = fit(residuals, [gravity], [start])
    assert gravity.given(found.z[0])["torque"] == pytest.approx(0.14, rel=0.03)
    assert found.loss < 1.1 * residuals.size


@pytest.mark.parametrize("angles", [(0.0, 0.0, 0.0), (0.0, 2.0, -1.0)])
def test_own_start_angles_promise_little_where_all_are_one(angles):
    """What noise lets them gain: an angle's degree of freedom each, and the best of 13."""
    recorded = [
        record(MOTOR, f"gravity_imbalance:torque=0.005,phase={a}", count=1, seed=20 + k)[0]
        for k, a in enumerate(angles)
    ]
    residuals = FreeRunResiduals(
        MOTOR, [replace(e, number=k) for k, e in enumerate(recorded, start=1)], (NOISE, 1.0)
    )
    true, none = uses(["gravity_imbalance:torque=0.005"]), np.zeros((residuals.size, 0))
    gain = gain_of_angles(residuals, true, none, SEARCH_STEP)
    if any(angles):
        assert gain > residuals.size
    else:
        assert 0 <= gain < chi2.ppf(1 - CHANCE, 13 * len(angles))
