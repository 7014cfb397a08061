"""A diagnosis made by hand of a simulated rotor: real curves and errors, made-up bookkeeping."""

from __future__ import annotations

import numpy as np
from scipy.signal import savgol_filter

from ldt_core.diagnosis.diagnosis import (
    Diagnosis,
    DrawnExperiment,
    Gap,
    GapLocation,
    HeldOutErrors,
    NextExperiment,
    ParameterAmount,
    RankedCandidate,
    Remainder,
    Verdict,
)
from ldt_core.effects import EFFECTS, get_effect
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine
from ldt_core.models.physics import PhysicsModel

NOISE = 0.1  # rad/s
KINDS = ("none", "effect", "ambiguous", "unknown")
#: Kind → effects that act, and those that the verdict adds.
TRUTH = {
    "none": ({}, {}),
    "effect": ({"unbalance": {"e": 0.005}}, {"unbalance": {"e": 0.0049}}),
    "pair": (
        {"coulomb_friction": {"torque": 0.05}, "gravity_imbalance": {"torque": 0.3}},
        {"coulomb_friction": {"torque": 0.05}, "gravity_imbalance": {"torque": 0.29}},
    ),
    "ambiguous": ({"viscous_friction": {"b": 0.004}}, {"viscous_friction": {"b": 0.0041}}),
    "unknown": ({"stribeck_friction": {"torque": 0.2, "static": 0.4}}, {}),
}
SENTENCES = {
    "none": "There is no gap: the errors are as the sensor's noise.",
    "effect": "The rotor is out of balance: e = 4.90 mm (4.70 to 5.10). It lies between 15 and 31 "
    "rad/s; adding it cuts the error on held-out experiments to that of the sensor's noise.",
    "pair": "Dry friction of 0.050 N m and gravity on an eccentric mass, 0.29 N m, act together.",
    "ambiguous": "Viscous friction, the motor constant or the supply's resistance: this recording "
    "cannot tell them apart.",
    "unknown": "Something that is none of the known effects acts at low speeds.",
}


def fake_diagnosis(kind: str = "effect", experiments: int = 8, machine: str = "rotor") -> Diagnosis:
    """Of the kinds in TRUTH; `pair` is an effect with two members."""
    shown = fake_shown(kind, experiments)
    held = [s for s in shown if s.held_out]
    before, after = (_errors(held, name) for name in ("before", "after"))
    closed = None
    if kind != "none":
        closed = (before.rmse**2 - after.rmse**2) / (before.rmse**2 - NOISE**2)
    named = {"none": [], "unknown": []}.get(kind, list(TRUTH[kind][1]))
    acting = [[n] for n in named]
    if kind == "ambiguous":
        named = acting[0] = ["viscous_friction", "motor_constant", "source_resistance"]
    verdict = Verdict(
        "effect" if kind == "pair" else kind, named, acting, 0.97, SENTENCES.get(kind, "")
    )
    return Diagnosis(
        machine,
        ["bags/monday", "bags/tuesday evening"],
        {
            "fit": [s.experiment.number for s in shown if not s.held_out],
            "held_out": [s.experiment.number for s in held],
        },
        verdict,
        Gap(
            NOISE,
            before,
            after,
            closed,
            None if closed is None else (closed - 0.03, min(closed + 0.02, 1.0)),
            () if closed is None else fake_regimes(before, after, closed),
        ),
        fake_places(kind),
        fake_candidates(kind, named, before.rmse, closed),
        Remainder(
            None if closed is None else 1 - closed,
            kind == "unknown",
            ["speed", "acceleration"] if kind == "unknown" else [],
        ),
        ["foundation_stiffness", "foundation_damping", "armature_inductance"],
        [["viscous_friction", "motor_constant", "source_resistance"]] if kind != "none" else [],
        fake_next() if kind in ("ambiguous", "unknown") else None,
        ["The calibrated noise is 0.1 rad/s.", "Experiment 3 starts at a speed other than 0."],
        [{"effect": n, "parameters": p} for n, p in TRUTH[kind][1].items()],
        shown=tuple(shown),
    )


