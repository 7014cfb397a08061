"""Whether the recording can be trusted: what is odd about it, and what its nodes said last."""

from __future__ import annotations

from ldt_core.doctor.check import Finding, Grade
from ldt_core.doctor.recording_checks import findings
from ldt_core.views.page.blocks import Mark, Section, Table, Text, Value
from ldt_core.views.report.reported_run import ReportedRun

TONES = {Grade.OK: "good", Grade.WARNING: "open", Grade.PROBLEM: "bad"}


def remarks(run: ReportedRun) -> list[Finding]:
    """Findings on the recording that are not well."""
    return [f for f in findings(run.health) if f.grade is not Grade.OK]


def section(run: ReportedRun) -> Section:
    """The health of the recording, and of the nodes that made it."""
    found = Section("health", "Health of the recording")
    odd = remarks(run)
    if odd:
        head = ("what", "grade", "found", "what to do")
        rows = [
            (f.name, Mark(f.grade, TONES[f.grade]), _bare(f.message, run), f.remedy) for f in odd
        ]
        found.blocks.append(Table("What is odd about the recording", head, rows, cards=True))
    else:
        found.blocks.append(
            Text("No experiment is missing, repeated, late or unused, and no file is damaged.")
        )
    nodes = run.health.nodes
    if not nodes:
        absent = "No node's health was recorded: this was no run of the graph."
        found.blocks.append(Text(absent, "missing"))
        return found
    said: list[tuple[Value, ...]] = []
    for node in (nodes[name] for name in sorted(nodes)):
        rejected = "; ".join(f"{count} × {kind}" for kind, count in node.rejected.items())
        said.append((node.role, node.message, rejected or "nothing", node.last_rejection or "-"))
    head = ("node", "said last", "rejected", "why, the last time")
    found.blocks.append(Table("The nodes of the graph", head, said, cards=True, named=(2, 3)))
    return found


def _bare(sentence: str, run: ReportedRun) -> str:
    """Without where the recording lay, no business of those to whom the page is sent."""
    path = str(run.health.path)
    for behind in (": ", ", ", "/"):
        sentence = sentence.replace(f"{path}{behind}", "")
    return sentence
