"""The results that the page `ldt docs speed` shows, and its table, which is made from them.

python -m tests.benchmarks --keep [NAME ...]

measures, takes the rows into `bags/benchmarks.json` with day, commit and processor, and writes the
table anew. Without `--keep` nothing is touched.
"""

from __future__ import annotations

import json
import os
import platform
import re
import subprocess
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from tests.benchmarks.row import Row
from tests.page_table import write_table

KEPT = Path(__file__).parents[2] / "bags" / "benchmarks.json"
HEAD = "| work | LDT | peer | LDT is | details |"
NO_AIM = ("", "-")
Kept = Mapping[str, Any]


def load() -> list[dict[str, Any]]:
    """What is kept, in the order of the table."""
    rows: list[dict[str, Any]] = json.loads(KEPT.read_text("utf-8"))
    return rows


def merge(rows: Iterable[Kept], measured: Iterable[Row]) -> list[Kept]:
    """Rows with those measured now in the place of the same work beside the same peer."""
    now = stamp()
    by_work = {(r["name"], r["peer"]): r for r in rows}
    for row in measured:
        by_work[row.name, row.peer] = {**asdict(row), **now}
    return list(by_work.values())


def processor() -> str:
    """Processor, cores and Python, as they are here."""
    model = "unknown processor"
    cpu = Path("/proc/cpuinfo")
    if cpu.exists():
        names = [line for line in cpu.read_text().splitlines() if line.startswith("model name")]
        model = names[0].partition(":")[2].strip() if names else model
    return f"{model}, {os.cpu_count()} cores, Python {platform.python_version()}"


def stamp() -> dict[str, str]:
    """When and where something was measured: day, commit, processor."""
    day = datetime.now(UTC).date().isoformat()
    head = ["git", "-C", str(KEPT.parent), "rev-parse", "--short", "HEAD"]
    commit = subprocess.run(head, capture_output=True, text=True, check=True).stdout.strip()
    return {"day": day, "commit": commit, "processor": processor()}


def table(rows: Iterable[Kept]) -> str:
    """Markdown: a line for each row, and the processors, told by letters."""
    kept = list(rows)
    processors = list(dict.fromkeys(r["processor"] for r in kept))
    letters = {p: chr(ord("A") + k) for k, p in enumerate(processors)}
    lines = [HEAD, "|---" * HEAD.count(" | ") + "|---|"]
    for r in kept:
        ratio = r["peer_s"] / r["ours_s"]
        aim = f" (aim: {aimed(r['aim'])})" if r["aim"] not in NO_AIM else ""
        stamped = f"{r['day']}, {r['commit']}, {letters[r['processor']]}"
        cells = (
            *(r["name"], span(r["ours_s"]), f"{span(r['peer_s'])}: {r['peer']}"),
            (times(ratio, "faster") if ratio >= 1 else times(1 / ratio, "slower")) + aim,
            f"{r['note']}; {stamped}" if r["note"] else stamped,
        )
        lines.append("| " + " | ".join(cells) + " |")
    told = "; ".join(f"{letter}: {p}" for p, letter in letters.items())
    ends = "Details end with the date, the commit that added the row, and the processor."
    return "\n".join([*lines, "", f"{ends} {told}.", ""])


def times(ratio: float, word: str) -> str:
    """So many times faster or slower, with three digits and no exponent."""
    told = f"{float(f'{ratio:.3g}'):,g}" if ratio < 1e6 else f"{ratio:.1e}"
    return f"{told} times {word}"


def aimed(told: str) -> str:
    """An aim as it is kept, in words.

    >>> aimed("at least 1/3"), aimed("5000"), aimed("20×"), aimed("under 30 s")
    ('at most 3 times slower', '5,000 times faster', '20 times faster', 'under 30 s')
    """
    if slower := re.fullmatch(r"(?:at least |above )1/([\d.]+)", told):
        return f"at most {times(float(slower[1]), 'slower')}"
    faster = re.fullmatch(r"([\d.]+)[x×]?", told)
    return times(float(faster[1]), "faster") if faster else told


def keep(measured: Iterable[Row]) -> None:
    """Take rows into the kept results, and write the page's table anew."""
    rows = merge(load(), measured)
    KEPT.write_text(json.dumps(rows, indent=1, ensure_ascii=False) + "\n", "utf-8")
    write_table("speed", table(rows))


def span(seconds: float) -> str:
    """A time with three digits and the unit that fits."""
    for scale, unit in ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs")):
        if seconds >= scale:
            value = seconds / scale
            return f"{value:.0f} {unit}" if value >= 1000 else f"{value:.3g} {unit}"
    return f"{seconds / 1e-9:.3g} ns"
