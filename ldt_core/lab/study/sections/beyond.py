"""How far a better learner and a better detector go."""

from __future__ import annotations

from collections.abc import Mapping

from ldt_core.lab.study.figures.reading import Reading
from ldt_core.views.page.blocks import Section, Text
from ldt_core.views.page.style import Drawing

BETTER = "this study has no runs beyond the paper (group better)."


def beyond(reading: Reading, drawings: Mapping[str, Drawing | None]) -> Section:
    """Shares, stream, detectability, false alarms, kinds."""
    section = Section("beyond", "Beyond the paper")
    section.blocks.append(
        Text(
            "The diagnosed model keeps the physics and fits the cause, the eccentricity, from the "
            "experiments that are still valid; the calibrated detector keeps a stated rate of "
            "false alarms. The lower line of each comparison is not zero: even the true model with "
            "the true eccentricity has an error, from the noise and from what the unknown start "
            "does to a machine near the edge of capture; and who learns from an experiment is one "
            "experiment late at every drift."
        )
    )
    section.figure(drawings["shares"], f"What is left of the error: {BETTER}")
    section.figure(drawings["over_stream"], f"The error over one stream: {BETTER}")
    section.figure(
        drawings["estimate"],
        "The cause as the twin sees it: this study has no model that names one (group better).",
    )
    section.figure(drawings["detectable"], f"Which drifts can be found: {BETTER}")
    section.figure(
        drawings["false_alarms"],
        "Stated and observed false alarms: this study has no streams without drift.",
    )
    section.figure(
        drawings["kinds"],
        "Other kinds of drift: this study has no runs for them (group kinds).",
    )
    return section
