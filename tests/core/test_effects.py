"""Effects: each does what its formula says, and refuses what it cannot be."""

from __future__ import annotations

import dataclasses
import math
import re
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

import ldt_core as ldt
from ldt_core.base.errors import BadInput, OptionError
from ldt_core.checks import check_effect
from ldt_core.effects import EFFECTS, get_effect, parse_effect
from ldt_core.effects.drive import COPPER
from ldt_core.effects.friction import STICK_SPEED
from ldt_core.machine.machine_file import load_machine
from ldt_core.physics import integrate
from ldt_core.physics.effect import Effect
from ldt_core.physics.parameter import Parameter

ROTOR, MOTOR = load_machine("rotor"), load_machine("dc_motor")
PERIOD = 0.01


def free_run(machine, volts, *effects, speed=0.0, period=PERIOD):
    """(states, measured speed) from a steady start."""
    uses = [parse_effect(e) if isinstance(e, str) else e for e in effects]
    physics, values = machine.model, machine.parameters
    initial = physics.initial_state(values, speed)
    states = physics.simulate(values, volts, period, initial, uses)
    return states, physics.measure(states, period, uses)


def held(level, seconds, period=PERIOD):
    return np.full(round(seconds / period) + 1, float(level))


@pytest.mark.slow
@pytest.mark.parametrize("name", EFFECTS.names())
def test_every_effect_keeps_the_promises_of_the_generic_suite(name):
    """Neutral values change nothing, bounds hold, runs repeat, typical values are seen."""
    effect = EFFECTS.get(name)
    assert effect.name == name
    check_effect(effect)


SI = {"V", "A", "Ohm", "H", "N", "m", "kg", "s", "s^2", "rad", "K", "W"}
#: Parameters that physics allows both signs: an increment of what is there, an offset, an angle.
EITHER_SIGN = {
    ("viscous_friction", "b"),
    ("sensor_bias", "bias"),
    ("input_bias", "bias"),
    ("gravity_imbalance", "phase"),
    ("cogging_torque", "phase"),
}


@pytest.mark.parametrize("name", EFFECTS.names())
def test_every_effect_says_what_it_is_and_where_from(name):
    """Description, equation, reference; each parameter in SI, with a sign and a size."""
    effect = EFFECTS.get(name)
    assert effect.description
    assert effect.equation
    assert len(effect.reference) > 20
    for p in effect.parameters:
        assert set(p.unit.replace("/", " ").split()) <= SI, p
        assert p.scale > 0, p
        assert (p.low < 0) == ((name, p.name) in EITHER_SIGN), p


def test_the_suite_catches_an_effect_that_is_not_neutral():
    """A default that changes the speed is found out."""
    wrong = Effect(
        name="wrong",
        description="always there",
        equation="torque = -0.1",
        parameters=(Parameter("torque", "N m", 0.0, default=0.1, description="T"),),
        torque=EFFECTS.get("constant_load").torque,
    )
    with pytest.raises(AssertionError, match="neutral values change the speed by"):
        check_effect(wrong)


@pytest.mark.parametrize(
    ("level", "effect", "torque"),
    [
        (10, "coulomb_friction:torque=0.1", lambda w: 0.1),
        (10, "constant_load:torque=0.1", lambda w: 0.1),
        (10, "quadratic_drag:c=0.0002", lambda w: 2e-4 * w**2),
        (10, "viscous_friction:b=0.005", lambda w: 0.005 * w),
        (
            10,
            "stribeck_friction:torque=0.1,static=0.2,velocity=20",
            lambda w: 0.1 + 0.2 * math.exp(-((w / 20) ** 2)),
        ),
        (10, "asymmetric_friction:torque_forward=0.2,torque_backward=0.05", lambda w: 0.2),
        (-10, "asymmetric_friction:torque_forward=0.2,torque_backward=0.05", lambda w: -0.05),
        (10, "viscous_asymmetric:b_forward=0.006,b_backward=0.003", lambda w: 0.006 * w),
        (-10, "viscous_asymmetric:b_forward=0.006,b_backward=0.003", lambda w: 0.003 * w),
    ],
)
def test_a_load_takes_its_torque_from_the_steady_speed(level, effect, torque):
    """At steady speed K_t i = b w + T(w), to eight digits, and V = R i + K_t w."""
    states, _ = free_run(ROTOR, held(level, 20), effect)
    p, (speed, current) = ROTOR.parameters, states[-1, 1:3]
    assert p["K_t"] * current == pytest.approx(p["b"] * speed + torque(speed), rel=1e-8)
    assert p["R"] * current + p["K_t"] * speed == pytest.approx(level, rel=1e-8)


