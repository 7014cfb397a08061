"""All thresholds of the decision between none, effect, ambiguous and unknown.

A power is a sum of squares of residuals in noise deviations, a loss the same with the noise in it.
The gap is the power that the machine file leaves beyond the noise; the remainder is what a set of
effects leaves of it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

#: Chosen so that the cases of `ldt challenge`, whose laws are not the library's, come out right.
CASES = "chosen on simulated machines, see `ldt challenge`"
CHI_SQUARE = "chi-square distribution, 1 degree of freedom, p = 0.001"
MOTOR = "a motor's free response, see `physics.motor`"
SHARE_OF_GAP = "share of the gap"
SHARE_OF_REMAINDER = "share of the smaller set's remainder"
LOSS = "squared noise deviations"


def _threshold(value: float, unit: str, reason: str, source: str) -> Any:
    return field(default=value, metadata={"unit": unit, "reason": reason, "source": source})


@dataclass(frozen=True)
class Thresholds:
    """Limits of the decision, each with `unit`, `reason` and `source` in its field's metadata."""

    # Noise, and what counts as a gap
    law_error: float = _threshold(
        0.03,
        "share of a channel's gap, as root mean square",
        "A law is never exactly the machine's: so much counts as noise.",
        CASES,
    )
    error_bandwidths: float = _threshold(
        10.0,
        "bandwidths of the motor",
        "Inertia lets errors of a machine show only at low frequencies.",
        MOTOR,
    )
    error_orders: float = _threshold(
        1.5,
        "orders of the shaft at its highest speed",
        "What turns with the shaft shows at its order, so the error band includes it.",
        CASES,
    )
    noise_band_start: float = _threshold(
        2.0,
        "upper limits of the error band",
        "Between the bands lies a margin, so that no error counts as noise.",
        CASES,
    )
    noise_level_change: float = _threshold(
        1.2,
        "factor on the noise deviation of the measured signals",
        "A noise estimated from residuals may not absorb what effects should explain.",
        CASES,
    )
    noise_frequencies: float = _threshold(
        20,
        "frequencies of one experiment",
        "With fewer above the error band, the noise cannot be estimated anew.",
        CASES,
    )
    gap_false_alarm: float = _threshold(
        0.002,
        "probability",
        "Each of two tests may see a gap in noise alone so often.",
        "chosen: one false alarm in 250 recordings",
    )
    remainder_false_alarm: float = _threshold(
        0.01,
        "probability",
        "Noise alone may pass for a structured remainder so often.",
        "chosen: the usual 1 % level",
    )
    confidence_without_search: float = _threshold(
        0.99,
        "probability",
        "A verdict without any fit has no draws from which to estimate its confidence.",
        "chosen: below 1, since a test can err",
    )
    trusted_experiments: int = _threshold(
        4,
        "experiments",
        "With fewer before a sensor fault, the verdict is unknown.",
        "chosen: the least that leaves three to fit and one to hold out",
    )
    # Which sets of effects are considered
    start_angle_gain: float = _threshold(
        12.0,
        f"{LOSS} per experiment",
        "A start angle for each experiment is a parameter more: it must gain more than chance.",
        "chi-square distribution, 1 degree of freedom, p = 0.0005",
    )
    chance_gain: float = _threshold(
        30.0,
        f"{LOSS} per added effect",
        "Over all sets that are tried, the best gains by chance nearly as much.",
        CASES,
    )
    largest_set: int = _threshold(
        6, "effects", "Larger sets take long to fit, and explain nearly anything.", CASES
    )
    opposed_responses: float = _threshold(
        -0.95,
        "cosine of two responses",
        "Effects that cancel each other imitate anything, and no machine has them.",
        CASES,
    )
    # How many effects are named
    further_effect_of_gap: float = _threshold(
        0.025,
        SHARE_OF_GAP,
        "Other effects can always take away some of what an inexact law leaves.",
        CASES,
    )
    further_effect_of_remainder: float = _threshold(
        0.5, SHARE_OF_REMAINDER, "A true effect takes away most of what the others leave.", CASES
    )
    small_effect_of_gap: float = _threshold(
        0.003, SHARE_OF_GAP, "A smaller part cannot be told from the errors of the laws.", CASES
    )
    small_effect_of_remainder: float = _threshold(
        0.75,
        SHARE_OF_REMAINDER,
        "The error of an inexact law hardly ever has another effect's shape so closely.",
        CASES,
    )
    same_family_of_gap: float = _threshold(
        0.06,
        SHARE_OF_GAP,
        "A law that is a little off looks like a second effect of its family.",
        CASES,
    )
    simpler_set_of_gap: float = _threshold(
        0.01,
        SHARE_OF_GAP,
        "More parameters follow a machine better even where the simpler law is right.",
        CASES,
    )
    shapley_share: float = _threshold(
        0.01,
        "share of what the set explains",
        "A member that brings less only mends what another law gets wrong.",
        CASES,
    )
    # Which verdict it is
    indistinguishable_loss: float = _threshold(
        10.8, LOSS, "Sets that differ by less cannot be told apart.", CHI_SQUARE
    )
    indistinguishable_of_remainder: float = _threshold(
        0.7,
        "share of the best set's remainder",
        "Laws are inexact by the remainder, so a smaller difference tells no sets apart.",
        CASES,
    )
    unexplained_of_gap: float = _threshold(
        0.05,
        SHARE_OF_GAP,
        "A set that leaves more is not the cause: the verdict is unknown.",
        CASES,
    )
    # What the recording and a further experiment can show
    visible_change: float = _threshold(
        25.0, LOSS, "An effect that changes less could not have been seen.", "5 deviations, squared"
    )
    settling_distance: float = _threshold(
        25.0,
        LOSS,
        "An experiment that moves the sets less far apart does not settle which is right.",
        "5 deviations, squared",
    )


THRESHOLDS = Thresholds()
