"""The tables of the page `ldt docs accuracy`, from a scored challenge.

ldt challenge make --cases N --seed S --out cases
ldt challenge score cases cases.key.json --out score --no-comparators
python -m tests.challenge_table score

keeps what the tables need in `bags/challenge.json` and writes them anew, with the diagram of how
often a stated confidence was right. With --add the rounds kept before stay beside it; one of them
is not added again. A second folder is one with comparators, of the first cases; it may be the same.
Without one, the table of comparators stays that of the round in which they were last asked.
"""

from __future__ import annotations

import json
import math
import statistics
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ldt_core.lab.statistics import proportion
from tests.page_table import write_table

KEPT = Path(__file__).parents[1] / "bags" / "challenge.json"
COLUMNS = (
    *("who", "case", "kind", "effects", "outside", "verdict", "acting", "outcome", "right"),
    *("confidence", "nominal", "closure", "seconds"),
)
BINS = ((0.0, 0.5), (0.5, 0.7), (0.7, 0.85), (0.85, 0.95), (0.95, 1.0))
POINTS = 0.05  # of a closed fraction
DIAGNOSIS = "diagnosis"
ADD = "--add"
Case = Mapping[str, Any]


def kept(folders: Sequence[Path], before: Mapping[str, Any], add: bool = False) -> dict[str, Any]:
    """What the tables need of the scores in these folders, and of what was kept before.

    Args:
        add: whether the cases kept before stay beside these.
    """
    scores = [json.loads((f / "score.json").read_text("utf-8")) for f in folders]
    of_key = {"sha256": scores[0]["keys"][0]["sha256"]}
    own = [c for c in _slim(scores[0]) if c["who"] == DIAGNOSIS]
    rounds, cases = (before.get(n, []) if add else [] for n in ("rounds", "cases"))
    if all(r["sha256"] != of_key["sha256"] for r in rounds):
        rounds, cases = [*rounds, {**of_key, "cases": len(own)}], [*cases, *own]
    compared = before.get("compared", {})
    if others := [c for s in scores[1:] for c in _slim(s) if c["who"] != DIAGNOSIS]:
        asked = {c["case"] for c in others}
        compared = {**of_key, "cases": [*(c for c in own if c["case"] in asked), *others]}
    about = {"rounds": rounds, "stamp": scores[0]["stamp"]}
    return {**about, "cases": cases, "compared": compared}


def _slim(score: Mapping[str, Any]) -> list[Case]:
    return [{n: c[n] for n in COLUMNS} for c in score["cases"]]


def share(found: Iterable[bool]) -> str:
    """A share in percent with Wilson's interval and its count."""
    right = list(found)
    if not right:
        return ""
    p = proportion(sum(right), len(right), method="wilson")
    low, high = (f"{100 * v:.0f}" for v in (p.low, p.high))
    return f"{100 * (p.value or 0.0):.0f} % [{low}, {high}] of {len(right)}"


def _within(cases: Iterable[Case], excitation: str) -> list[bool]:
    """Whether what was promised came true within five points; a promise refused is kept."""
    pairs = [c["closure"].get(excitation) for c in cases]
    return [
        p["realised"] is not None and abs(p["promised"] - p["realised"]) <= POINTS
        for p in pairs
        if p is not None
    ]


#: What a row is of: cases, how each is judged, what was aimed at.
ROWS: tuple[tuple[str, Callable[[Case], bool], Callable[[Case], bool], str], ...] = (
    (
        "single effects: named, or in a group of at most 3",
        lambda c: c["kind"] == "single",
        lambda c: bool(c["right"]) and max(map(len, c["acting"]), default=9) <= 3,
        "95 %",
    ),
    ("pairs", lambda c: c["kind"] == "pair", lambda c: bool(c["right"]), "90 %"),
    ("triples", lambda c: c["kind"] == "triple", lambda c: bool(c["right"]), "70 %"),
    ("without a gap: `none`", lambda c: c["kind"] == "none", lambda c: bool(c["right"]), "99 %"),
    ("outside causes: `unknown`", lambda c: c["kind"] == "outside", lambda c: c["right"], "90 %"),
    (
        "nominal parameters explain the gap: said so",
        lambda c: c["nominal"] is not None,
        lambda c: bool(c["nominal"]),
        "95 %",
    ),
    (
        "with effects of the library: a wrong name",
        lambda c: c["kind"] in ("single", "pair", "triple"),
        lambda c: c["outcome"] == "wrong",
        "",
    ),
    (
        "the same: `unknown`",
        lambda c: c["kind"] in ("single", "pair", "triple"),
        lambda c: c["outcome"] == "unknown",
        "",
    ),
)