def test_dry_friction_above_the_stall_torque_holds_the_shaft():
    """The motor pulls with 0.3 N m against 0.5: the shaft creeps below the smoothing speed."""
    _, speed = free_run(ROTOR, held(1, 5), "coulomb_friction:torque=0.5")
    assert np.abs(speed).max() < STICK_SPEED


def test_a_constant_load_turns_the_shaft_back_at_zero_voltage_and_friction_does_not():
    """A hoist's load falls; friction only resists."""
    _, fallen = free_run(ROTOR, held(0, 5), "constant_load:torque=0.1")
    _, still = free_run(ROTOR, held(0, 5), "coulomb_friction:torque=0.1")
    assert fallen[-1] < -0.5
    assert np.all(still == 0)


def test_source_and_armature_resistance_cannot_be_told_apart_from_the_command():
    """0.3 Ohm in the supply or in the winding: the same speed, by two different routes."""
    volts = np.repeat([6.0, 14, -9, 3], 200)
    _, source = free_run(ROTOR, volts, "source_resistance:resistance=0.3")
    _, armature = free_run(ROTOR, volts, "armature_resistance:factor=1.3")
    np.testing.assert_allclose(source, armature, atol=1e-6)


def test_gravity_imbalance_is_the_weight_of_an_eccentric_mass():
    """T = m g e gives the speed of a horizontal shaft with that e, next to the same unbalance."""
    volts = np.repeat([6.0, 12], 300)
    lying = ROTOR.with_parameters(e=0.001, g=9.81)
    weight = 4.9 * 9.81 * 0.001
    standing = ROTOR.with_parameters(e=0.001)
    _, true = free_run(lying, volts)
    _, ours = free_run(standing, volts, f"gravity_imbalance:torque={weight!r}")
    np.testing.assert_allclose(ours, true, atol=1e-9)


def test_cogging_has_its_periods_in_a_turn():
    """The speed ripples n times a turn."""
    states, speed = free_run(ROTOR, held(6, 20), "cogging_torque:torque=0.3,periods=7")
    late = slice(1000, None)
    angle = np.linspace(*states[late, 0][[0, -1]], 4096)
    ripple = np.interp(angle, states[late, 0], speed[late] - speed[late].mean())
    cycles = np.fft.rfftfreq(angle.size, (angle[1] - angle[0]) / (2 * math.pi))
    strongest = cycles[np.argmax(np.abs(np.fft.rfft(ripple * np.hanning(angle.size))))]
    assert strongest == pytest.approx(7, abs=0.1)


def test_a_winding_settles_where_cooling_balances_its_losses():
    """rise = R_th R (1 + alpha rise) i^2 after many time constants; cold at the start."""
    effect = "winding_heating:thermal_resistance=5,time_constant=0.5"
    states, _ = free_run(ROTOR, held(16, 20), effect, "coulomb_friction:torque=1")
    current, rise = states[-1, 2], states[-1, -1]
    assert states[0, -1] == 0
    assert rise == pytest.approx(5 * (1 + COPPER * rise) * current**2, rel=1e-6)
    assert ROTOR.parameters["R"] * (1 + COPPER * rise) * current + 0.3 * states[
        -1, 1
    ] == pytest.approx(16, rel=1e-6)


def test_a_coupling_is_the_linear_two_mass_system():
    """Against the matrix exponential of twist, speed, current, far speed; stiff means rigid."""
    effect = "torsional_compliance:share=0.4,stiffness=3,damping=0.02"
    near, far, k, d = 0.012, 0.008, 3, 0.02
    a = np.array(
        [
            [0, 1, 0, -1],
            [-k / near, -(0.01 + d) / near, 0.3 / near, d / near],
            [0, -0.3 / 0.002, -1 / 0.002, 0],
            [k / far, d / far, 0, -d / far],
        ]
    )
    steady = -np.linalg.solve(a, [0, 0, 8 / 0.002, 0])
    states, _ = free_run(ROTOR, held(8, 1), effect)
    exact = [steady - expm(a * t) @ steady for t in np.arange(101) * PERIOD]
    np.testing.assert_allclose(states[:, 1], [x[1] for x in exact], atol=1e-6)
    np.testing.assert_allclose(states[:, -1], [x[3] for x in exact], atol=1e-6)
    stiff = free_run(ROTOR, held(8, 1), "torsional_compliance:share=0.4,stiffness=5000,damping=1")
    np.testing.assert_allclose(stiff[1], free_run(ROTOR, held(8, 1))[1], atol=0.02)


