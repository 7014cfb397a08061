"""What was run, and what the study says to each claim and aim."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ldt_core.base.code_version import code_version
from ldt_core.base.sentences import number
from ldt_core.lab.study.claims import Claim, ClaimVerdict, aims, claims, percent
from ldt_core.lab.study.study import Evidence, Study
from ldt_core.views.page.blocks import Item, Items, Mark, Pairs, Section, Table, Text
from ldt_core.views.page.style import Drawing

TONES = {
    ClaimVerdict.CONFIRMED: "good",
    ClaimVerdict.MET: "good",
    ClaimVerdict.NOT_CONFIRMED: "bad",
    ClaimVerdict.MISSED: "bad",
}


def summary(evidence: Evidence, drawings: Mapping[str, Drawing | None]) -> Section:
    """The head of the page."""
    section = Section("summary", "Summary")
    of_paper, of_ours = claims(evidence), aims(evidence)
    section.blocks += [
        Items([Item(line) for line in _lines(evidence, of_paper, of_ours)]),
        Pairs(what_was_run(evidence)),
    ]
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


def _lines(evidence: Evidence, of_paper: Sequence[Claim], of_ours: Sequence[Claim]) -> list[str]:
    """Five at most."""
    lines = []
    if of_paper:
        lines.append(f"Of {len(of_paper)} claims of the paper: {_counted(of_paper)}.")
    for group, words in (("paper", "As in the paper"), ("better", "Beyond the paper")):
        found = []
        for (model, detector), results in evidence.study.pairs(group).items():
            share, count = (evidence.of(results, f) for f in ("share", "adaptations"))
            if share.value is not None and count.value is not None:
                low, high = percent(share.low), percent(share.high)
                range_ = f"{low} to {high}" if share.count > 1 else "one seed"
                text = (
                    f"{words}, the {model} model with the {detector} detector leaves the least of "
                    f"the original model's MME: {percent(share.value)} ({range_}), with "
                    f"{number(count.value)} adaptations a run."
                )
                found.append((share.value, text))
        lines += [min(found)[1]] if found else []
    lines += _floor(evidence)
    if of_ours:
        lines.append(f"Of {len(of_ours)} aims beyond the paper: {_counted(of_ours)}.")
    return lines[:5] or ["The study has no runs."]


def _floor(evidence: Evidence) -> list[str]:
    floors = [f for r in evidence.study.results("better") if (f := evidence.study.facts_of(r))]
    if not floors:
        return []
    visible = sum(len(f.detectable) for f in floors)
    drifts = sum(len(f.drifts) for f in floors)
    least = sum(f.mme_floor for f in floors) / len(floors)
    return [
        f"The floor, the true model with the true wear, has an MME of {number(least)} rad/s; "
        f"{number(100 * visible / drifts) if drifts else 0} % of the drifts show above the noise."
    ]


def _counted(found: Sequence[Claim]) -> str:
    verdicts = [c.verdict for c in found]
    return ", ".join(f"{verdicts.count(v)} {v}" for v in ClaimVerdict if v in verdicts)


def _verdicts(caption: str, name: str, found: Sequence[Claim]) -> Table | Text:
    if not found:
        return Text("The study has no runs for these.", "missing")
    rows = [
        (f"{c.text} ({c.where})", Mark(str(c.verdict), TONES.get(c.verdict, "open")), c.evidence)
        for c in found
    ]
    return Table(caption, (name, "verdict", "evidence"), rows, cards=True)
