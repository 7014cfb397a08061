"""The verdict in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ldt_core.base.sentences import listed, measured, number, plain, spoken
from ldt_core.diagnosis.diagnosis import (
    Gap,
    GapLocation,
    HeldOutErrors,
    NextExperiment,
    ParameterAmount,
    Verdict,
)
from ldt_core.diagnosis.thresholds import THRESHOLDS
from ldt_core.physics.effect import Effect

FAULT = "sensor fault"  # of a sentence that tells one
COMMON_RANGE = 0.5  # of two ranges together: where both hold more, one of them is said
WHOLE_GAP = 0.9  # share of the gap in a place: with less, the share is said
MOST_LEVELS = 8  # of a voltage that somebody sets by hand


def sentence(
    machine: str,
    kind: str,
    acting: Sequence[Sequence[str]],
    amounts: Mapping[str, Mapping[str, ParameterAmount]],
    gap: Gap,
    where: Sequence[GapLocation],
    left: float | None,
    begun: tuple[HeldOutErrors, HeldOutErrors] | None = None,
    spent: bool = False,
    own: str = "",
) -> str:
    """One or two sentences for a person.

    Args:
        left: part that the best set leaves, of what nominal parameters leave of the gap.
        begun: errors without the effects and with them from start states that were fitted, where
            a free run from the usual ones is no better with them.
        spent: whether the search ended at its limit of work.
        own: what nominal parameters close of the gap by themselves, as a clause; see
            `nominal.closing`.
    """
    if kind == "none" and gap.before.rmse**2 > THRESHOLDS.plainly_structured * gap.noise_std**2:
        return (
            f"No gap: within its tolerances, the machine file of {machine} explains the speed to "
            f"the noise ({gap.noise_std:.3g} rad/s) from start states that were fitted. As nobody "
            "measured these, its free runs of held-out experiments err by "
            f"{gap.before.rmse:.3g} rad/s."
        )
    if kind == "none":
        return (
            f"No gap: on held-out experiments the machine file of {machine} predicts the speed to "
            f"{gap.before.rmse:.3g} rad/s, which is the noise ({gap.noise_std:.3g} rad/s)."
        )
    place = f", {_lies(where)}" if where and where[0].share_of_data < 1 else ""
    if kind == "unknown":
        much = "" if left is None else f" The best set of them leaves {left:.0%} of it."
        none = "none of the known effects explains"
        if spent:
            none = "no set of effects that was tried before the limit of work explains"
        first, rest = (f"{own}, and ", "the rest") if own else ("", "the gap")
        return (
            f"Unknown: {first}{none} {rest}{place}.{much} "
            f"On held-out experiments the error is {gap.before.rmse:.3g} rad/s."
        )
    that = "it" if len(acting) == 1 else "them"
    what, verb, part = *_acting(acting, amounts), gap.closed_fraction
    ends = gap.closed_fraction_ci95
    closed = f" {verb} the gap in part" if part is None else f" {verb} {part:.0%} of the gap"
    if part is None and ends is not None:
        closed = f" {verb} {ends[0]:.0%} to {ends[1]:.0%} of the gap, by the experiment"
    if begun:
        return (
            f"{what[0].upper()}{what[1:]} {verb} the gap{place}: with {that}, and a "
            f"start state of its own for each held-out experiment, the error falls from "
            f"{begun[0].rmse:.3g} to {begun[1].rmse:.3g} rad/s, noise is {gap.noise_std:.3g}. "
            f"Where the start state is unknown, the speed cannot be predicted "
            f"({gap.after.rmse:.3g} rad/s)."
        )
    more = gap.after.rmse**2 > THRESHOLDS.plainly_structured * gap.noise_std**2
    rest = " What is left is more than noise, and its cause is not known." if more else ""
    return (
        f"{what[0].upper()}{what[1:]}{closed}{place}; adding {that} cuts the error on "
        f"held-out experiments from {gap.before.rmse:.3g} to {gap.after.rmse:.3g} rad/s, noise is "
        f"{gap.noise_std:.3g}.{rest}"
    )


def not_standing(
    names: Sequence[str], gap: Gap, where: Sequence[GapLocation], objection: str
) -> str:
    """The sentence where what fits best is not the answer.

    Args:
        names: of the effects that fit best together.
        objection: why they are not, as the end of a sentence.
    """
    place = f", {_lies(where)}," if where and where[0].share_of_data < 1 else ""
    best = " and ".join(spoken(n) for n in names)
    fit = "fits" if len(names) == 1 else "fit"
    return (
        f"Unknown: the gap{place} is not explained. On held-out experiments the error is "
        f"{gap.before.rmse:.3g} rad/s. {best[0].upper()}{best[1:]} {fit} it best, but {objection}."
    )


def not_seen(gap: Gap, motion: float) -> str:
    """The sentence where the error is as large as the motion.

    Args:
        motion: root mean square of the speed [rad/s].
    """
    return (
        f"Unknown: the machine file errs by {gap.before.rmse:.3g} rad/s on held-out experiments, "
        f"no less than a shaft that stands still ({motion:.3g}), and only noise is seen there."
    )


def not_all_alike(left: float, worst: int, noise: float) -> str:
    """The sentence where only experiments that were held out show a gap.

    Args:
        left: the machine file's error on them [rad/s].
        worst: number of the one with the largest error.
        noise: what the others leave [rad/s].
    """
    return (
        f"Unknown: the machine file leaves only noise ({noise:.3g} rad/s) on most experiments, and "
        f"{left:.3g} rad/s on those held out, most on experiment {worst}: they are not all of one "
        "machine in one state, or a sensor failed."
    )


def sensor_fault(verdict: Verdict) -> bool:
    """Whether a sensor's fault is said, which no shorter sentence may hide."""
    return FAULT in verdict.sentence.lower()


