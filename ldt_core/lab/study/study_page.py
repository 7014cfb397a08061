"""The page of a study: one HTML file that holds all, and its figures as files beside it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from ldt_core.base.code_version import code_version
from ldt_core.base.result_files import write
from ldt_core.lab.study.figures import drawings
from ldt_core.lab.study.sections.alarms import alarms
from ldt_core.lab.study.sections.findings import beyond, methods, reproduction
from ldt_core.lab.study.sections.robustness import robustness
from ldt_core.lab.study.sections.summary import streams, summary
from ldt_core.lab.study.sections.trials import trials
from ldt_core.lab.study.study import Evidence, Study
from ldt_core.views.page import style
from ldt_core.views.page.blocks import Section
from ldt_core.views.page.page_builder import render

TITLE = "Study of the learning digital twin"
FILE, FIGURES = "study.html", "figures"
FEW_STREAMS = 5  # streams; with fewer an interval by Student's t spans nearly anything

Drawings = Mapping[str, style.Drawing | None]

SECTIONS: tuple[Callable[[Evidence, Drawings], Section], ...] = (
    summary,
    reproduction,
    beyond,
    robustness,
    trials,
    alarms,
    methods,
)


def write_figures(study: Study, out: Path | str) -> list[Path]:
    """Write OUT/figures/NAME.png and NAME.svg of all figures that the study has runs for.

    Returns:
        The files.

    Raises:
        LdtError: matplotlib is not installed.
    """
    style.require()
    folder = Path(out) / FIGURES
    folder.mkdir(parents=True, exist_ok=True)
    found = drawings(Evidence(study)).values()
    return [file for drawing in found if drawing for file in style.save(drawing, folder)]


def write_page(study: Study, out: Path | str) -> Path:
    """Write OUT/study.html, which needs no network and no other file.

    Returns:
        The file.

    Raises:
        LdtError: matplotlib is not installed.
    """
    style.require()
    evidence = Evidence(study)
    found = drawings(evidence)
    made = [make(evidence, found) for make in SECTIONS]
    path = Path(out) / FILE
    path.parent.mkdir(parents=True, exist_ok=True)
    page = render(TITLE, lead(study), footer(study), made)
    write(path, page)
    return path


def lead(study: Study) -> str:
    """The sentence under the title."""
    if not study.entries:
        return "The learning twin on streams of every kind, beside references that know the truth."
    seeds = len(streams(study))
    few = " They are too few to decide much: this is a trial." if seeds < FEW_STREAMS else ""
    return (
        "Every claim of “Towards learning digital twin” (Zhou, Walther, Verl, CIRP CMS 2024) "
        f"examined on {seeds} random stream{'' if seeds == 1 else 's'} of a simulated rotor that "
        f"wears, and how far a learner goes that keeps the physics.{few}"
    )


def footer(study: Study) -> str:
    """The last line."""
    version = code_version()["ldt"]
    return f"Made by LDT {version}. Everything on this page is computed from the study's runs."