def test_a_spring_holds_the_shaft_where_the_motor_at_standstill_balances_it():
    """K_t V / R = k theta, both ways."""
    stall = MOTOR.parameters["K_t"] / MOTOR.parameters["R"]
    for volts in (12.0, -6.0):
        states, _ = free_run(MOTOR, held(volts, 60), "spring_load:stiffness=0.01")
        assert states[-1, 0] == pytest.approx(stall * volts / 0.01, rel=1e-6)


def test_a_backlash_lets_the_motor_turn_alone_through_its_play():
    """Until the twist is half of it, as a motor without the far end; closed, as with it."""
    effect = "backlash:share=0.4,slack=0.5,stiffness=100,damping=0.2"
    states, _ = free_run(MOTOR, held(6, 2, 0.001), effect, period=0.001)
    alone, _ = free_run(MOTOR, held(6, 2, 0.001), "inertia:factor=0.6", period=0.001)
    twist = states[:, 0] - states[:, -2]
    free = int(np.argmax(twist > 0.25))
    assert 10 < free < 200
    np.testing.assert_allclose(states[:free, 1], alone[:free, 1], rtol=1e-4)
    assert np.all(states[:free, -1] == 0)
    rigid, _ = free_run(MOTOR, held(6, 2, 0.001), period=0.001)
    assert states[-1, 1] == pytest.approx(rigid[-1, 1], rel=1e-3)


@pytest.mark.parametrize("blow", [2.0, 5.0, 20.0])
@pytest.mark.parametrize(
    ("stiffness", "damping"), [(30, 0.005), (30, 0.02), (30, 0.05), (10, 0.03)]
)
def test_a_blow_of_teeth_leaves_what_a_spring_with_a_damper_does(stiffness, damping, blow):
    """Schwager, Poschel: Coefficient of restitution and linear-dashpot model revisited (2007)."""
    mass = 0.25 * MOTOR.parameters["J"]  # of two equal halves, in series
    decay = damping / (2 * mass)
    swing = math.sqrt(stiffness / mass - decay**2)
    angle = math.pi - math.atan(2 * decay * swing / (swing**2 - decay**2))
    free, physics = {**MOTOR.parameters, "K_t": 1e-9, "b": 0.0}, MOTOR.model
    use = [parse_effect(f"backlash:share=0.5,slack=0.2,{stiffness=!r},{damping=!r}")]
    start = np.append(physics.initial_state(free, blow), [0.0, 0.0])  # the far end stands still
    states = physics.simulate(free, held(0, 0.02 + 0.15 / blow, 5e-4), 5e-4, start, use)
    apart = float(np.max(states[:, -1] - states[:, 1]))
    assert apart / blow == pytest.approx(math.exp(-decay / swing * angle), abs=2e-3)


def test_a_backlash_without_play_is_a_coupling():
    """Whose ends are pressed together where they would be drawn apart."""
    same = "share=0.4,stiffness=3,damping=0.02"
    without = free_run(ROTOR, held(8, 1), f"backlash:slack=0,{same}")[1]
    coupling = free_run(ROTOR, held(8, 1), f"torsional_compliance:{same}")[1]
    np.testing.assert_allclose(without, coupling, atol=0.05)


@given(
    share=st.floats(0.05, 0.9),
    slack=st.floats(0, 2),
    stiffness=st.floats(1, 1000),
    damping=st.floats(0, 1),
)
def test_a_backlash_creates_no_energy(share, slack, stiffness, damping):
    """A motor without friction that turns alone keeps no more than it had: its ends only push."""
    free = dataclasses.replace(MOTOR, parameters={**MOTOR.parameters, "K_t": 1e-9, "b": 0.0})
    use = f"backlash:{share=!r},{slack=!r},{stiffness=!r},{damping=!r}"
    states, _ = free_run(free, held(0, 0.5), use, speed=20.0)
    rotor = (1 - share) * free.parameters["J"] * states[:, 1] ** 2
    load = share * free.parameters["J"] * states[:, -1] ** 2
    pressed = np.maximum(np.abs(states[:, 0] - states[:, -2]) - slack / 2, 0)
    energy = rotor + load + stiffness * pressed**2
    assert energy.max() <= energy[0] * (1 + 1e-3)