def table(found: Mapping[str, Any]) -> str:
    """Markdown: what was right, the reliability of the confidence, comparators."""
    own = [c for c in found["cases"] if c["who"] == DIAGNOSIS]
    rounds = found["rounds"]
    seconds = [c["seconds"] for c in own[-rounds[-1]["cases"] :]]
    lines = ["| cases | right | aim |", "|---|---|---|"]
    for name, chosen, right, aim in ROWS:
        lines.append(f"| {name} | {share(bool(right(c)) for c in own if chosen(c))} | {aim} |")
    for excitation, words, aim in (("same", "the same", "95 %"), ("another", "another", "90 %")):
        kept_promises = share(_within(own, excitation))
        lines.append(f"| closure within 5 points, {words} excitation | {kept_promises} | {aim} |")
    lines += ["", f"{len(own)} cases. In brackets 95 % intervals (Wilson). The keys' SHA-256:", ""]
    lines += [f"- `{r['sha256']}` ({r['cases']} cases)" for r in rounds]
    spent = f"{statistics.median(seconds):.1f} s in the median, {max(seconds):.0f} s at most"
    lines += ["", f"Processor time in the last of them: {spent}."]
    lines += ["", "| confidence stated | mean | right |", "|---|---|---|"]
    for (low, high), inside in _bins(own):
        mean = statistics.fmean(c["confidence"] for c in inside)
        observed = share(bool(c["right"]) for c in inside)
        lines.append(f"| {low:g} to {high:g} | {mean:.2f} | {observed} |")
    return "\n".join([*lines, *_comparators(found.get("compared", {})), ""])


def _bins(own: Sequence[Case]) -> list[tuple[tuple[float, float], list[Case]]]:
    known = [c for c in own if c["confidence"] is not None]
    bins = [(b, [c for c in known if b[0] < c["confidence"] <= b[1]]) for b in BINS]
    return [(b, inside) for b, inside in bins if inside]


def _comparators(compared: Mapping[str, Any]) -> list[str]:
    cases = compared.get("cases", [])
    who = list(dict.fromkeys(c["who"] for c in cases if c["who"] != DIAGNOSIS))
    if not who:
        return []
    same = {c["case"] for c in cases if c["who"] != DIAGNOSIS}
    everybody = [DIAGNOSIS, *who]
    key = f"`{compared['sha256'][:8]}…`"
    lines = ["", f"| the first {len(same)} cases of key {key} | {' | '.join(everybody)} |"]
    lines += ["|---|" + "---|" * len(everybody)]
    of = {w: [c for c in cases if c["who"] == w and c["case"] in same] for w in everybody}
    for name, chosen, judged, _ in (*ROWS[:5], ROWS[6]):
        cells = [_counted(bool(judged(c)) for c in of[w] if chosen(c)) for w in everybody]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    realised = [
        [p["realised"] for c in of[w] if (p := c["closure"].get("another")) is not None]
        for w in everybody
    ]
    medians = [statistics.median([q for q in r if q is not None] or [math.nan]) for r in realised]
    shares = " | ".join("" if math.isnan(m) else f"{100 * m:.1f} %" for m in medians)
    lines.append(f"| gap closed with another excitation, median | {shares} |")
    times = " | ".join(f"{statistics.median(c['seconds'] for c in of[w]):.0f} s" for w in everybody)
    lines.append(f"| processor time, median | {times} |")
    return lines


def _counted(found: Iterable[bool]) -> str:
    right = list(found)
    return f"{sum(right)} of {len(right)}" if right else ""


def picture(found: Mapping[str, Any], folder: Path) -> None:
    """The reliability diagram: stated against observed, with 95 % intervals."""
    from ldt_core.views.page import style

    own = [c for c in found["cases"] if c["who"] == DIAGNOSIS]

    def draw(layout: style.Layout) -> Any:
        figure = style.blank(style.Layout(layout.name, 3.6, False), 3.2)
        axes = figure.add_subplot()
        axes.plot([0, 1], [0, 1], color=style.FAINT)
        for _, inside in _bins(own):
            right = proportion(sum(bool(c["right"]) for c in inside), len(inside), method="wilson")
            at, value = statistics.fmean(c["confidence"] for c in inside), right.value or 0.0
            ends = [[value - right.low], [right.high - value]]
            axes.errorbar([at], [value], yerr=ends, fmt="o", color=style.INK)
            how = {"textcoords": "offset points", "ha": "center"}
            above = at < 0.95  # the last two bins are close to each other
            end, offset = (right.high, 4) if above else (right.low, -12)
            axes.annotate(str(len(inside)), (at, end or 0.0), (0, offset), **how)
        axes.set_xlabel("confidence stated (mean of a bin)")
        axes.set_ylabel("share that was right")
        axes.set_xlim(0, 1.02)
        axes.set_ylim(0, 1.1)
        return figure

    about = ("confidence stated and observed", "shares", "points beside the diagonal")
    style.save(style.Drawing("reliability", *about, draw), folder)


def main(*given: str) -> int:
    """Write tables, picture and what they were made from."""
    folders = [f for f in given if f != ADD]
    if not folders:
        raise SystemExit(f"expected the folder of a score, got none; {__doc__}")
    before = json.loads(KEPT.read_text("utf-8")) if KEPT.exists() else {}
    found = kept([Path(f) for f in folders], before, ADD in given)
    line_by_line = json.dumps(found, sort_keys=True).replace('{"acting"', '\n{"acting"')
    KEPT.write_text(line_by_line + "\n", encoding="utf-8")
    again = json.loads(KEPT.read_text("utf-8"))
    write_table("accuracy", table(again))
    picture(again, KEPT.parent / "figures")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(*sys.argv[1:]))
