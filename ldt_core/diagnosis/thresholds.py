"""All thresholds of the decision between none, effect, ambiguous and unknown.

A power is a sum of squares of residuals in noise deviations, a loss the same with the noise in it.
The gap is the power that the machine file leaves beyond the noise; the remainder is what a set of
effects leaves of it. `ldt docs limits` shows what each is worth: how many answers change with it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

#: Chosen so that the cases of `ldt challenge`, whose laws are not the library's, come out right.
CASES = "cases of `ldt challenge`"
CHI_SQUARE = "chi-square distribution, 1 degree of freedom"
CHOSEN = "chosen"
MOTOR = "a motor's free response, see `physics.motor`"
FIVE_DEVIATIONS = "5 deviations, squared"
OF_GAP = "share of the gap"
OF_REMAINDER = "share of the smaller set's remainder"
LOSS = "squared noise deviations"
CHANCE = "probability"


def _limit(value: float, unit: str, source: str, reason: str) -> Any:
    return field(default=value, metadata={"unit": unit, "reason": reason, "source": source})


@dataclass(frozen=True)
class Thresholds:
    """Limits of the decision, each with `unit`, `reason` and `source` in its field's metadata."""

    # Noise, and what counts as a gap
    law_error: float = _limit(
        0.03, "share of a channel's gap, rms", CASES, "No law is exactly the machine's."
    )
    error_bandwidths: float = _limit(
        10.0, "bandwidths of the motor", MOTOR, "Inertia lets errors show only below them."
    )
    error_orders: float = _limit(
        1.5, "orders of the fastest shaft", CASES, "What turns with it shows at its order."
    )
    noise_band_start: float = _limit(
        2.0, "upper limits of the error band", CASES, "The margin keeps errors out of the noise."
    )
    noise_level_change: float = _limit(
        1.2, "factor on the measured noise", CASES, "Noise may not absorb what effects explain."
    )
    noise_frequencies: float = _limit(
        20, "frequencies of one experiment", CASES, "Fewer do not tell the noise anew."
    )
    least_gap: float = _limit(
        0.005, "power of the noise", CHOSEN, "Gaps of a 14th of the noise matter to no prediction."
    )
    least_gap_of_signal: float = _limit(
        1e-8, "power of the signal", CHOSEN, "A ten-thousandth is what simulations are exact to."
    )
    gap_false_alarm: float = _limit(
        0.002, CHANCE, CHOSEN, "Two tests each: one false alarm in 250 recordings."
    )
    remainder_false_alarm: float = _limit(
        0.01, CHANCE, CHOSEN, "The usual level at which noise passes for structure."
    )
    trusted_experiments: int = _limit(
        4, "experiments", CHOSEN, "Three to fit and one to hold out, before a sensor fault."
    )
    # Which sets of effects are considered
    start_state_gain: float = _limit(
        12.0,
        f"{LOSS} per experiment and start state",
        f"{CHI_SQUARE}, p = 0.0005",
        "An angle, or how warm a winding was, is a parameter more.",
    )
    chance_gain: float = _limit(
        30.0, f"{LOSS} per added effect", CASES, "The best of all sets gains so much by chance."
    )
    largest_set: int = _limit(6, "effects", CASES, "Larger sets explain nearly anything.")
    opposed_responses: float = _limit(
        -0.95, "cosine of two responses", CASES, "Effects that cancel each other imitate anything."
    )
    # How many effects are named
    further_effect_of_gap: float = _limit(
        0.025, OF_GAP, CASES, "Other effects always take some of what an inexact law leaves."
    )
    further_effect_of_remainder: float = _limit(
        0.5, OF_REMAINDER, CASES, "A true effect takes away most of what the others leave."
    )
    small_effect_of_gap: float = _limit(
        0.003, OF_GAP, CASES, "A smaller part cannot be told from the errors of the laws."
    )
    whole_remainder: float = _limit(
        0.75, OF_REMAINDER, CASES, "What takes away less mends another law, if by chance."
    )
    nearly_all_of_remainder: float = _limit(
        0.95, OF_REMAINDER, CASES, "What takes away so much mends no law, however small it is."
    )
    relative: float = _limit(
        0.9,
        OF_REMAINDER,
        CASES,
        "What a further effect takes beside a law that departs: nearly all.",
    )
    same_family_of_gap: float = _limit(
        0.06, OF_GAP, CASES, "A law that is a little off looks like a second effect of its family."
    )
    simpler_set_of_gap: float = _limit(
        0.01, OF_GAP, CASES, "More parameters follow better even where the simpler law is right."
    )
    # Which verdict it is
    indistinguishable_loss: float = _limit(
        10.8, LOSS, f"{CHI_SQUARE}, p = 0.001", "Sets that differ by less cannot be told apart."
    )
    indistinguishable_of_remainder: float = _limit(
        0.7, "share of the best set's remainder", CASES, "Laws are inexact by the remainder."
    )
    plainly_structured: float = _limit(
        4.0,
        "excess at which noise passes for structure",
        CASES,
        "Twice as far in amplitude: not by chance.",
    )
    departure_of_law: float = _limit(
        0.05, "power of what the law does", CASES, "What departs by more is another law."
    )
    prior_deviations: float = _limit(
        3.0,
        "deviations of a parameter's prior",
        CHOSEN,
        "Beyond, it is a finding: 1 in 370 by chance.",
    )
    unexplained_of_signal: float = _limit(
        0.1,
        "power of the signal",
        CHOSEN,
        "A coefficient of determination of 0.9: a law that leaves more is not the machine's.",
    )
    behind_reference: float = _limit(
        4.0, "power that a reference leaves", CHOSEN, "Twice its error, and it knows less physics."
    )
    trifle_of_gap: float = _limit(
        0.03, OF_GAP, CASES, "A library's law that is the right one leaves up to as much."
    )
    told_of_gap: float = _limit(
        0.01, OF_GAP, CHOSEN, "What closes less is said to have nothing to do with the gap."
    )
    # What the recording and a further experiment can show
    visible_change: float = _limit(
        25.0, LOSS, FIVE_DEVIATIONS, "An effect that changes less could not have been seen."
    )
    settling_distance: float = _limit(
        25.0, LOSS, FIVE_DEVIATIONS, "An experiment that moves sets less far apart settles nothing."
    )


THRESHOLDS = Thresholds()
