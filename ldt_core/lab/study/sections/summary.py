"""What was run, and what the study says to each claim and aim."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ldt_core.base.code_version import code_version
from ldt_core.lab.study.claims import Claim, ClaimVerdict, aims, claims
from ldt_core.lab.study.study import Evidence, Study
from ldt_core.views.page.blocks import Mark, Pairs, Section, Table, Text
from ldt_core.views.page.style import Drawing

TONES = {
    ClaimVerdict.CONFIRMED: "good",
    ClaimVerdict.MET: "good",
    ClaimVerdict.NOT_CONFIRMED: "bad",
    ClaimVerdict.MISSED: "bad",
}


def summary(evidence: Evidence, drawings: Mapping[str, Drawing | None]) -> Section:
    """The head of the page: what was run, and every verdict."""
    section = Section("summary", "Summary")
    of_paper, of_ours = claims(evidence), aims(evidence)
    section.blocks.append(Pairs(what_was_run(evidence)))
    section.blocks += [Text(note, "missing") for note in evidence.study.notes]
    section.blocks += [
        Text("What the paper claims", "heading"),
        _verdicts("Claims of the paper, examined on our rotor", "claim", of_paper),
        Text("What was aimed at beyond it", "heading"),
        _verdicts("Aims beyond the paper", "aim", of_ours),
        Text(
            "A verdict is the interval's: with the whole 95 % interval over the seeds on the "
            "claim's side of its bound it is confirmed (an aim: met), with the whole interval on "
            "the other side not (missed), else undecided."
        ),
    ]
    return section


def verdicts(evidence: Evidence) -> str:
    """How many claims and aims came to which verdict."""
    return f"claims of the paper: {_counted(claims(evidence))}; aims: {_counted(aims(evidence))}"


def what_was_run(evidence: Evidence) -> list[tuple[str, str]]:
    """Names and values of the study as a whole."""
    study = evidence.study
    results = study.results()
    seeds = streams(study)
    return [
        ("seeds", f"{len(seeds)} ({seeds[0]} to {seeds[-1]})" if seeds else "0"),
        ("experiments a run", ", ".join(map(str, sorted({r.case.experiments for r in results})))),
        ("machine", ", ".join(sorted({r.case.machine for r in results}))),
        ("runs", f"{len(results)}"),
        ("version", ", ".join(f"{name} {version}" for name, version in code_version().items())),
    ]


def streams(study: Study) -> list[int]:
    """Seeds of the streams that wear; those of the machine in control are others, and more."""
    worn = {e.result.case.seed for e in study.entries if set(e.groups) != {"control"}}
    return sorted(worn or {e.result.case.seed for e in study.entries})


def _counted(found: Sequence[Claim]) -> str:
    verdicts = [c.verdict for c in found]
    return ", ".join(f"{verdicts.count(v)} {v}" for v in ClaimVerdict if v in verdicts)


def _verdicts(caption: str, name: str, found: Sequence[Claim]) -> Table:
    rows = [
        (f"{c.text} ({c.where})", Mark(str(c.verdict), TONES.get(c.verdict, "open")), c.evidence)
        for c in found
    ]
    return Table(caption, (name, "verdict", "evidence"), rows, cards=True)
