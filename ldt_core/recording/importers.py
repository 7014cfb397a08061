"""Experiments out of a CSV file or a foreign recording (the work behind `ldt import`)."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ldt_core.base.clock import LATEST
from ldt_core.base.errors import OptionError, RecordingError
from ldt_core.base.experiment import Experiment
from ldt_core.base.printable import as_argument
from ldt_core.base.sentences import counted
from ldt_core.base.units import UNITS, Field, parse_field, propose_fields
from ldt_core.machine.experiment_limits import SHORTEST_PERIOD
from ldt_core.physics.parameter import LARGEST
from ldt_core.recording.csv_table import CsvTable
from ldt_core.recording.message_fields import parse_field_path, read_fields
from ldt_core.recording.storage import Storage
from ldt_core.segmenter import CHANNELS, Segmenter, build_rule
from ldt_core.segmenter.cut_rules import LEAST_SAMPLES
from ldt_core.segmenter.resampling import (
    GAP_PERIODS,
    Series,
    check_times,
    find_period,
    fits_grid,
    resample,
    split_at_gaps,
)

LEAST_GAP = 1.5  # periods of the experiments; a stream far faster than they are may not pause less
ROUNDING = 1e-6  # of a period: what floating point loses in a length or an end time
# What hardly any motor does, but a column in another unit seems to do.
SLOW, QUICK = 1.0, 1e-6  # s between samples
#: Quantity → (largest size, in which unit, what it is then): 9549 rpm; a railway's voltage.
RARE = {"voltage": (1000.0, "V", "mV"), "speed": (1000.0, "rad/s", "rpm")}
#: Unit that times likely have where so many of them lie between samples: 1 Hz to 1 kHz.
LIKELY = {"ms": 1e3, "us": 1e6, "ns": math.inf}
MOST_SAMPLES = 100_000_000  # of a stretch; more is a period in the wrong unit


class Imported(NamedTuple):
    """What an import made; what it did, and which of it speaks for another unit, in sentences."""

    experiments: list[Experiment]
    notes: list[str]
    doubts: Sequence[str] = ()


def import_file(
    path: str | Path,
    voltage: str,
    speed: str,
    current: str | None = None,
    time: str | None = None,
    sample_period: float | None = None,
    length: float | None = None,
    cut: Mapping[str, Any] | None = None,
) -> Imported:
    """Experiments out of a table or a foreign recording.

    Args:
        path: CSV file (`.gz` too), rosbag2 folder, `.mcap` or `.db3` file.
        voltage, speed, current: FIELD[:UNIT]; FIELD is a column (name, or number from 1) or
            `/topic.field[index]`.
        time: FIELD[:UNIT] of the time of each sample. A recording has times of its own.
        sample_period: [s]; without `time`, how far apart the rows are; with times, the period to
            resample to instead of the one found.
        length: of each experiment [s]; None makes one experiment of each stretch without a gap.
        cut: the parameters of the group `cut`, for experiments by trigger or by steady state.

    Raises:
        OptionError: an unknown unit, or options that do not go together.
        RecordingError: a file, column, topic or cell that cannot be used; names line or message.
    """
    for name, value in (("--sample-period", sample_period), ("--length", length)):
        if value is not None and not SHORTEST_PERIOD <= value <= LATEST:
            expected = f"seconds above 0, {SHORTEST_PERIOD:g} to {LATEST:g}"
            raise OptionError(name, expected, value)
    options = {"voltage": voltage, "speed": speed, "current": current, "time": time}
    given = {quantity: text for quantity, text in options.items() if text is not None}
    if not Path(path).exists():
        raise RecordingError(str(path), "a CSV file or a recording", "No such file or directory")
    path = Path(path)
    read = _from_bag if is_bag(path) else _from_table
    series, notes = read(path, given, sample_period)
    for quantity, one in series.items():
        largest = float(np.nanmax(np.abs(one.values), initial=0.0))
        if largest > LARGEST:
            where = f"{path}, {quantity} from {given[quantity]!r}"
            raise RecordingError(where, f"at most {LARGEST:g} in SI units", f"{largest:g}")
    doubts = _doubts(series, given)
    return _cut(str(path), series, notes + doubts, sample_period, length, cut, doubts)


def is_bag(path: Path) -> bool:
    """Whether a file is a recording by its name; else it is a table."""
    return path.is_dir() or path.name.endswith((".mcap", ".db3", ".zstd", ".bag"))


def _doubts(series: Mapping[str, Series], given: Mapping[str, str]) -> list[str]:
    """Where a column that names no unit has the size of another one."""
    bare = [q for q, text in given.items() if not text.endswith(tuple(f":{u}" for u in UNITS[q]))]
    speed, notes = series["speed"], []
    step = float(np.median(np.diff(speed.time))) if speed.time.size > 1 else 0.0
    slow = next((unit for unit, most in LIKELY.items() if step < most), "")
    for quantity, (most, si, unit) in RARE.items():
        largest = float(np.nanmax(np.abs(series[quantity].values), initial=0.0))
        if quantity in bare and largest > most:
            told = f"{quantity}s up to {largest:.5g} {si} are rare"
            notes.append(_doubt(told, unit, quantity, given, unit))
    if "time" in bare and step >= SLOW:
        told = f"{step:g} s between samples are long"
        notes.append(_doubt(told, slow, "time", given, slow))
    if "time" in bare and 0 < step <= QUICK:
        told = f"{step:.3g} s between samples are short"
        notes.append(_doubt(told, "days, as a spreadsheet's dates", "time", given, "d"))
    return notes


def _doubt(told: str, named: str, quantity: str, given: Mapping[str, str], unit: str) -> str:
    return f"{told}; if they are {named}: --{quantity} {given[quantity]}:{unit}"


def _check_apart(given: Mapping[str, str], places: Iterable[object]) -> None:
    """Refuse one column for two quantities: a machine would be made of it that is none.

    Args:
        given: quantity → FIELD[:UNIT].
        places: what each stands for.

    Raises:
        OptionError: names the second.
    """
    taken: dict[object, str] = {}
    for (quantity, text), place in zip(given.items(), places, strict=True):
        if (other := taken.setdefault(place, quantity)) != quantity:
            expected = f"another field than that of the {other}"
            raise OptionError(f"--{quantity}", expected, repr(text))


def _from_table(
    path: Path, given: dict[str, str], sample_period: float | None
) -> tuple[dict[str, Series], list[str]]:
    if "time" not in given and sample_period is None:
        raise OptionError(
            "--time or --sample-period", "one of them: a table has no times", "neither"
        )
    table = CsvTable(path)
    fields = {q: parse_field(text, q, table.columns) for q, text in given.items()}
    wanted = [table.column(f.name) for f in fields.values()]
    _check_apart(given, wanted)
    in_seconds = "time" in fields and fields["time"].factor == 1
    dated = wanted[list(fields).index("time")] if in_seconds else None
    lines, columns = table.read(wanted, timed="time" in fields, dated=dated)
    values = {
        q: column * field.factor for (q, field), column in zip(fields.items(), columns, strict=True)
    }
    assert sample_period is not None or "time" in values
    at = np.asarray(np.arange(lines.size) * (sample_period or 0.0), dtype=np.float64)
    times = values.pop("time", at)
    notes = [f"{counted(lines.size, 'row')}; {_conversions(fields)}", *table.notes]
    named = propose_fields(table.columns)
    swapped = (("voltage", "speed"), ("speed", "voltage"))
    if all(f"{named.get(q, '')}:".startswith(f"{fields[of].name}:") for q, of in swapped):
        notes.append(
            "voltage and speed look swapped; by their names it is "
            f"--voltage {named['voltage']} --speed {named['speed']}"
        )
    if not table.headed:
        taken = ", ".join(
            f"column {field.name} for the {q} in {field.unit} ({spread(column)})"
            for (q, field), column in zip(fields.items(), columns, strict=True)
        )
        notes = [
            f"{counted(lines.size, 'row')} without a header line; taken are {taken}",
            *table.notes,
        ]
        notes.append("if that is wrong, import again with --force and other FIELD:UNIT")

    def place(index: int) -> str:
        return f"line {lines[index]}"

    return {q: Series(times, column, place) for q, column in values.items()}, notes


def _from_bag(
    path: Path, given: dict[str, str], sample_period: float | None
) -> tuple[dict[str, Series], list[str]]:
    storage = Storage(path)
    ours = any(topic.rpartition("/")[2] == "experiment" for topic in storage.topics)
    if ours and not all(text.startswith("/") for text in given.values()):
        got = (
            f"a recording of experiments, which needs no import (ldt info {as_argument(str(path))})"
        )
        raise RecordingError(path, "a CSV file or a foreign bag", got)
    fields = {q: parse_field(text, q) for q, text in given.items()}
    sources = {q: parse_field_path(f"--{q}", field.name) for q, field in fields.items()}
    _check_apart(given, sources.values())
    if "time" in sources and len({s.topic for s in sources.values()}) > 1:
        raise OptionError("--time", "all channels from the topic of the time", given["time"])
    series, timed = read_fields(storage, sources)
    series = {q: s._replace(values=s.values * fields[q].factor) for q, s in series.items()}
    sizes = ", ".join(f"{s.values.size} of {sources[q].text}" for q, s in series.items())
    notes = [f"{sizes}; {_conversions(fields)}"]
    if "time" in series:
        times = series.pop("time").values
        series = {q: s._replace(time=times) for q, s in series.items()}
    else:
        notes.append(timed)
    if sources["voltage"].topic != sources["speed"].topic:
        times = np.append(series["voltage"].time, series["speed"].time[-1])
        notes.append(f"the voltage is held for up to {np.diff(times).max():.3g} s")
    return series, notes + storage.notes


def spread(values: np.ndarray) -> str:
    """From where to where numbers reach, for a person to recognize a column by.

    >>> spread(np.array([3.0, -1.5]))
    '-1.5 to 3'
    """
    return f"{values.min():.4g} to {values.max():.4g}"


def _conversions(fields: dict[str, Field]) -> str:
    return ", ".join(f"{q} from {f.name!r} in {f.unit}" for q, f in fields.items())


def _cut(
    where: str,
    series: dict[str, Series],
    notes: list[str],
    sample_period: float | None,
    length: float | None,
    cut: Mapping[str, Any] | None,
    doubts: Sequence[str] = (),
) -> Imported:
    """Grid, gaps, and experiments of equal length, or what the segmenter makes of the stream."""
    for one in series.values():
        check_times(where, one)
    speed = series["speed"]
    if speed.time.size < LEAST_SAMPLES:
        raise RecordingError(where, f"{LEAST_SAMPLES} samples or more", speed.time.size)
    found = find_period(speed.time)
    if found < SHORTEST_PERIOD:
        expected = f"times {SHORTEST_PERIOD:g} s apart or more"
        raise RecordingError(where, expected, f"{found:g} s")
    period = found if sample_period is None else sample_period
    doubt = f" ({'; '.join(doubts)})" if doubts else ""
    if (last := max(one.time[-1] for one in series.values())) > LATEST:
        raise RecordingError(where, f"times up to {LATEST:g} s{doubt}", f"{last:.10g} s")
    size = None if length is None else round(length / period)
    if size is not None and size < LEAST_SAMPLES:
        expected = f"{LEAST_SAMPLES} periods of {period:g} s or more{doubt}"
        raise OptionError("--length", expected, length)
    start = min(one.time[0] for one in series.values())
    if start < 0:  # a recording counts time from an epoch
        notes.append(f"times moved by {-start:g} s to begin at 0")
        series = {q: s._replace(time=s.time - start) for q, s in series.items()}
    if cut is not None and cut["cut"] != "length":
        done, counts = _segmented(series, period, found, length, cut)
        if not done:
            expected = f"an experiment by {cut['cut']}"
            raise RecordingError(where, expected, _listed(counts) or "none")
        notes.append(f"cut by {cut['cut']}")
        return Imported(done, [*notes, *([_listed(counts)] if counts else [])], doubts)
    stretches = _stretches(series, found)
    if len(stretches) > 1:
        gaps = counted(len(stretches) - 1, "gap")
        notes.append(
            f"{gaps} of more than {GAP_PERIODS:g} periods of {found:g} s, the first after "
            f"{_gap(series, found)}; no experiment reaches over one"
        )
    experiments: list[Experiment] = []
    dropped = resampled = 0
    for part in stretches:
        grid, columns, changed = _on_grid(part, period)
        resampled += changed
        step = size or grid.size
        whole = grid.size // step if step >= LEAST_SAMPLES else 0
        dropped += grid.size - whole * step
        for begin in range(0, whole * step, step):
            rows = slice(begin, begin + step)
            experiments.append(
                Experiment(
                    len(experiments) + 1,
                    float(grid[begin]),
                    period,
                    **{q: column[rows] for q, column in columns.items()},
                )
            )
    if not experiments:
        longest = max((p["speed"].time[-1] - p["speed"].time[0] for p in stretches), default=0.0)
        wanted = f"{length:g} s" if length is not None else f"{LEAST_SAMPLES} samples"
        raise RecordingError(
            where, f"a stretch of {wanted} without a gap", f"{longest + period:g} s at most"
        )
    if resampled:
        notes.append("resampled: the samples were not on a uniform grid of that period")
    if dropped:
        notes.append(
            f"{counted(dropped, 'sample')} at ends of stretches dropped: too few for an experiment"
        )
    return Imported(experiments, notes, doubts)


def _segmented(
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


def _listed(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{reason}: {count}" for reason, count in counts.items())


def _stretches(series: dict[str, Series], period: float) -> list[dict[str, Series]]:
    """The series cut at the gaps of all channels but a voltage that has its own times.

    A voltage command of its own topic may be sent only when it changes; it holds meanwhile.
    """
    speed = series["speed"]
    parts = [(s.time[0], s.time[-1]) for s in _parts(speed, period)]
    current = series.get("current")
    if current is not None and current.time is not speed.time:
        own = find_period(current.time) if current.time.size > 1 else period
        spans = [(s.time[0], s.time[-1]) for s in _parts(current, own)]
        parts = [
            (max(a, c), min(b, d)) for a, b in parts for c, d in spans if max(a, c) <= min(b, d)
        ]
    begins = series["voltage"].time[0]  # before it there is no voltage
    parts = [(max(a, begins), b) for a, b in parts if b >= begins]
    return [{q: _between(s, a, b, q == "voltage") for q, s in series.items()} for a, b in parts]


def _parts(series: Series, period: float) -> list[Series]:
    cuts = split_at_gaps(series.time, period)
    return [Series(series.time[cut], series.values[cut], series.place) for cut in cuts]


def _between(series: Series, begin: float, end: float, held: bool) -> Series:
    """Samples from begin to end, with the neighbours that interpolation or holding needs."""
    first = max(int(np.searchsorted(series.time, begin, side="right")) - 1, 0)
    last = int(np.searchsorted(series.time, end, side="right" if held else "left"))
    cut = slice(first, last + (not held))
    return Series(series.time[cut], series.values[cut], series.place)


def _gap(series: dict[str, Series], period: float) -> str:
    speed = series["speed"]
    end = split_at_gaps(speed.time, period)[0].stop
    return speed.place(end - 1) if end < speed.time.size else "one in the current"


def _on_grid(part: dict[str, Series], period: float) -> tuple[np.ndarray, dict[str, Any], bool]:
    """(times, channel → values on them, whether they were resampled)."""
    speed = part["speed"]
    shared = all(s.time.size == speed.time.size for s in part.values()) and all(
        np.array_equal(s.time, speed.time) for s in part.values()
    )
    if shared and fits_grid(speed.time, period):
        return speed.time, {q: s.values for q, s in part.items()}, False
    begin = max(s.time[0] for s in part.values())
    later = speed.time[speed.time >= begin]
    begin = later[0] if later.size else begin  # on a measured speed, which then needs no change
    end = min(s.time[-1] for q, s in part.items() if q != "voltage")
    count = max((end - begin) / period + ROUNDING + 1, 0)
    if count > MOST_SAMPLES:
        raise OptionError("--sample-period", f"at most {MOST_SAMPLES} samples", f"{count:.3g}")
    grid = begin + period * np.arange(int(count))
    columns = {q: resample(s, grid, period, held=q == "voltage") for q, s in part.items()}
    return grid, columns, True
