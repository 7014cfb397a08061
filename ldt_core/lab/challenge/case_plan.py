"""A sealed case: drawn, checked to be fair, and simulated."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ldt_core.base.errors import LdtError, OptionError, did_you_mean
from ldt_core.base.experiment import Experiment, rms
from ldt_core.lab.challenge.law import PHASE, Law
from ldt_core.lab.challenge.law_fitting import nearest, size_for
from ldt_core.lab.challenge.laws import LAWS, OUTSIDE
from ldt_core.lab.challenge.rig import (
    ALIKE,
    OTHER,
    PROBES,
    REVERSING,
    SHOWN,
    VOLTAGE,
    Acting,
    CaseBench,
    CaseSetting,
    draw_excitation,
)
from ldt_core.lab.challenge.simulation import Unsteady
from ldt_core.lab.challenge.variation import ROTOR, draw_setting

KINDS = ("none", "single", "pair", "triple", "outside")
MEMBERS = {"none": 0, "single": 1, "pair": 2, "triple": 3, "outside": 1}

HEALTHY = range(101, 104)  # numbers of the experiments by which a file is calibrated
FURTHER = range(SHOWN + 1, SHOWN + ALIKE + OTHER + 1)  # numbers of the further experiments
STRENGTH_RANGE = (3.3, 1000.0)  # root mean square of a gap over the noise, drawn log-uniformly
LARGEST_GAP = 15.0  # rad/s, root mean square: a third of what machines turn
LEAST_MEMBER_STRENGTH = 1.0  # the same, of each effect in a set
LEAST_MEMBER_SHARE = 0.15  # of an effect's own gap, next to another's in the set
MOST_ALIKE_COSINE = 0.95  # cosine of two gaps, beyond which no recording could tell a pair apart
DEPARTURE_SCALES = (1.0, 0.5, 0.25, 0.12)  # of a law from the library's, tried in turn
#: Of the gap's energy, by the nearest parameters of the library: a larger departure is not fair.
LEAST_EXPLAINED_SHARE = 0.97
WINDING_LIMIT = 250.0  # K above the surroundings; a winding burns beyond
LEAST_SPEED_RMS = 2.0  # rad/s, root mean square; a machine that is held still shows nothing
ATTEMPTS = 60  # of drawing a case that is fair; then it is an error
MARGIN = 1.15  # times a least strength: sizes are met to within `SIZE_TOLERANCE`
MARGIN_OF_SHARE = 1.3  # the same for the ratio of two
MOST_OFF = 1.5  # factor between a strength that was asked for and the one that came out
DIGITS = 6  # of the numbers in a key
WINDING_STATE = 8  # state


@dataclass(frozen=True)
class CasePlan:
    """All that makes a case's experiments, and what its key says.

    Args:
        setting: the machine, its excitation and its sensors.
        acting: the laws in it.
        truth: entry of the key.
    """

    setting: CaseSetting
    acting: tuple[Acting, ...]
    truth: dict[str, Any]

    @property
    def machine(self) -> dict[str, Any]:
        """The keys of the true machine's file, without what acts."""
        s = self.setting
        return {
            "name": "rotor" if s.physics == ROTOR else "motor",
            "physics": s.physics,
            "parameters": dict(s.known),
            "limits": {"voltage": [-24.0, 24.0]},
            "experiment": {"duration": s.samples * s.period, "sample_period": s.period},
        }

    def healthy(self) -> Iterator[Experiment]:
        """Those of the machine before anything acted on it, to calibrate its file by."""
        random = self.setting.random(0, VOLTAGE)
        before = draw_excitation(str(random.choice(REVERSING)), random)
        bench = CaseBench(replace(self.setting, excitation=before, other=before))
        return (bench.experiment((), n) for n in HEALTHY)

    def experiments(self) -> Iterator[Experiment]:
        """Those that the diagnosis sees."""
        bench = CaseBench(self.setting)
        return (bench.experiment(self.acting, n) for n in range(1, SHOWN + 1))

    def further(self) -> Iterator[Experiment]:
        """Those of the same machine that it does not see."""
        bench = CaseBench(self.setting)
        return (bench.experiment(self.acting, n) for n in FURTHER)


