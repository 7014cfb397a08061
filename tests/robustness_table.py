"""The table of the page `ldt docs streams`, from the results of a study.

ldt study --only robustness --seeds 10 --out streams
python -m tests.robustness_table streams

keeps the columns that the table needs in `bags/robustness.csv` and writes the table anew. A study
that was interrupted gives the streams that it had finished; what was kept of the others stays.
"""

from __future__ import annotations

import csv
import json
import statistics
import sys
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path

from ldt_core.lab.study.robustness.robust_run import DEFAULT, RobustRun, RobustTask, score_run
from ldt_core.lab.study.robustness.streams import STREAMS
from tests.page_table import write_table

KEPT = Path(__file__).parents[1] / "bags" / "robustness.csv"
COLUMNS = (
    *("stream", "setup", "seed", "experiments", "left", "late_left", "learned"),
    *("adaptations", "changes", "gross_holds", "seconds"),
)
HEAD = (
    "| stream | seeds | remaining error | one step late | without the first "
    "| new models per change |"
)
Row = Mapping[str, str]


def rows(file: Path) -> list[dict[str, str]]:
    """The lines of the kept result file."""
    with file.open(newline="", encoding="utf-8") as text:
        return [{name: line[name] for name in COLUMNS} for line in csv.DictReader(text)]


def results(study: Path) -> list[dict[str, str]]:
    """The kept columns of the runs in a study's folder."""
    found = []
    for file in sorted(study.glob("robustness/*.json")):
        content = json.loads(file.read_text("utf-8"))["content"]
        task = RobustTask(**content["task"])
        whole = {**asdict(task), **asdict(score_run(RobustRun.from_dict(task, content)))}
        found.append({name: str(whole[name]) for name in COLUMNS})
    return found


def table(found: Iterable[Row]) -> str:
    """Markdown: one line for each stream, percent of the original's mean maximum error."""
    lines = [HEAD, "|---|---|---|---|---|---|"]
    kept = list(found)
    for name, kind in STREAMS.items():
        own = [r for r in kept if r["stream"] == name and r["setup"] == DEFAULT]
        if not own:
            continue
        changes = sum(int(r["changes"]) for r in own)
        models = sum(int(r["adaptations"]) for r in own)
        cells = (
            f"`{name}`: {kind.about}",
            str(len(own)),
            _percent(own, "left"),
            _percent(own, "late_left"),
            _percent(own, "learned"),
            f"{models / changes:.1f}" if changes else f"{models} in total",
        )
        lines.append("| " + " | ".join(cells) + " |")
    gross = sum(int(r["gross_holds"]) for r in kept if r["setup"] == DEFAULT)
    count = sum(int(r["experiments"]) for r in kept if r["setup"] == DEFAULT)
    said = f"Errors above ten times the noise while the state was `holds`: {gross} of {count:,}."
    return "\n".join([*lines, "", said, ""])


def _percent(found: Iterable[Row], name: str) -> str:
    """The mean over seeds, and the least and the most."""
    shares = [100 * float(r[name]) for r in found]
    least, most = f"{min(shares):.0f}", f"{max(shares):.0f}"
    return f"{statistics.fmean(shares):.0f} %" + (f" ({least} to {most})" if least != most else "")


def main(study: str) -> int:
    """Write table and kept columns."""
    found = results(Path(study))
    anew = {(line["stream"], line["setup"]) for line in found}
    found += [line for line in rows(KEPT) if (line["stream"], line["setup"]) not in anew]
    with KEPT.open("w", newline="", encoding="utf-8") as text:
        writer = csv.DictWriter(text, COLUMNS)
        writer.writeheader()
        writer.writerows(found)
    write_table("streams", table(found))
    return 0


if __name__ == "__main__":
    raise SystemExit(main(*sys.argv[1:]))