@pytest.mark.slow
@given(delay=st.floats(0, 0.3), level=st.floats(1, 20))
def test_a_delay_shifts_the_response_off_the_grid_as_well(delay, level):
    """From rest, the speed at t with a delay is the speed at t - delay without.

    A linear machine's error of integration is proportional to its voltage.
    """
    physics, values = MOTOR.model, MOTOR.parameters
    speed = free_run(MOTOR, held(level, 0.5), f"input_delay:delay={delay!r}")[1]
    for k in (10, 25, 50):
        early = k * PERIOD - delay
        if early <= 1e-9:
            assert speed[k] == pytest.approx(0, abs=1e-6)
        else:
            exact = physics.simulate(values, [level, level], early, np.zeros(3))[-1, 1]
            assert speed[k] == pytest.approx(exact, abs=1e-6 * level)


def test_before_a_delayed_command_the_machine_runs_on_as_it_was():
    """A machine that starts in steady running stays there until the command arrives."""
    _, speed = free_run(ROTOR, held(20, 1), "input_delay:delay=0.2", speed=30.0)
    np.testing.assert_allclose(speed[:21], 30.0, atol=1e-6)
    assert speed[30] > 31


def test_what_lies_between_command_and_terminals_changes_the_command():
    """12 V behind a limit of 10 is 10 V; behind a dead zone of 0.5 V it is 11.5, either sign."""
    for level, effect, same in [
        (12, "voltage_saturation:limit=10", 10),
        (-12, "voltage_saturation:limit=10", -10),
        (12, "input_deadzone:width=0.5", 11.5),
        (-12, "input_deadzone:width=0.5", -11.5),
        (0.4, "input_deadzone:width=0.5", 0),
        (12, "input_gain:factor=0.5", 6),
        (-12, "input_bias:bias=0.5", -11.5),
    ]:
        got = free_run(ROTOR, held(level, 3), effect)[1]
        np.testing.assert_array_equal(got, free_run(ROTOR, held(same, 3))[1])


def test_a_slow_sensor_follows_as_a_first_order_filter():
    """Exact for a ramp: it lags by tau (1 - exp(-t / tau)); at rest on its first sample."""
    time, tau = np.arange(200) * PERIOD, 0.07
    lag = EFFECTS.get("sensor_lag").on_measurement
    ramp = lag(5 + 3 * time, PERIOD, tau)
    np.testing.assert_allclose(ramp, 5 + 3 * (time - tau * -np.expm1(-time / tau)), atol=1e-12)


def test_gain_and_bias_act_on_the_measurement_alone():
    """The states are those of the machine, only the measured speed differs."""
    volts = held(8, 2)
    states, plain = free_run(ROTOR, volts)
    got, speed = free_run(ROTOR, volts, "sensor_gain:factor=1.1", "sensor_bias:bias=-2")
    np.testing.assert_array_equal(got, states)
    np.testing.assert_allclose(speed, plain * 1.1 - 2, rtol=1e-15)


def test_one_compiled_kernel_serves_every_combination():
    """Three more effects, one of them new: the kernel is not compiled again."""
    for machine in (ROTOR, MOTOR):
        free_run(machine, held(8, 1), "coulomb_friction")
    before = len(integrate.runge_kutta.signatures)
    mixed = ("winding_heating", "cogging_torque", "source_resistance", "torsional_compliance")
    free_run(ROTOR, held(8, 1), *mixed)
    free_run(MOTOR, held(8, 1), "quadratic_drag", "constant_load")
    assert len(integrate.runge_kutta.signatures) == before
    assert before <= 4, "with a foundation or without, with effects or without"


def test_effects_add_up_in_any_order():
    """Friction and load together, either way round, and their sum as one load."""
    volts = held(10, 5)
    one = free_run(ROTOR, volts, "constant_load:torque=0.1", "quadratic_drag:c=0.0001")[1]
    two = free_run(ROTOR, volts, "quadratic_drag:c=0.0001", "constant_load:torque=0.1")[1]
    np.testing.assert_allclose(one, two, rtol=1e-12, atol=1e-12)
    halves = ("constant_load:torque=0.06", "constant_load:torque=0.04", "quadratic_drag:c=0.0001")
    np.testing.assert_allclose(free_run(ROTOR, volts, *halves)[1], one, rtol=1e-9, atol=1e-9)


