"""Whether the default twin is as good on the streams as it has to be."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from ldt_core.base.sentences import number
from ldt_core.lab.statistics import Interval, mean, rate
from ldt_core.lab.study.robustness.robust_run import DEFAULT, RobustRun, RobustScore, score_run
from ldt_core.lab.study.robustness.streams import STREAMS

#: Experiments to a false alarm that the default detector states (`parameters.yaml`).
STATED_EVERY = 1000.0
QUIET = "quiet"
#: Adaptations a change of the machine, in the mean.
MOST_PER_CHANGE = 1.0


@dataclass(frozen=True)
class AimVerdict:
    """One aim, and what came of it.

    Attributes:
        stream: whose aim it is; "" for all.
        aim: in words.
        found: in words.
        passed: whether the mean over the seeds, or the worst run, is as asked.
    """

    stream: str
    aim: str
    found: str
    passed: bool


Scored = dict[str, list[tuple[RobustRun, RobustScore]]]


def scored(runs: Iterable[RobustRun], setup: str = DEFAULT) -> Scored:
    """Stream → its runs under a setup with their figures, in the order of `STREAMS`."""
    found: Scored = {}
    for run in runs:
        if run.task.setup == setup:
            found.setdefault(run.task.stream, []).append((run, score_run(run)))
    return {name: found[name] for name in STREAMS if name in found}


def robust_aims(runs: Sequence[RobustRun]) -> list[AimVerdict]:
    """Every aim on whose streams the default has run."""
    by_stream = scored(runs)
    found = [v for name, entries in by_stream.items() for v in _of_stream(name, entries)]
    every = [entry for entries in by_stream.values() for entry in entries]
    return [*found, *_of_all(every), *_of_quiet(by_stream.get(QUIET, []))] if every else []


def _of_stream(name: str, entries: list[tuple[RobustRun, RobustScore]]) -> list[AimVerdict]:
    aim, scores = STREAMS[name].aim, [score for _, score in entries]
    asked = (
        ("left as a multiple of late", aim.late, mean(s.over_late for s in scores), 1.0, ""),
        ("left", aim.left, mean(s.left for s in scores), 100.0, " %"),
        ("left after the first", aim.learned, mean(s.learned for s in scores), 100.0, " %"),
    )
    return [
        AimVerdict(
            name,
            f"{what} at most {number(scale * most)}{unit}",
            _scaled(found, scale, unit),
            found.value is not None and found.value <= most,
        )
        for what, most, found, scale, unit in asked
        if most is not None
    ]


def _of_all(every: list[tuple[RobustRun, RobustScore]]) -> list[AimVerdict]:
    worst = max(every, key=lambda e: e[1].left)
    gross = sum(score.gross_holds for _, score in every)
    where = sorted({run.task.stream for run, score in every if score.gross_holds})
    per_change = mean(score.per_change for _, score in every)
    return [
        AimVerdict(
            "",
            "worse than the original on any stream: never",
            f"at worst {number(100 * worst[1].left)} % left, {_named(worst[0])}",
            worst[1].left <= 1.0,
        ),
        AimVerdict(
            "",
            "error above ten times the noise and the state “holds”: never",
            f"{gross} experiments" + (f", on {', '.join(where)}" if where else ""),
            gross == 0,
        ),
        AimVerdict(
            "",
            "at most one adaptation a change, in the mean",
            _scaled(per_change, 1.0, ""),
            per_change.value is not None and per_change.value <= MOST_PER_CHANGE,
        ),
    ]


def _of_quiet(entries: list[tuple[RobustRun, RobustScore]]) -> list[AimVerdict]:
    if not entries:
        return []
    count = sum(score.adaptations for _, score in entries)
    exposure = sum(len(run.max_error) for run, _ in entries)
    found = rate(count, exposure)
    return [
        AimVerdict(
            QUIET,
            "adaptations on a quiet machine within the false alarms stated, one in 1000",
            f"{count} in {exposure} experiments",
            found.low <= 1 / STATED_EVERY,
        )
    ]


def _scaled(found: Interval, scale: float, unit: str) -> str:
    if found.value is None:
        return "unknown"
    text = f"{number(scale * found.value)}{unit}"
    if found.count < 2:
        return f"{text}, one run"
    return f"{text} [{number(scale * found.low)}, {number(scale * found.high)}]"


def _named(run: RobustRun) -> str:
    return f"{run.task.stream}, seed {run.task.seed}"
