"""A recorded stream, cut by the segmenter as a running machine's is (`ldt import --cut`)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

from ldt_core.base.errors import OptionError
from ldt_core.base.experiment import Experiment
from ldt_core.segmenter import CHANNELS, Segmenter, build_rule
from ldt_core.segmenter.resampling import GAP_PERIODS, Series

LEAST_GAP = 1.5  # periods of the experiments; a stream far faster than they are may not pause less


def segmented(
    series: Mapping[str, Series],
    period: float,
    found: float,
    length: float | None,
    cut: Mapping[str, Any],
) -> tuple[list[Experiment], Counter[str]]:
    """Experiments of a stream, and what was left out by its reason.

    Args:
        series: voltage, speed and perhaps current, at increasing times.
        period: of the experiments [s].
        found: period of the stream [s].
        length: from the edge on, by trigger; the greatest, by steady state [s].
        cut: the parameters of the group `cut`, by name; the rule is `cut`.

    Raises:
        OptionError: no length, or one that makes no experiment.
    """
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