def plan_case(
    kind: str,
    effects: Sequence[str] = (),
    *,
    seed: tuple[int, ...],
    strength: float | None = None,
    **asked: Any,
) -> CasePlan:
    """All of a case of this kind but its experiments.

    Args:
        kind: none, single, pair, triple or outside.
        effects: names, as many as the kind has; of an outside cause its own. Those that are not
            given are drawn.
        seed: the same seed makes the same case.
        asked: whatever is not to be drawn: `strength` (of the gap over the noise), and of
            `draw_setting` physics, excitation, start, noise, current, samples.

    Raises:
        OptionError: an unknown kind or effect, or one that the machine asked for cannot have.
        LdtError: no fair case was found.
    """
    _check(kind, effects)
    random = np.random.default_rng(np.random.SeedSequence(seed))
    for attempt in range(ATTEMPTS):
        laws = _laws(kind, effects, random)
        setting = draw_setting(laws, random, (*seed, attempt), **asked)
        try:
            plan = _plan(kind, laws, setting, random, strength)
            if plan is None:
                continue
            for _ in itertools.chain(plan.experiments(), plan.further()):
                pass  # a controller may drive a machine where its trials did not
        except Unsteady:
            continue
        return plan
    about = f"{kind} case" + (f" of {', '.join(effects)}" if effects else "")
    raise LdtError(f"no fair {about} was found in {ATTEMPTS} attempts")


def _check(kind: str, effects: Sequence[str]) -> None:
    if kind not in KINDS:
        raise OptionError("kind of case", did_you_mean(kind, KINDS), repr(kind))
    if len(effects) > MEMBERS[kind]:
        raise OptionError(f"effects of a {kind} case", f"{MEMBERS[kind]} at most", len(effects))
    known = OUTSIDE if kind == "outside" else LAWS
    for name in effects:
        if name not in known:
            raise OptionError("effect", did_you_mean(name, known), repr(name))
    families = [known[name].family or name for name in effects]
    if len(set(families)) < len(families):
        raise OptionError("effects", "of different families", " and ".join(effects))


def _laws(kind: str, effects: Sequence[str], random: np.random.Generator) -> list[Law]:
    """The laws named, with others that go with them up to the number that the kind has."""
    known = OUTSIDE if kind == "outside" else LAWS
    laws = [known[name] for name in effects]
    for name in random.permutation(sorted(known)):
        taken = {law.family or law.name for law in laws}
        law = known[str(name)]
        if len(laws) < MEMBERS[kind] and (law.family or law.name) not in taken:
            laws.append(law)
    return laws


def _plan(
    kind: str,
    laws: Sequence[Law],
    setting: CaseSetting,
    random: np.random.Generator,
    strength: float | None,
) -> CasePlan | None:
    """The plan of a case, or None when it would not be fair."""
    bench, wanted = CaseBench(setting), _strengths(len(laws), random, strength, setting.noise)
    acting: list[Acting] = []
    for law, snr in zip(laws, wanted, strict=True):
        shape = {n: float(v) for n, v in law.draw(random, setting.known).items()}
        if law.name == "unbalance" and strength is None:
            size = float(random.uniform(*law.sizes))
            acting.append(Acting(law.name, law.values(size, shape, setting.known), shape))
        else:
            acting.append(size_for(bench, law, shape, snr * setting.noise)[0])
    own = [bench.gap((a,), PROBES).ravel() for a in acting]
    if not _fair([rms(g) / setting.noise for g in own], own) or not _sane(bench, acting):
        return None
    if strength is not None and len(own) == 1:
        off = abs(math.log(rms(own[0]) / setting.noise / strength))
        if off > math.log(MOST_OFF):
            return None
    fitted, explained = tuple(acting), None
    if acting and kind != "outside":
        for odd in DEPARTURE_SCALES:
            acting = [Acting(a.name, a.values, a.shape, odd) for a in acting]
            fitted, explained = nearest(bench, acting)
            if explained >= LEAST_EXPLAINED_SHARE:
                break
        else:
            return None
    gap = bench.gap_rms(acting, range(1, SHOWN + 1)) if acting else 0.0
    snr = gap / setting.noise
    if acting and snr < (STRENGTH_RANGE[0] if len(acting) == 1 else LEAST_MEMBER_STRENGTH):
        return None
    shares = {a.name: rms(g) for a, g in zip(acting, own, strict=True)}
    truth = _truth(kind, setting, acting, fitted, wanted, shares)
    figures = {
        "gap_rms": gap,
        "signal_to_noise": snr,
        "explained": explained,
        "further_noise": {str(n): bench.noise(n) for n in FURTHER},
    }
    return CasePlan(setting, tuple(acting), rounded_numbers({**truth, **figures}))


