"""Machines by MuJoCo's motor, joints and tendons, whose cause is in the library or outside it.

    python -m tests.mujoco_causes FOLDER [NAME...]

writes each answer, and a row for each to `table.md`. The file of each machine is a data sheet,
calibrated on noisy records of the healthy one.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from ldt_core.base.experiment import Experiment
from ldt_core.base.sentences import spoken
from ldt_core.calibration.calibrate import calibrate
from ldt_core.diagnosis.diagnose import diagnose
from ldt_core.physics.effect import Effect
from tests.motors import motor_file

TRUE = {"J": 2e-3, "K_t": 0.12, "R": 1.2, "L": 1e-5, "b": 5e-4}
SHEET = 0.05  # error of the data sheet, at most
NOISE, CURRENT_NOISE = 0.1, 0.02  # rad/s, A
STEP = 1e-3  # s, of the engine unless a case has its own

# A hinge with the rotor's inertia; a pendulum of `mass` at `arm`; behind a tendon a far inertia.
HINGE = """<mujoco><option timestep="{step}" integrator="implicitfast" gravity="0 0 -9.81"/>
<compiler angle="radian"/><worldbody>
<body><joint name="near" axis="0 1 0" armature="{near}" {joint}/>
<geom size="{ball}" pos="0 0 -{arm}" mass="{mass}"/></body>
<body pos="0 1 0"><joint name="far" axis="0 1 0" armature="{far}"/><geom size="0.01" mass="1e-6"/>
</body></worldbody><tendon>{tendon}</tendon></mujoco>"""
TENDON = '<fixed {law}><joint joint="near" coef="1"/><joint joint="far" coef="-1"/></fixed>'
BALL = 0.01  # m, radius of the pendulum's
FAR = 0.4  # of the inertia, where there is a tendon


@dataclass(frozen=True)
class Case:
    """A change of the machine, and how it is recorded.

    Args:
        true: names, for each effect that acts those of which any is right; () for no cause, None
            for one that the library does not have.
        motor: arguments of MuJoCo's motor.
        joint: attributes of the hinge.
        tendon: attributes of the tendon to the far inertia.
        drag: N m s^2, by the square of the speed.
        pendulum: mass [kg] and arm [m].
        supply: part of the command that reaches the motor.
        lag, delay: of the sensor [s], of the command [samples].
    """

    true: Sequence[str] | None
    motor: Mapping[str, Any] = field(default_factory=dict)
    joint: str = ""
    tendon: str = ""
    drag: float = 0.0
    pendulum: tuple[float, float] = (1e-6, 0.0)
    inertia: float = 1.0
    damping: float = TRUE["b"]
    limit: float = 0.0
    supply: float = 1.0
    lag: float = 0.0
    delay: int = 0
    volts: tuple[float, float] = (-12.0, 12.0)
    period: float = 0.01
    samples: int = 400
    count: int = 8
    hold: float = 0.5
    step: float = STEP
    current: bool = False


HEATS = {"thermal": [3.0, 4.0, 0.0, 0.0039, 25.0, 25.0]}
LONG: dict[str, Any] = {"period": 0.02, "samples": 1000, "hold": 2.0, "count": 6}
CASES: Mapping[str, Case] = {
    "none": Case(()),
    "none_forward": Case((), volts=(2.0, 12.0)),
    "friction": Case(["coulomb_friction"], joint='frictionloss="0.05"'),
    "lugre": Case(
        ["coulomb_friction stribeck_friction"],
        {"lugre": [100.0, 0.05, 0.03, 0.06, 2.0]},
        volts=(-5.0, 5.0),
    ),
    "pendulum": Case(["gravity_imbalance"], pendulum=(0.05, 0.04), volts=(-4.0, 4.0)),
    "cogging": Case(["cogging_torque"], {"cogging": [0.02, 7.0, 0.0]}, volts=(-4.0, 4.0)),
    "constant": Case(["motor_constant"], {"motorconst": [0.132, 0.132]}),
    "voltage_limit": Case(["voltage_saturation"], limit=8.0),
    "torque_limit": Case(["current_limit"], {"saturation": [0.5, 0.0, 0.0]}),
    "current_limit": Case(["current_limit"], {"saturation": [0.0, 5.0, 0.0]}),
    "heating": Case(["winding_heating"], HEATS, **LONG),
    "coupling": Case(
        ["torsional_compliance"], tendon='stiffness="2" damping="0.004"', period=0.005
    ),
    "backlash": Case(
        ["backlash"],
        tendon='limited="true" range="-0.075 0.075" solreflimit="-2e5 -200"',
        period=0.005,
        step=2.5e-4,
    ),
    "drag": Case(["quadratic_drag"], drag=3e-5),
    "supply": Case(["input_gain"], supply=0.9),
    "supply_current": Case(["input_gain"], supply=0.9, current=True),
    "spring": Case(["spring_load"], joint='stiffness="0.01"', volts=(-3.0, 3.0)),
    "stop": Case(
        None, joint='limited="true" range="-20 20" solreflimit="0.004 0.3"', volts=(-6.0, 6.0)
    ),
    "resistance_friction": Case(
        ["armature_resistance", "coulomb_friction"],
        {"resistance": 1.56},
        joint='frictionloss="0.04"',
    ),
    "inertia_damping": Case(["inertia", "viscous_friction"], inertia=1.4, damping=3.5e-3),
    "friction_pendulum": Case(
        ["coulomb_friction", "gravity_imbalance"],
        joint='frictionloss="0.03"',
        pendulum=(0.05, 0.06),
        volts=(-5.0, 5.0),
    ),
    "friction_lag": Case(["coulomb_friction", "sensor_lag"], joint='frictionloss="0.05"', lag=0.03),
    "delay_constant": Case(
        ["input_delay", "motor_constant"], {"motorconst": [0.108, 0.108]}, delay=2
    ),
    "cogging_friction": Case(
        ["cogging_torque", "coulomb_friction"],
        {"cogging": [0.03, 12.0, 0.3]},
        joint='frictionloss="0.04"',
        volts=(-4.0, 4.0),
        period=0.005,
    ),
    "heating_friction": Case(
        ["winding_heating", "coulomb_friction"], HEATS, joint='frictionloss="0.05"', **LONG
    ),
    "friction_inertia_drag": Case(
        ["coulomb_friction", "inertia", "quadratic_drag"],
        joint='frictionloss="0.03"',
        inertia=1.3,
        drag=2e-5,
    ),
}


def simulated(case: Case, volts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(L,) speed [rad/s] and current [A] from rest, without noise, under (L,) voltages."""
    inertia = TRUE["J"] * case.inertia
    mass, arm = case.pendulum
    inertia -= mass * arm**2 + 0.4 * mass * BALL**2  # which the engine adds to the hinge's own
    far = FAR * inertia if case.tendon else 1.0
    tendon = TENDON.format(law=case.tendon) if case.tendon else ""
    xml = HINGE.format(
        step=case.step,
        near=inertia - far if tendon else inertia,
        joint=f'damping="{case.damping}" {case.joint}',
        mass=mass,
        arm=arm,
        ball=BALL,
        far=far,
        tendon=tendon,
    )
    spec = mujoco.MjSpec.from_string(xml)
    actuator = spec.add_actuator(name="motor", target="near")
    actuator.trntype = mujoco.mjtTrn.mjTRN_JOINT
    motor: dict[str, Any] = {"motorconst": [TRUE["K_t"]] * 2, "resistance": TRUE["R"], **case.motor}
    actuator.set_to_dcmotor(**motor)
    if case.limit:
        actuator.ctrllimited, actuator.ctrlrange = 1, [-case.limit, case.limit]
    model = spec.compile()
    data, steps = mujoco.MjData(model), round(case.period / case.step)
    supplied = case.supply * np.concatenate([np.zeros(case.delay), volts])[: len(volts)]
    constant = motor["motorconst"][0]
    speed, current, shown = np.empty(len(volts)), np.empty(len(volts)), 0.0
    for k, level in enumerate(supplied):
        data.ctrl[0], now = level, data.qvel[0]
        shown = now if not case.lag else now + (shown - now) * np.exp(-case.period / case.lag)
        speed[k], current[k] = (
            shown,
            (data.actuator_force[0] / constant if k else level / TRUE["R"]),
        )
        for _ in range(steps):
            data.qfrc_applied[0] = -case.drag * data.qvel[0] * abs(data.qvel[0])
            mujoco.mj_step(model, data)
    return speed, current


