"""The sections of the page of a study, in the order in which they are read."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from ldt_core.base.code_version import code_version
from ldt_core.lab.study.evidence import Evidence
from ldt_core.lab.study.sections.findings import beyond, chance, reproduction, runs
from ldt_core.lab.study.sections.methods import deviations, methods
from ldt_core.lab.study.sections.summary import streams, summary
from ldt_core.lab.study.study import Study
from ldt_core.views.page.blocks import Section
from ldt_core.views.page.style import Drawing

FEW = 5  # streams; with fewer an interval by Student's t spans nearly anything

Drawings = Mapping[str, Drawing | None]

SECTIONS: tuple[Callable[[Evidence, Drawings], Section], ...] = (
    summary,
    reproduction,
    chance,
    beyond,
    deviations,
    methods,
    runs,
)


def lead(study: Study) -> str:
    """The sentence under the title."""
    seeds = len(streams(study))
    few = " They are too few to decide much: this is a trial." if seeds < FEW else ""
    return (
        "Every claim of “Towards learning digital twin” (Zhou, Walther, Verl, CIRP CMS 2024) "
        f"examined on {seeds} random stream{'' if seeds == 1 else 's'} of a simulated rotor that "
        f"wears, and how far a learner goes that keeps the physics.{few}"
    )


def footer(study: Study) -> str:
    """The last line."""
    version = code_version()["ldt"]
    return f"Made by LDT {version}. Everything on this page is computed from the study's runs."