def _strengths(
    count: int, random: np.random.Generator, strength: float | None, noise: float
) -> tuple[float, ...]:
    """Wanted strength of each member's own gap."""
    most = min(STRENGTH_RANGE[1], LARGEST_GAP / noise)
    low, high = (STRENGTH_RANGE[0], most) if count == 1 else (LEAST_MEMBER_STRENGTH * MARGIN, most)
    if strength is not None:
        return (strength,) * count
    drawn: list[float] = []
    for _ in range(count):
        least = max([low, *(LEAST_MEMBER_SHARE * MARGIN_OF_SHARE * s for s in drawn)])
        most = min([high, *(s / LEAST_MEMBER_SHARE / MARGIN_OF_SHARE for s in drawn)])
        drawn.append(float(np.exp(random.uniform(math.log(least), math.log(most)))))
    return tuple(drawn)


def _fair(strengths: Sequence[float], own: Sequence[np.ndarray]) -> bool:
    """Whether each effect shows, next to the noise and next to the others."""
    if len(own) == 0:
        return True
    if len(own) == 1:
        return strengths[0] >= STRENGTH_RANGE[0]
    if min(strengths) < max(LEAST_MEMBER_STRENGTH, LEAST_MEMBER_SHARE * max(strengths)):
        return False
    units = [g / np.linalg.norm(g) for g in own]
    cosines = [abs(a @ b) for k, a in enumerate(units) for b in units[:k]]
    return max(cosines) <= MOST_ALIKE_COSINE


def _sane(bench: CaseBench, acting: Sequence[Acting]) -> bool:
    """Whether the machine turns and nothing burns."""
    for number in PROBES:
        motion = bench.run(acting, number)
        if (
            motion.states[:, WINDING_STATE].max() > WINDING_LIMIT
            or rms(motion.states[:, 1]) < LEAST_SPEED_RMS
        ):
            return False
    return True


def _truth(
    kind: str,
    setting: CaseSetting,
    acting: Sequence[Acting],
    fitted: Sequence[Acting],
    wanted: Sequence[float],
    shares: dict[str, float],
) -> dict[str, Any]:
    """A key's entry."""
    outside = kind == "outside"
    places = [
        a.law.place(a.values, a.shape, setting.known) for a in acting if a.law.place is not None
    ]
    return {
        "kind": kind,
        "effects": [] if outside else sorted(a.name for a in acting),
        "outside": acting[0].name if outside else None,
        "parameters": {} if outside else {a.name: _parameters(a, setting) for a in fitted},
        "place": places[0] if len(acting) == 1 and places else None,
        "strength": dict(zip((a.name for a in acting), wanted, strict=True)),
        "own_gap_rms": shares,
        "noise": setting.noise,
        "current_noise": setting.current_noise,
        "physics": setting.physics,
        "excitation": [setting.excitation.kind, setting.other.kind],
        "start": setting.start,
        "period": setting.period,
        "electrical_time": setting.known["L"] / setting.known["R"],
        "quantum": setting.quantum,
        "file": setting.file,
        "laws": {a.name: {"odd": a.odd, **a.values, "shape": dict(a.shape)} for a in acting},
        "left_out": None,
    }


def _parameters(fitted: Acting, setting: CaseSetting) -> dict[str, Any]:
    """The library's parameters with units; null what has no one value in all experiments."""
    known = {}
    for name, unit in fitted.law.units.items():
        wanders = name == PHASE and setting.start != "rest"
        value = None if wanders else fitted.values[name]
        if value is not None and name == PHASE:
            value = math.remainder(value, 2 * math.pi)
        known[name] = {"value": value, "unit": unit}
    return known


def rounded_numbers(item: Any) -> Any:
    """The same with numbers of six digits, as a key has them."""
    if isinstance(item, float):
        return float(f"{item:.{DIGITS}g}")
    if isinstance(item, dict):
        return {k: rounded_numbers(v) for k, v in item.items()}
    if isinstance(item, list | tuple):
        return [rounded_numbers(v) for v in item]
    return item