def recorded(case: Case, healthy: bool, seed: int) -> list[Experiment]:
    """Experiments under random steps, with noise, of the machine before its change or after."""
    random = np.random.default_rng(seed)
    plain = Case((), step=case.step, period=case.period)
    found, hold = [], round(case.hold / case.period)
    for number in range(1, case.count + 1):
        levels = random.uniform(*case.volts, case.samples // hold + 1)
        volts = np.repeat(levels, hold)[: case.samples]
        speed, current = simulated(plain if healthy else case, volts)
        speed = speed + random.normal(0, NOISE, speed.size)
        amperes = current + random.normal(0, CURRENT_NOISE, current.size) if case.current else None
        found.append(Experiment(number, 100.0 * number, case.period, volts, speed, amperes))
    return found


def answer(case: Case, effects: Sequence[Effect] | None = None) -> Any:
    """The diagnosis of a case."""
    random = np.random.default_rng(7)
    sheet = {n: v * (1 + SHEET * random.uniform(-1, 1)) for n, v in TRUE.items()}
    given = motor_file(sheet, case.samples, case.period)
    known = calibrate(given, recorded(case, True, 1)).with_recordings(["healthy"]).machine
    return diagnose(
        known, recorded(case, False, 101), recordings=["shown"], effects=effects, workers=1
    )


def right(case: Case, acting: Sequence[Sequence[str]], kind: str) -> bool:
    """Whether each true effect is named or in a group of its own, and nothing else."""
    if not case.true:
        return kind == ("none" if case.true is not None else "unknown")
    groups, missing = [set(g) for g in acting], []
    for names in case.true:
        own = next((g for g in groups if g & set(names.split())), None)
        missing += [] if own else [names]
        groups = [g for g in groups if g is not own]
    return not missing and not groups


def either(names: str) -> str:
    """Names of which any is right, in words."""
    return " or ".join(map(spoken, names.split()))


def main(folder: str, *names: str) -> None:
    """Answer the cases, one line each."""
    rows = ["| true | answer | confidence | |", "|---|---|---|---|"]
    Path(folder).mkdir(parents=True, exist_ok=True)
    for name in names or CASES:
        case, found = CASES[name], answer(CASES[name])
        verdict = found.verdict
        said = "; ".join(" or ".join(map(spoken, g)) for g in verdict.acting) or verdict.kind
        true = "outside" if case.true is None else ", ".join(map(either, case.true)) or "none"
        mark = "" if right(case, verdict.acting, verdict.kind) else "wrong"
        rows.append(f"| {true} | {said} | {verdict.confidence:.2f} | {mark} |")
        print(name, rows[-1], flush=True)
        (Path(folder) / f"{name}.json").write_text(json.dumps(found.as_dict()), encoding="utf-8")
    (Path(folder) / "table.md").write_text("\n".join(rows) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