def fake_shown(kind: str, experiments: int) -> list[DrawnExperiment]:
    """Experiments of a plant with what truly acts, and free runs without and with the verdict."""
    machine = load_machine("rotor")
    truth, added = (
        [(get_effect(n), get_effect(n).check(p)) for n, p in use.items()] for use in TRUTH[kind]
    )
    voltage = "ramp" if kind == "unknown" else "steps"
    plant = Plant(machine, seed=4, effects=truth, degradation="none", noise=NOISE, voltage=voltage)
    before, after = PhysicsModel(machine), PhysicsModel(machine, effects=added)
    found = []
    for number in range(1, experiments + 1):
        e = plant.experiment(number)
        runs = [m.predict(e).speed for m in (before, after)]
        torques = [_torque(machine.parameters, e, run) for run in runs]
        smooth, slope = (savgol_filter(e.speed, 15, 2, deriv=d, delta=e.period) for d in (0, 1))
        found.append(DrawnExperiment(e, number % 3 == 0, *runs, *torques, smooth, slope))
    return found


def _torque(values, experiment, predicted):
    rest = experiment.speed - predicted
    memory = values["J"] * values["R"] / (values["K_t"] ** 2 + values["b"] * values["R"])
    smooth, slope = (savgol_filter(rest, 15, 2, deriv=d, delta=experiment.period) for d in (0, 1))
    return values["J"] * (slope + smooth / memory)


def _errors(shown, name):
    rest = [s.experiment.speed - getattr(s, name) for s in shown]
    rmse = float(np.sqrt(np.mean(np.concatenate(rest) ** 2)))
    return HeldOutErrors(rmse, float(np.mean([np.abs(r).max() for r in rest])))


def fake_regimes(before, after, closed):
    """Three regimes, the worst of which grew worse."""
    rows = (
        ("speed 2 to 11 rad/s", 0.11, 0.12, -0.12),
        ("speed 11 to 24 rad/s", 0.9, 0.4, 0.62),
        ("speed 24 to 45 rad/s", before.rmse, after.rmse, closed),
    )
    keys = ("regime", "rmse_before", "rmse_after", "closed_fraction")
    return tuple({**dict(zip(keys, row, strict=True)), "samples": 500} for row in rows)


def fake_places(kind):
    """Where it would lie."""
    if kind == "none":
        return []
    if kind == "pair":
        return [
            GapLocation("order", 0.9, 1.1, "", 0.71, 0.03),
            GapLocation("speed", 2, 46, "rad/s", 1, 1),
        ]
    if kind == "unknown":
        return [GapLocation("speed", 0.0, 9.7, "rad/s", 0.55, 0.02)]
    return [
        GapLocation("speed", 15.2, 31.4, "rad/s", 0.92, 0.41),
        GapLocation("frequency", 0.35, 3.1, "Hz", 0.9, 0.31),
        GapLocation("experiment", 3, 6, "", 0.88, 0.5),
    ]


def fake_candidates(kind, named, rmse, closed):
    """All effects of the library, ranked."""
    random = np.random.default_rng(1)
    order = [*named, *(n for n in sorted(EFFECTS.builtin) if n not in named)]
    found = []
    for i, name in enumerate(order):
        part = None
        if closed is not None:
            alone = (0.31, 0.58) if kind == "pair" else (closed, 0.97 * closed, 0.94 * closed)
            part = alone[i] if name in named else float(0.6 * 0.75**i - 0.03)
        if name == "sensor_lag" and part is not None:
            part = -2.4
        reason = None
        if name not in named:
            reason = (
                "explains nothing that is not noise"
                if kind == "none"
                else f"leaves {random.uniform(3, 90):.0f} times as much as the best set"
            )
        share = None
        if kind == "pair" and name in named:
            share = (0.62, 0.38)[named.index(name)]
        left = rmse if part is None else float(np.sqrt(max(rmse**2 * (1 - part), 0.01)))
        score = None if part is None else max(part, 0.0)
        found.append(
            RankedCandidate(
                name, _amounts(name, TRUTH[kind][1].get(name)), left, part, share, score, reason
            )
        )
    return found


def _amounts(name, added):
    effect = get_effect(name)
    given = effect.check(added or effect.typical)
    return {
        p.name: ParameterAmount(
            given[p.name],
            p.unit,
            None if p.name == "phase" else (0.95 * given[p.name], 1.06 * given[p.name]),
        )
        for p in effect.parameters
    }


def fake_next():
    """Steps through 0."""
    levels = np.random.default_rng(2).uniform(-14, 14, 20)
    why = "stepping the voltage to and fro through 0 with the current measured splits the group"
    return NextExperiment(why, np.repeat(levels, 100), 0.01, ["voltage", "speed", "current"])
