"""The page of a study: one HTML file that holds all, and its figures as files beside it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from ldt_core.base.code_version import code_version
from ldt_core.base.result_files import write
from ldt_core.base.sentences import counted, few, number
from ldt_core.lab.study.claims.robust_aims import robust_aims
from ldt_core.lab.study.figures import drawings
from ldt_core.lab.study.sections.alarms import alarms
from ldt_core.lab.study.sections.findings import beyond, methods, reproduction
from ldt_core.lab.study.sections.robustness import robustness
from ldt_core.lab.study.sections.summary import streams, summary, verdicts
from ldt_core.lab.study.sections.trials import trials
from ldt_core.lab.study.study import Evidence, Study
from ldt_core.views.page import style
from ldt_core.views.page.blocks import Answer, Figure, Mark, Section
from ldt_core.views.page.page_builder import render

TITLE = "Study of the learning digital twin"
FILE, FIGURES = "study.html", "figures"
MOST_NAMED = 3  # aims missed that the answer names; the section has all
FEW_STREAMS = 5  # streams; with fewer an interval by Student's t spans nearly anything

#: What may stand beside the answer, the first that there is.
OF_ANSWER = ("over_stream", "shares", "robust_streams")

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


def write_study_page(study: Study, out: Path | str) -> Path:
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
    page = render(TITLE, lead(study), footer(), made, answer(evidence), figure=_lifted(made))
    write(path, page)
    return path


def lead(study: Study) -> str:
    """The sentence under the title."""
    if not study.entries:
        return "The learning twin on streams of every kind, beside references that know the truth."
    seeds = len(streams(study))
    trial = " They are too few to decide much: this is a trial." if seeds < FEW_STREAMS else ""
    return (
        "Every claim of “Towards learning digital twin” (Zhou, Walther, Verl, CIRP CMS 2024) "
        f"examined on {counted(seeds, 'random stream')} of a simulated rotor that "
        f"wears, and how far a learner goes that keeps the physics.{trial}"
    )


def answer(evidence: Evidence) -> Answer | None:
    """Whether learning helped, by how much, and what became of claims and aims."""
    study = evidence.study
    group = "better" if study.pairs("better") else "paper"
    shares = {
        pair: share
        for pair, runs in study.pairs(group).items()
        if (share := evidence.of(runs, "share")).value is not None
    }
    if not shares:
        return _robust_answer(study) if study.robust else None
    (model, detector), best = min(shares.items(), key=lambda item: item[1].value or 0.0)
    mark = Mark("too few streams to decide", "open")
    if best.high < 1:
        mark = Mark("learning helps", "good")
    elif best.low > 1:
        mark = Mark("learning does not help", "bad")
    sentence = (
        f"The best of {counted(len(shares), 'learner')}, the {style.look(model).label} model with "
        f"the {style.look(detector).label} detector, leaves "
        f"{number(100 * (best.value or 0.0))} % of the original model's error"
    )
    if best.count > 1:
        low, high = (number(100 * bound) for bound in (best.low, best.high))
        sentence += f" (mean over {best.count} streams, 95 % interval {low} to {high} %)."
    else:
        sentence += " on one stream, too few for an interval."
    return Answer(mark, verdicts(evidence), sentence)


def _robust_answer(study: Study) -> Answer:
    found = robust_aims(study.robust)
    met = sum(verdict.passed for verdict in found)
    mark = Mark(
        f"{met} of {counted(len(found), 'aim')} met", "good" if met == len(found) else "bad"
    )
    missed = [f"{v.stream or 'all streams'}: {v.aim}" for v in found if not v.passed]
    sentence = "The default met every aim on these streams."
    if missed:
        sentence = f"The default missed an aim on {few(missed, MOST_NAMED)}."
    return Answer(mark, "default settings, references know the truth", sentence)


def _lifted(sections: Sequence[Section]) -> Figure | None:
    """The figure that stands beside the answer, taken out of its section."""
    for name in OF_ANSWER:
        for section in sections:
            for block in section.blocks:
                if isinstance(block, Figure) and block.name == name:
                    section.blocks.remove(block)
                    return block
    return None


def footer() -> str:
    """The last line."""
    version = code_version()["ldt"]
    return f"Made by LDT {version}. Everything on this page is computed from the study's runs."
