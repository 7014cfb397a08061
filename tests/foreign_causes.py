"""Machines with causes that the library does not have, at small gaps and in short records.

    python -m tests.foreign_causes FOLDER [NAME...]

writes each answer and a `score.json`, as `ldt challenge score` does, for `confidence_calibration`.
The right answer is *unknown*; soft bristles are dry friction, too, and a constant that falls with
the current is magnetic saturation. Each machine is a motor under Runge-Kutta steps of 1 ms, its
file calibrated on noisy records of the healthy one.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ldt_core.base.experiment import Experiment, rms
from ldt_core.calibration.calibrate import calibrate
from ldt_core.diagnosis.diagnose import diagnose
from tests.motors import motor_file

J, K, R, L, B = 1e-3, 0.05, 0.8, 1e-3, 3e-4
TRUE = {"J": J, "K_t": K, "R": R, "L": L, "b": B}
PERIOD, FINER, HELD = 0.01, 10, 100  # s, steps of the engine in a sample, samples of a level
EXPERIMENTS, HEALTHY, SHEET = 8, 4, 0.05  # of a case, to calibrate by, errors of the data sheet
#: Gap over noise, samples, range of the voltage [V].
SETTINGS = ((2.5, 300, (-12, 12)), (2.5, 300, (3, 12)), (3.0, 600, (-12, 12)))
SETTINGS += ((20.0, 600, (-12, 12)),)
SEED = 3
#: Effects of the library that are one law of a cause: in a group, one of them is right as well.
ALSO_RIGHT = {
    "bristles": {"coulomb_friction", "stribeck_friction"},
    "saturation": {"magnetic_saturation"},
}
Array = np.ndarray


def motor(y: Array, u: Array, torque: Any = 0.0, *own: Any, **changed: Any) -> Array:
    """Rates of angle, speed, current, and of a cause's own states."""
    p = {"J": J, "K": K, "b": B, **changed}
    speed = (p["K"] * y[2] - p["b"] * y[1] + torque) / p["J"]
    return np.stack([y[1], speed, (u - R * y[2] - p["K"] * y[1]) / L, *own])


def healthy(t: float, y: Array, u: Array) -> Array:
    return motor(y, u)


def cam(t: float, y: Array, u: Array) -> Array:
    """A follower that is lifted over 60 degrees, and rests."""
    angle = np.mod(y[0], 2 * np.pi)
    return motor(y, u, -0.02 * np.where(angle < 1.05, np.sin(2 * np.pi * angle / 1.05), 0.0))


def magnets_warm(t: float, y: Array, u: Array) -> Array:
    """K_t falls by 3 % in 6 s of each experiment."""
    return motor(y, u, K=K * (1 - 0.03 * t / 6.0))


def saturation(t: float, y: Array, u: Array) -> Array:
    return motor(y, u, K=K / (1 + (np.abs(y[2]) / 12.0) ** 3))


def governor(t: float, y: Array, u: Array) -> Array:
    """Inertia that grows with the speed."""
    part = (y[1] / 120.0) ** 2
    return motor(y, u, J=J + 6e-4 * part / (1 + part))


def belt(t: float, y: Array, u: Array) -> Array:
    """Part of the inertia is behind a belt that slips."""
    pull = 0.03 * np.clip(y[1] - y[3], -1, 1)
    return motor(y, u, -pull, (pull - 1e-4 * y[3]) / 4e-4, J=6e-4, b=2e-4)


def film(t: float, y: Array, u: Array) -> Array:
    """Friction under a film of oil that takes half a second to form."""
    friction = 0.03 * np.tanh(y[1]) * (1 - 0.8 * y[3])
    return motor(y, u, -friction, (np.minimum(np.abs(y[1]) / 60.0, 1.0) - y[3]) / 0.5)


def bristles(t: float, y: Array, u: Array) -> Array:
    """LuGre's friction, so soft that it takes 0.3 rad to slide."""
    most = 0.03 * (0.6 + 0.4 * np.exp(-((y[1] / 8) ** 2)))
    bent = y[1] - 0.1 * np.abs(y[1]) / most * y[3]
    return motor(y, u, -(0.1 * y[3] + 1e-4 * bent), bent)


def battery(t: float, y: Array, u: Array) -> Array:
    """Sags with the current, and recovers in 1.5 s."""
    return motor(y, u * np.clip(1 - y[3], 0, 1), 0.0, (0.012 * np.abs(y[2]) - y[3]) / 1.5)


def relay_brake(t: float, y: Array, u: Array) -> Array:
    """Grips above 90 rad/s and lets go below 50."""
    wanted = np.where(np.abs(y[1]) > 90, 1.0, np.where(np.abs(y[1]) < 50, 0.0, y[3]))
    torque = -0.005 * np.sign(y[1]) * (1 + np.tanh(10 * (y[3] - 0.5)))
    return motor(y, u, torque, (wanted - y[3]) / 0.05)