@pytest.mark.slow
def test_a_user_adds_an_effect_in_a_file_of_their_own(tmp_path):
    """Named as path/to/file.py:NAME, with parameters, it acts as ours do."""
    file = tmp_path / "mine.py"
    file.write_text(
        "from ldt_core.effects.base import Effect\n"
        "from ldt_core.physics.parameter import Parameter\n"
        "def torque(t, theta, omega, current, voltage, p):\n"
        "    return -p[0] * omega**3\n"
        "CUBIC = Effect(name='cubic_drag', description='grows with the cube', "
        "equation='-c omega^3', torque=torque, typical={'c': 1e-5},\n"
        "    parameters=(Parameter('c', 'N m s^3', 0.0, default=0.0, description='c'),))\n"
    )
    effect, values = parse_effect(f"{file}:CUBIC:c=2e-5")
    assert values == {"c": 2e-5}
    check_effect(effect)
    states, _ = free_run(ROTOR, held(10, 20), (effect, values))
    speed, current = states[-1, 1:3]
    assert 0.3 * current == pytest.approx(0.01 * speed + 2e-5 * speed**3, rel=1e-7)


@pytest.mark.slow
def test_a_file_of_ones_own_serves_one_command_after_the_other(tmp_path):
    """A second process reads the same file, and finds no compiled remains that it cannot use."""
    (tmp_path / "mine.py").write_text(
        "from ldt_core.effects.base import Effect\n"
        "from ldt_core.physics.parameter import Parameter\n"
        "def torque(t, theta, omega, current, voltage, p):\n"
        "    return -p[0] * omega\n"
        "MINE = Effect('mine', 'drag', '-c omega', (Parameter('c', '', 0.0, default=0.0),), "
        "typical={'c': 0.01}, torque=torque)\n"
    )
    use = "from ldt_core.effects import get_effect; get_effect('mine.py:MINE').compiled"
    for _ in range(2):
        done = subprocess.run([sys.executable, "-P", "-c", use], cwd=tmp_path, capture_output=True)
        assert done.returncode == 0, done.stderr.decode()


def test_a_bare_name_means_typical_values_and_a_value_leaves_the_rest_neutral():
    """`stribeck_friction` is plainly there; `stribeck_friction:velocity=3` is not."""
    assert parse_effect("unbalance")[1] == {"e": 0.008}
    assert parse_effect("stribeck_friction:velocity=3")[1]["static"] == 0
    effect, values = parse_effect(" coulomb_friction : torque = 0.1 ")
    assert effect.describe(values) == "coulomb_friction:torque=0.1"


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("unbalance:e=5mm", 0.005),
        ("unbalance:e= 5 mm ", 0.005),
        ("unbalance:e=0.5cm", 0.005),
        ("unbalance:e=5000 μm", 0.005),
        ("unbalance:e=5e-3m", 0.005),
        ("coulomb_friction:torque=50 mN m", 0.05),
        ("input_delay:delay=20ms", 0.02),
        ("sensor_bias:bias=-1rad/s", -1.0),
    ],
)
def test_a_value_may_have_its_unit(text, value):
    """The SI unit, also with a prefix."""
    (found,) = parse_effect(text)[1].values()
    assert found == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("unbalanse", "did you mean 'unbalance'"),
        ("unbalance:f=1", "effect unbalance: expected one of 'e'"),
        ("unbalance:e=-1", "effect unbalance, e: expected at least 0 m, got -1"),
        ("unbalance:e=nan", "effect unbalance, e: expected at least 0 m"),
        ("unbalance:e=wide", "expected a number, in m or with its unit, got 'wide'"),
        ("unbalance:e=5V", "expected a number, in m or with its unit, got '5V'"),
        ("unbalance:e=5", "expected at most 1 m (5mm is 0.005 m), got 5 m"),
        ("unbalance:e=5m", "got 5 m"),
        ("unbalance:", "param=value"),
        ("unbalance:e=1,e=2", "expected one value, got two"),
        ("torsional_compliance:share=2", "at least 0 and at most 0.95"),
        ("ldt_core/base/errors.py:BadInput", "expected an object of class Effect"),
        ("nowhere.py:X", "a Python file at nowhere.py"),
    ],
)
def test_what_is_no_effect_is_refused_with_a_sentence(text, words):
    """Unknown names, values out of bounds, things that are no effects."""
    with pytest.raises(OptionError, match="(?s).*" + re.escape(words)):
        parse_effect(text)


