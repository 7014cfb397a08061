"""What a stranger varies from one recording to the next: machine, voltage, start, sensors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import yaml

import msgs_config
from ldt_core.base.errors import OptionError, did_you_mean
from ldt_core.lab.challenge.law import Law
from ldt_core.lab.challenge.rig import (
    KINDS,
    REVERSING,
    STARTS,
    STEPPED,
    CaseSetting,
    draw_excitation,
)

ROTOR, MOTOR = "dc_motor_rotor", "dc_motor"
MOTORS = 0.5  # share of machines without a foundation
#: Sample periods [s], 50 Hz to 2 kHz: of motors, which are as many times slower or faster, and of
#: rotors, which are not, since a foundation's resonance would leave their speeds.
PERIODS = {"dc_motor": (0.02, 0.01, 0.005, 0.002, 0.001, 0.0005), "dc_motor_rotor": (0.02, 0.01)}
USUAL = 0.01  # s, the period that voltages and machines are written for
ELECTRICAL = (3e-5, 0.5)  # s, L / R of a machine with the usual period: with PERIODS 6 decades
QUICK = 0.005  # s, largest L / R for laws that take the current to settle at once
QUANTISED = 0.3  # share of speed sensors with steps
QUANTA = (1.0, 4.0)  # noise deviations, of a step
DATASHEET = 0.5  # share of machine files with tolerances in place of a calibration, where no cause
OWN_VALUES = 0.5  # share of machines with other numbers than the rotor's file
SPREAD, MOST = 0.15, 0.35  # of the logarithm of each number, and how far it may go
KNOWN_UNBALANCE = 0.1  # share of rotors whose file knows of some unbalance, whatever acts
ECCENTRICITY = (0.003, 0.006)  # m, of those
SHARES = (0.3, 0.2, 0.08, 0.06, 0.08, 0.04, 0.07, 0.07, 0.1)  # of KINDS, in their order
STARTING = (0.5, 0.13, 0.27, 0.1)  # shares of STARTS
CUT = 0.5  # of the usual samples, in each piece of one long record
PAUSING, PAUSES = 0.25, 0.3  # share of stepped voltages that pause, and of their levels at 0
WARM = (2.0, 4.0)  # s, that a machine runs before the recording is cut
NOISE = (0.005, 0.2)  # rad/s, drawn by its logarithm
CURRENT_NOISE = 0.02  # A


def draw_setting(
    laws: Sequence[Law],
    random: np.random.Generator,
    seed: tuple[int, ...],
    *,
    physics: str = "",
    excitation: str = "",
    start: str = "",
    noise: float | None = None,
    current: bool | None = None,
    samples: int = 2000,
) -> CaseSetting:
    """A setting in which these laws can act and show; what is not given is drawn.

    Args:
        laws: that will act.
        random: to draw from.
        seed: of the experiments.
        physics: kind of machine.
        excitation: kind, of the case itself.
        start: see STARTS.
        noise: deviation on the speed [rad/s].
        current: whether it is recorded.
        samples: in an experiment.

    Raises:
        OptionError: a kind that does not exist or that the laws cannot have.
    """
    needs = {law.needs for law in laws}
    for given, known, what in (
        (physics, (ROTOR, MOTOR), "physics"),
        (excitation, KINDS, "excitation"),
        (start, STARTS, "start"),
    ):
        if given and given not in known:
            raise OptionError(what, did_you_mean(given, known), repr(given))
    if physics == MOTOR and needs - {""}:
        raise OptionError("physics", f"{ROTOR} for {', '.join(x.name for x in laws)}", physics)
    alone = random.random() < MOTORS
    if not physics:
        physics = MOTOR if alone and not needs - {""} else ROTOR
    period = float(random.choice(PERIODS[physics]))
    pace = period / USUAL if physics == MOTOR else 1.0
    slowest = QUICK if any(law.quick for law in laws) else ELECTRICAL[1]
    machine = _machine(physics, "eccentric" in needs, pace, slowest, random)
    both_ways = any(law.reversing for law in laws)
    pausing = any(law.pausing for law in laws)
    kinds = REVERSING if both_ways else KINDS
    drawn = _kind(random, tuple(k for k in kinds if k in STEPPED) if pausing else kinds)
    kind = excitation or drawn
    other = _kind(random, tuple(k for k in KINDS if k != kind))
    voltages = draw_excitation(kind, random), draw_excitation(other, random)
    if pausing or random.random() < PAUSING:
        one, two = (replace(v, pauses=PAUSES * (v.kind in STEPPED)) for v in voltages)
        voltages = one, two
    any_start = STARTS[random.choice(len(STARTS), p=STARTING)]
    drawn_start = start or ("rest" if any(law.from_rest for law in laws) else any_start)
    if drawn_start == "cut" and kind == "closed_loop":  # its controller begins with each record
        drawn_start = "running"
    length = samples if physics == MOTOR else round(samples * USUAL / period)
    length = round(length * CUT) if drawn_start == "cut" else length
    warm = round(random.uniform(*WARM) * pace / period)
    drawn_noise = float(f"{np.exp(random.uniform(*np.log(NOISE))):.3g}")
    with_current = random.random() < 0.5
    used_noise = drawn_noise if noise is None else noise
    step = used_noise * float(random.uniform(*QUANTA)) if random.random() < QUANTISED else 0.0
    by_datasheet = random.random() < DATASHEET and not laws
    return CaseSetting(
        physics=physics,
        known=machine,
        excitation=voltages[0],
        other=voltages[1],
        start=drawn_start,
        warm=warm,
        noise=used_noise,
        current_noise=CURRENT_NOISE if (with_current if current is None else current) else None,
        seed=seed,
        samples=length,
        period=period,
        pace=pace,
        quantum=step,
        file="datasheet" if by_datasheet else "calibrated",
    )


def _machine(
    physics: str, eccentric: bool, pace: float, slowest: float, random: np.random.Generator
) -> Mapping[str, float]:
    """True parameters of a machine: the rotor's own or others like them, as many times as slow."""
    rotor: dict[str, Any] = yaml.safe_load(msgs_config.machine_text("rotor"))["parameters"]
    names = ("J", "K_t", "R", "L", "b") if physics == MOTOR else tuple(rotor)
    known = {name: float(rotor[name]) for name in names}
    own, unbalanced = random.random() < OWN_VALUES, random.random() < KNOWN_UNBALANCE
    moved = np.exp(np.clip(random.normal(0.0, SPREAD, len(names)), -MOST, MOST))
    if own:
        known = {n: float(f"{known[n] * m:.3g}") for n, m in zip(names, moved, strict=True)}
    electrical = pace * float(np.exp(random.uniform(math.log(ELECTRICAL[0]), math.log(slowest))))
    known["J"] = float(f"{known['J'] * pace:.4g}")
    known["L"] = float(f"{known['R'] * electrical:.3g}")
    e = float(np.round(random.uniform(*ECCENTRICITY), 4))
    if physics == ROTOR and (eccentric or unbalanced):
        known["e"] = e
    return known


def _kind(random: np.random.Generator, kinds: Sequence[str]) -> str:
    shares = np.array([SHARES[KINDS.index(k)] for k in kinds])
    return str(random.choice(kinds, p=shares / shares.sum()))