def fan_stall(t: float, y: Array, u: Array) -> Array:
    return motor(y, u, -3e-6 * y[1] * np.abs(y[1]) * np.where(np.abs(y[1]) > 110, 0.4, 1.0))


def compressor(t: float, y: Array, u: Array) -> Array:
    return motor(y, u, -0.01 * (1 + np.sign(np.sin(2 * np.pi * 1.7 * t))))


def slow_sensor(t: float, y: Array, u: Array) -> Array:
    """What it shows changes by 250 rad/s^2 at most."""
    return motor(y, u, 0.0, np.clip(200 * (y[1] - y[3]), -250, 250))


#: Name to rates and how many states of its own.
CAUSES: Mapping[str, tuple[Callable[[float, Array, Array], Array], int]] = {
    "cam": (cam, 0),
    "magnets_warm": (magnets_warm, 0),
    "saturation": (saturation, 0),
    "governor": (governor, 0),
    "belt": (belt, 1),
    "film": (film, 1),
    "bristles": (bristles, 1),
    "battery": (battery, 1),
    "relay_brake": (relay_brake, 1),
    "fan_stall": (fan_stall, 0),
    "compressor": (compressor, 0),
    "slow_sensor": (slow_sensor, 1),
}


def turned(name: str, u: Array) -> Array:
    """(experiments, samples) speed as its sensor shows it, from rest [rad/s]."""
    rate, states = CAUSES.get(name, (healthy, 0))
    return integrated(rate, states, u)[3 if name == "slow_sensor" else 1]


def integrated(rate: Callable[[float, Array, Array], Array], states: int, u: Array) -> Array:
    """(3 + states, experiments, samples) angle, speed, current and a cause's own, from rest."""
    y, t, step = np.zeros((3 + states, len(u))), 0.0, PERIOD / FINER
    found = np.empty((len(y), *u.shape))
    for i in range(u.shape[1]):
        found[..., i], v = y, u[:, i]
        for _ in range(FINER):
            a = rate(t, y, v)
            b = rate(t + step / 2, y + step / 2 * a, v)
            c = rate(t + step / 2, y + step / 2 * b, v)
            d = rate(t + step, y + step * c, v)
            y, t = y + step / 6 * (a + 2 * b + 2 * c + d), t + step
    return found


def answer(name: str, over_noise: float, samples: int, volts: tuple[float, float]) -> Any:
    """The diagnosis of one case."""
    random = np.random.default_rng(SEED)

    def levels(count: int, length: int, low: float, high: float) -> Array:
        return np.repeat(random.uniform(low, high, (count, length // HELD)), HELD, axis=1)

    u = levels(EXPERIMENTS, samples, *volts)
    speed = turned(name, u)
    noise = rms((speed - turned("", u)).ravel()) / over_noise

    def measured(u: Array, speed: Array) -> list[Experiment]:
        rows = zip(u, speed + noise * random.standard_normal(speed.shape), strict=True)
        return [Experiment(k + 1, 100.0 * k, PERIOD, *row) for k, row in enumerate(rows)]

    before = levels(HEALTHY, 500, -12, 12)
    sheet = {n: v * float(np.exp(random.normal(0, SHEET))) for n, v in TRUE.items()}
    given = motor_file(sheet, samples, PERIOD)
    known = calibrate(given, measured(before, turned("", before)))
    machine = known.with_recordings(["healthy"]).machine
    return diagnose(machine, measured(u, speed), recordings=["shown"], workers=1)


def main(folder: str, *names: str) -> None:
    """Answer the cases, one line each."""
    cases: list[dict[str, Any]] = []
    for name in names or CAUSES:
        for number, setting in enumerate(SETTINGS):
            found = answer(name, *setting)
            case, verdict = f"{name}_{number}", found.verdict
            also = ALSO_RIGHT.get(name, set())
            named = bool(verdict.acting) and all(also & set(g) for g in verdict.acting)
            right = verdict.kind == "unknown" or named
            place = Path(folder) / case
            place.mkdir(parents=True, exist_ok=True)
            (place / "diagnosis.json").write_text(json.dumps(found.as_dict()), encoding="utf-8")
            about = {"who": "diagnosis", "case": case, "verdict": verdict.kind, "right": right}
            cases.append(about)
            print(
                case, right, verdict.kind, verdict.acting, f"{verdict.confidence:.2f}", flush=True
            )
    (Path(folder) / "score.json").write_text(json.dumps({"cases": cases}), encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
