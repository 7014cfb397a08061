"""The answer of a diagnosis in one short sentence: cause, amount, what it closes."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ldt_core.base.sentences import listed, spoken
from ldt_core.diagnosis.diagnosis import Diagnosis, ParameterAmount
from ldt_core.diagnosis.nominal import moved, own_part
from ldt_core.diagnosis.sentence import location, sensor_fault
from ldt_core.views.diagnosis_page.number_format import known, percent, unit_of, value_of

#: Kind of a verdict → words for people.
WORDS = {
    "none": "no gap",
    "effect": "cause found",
    "ambiguous": "causes not told apart",
    "unknown": "cause unknown",
}
FACTOR = "factor"  # the parameter of an effect that says how many times the file's number it is
DIGITS = 2  # of errors: what was measured knows no more
MOST_DIGITS = 6  # behind the point


def headline(diagnosis: Diagnosis) -> str:
    """The short sentence; the verdict's own where a sensor is at fault.

    "Unbalance, 5.0 ± 0.1 mm, closes 100 % of the gap (1.1 → 0.10 rad/s)."
    """
    verdict, gap = diagnosis.verdict, diagnosis.gap
    if sensor_fault(verdict):
        return verdict.sentence
    before, after = (value_of(e.rmse, DIGITS) for e in (gap.before, gap.after))
    if no_effect_needed(diagnosis):
        return (
            "No effect is needed: the file's own numbers, within their tolerances, close "
            f"{percent(diagnosis.refit[0].closed_fraction)} of the gap of {before} rad/s."
        )
    if verdict.kind == "none":
        return (
            f"No gap: the machine file predicts the speed to {before} rad/s, "
            f"and the noise is {value_of(gap.noise_std, DIGITS)} rad/s."
        )
    if verdict.kind not in ("effect", "ambiguous") or not verdict.acting:
        told = f"No known cause explains the gap of {before} rad/s"
        if own := own_part(diagnosis.refit):
            numbers = f"nominal parameters{moved(diagnosis.refit)} close {percent(own)}"
            told = f"Of the gap of {before} rad/s, {numbers}, and no known cause explains the rest"
        if diagnosis.where:
            clearest = diagnosis.where[0]
            told += f"; {percent(clearest.share_of_gap)} of it lies {location(clearest)}"
        return f"{told}."
    alone = len(verdict.acting) == 1
    groups = [_group(diagnosis, group, alone) for group in verdict.acting]
    open_ones = not alone and any(len(group) > 1 for group in verdict.acting)
    named = "; ".join(groups) if open_ones else listed(groups)
    closed = ""
    much = f"{100 * gap.closed_fraction:.0f} %" if known(gap.closed_fraction) else ""
    if not much and gap.closed_fraction_ci95 is not None:
        much = " to ".join(f"{100 * end:.0f}" for end in gap.closed_fraction_ci95) + " %"
    if much:
        verb = "closes" if alone else ": together they close" if open_ones else "close"
        closed = f"{'' if open_ones else ' '}{verb} {much} of the gap"
    return f"{named[0].upper()}{named[1:]}{closed} ({before} → {after} rad/s)."


def no_effect_needed(diagnosis: Diagnosis) -> bool:
    """Whether there is a gap, and the file's own numbers close it."""
    return diagnosis.verdict.kind == "none" and own_part(diagnosis.refit) is not None


def _group(diagnosis: Diagnosis, group: Sequence[str], alone: bool) -> str:
    """An effect with its amount, or all that may be it; whether it is the only one."""
    if len(group) > 1:
        return listed([spoken(name) for name in group], "or")
    ranked = next((c for c in diagnosis.candidates if c.effect == group[0]), None)
    added = next((e for e in diagnosis.effects if e["effect"] == group[0]), None)
    if ranked is None or added is None:
        return spoken(group[0])
    amounts = {n: a for n, a in ranked.parameters.items() if a.ci95 is not None}
    told = ", ".join(
        f"{brief_amount(a)} times"
        if n == FACTOR
        else brief_amount(a)
        if len(amounts) == 1
        else f"{n} {brief_amount(a)}"
        for n, a in amounts.items()
    )
    if not told:
        return spoken(group[0])
    return f"{spoken(group[0])}, {told}," if alone else f"{spoken(group[0])} ({told})"


def brief_amount(found: ParameterAmount) -> str:
    """A value and half its interval, to the first digit that the interval leaves open.

    >>> brief_amount(ParameterAmount(0.005, "m", (0.00486, 0.00514)))
    '5.0 ± 0.1 mm'
    >>> brief_amount(ParameterAmount(1.02, "", (0.98, 1.06)))
    '1.02 ± 0.04'
    """
    scale, unit = (1e3, "mm") if found.unit == "m" else (1.0, unit_of(found.unit))
    value = scale * found.value
    spread = 0.0
    if found.ci95 is not None:
        spread = scale * max(found.ci95[1] - found.value, found.value - found.ci95[0])
    if not 0 < spread < math.inf:
        return f"{value_of(value)} {unit}".rstrip()
    # Rounded first: 0.096 is 0.1, one digit behind the point.
    digits = -math.floor(math.log10(float(f"{spread:.0e}")))
    if not 0 <= digits <= MOST_DIGITS:
        return f"{value_of(value)} ± {value_of(spread, 1)} {unit}".rstrip()
    return f"{value:.{digits}f} ± {spread:.{digits}f} {unit}".rstrip()