@pytest.mark.parametrize(
    ("machine", "effect", "words"),
    [
        (MOTOR, "foundation_stiffness", "a machine with parameter K_x and K_y, got physics"),
        (MOTOR, "unbalance", "a machine with parameter e"),
        (ROTOR, "viscous_friction:b=-0.02", "b of the machine: expected at least 0 N m s"),
        (ROTOR, "coulomb_friction:torque=1e12", "a fastest rate of at most"),
    ],
)
def test_an_effect_that_the_machine_cannot_have_is_refused(machine, effect, words):
    """A motor without foundation, friction below nothing, friction beyond computing."""
    with pytest.raises(BadInput, match=words):
        free_run(machine, held(5, 1), effect)


def test_a_function_that_cannot_be_compiled_is_refused_with_a_sentence():
    """Text among the numbers of a torque."""

    def torque(t, theta, omega, current, voltage, p):
        return "strong"

    effect = Effect("odd", "odd", "odd", (Parameter("c", "", default=0.0),), torque=torque)
    with pytest.raises(OptionError, match="effect odd: expected a function that numba compiles"):
        free_run(ROTOR, held(5, 1), (effect, {"c": 0.0}))


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("mine", "their_effect:MIEN", "of the package their: expected their_effect:MIEN that can"),
        ("mine", "their_efect:MINE", "got ModuleNotFoundError: No module named 'their_efect'"),
        ("other", "their_effect:MINE", "an entry point of the effect's own name, 'mine'"),
        ("mine", "their_effect:Effect", "an object of class Effect"),
    ],
)
def test_a_wrong_entry_point_is_told_in_a_sentence(name, value, said, tmp_path, monkeypatch):
    """It was a traceback in every diagnosis, or an effect that no diagnosis could be read with."""
    (tmp_path / "their_effect.py").write_text(
        "from ldt_core.physics.effect import Effect\n"
        "from ldt_core.physics.parameter import Parameter\n"
        "MINE = Effect('mine', 'drag', '-c omega', (Parameter('c', '', 0.0, default=0.0),), "
        "torque=lambda t, a, w, i, u, p: -p[0] * w)\n"
    )
    about = tmp_path / "their-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: their\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(f"[ldt.effect]\n{name} = {value}\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(OptionError, match=re.escape(said)):
        get_effect(name)
    with pytest.raises(OptionError, match=re.escape(said)):
        load_machine("dc_motor").possible_effects()


@pytest.mark.parametrize(
    "wrong",
    [
        {},
        {"torque": math.cos, "on_voltage": math.cos},
        {"torque": math.cos, "terminal": math.cos, "states": ("a",)},
        {"on_voltage": math.cos, "states": ("a",)},
        {"torque": math.cos, "parameters": (Parameter("c", ""),)},
    ],
)
def test_an_effect_is_one_function_and_parameters_with_defaults(wrong):
    """Neither none nor two functions, and no parameter without a neutral value."""
    with pytest.raises(OptionError, match="effect odd"):
        Effect(**{"name": "odd", "description": "", "equation": "", "parameters": (), **wrong})


def cube(**more: float) -> Effect:
    """A drag of one's own that a small motor feels at 1e-10 N m s^3."""

    def torque(t, theta, omega, current, voltage, p):
        return -p[0] * omega**3

    size = Parameter("c", "N m s^3", 0.0, default=0.0, description="drag", **more)
    return Effect("cube", "drag", "-c omega^3", (size,), {"c": 1e-10}, torque=torque)


def test_an_effect_of_ones_own_is_found_in_the_sizes_of_its_machine():
    """Its scale was taken for the worked case's: the drag of the square was named in its place."""
    record = load_machine("dc_motor").as_dict()
    numbers = {"J": 2e-5, "K_t": 0.02, "R": 2.0, "L": 1e-3, "b": 1e-6}
    machine = ldt.Machine({**record, "parameters": numbers, "simulation": {}})
    mine = cube(scale=2e-11)
    experiments = ldt.simulate(machine, 4, effects={mine: {"c": 2e-11}}, noise=0.1, seed=2)
    rest = [n for n in EFFECTS.names() if n not in ("quadratic_drag", "viscous_friction")]
    found = ldt.diagnose(experiments, machine, effects=[mine], without=rest)
    assert found.verdict.effects == ["cube"]


def test_a_scale_that_is_far_from_what_is_typical_is_noticed():
    """A diagnosis would miss the effect, and name another."""
    assert cube().parameters[0].scale == 1e-10
    with pytest.raises(
        AssertionError, match="its typical value is 1e-10 from neutral and its scale"
    ):
        check_effect(cube(scale=1.0))