def unsought(verdict: Verdict) -> bool:
    """Whether a sensor's fault is all that is said: verdicts on machines are no measure of it."""
    return verdict.sentence.startswith(f"{FAULT.capitalize()}: ")


def not_measured(fault: str, verdict: str) -> str:
    """The sentence where a sensor is at fault.

    Args:
        fault: what it shows, and where.
        verdict: on the experiments before; "" where there are too few.
    """
    if not verdict:
        told = f"{FAULT.capitalize()}: {fault}."
        return f"{told} No cause is sought in a speed that was not measured."
    return f"{verdict} That is by the experiments before a {FAULT}: {fault}."


def _acting(
    acting: Sequence[Sequence[str]], amounts: Mapping[str, Mapping[str, ParameterAmount]]
) -> tuple[str, str]:
    """What acts, and the verb that goes with it."""
    told = [_one(group, amounts) for group in acting]
    unsettled = any(len(group) > 1 for group in acting)
    if len(told) == 1:
        return (f"{told[0]},", "explains") if unsettled else (told[0], "explains")
    if unsettled:
        return f"{'; and '.join(told)}: together they", "explain"
    return " and ".join(told), "explain"


def _one(group: Sequence[str], amounts: Mapping[str, Mapping[str, ParameterAmount]]) -> str:
    named = f"{spoken(group[0])} ({values(amounts[group[0]])})"
    if len(group) == 1:
        return named
    return f"{listed([named, *map(spoken, group[1:])], 'or')}, not told apart here"


def values(parameters: Mapping[str, ParameterAmount]) -> str:
    """Parameters with their intervals: "e = 4.9 ± 0.2 mm"."""
    parts = []
    for name, a in parameters.items():
        equals = "" if a.ci95 is None else "= "
        parts.append(f"{name} {equals}{measured(a.value, a.unit, a.ci95)}")
    return ", ".join(parts)


def grown(effect: Effect, known: Mapping[str, float], now: Mapping[str, float]) -> str:
    """What has become of an effect that the machine file knows."""
    changes = listed(
        f"{p.name} {number(known[p.name])} to {number(now[p.name])} {p.unit}".rstrip()
        for p in effect.parameters
    )
    return f"{spoken(effect.name)}, from the machine file's to what is found: {changes}"


def applied(then: NextExperiment) -> str:
    """The voltage of an experiment in numbers.

    >>> applied(NextExperiment("", [3.0] * 5 + [-4.5] * 5, 0.1, ["voltage", "speed"]))
    '3, -4.5 V for 0.5 s each'
    >>> applied(NextExperiment("", [0.0, 0.5, 1.0, 0.5], 0.1, ["voltage", "speed"]))
    '0 to 1 V'
    """
    volts, period = np.asarray(then.voltage, dtype=np.float64), then.sample_period
    begins = np.flatnonzero(np.diff(volts, prepend=np.nan))
    held = int(np.diff(begins, append=volts.size)[: max(begins.size - 1, 1)].min())  # the last ends
    between = f"{plain(float(volts.min()))} to {plain(float(volts.max()))} V"
    if held == 1:
        return between
    if begins.size > MOST_LEVELS:
        return f"{between} in steps of {held * period:.3g} s"
    return f"{', '.join(map(plain, volts[begins].tolist()))} V for {held * period:.3g} s each"


def _lies(where: Sequence[GapLocation]) -> str:
    """Where the clearest place is, both directions together if it is the same in both."""
    place, share = where[0], where[0].share_of_gap
    both = [p for p in where[1:] if (p.begin, p.end) == (-place.end, -place.begin)]
    if both and place.quantity == both[0].quantity:
        share += both[0].share_of_gap
        place = max(place, both[0], key=lambda p: p.end)
    part = "which lies" if share >= WHOLE_GAP else f"{share:.0%} of which lies"
    return f"{part} {location(place)}{' in both directions' if both else ''}{_steady(place, where)}"


def _steady(place: GapLocation, where: Sequence[GapLocation]) -> str:
    """Where else the effect acts when the machine turns steadily, if that is not the same."""
    steady = next((p for p in where if p.steady), None)
    if steady is None or place.steady:
        return ""
    if place.quantity == steady.quantity:
        both = min(place.end, steady.end) - max(place.begin, steady.begin)
        if both >= COMMON_RANGE * (max(place.end, steady.end) - min(place.begin, steady.begin)):
            return ""
    return f" (at steady speeds it acts from {steady.begin:.3g} to {steady.end:.3g} {steady.unit})"


def location(place: GapLocation) -> str:
    """Where a part of the gap lies: "in experiments 5 to 8", "at speeds from 10 to 20 rad/s"."""
    unit = f" {place.unit}" if place.unit else ""
    if place.quantity == "experiment":
        first, last = round(place.begin), round(place.end)
        return f"in experiment {first}" if first == last else f"in experiments {first} to {last}"
    irregular = {"time": "in the time", "frequency": "at frequencies"}
    word = irregular.get(place.quantity, f"at {place.quantity}s")
    return f"{word} from {place.begin:.3g} to {place.end:.3g}{unit}"
