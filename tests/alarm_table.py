"""The tables of false alarms and delays on the page `ldt docs detector`, from a study's results.

ldt study --only alarms --seeds 4 --out alarms
python -m tests.alarm_table alarms

keeps the counts in `bags/alarms.csv` and writes the tables anew. A study that was interrupted gives
the seeds and laws that it had finished.
"""

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

from ldt_core.base.sentences import listed, number
from ldt_core.lab.statistics import Interval, mean, proportion
from ldt_core.lab.study.robustness.alarm_trials import (
    AFTER,
    COUNTS,
    DELAYS,
    EVERY,
    SAMPLES,
    AlarmCount,
    AlarmTask,
    lorden,
    over_seeds,
)
from tests.benchmarks.kept import stamp
from tests.page_table import write_table

KEPT = Path(__file__).parents[1] / "bags" / "alarms.csv"
COLUMNS = ("law", "size", "seed", *COUNTS, *DELAYS, "taken")
#: What the laws of the study are, in words.
ABOUT = {
    "white": "normal, all samples alike",
    "AR 0.9": "a sample keeps 0.9 of the one before",
    "AR 0.99": "a sample keeps 0.99 of the one before",
    "Student 3": "heavy tails, 3 degrees of freedom",
    "lognormal scale": "another size in each experiment, mostly within a factor of two",
    "rarely loud": "five times as large in one experiment of twenty",
    "season in the excitation": "the size goes up and down by a half, over 50 experiments",
    "quantised": "rounded to steps of its deviation",
}
#: Laws whose samples depend on those before: the guarantee says nothing about them.
OUTSIDE = ("AR 0.9", "AR 0.99")
RATES_HEAD = (
    "| noise | stated, per 1000 | false alarms | experiments | per 1000 | at most, per 1000 "
    "| in a row, per 1000 |"
)
DELAYS_HEAD = (
    "| energy of the error | mean delay | never found | CUSUM, error known | bound, error known "
    "| bound, energy alone |"
)
Row = Mapping[str, str]


def rows(file: Path = KEPT) -> list[dict[str, str]]:
    """The lines of the kept result file."""
    with file.open(newline="", encoding="utf-8") as text:
        return list(csv.DictReader(text))


def results(study: Path, taken: str) -> list[dict[str, str]]:
    """The counts in a study's folder; `taken` says when and with which code."""
    found = []
    for file in sorted(study.glob("alarms/*.json")):
        content = json.loads(file.read_text("utf-8"))["content"]
        task = AlarmTask(**content["task"])
        plain = AlarmCount.from_dict(task, content).to_dict()
        row = {"law": task.law, "size": f"{task.size:g}", "seed": str(task.seed), "taken": taken}
        row |= {n: str(plain[n]) for n in COUNTS}
        found.append(row | {n: " ".join(map(str, plain[n])) for n in DELAYS})
    return found


def counts(found: Iterable[Row]) -> list[AlarmCount]:
    """The lines as the study has them."""
    return [
        AlarmCount(
            AlarmTask(int(r["seed"]), r["law"], float(r["size"])),
            **{n: int(r[n]) for n in COUNTS},
            **{n: tuple(map(int, r[n].split())) for n in DELAYS},
        )
        for r in found
    ]


def false_alarms(own: AlarmCount) -> Interval:
    """Share of experiments [1] with a first false alarm, with the exact 95 % interval."""
    return proportion(own.first, own.experiments)


def table(found: Iterable[Row]) -> str:
    """Markdown: a line for each law, then a line for each size of a change."""
    kept = list(found)
    known = counts(kept)
    totals = over_seeds(known)
    lines = [*_rates(totals), "", *_delays(totals)]
    taken = listed(sorted({r["taken"] for r in kept}))
    seeds = len({c.task.seed for c in known})
    told = f"{seeds} seeds, {SAMPLES} samples an experiment, computed on {taken}."
    return "\n".join([*lines, "", told, ""])


def _rates(known: list[AlarmCount]) -> list[str]:
    lines = [RATES_HEAD, "|---" * RATES_HEAD.count(" | ") + "|---|"]
    for own in known:
        law = own.task.law
        if not law:
            continue
        share = false_alarms(own)
        cells = (
            f"`{law}`: {ABOUT[law]}",
            "none: breaks the assumption" if law in OUTSIDE else number(1000 / EVERY, 1),
            f"{own.first:,}",
            f"{share.count:,}",
            number(1000 * (share.value or 0.0), 2),
            number(1000 * share.high, 2),
            number(1000 * (own.positives / own.in_a_row)),
        )
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def _delays(known: list[AlarmCount]) -> list[str]:
    lines = [DELAYS_HEAD, "|---" * DELAYS_HEAD.count(" | ") + "|---|"]
    for own in known:
        size, delays = own.task.size, own.delays
        if not delays:
            continue
        lost = sum(d > AFTER for d in delays)
        cells = (
            number(size, 2),
            f"above {AFTER}" if lost == len(delays) else _told(mean(delays), at_least=lost > 0),
            f"{lost} of {len(delays)}",
            number(mean(own.cusum).value or 0.0),
            number(lorden(size, known=True)),
            number(lorden(size, known=False)),
        )
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def _told(delay: Interval, *, at_least: bool) -> str:
    """A mean [experiments]; with changes that were never found, the least that it can be."""
    told = number(delay.value or 0.0)
    return f"at least {told}" if at_least else told


def main(study: str) -> int:
    """Write tables and kept counts."""
    now = stamp()
    with KEPT.open("w", newline="", encoding="utf-8") as text:
        writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(results(Path(study), f"{now['day']} with commit {now['commit']}"))
    write_table("detector", table(rows()))
    return 0


if __name__ == "__main__":
    raise SystemExit(main(*sys.argv[1:]))
