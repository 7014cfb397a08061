"""How an import cuts the channels of a record into experiments."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

from ldt_core.base.errors import OptionError, RecordingError
from ldt_core.base.experiment import Experiment
from ldt_core.base.sentences import counted
from ldt_core.recording.stretches import first_gap, on_grid, stretches
from ldt_core.segmenter import CHANNELS, Segmenter, build_rule
from ldt_core.segmenter.cut_rules import LEAST_SAMPLES
from ldt_core.segmenter.resampling import GAP_PERIODS, Series

LEAST_GAP = 1.5  # periods of the experiments; a stream far faster than they are may not pause less


def of_equal_length(
    where: str,
    series: dict[str, Series],
    notes: list[str],
    found: float,
    period: float,
    size: int | None,
) -> list[Experiment]:
    """Experiments of so many samples from each stretch without a gap; None for one of each."""
    parts = stretches(series, found)
    if len(parts) > 1:
        gaps = counted(len(parts) - 1, "gap")
        notes.append(
            f"{gaps} of more than {GAP_PERIODS:g} periods of {found:g} s, the first after "
            f"{first_gap(series, found)}; no experiment reaches over one"
        )
    experiments: list[Experiment] = []
    dropped = resampled = 0
    for part in parts:
        grid, columns, changed = on_grid(part, period)
        resampled += changed
        step = size or grid.size
        whole = grid.size // step if step >= LEAST_SAMPLES else 0
        dropped += grid.size - whole * step
        for begin in range(0, whole * step, step):
            rows = {q: column[begin : begin + step] for q, column in columns.items()}
            number = len(experiments) + 1
            experiments.append(Experiment(number, float(grid[begin]), period, **rows))
    if not experiments:
        longest = max((p["speed"].time[-1] - p["speed"].time[0] for p in parts), default=0.0)
        wanted = f"{LEAST_SAMPLES} samples" if size is None else f"{size * period:g} s"
        expected = f"a stretch of {wanted} without a gap"
        raise RecordingError(where, expected, f"{longest + period:g} s at most")
    if resampled:
        notes.append("resampled: the samples were not on a uniform grid of that period")
    if dropped:
        notes.append(
            f"{counted(dropped, 'sample')} at ends of stretches dropped: too few for an experiment"
        )
    return experiments


def segmented(
    series: Mapping[str, Series],
    period: float,
    found: float,
    length: float | None,
    cut: Mapping[str, Any],
) -> tuple[list[Experiment], Counter[str]]:
    """Experiments as the segmenter of a running machine cuts them, and what it left out."""
    if length is None:
        raise OptionError("--length", f"seconds, where the cut is by {cut['cut']}", "none")
    rest = {name: value for name, value in cut.items() if name != "cut"}
    rule = build_rule(cut["cut"], period, length, **rest)
    gap = max(GAP_PERIODS * found, LEAST_GAP * period)
    # All that is of one time has come before a period is over: there is nothing to wait for.
    one = Segmenter(rule, period, gap=gap, lateness=period, current="current" in series)
    order = sorted(
        (at, channel == "speed", channel, index)
        for channel in CHANNELS
        if channel in series
        for index, at in enumerate(series[channel].time.tolist())
    )
    values = {channel: s.values.tolist() for channel, s in series.items()}
    done: list[Experiment] = []
    for at, _, channel, index in order:
        done += one.feed(channel, at, values[channel][index])
    return done + one.end(), one.counts


def listed_counts(counts: Mapping[str, int]) -> str:
    """Each reason and how often, in words."""
    return ", ".join(f"{reason}: {count}" for reason, count in counts.items())
