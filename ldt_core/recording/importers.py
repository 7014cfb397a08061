"""Experiments out of a CSV file or a foreign recording (the work behind `ldt import`)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ldt_core.base.clock import LATEST
from ldt_core.base.errors import OptionError, RecordingError
from ldt_core.base.experiment import Experiment
from ldt_core.base.printable import as_argument
from ldt_core.base.sentences import counted
from ldt_core.base.units import Field, parse_field, propose_fields
from ldt_core.machine.experiment_limits import SHORTEST_PERIOD
from ldt_core.physics.parameter import LARGEST
from ldt_core.recording.csv_table import CsvTable
from ldt_core.recording.import_cuts import listed_counts, of_equal_length, segmented
from ldt_core.recording.message_fields import parse_field_path, read_fields
from ldt_core.recording.positions import speed_of_positions
from ldt_core.recording.storage import Storage
from ldt_core.recording.unit_doubts import unit_doubts
from ldt_core.segmenter.cut_rules import LEAST_SAMPLES
from ldt_core.segmenter.resampling import (
    GRID_TOLERANCE,
    Series,
    check_times,
    find_period,
)

MOVED = "times moved to follow the file before"


class FileLayout(NamedTuple):
    """What the files of one import have in common.

    Attributes:
        file: whose it is.
        columns: what is read of a table, in words: name, unit below it, whether dates.
        period: of the samples [s].
    """

    file: str
    columns: tuple[str, ...]
    period: float


class Imported(NamedTuple):
    """What an import made of a file.

    Attributes:
        content: how much the file has, in words.
        notes: what was done, and which of it speaks for another unit (`doubts`), in sentences.
    """

    experiments: list[Experiment]
    content: str
    notes: list[str]
    doubts: Sequence[str]
    layout: FileLayout


def import_file(
    path: str | Path,
    voltage: str,
    speed: str | None = None,
    current: str | None = None,
    time: str | None = None,
    position: str | None = None,
    sample_period: float | None = None,
    length: float | None = None,
    cut: Mapping[str, Any] | None = None,
    like: FileLayout | None = None,
) -> Imported:
    """Experiments out of a table or a foreign recording.

    Args:
        path: CSV file (`.gz` too), rosbag2 folder, `.mcap` or `.db3` file.
        voltage, speed, current: FIELD[:UNIT]; FIELD is a column (name, or number from 1) or
            `/topic.field[index]`.
        position: FIELD:UNIT of the shaft's angle; the speed is made of it, and none is given.
        time: FIELD[:UNIT] of the time of each sample. A recording has times of its own.
        sample_period: [s]; without `time`, how far apart the rows are; with times, the period to
            resample to instead of the one found.
        length: of each experiment [s]; None makes one experiment of each stretch without a gap.
        cut: the parameters of the group `cut`, for experiments by trigger or by steady state.
        like: of a file that this one has to be like; without `sample_period` its period is taken.

    Raises:
        OptionError: an unknown unit, or options that do not go together.
        RecordingError: a file, column, topic or cell that cannot be used; names line or message.
    """
    for name, value in (("--sample-period", sample_period), ("--length", length)):
        if value is not None and not SHORTEST_PERIOD <= value <= LATEST:
            expected = f"seconds above 0, {SHORTEST_PERIOD:g} to {LATEST:g}"
            raise OptionError(name, expected, value)
    if (speed is None) == (position is None):
        got = "neither" if speed is None else "both"
        raise OptionError("--speed or --position", "one of them", got)
    options = {"voltage": voltage, "speed": speed, "position": position, "current": current}
    given = {q: text for q, text in {**options, "time": time}.items() if text is not None}
    if not Path(path).exists():
        raise RecordingError(str(path), "a CSV file or a recording", "No such file or directory")
    path = Path(path)
    read = _from_bag if is_bag(path) else _from_table
    content, series, columns, notes = read(path, given, sample_period)
    if like is not None:
        for ours, theirs in zip(columns, like.columns, strict=False):
            if ours != theirs:
                raise RecordingError(path, f"{theirs}, as in {like.file}", ours)
    for quantity, one in series.items():
        largest = float(np.nanmax(np.abs(one.values), initial=0.0))
        if largest > LARGEST:
            where = f"{path}, {quantity} from {given.get(quantity, position)!r}"
            raise RecordingError(where, f"at most {LARGEST:g} in SI units", f"{largest:g}")
    doubts = unit_doubts(series, given)
    notes += doubts
    if not np.ptp(series["speed"].values):
        still = f"{series['speed'].values[0]:g} rad/s throughout"
        notes.append(f"the speed is {still}: is it the right field?")
    done = _cut(str(path), series, notes, sample_period, length, cut, doubts, like)
    layout = FileLayout(str(path), columns, done[0].period)
    return Imported(done, content, notes, doubts, layout)


def import_files(paths: Sequence[str], **options: Any) -> Iterator[Imported]:
    """The same of several files, one after the other: all have the columns and period of the first.

    Experiments are numbered on. Of a file that begins before the end of the one before, as its
    times do not say when it was recorded, all are moved by the same time to follow it.

    Args:
        options: of `import_file`.

    Raises:
        OptionError, RecordingError: as there; each names the file.
    """
    first: FileLayout | None = None
    number, end = 0, 0.0
    for path in paths:
        try:
            read = import_file(path, like=first, **options)
        except OptionError as error:
            if len(paths) == 1:
                raise
            raise OptionError(f"{path}, {error.where}", error.expected, error.got) from None
        first = first or read.layout
        later = end - read.experiments[0].start
        later = later if later > GRID_TOLERANCE * first.period else 0.0
        if number:
            read.notes.extend([MOVED] if later else [])
            for place, one in enumerate(read.experiments):
                after = replace(one, number=one.number + number, start=one.start + later)
                read.experiments[place] = after
        number, end = read.experiments[-1].number, read.experiments[-1].end
        if end > LATEST:
            raise RecordingError(path, f"an end up to {LATEST:g} s", f"{end:.10g} s")
        yield read
        del read  # before the next file needs its memory


def is_bag(path: Path) -> bool:
    """Whether a file is a recording by its name; else it is a table."""
    return path.is_dir() or path.name.endswith((".mcap", ".db3", ".zstd", ".bag"))


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
) -> tuple[str, dict[str, Series], tuple[str, ...], list[str]]:
    """(how many rows, channels, columns in words, notes)."""
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
    content = counted(lines.size, "row")
    notes = [_conversions(fields), *table.notes]
    named = propose_fields(table.columns)
    swapped = (("voltage", "speed"), ("speed", "voltage"))
    if "speed" in fields and all(
        f"{named.get(q, '')}:".startswith(f"{fields[of].name}:") for q, of in swapped
    ):
        notes.append(
            "voltage and speed look swapped; by their names it is "
            f"--voltage {named['voltage']} --speed {named['speed']}"
        )
    if not table.headed:
        taken = ", ".join(
            f"column {field.name} for the {q} in {field.unit} ({spread(column)})"
            for (q, field), column in zip(fields.items(), columns, strict=True)
        )
        content += " without a header line"
        notes = [f"taken are {taken}", *table.notes]
        notes.append("if that is wrong, import again with --force and other FIELD:UNIT")

    def place(index: int) -> str:
        return f"line {lines[index]}"

    series = {q: Series(times, column, place) for q, column in values.items()}
    _with_speed(path, series, fields, notes)
    return content, series, tuple(table.described(i) for i in wanted), notes


def _from_bag(
    path: Path, given: dict[str, str], sample_period: float | None
) -> tuple[str, dict[str, Series], tuple[str, ...], list[str]]:
    """(how many messages, channels, no columns, notes)."""
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
    notes = [_conversions(fields)]
    if "time" in series:
        times = series.pop("time").values
        series = {q: s._replace(time=times) for q, s in series.items()}
    else:
        notes.append(timed)
    moving = "speed" if "speed" in sources else "position"
    if sources["voltage"].topic != sources[moving].topic:
        times = np.append(series["voltage"].time, series[moving].time[-1])
        notes.append(f"the voltage is held for up to {np.diff(times).max():.3g} s")
    _with_speed(path, series, fields, notes)
    return sizes, series, (), notes + storage.notes


def _with_speed(
    path: Path, series: dict[str, Series], fields: Mapping[str, Field], notes: list[str]
) -> None:
    """Put the speed in the place of a position, and the voltage beside it."""
    if "position" in series:
        position, unit = series.pop("position"), fields["position"].factor
        made = speed_of_positions(str(path), position, series["voltage"], unit)
        series["speed"], series["voltage"] = made[:2]
        notes += made[2]


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
    doubts: Sequence[str],
    like: FileLayout | None,
) -> list[Experiment]:
    """Experiments of equal length, or what the segmenter makes of the stream."""
    for one in series.values():
        check_times(where, one)
    speed = series["speed"]
    if speed.time.size < LEAST_SAMPLES:
        raise RecordingError(where, f"{LEAST_SAMPLES} samples or more", speed.time.size)
    found = find_period(speed.time)
    if found < SHORTEST_PERIOD:
        expected = f"times {SHORTEST_PERIOD:g} s apart or more"
        raise RecordingError(where, expected, f"{found:g} s")
    period = _period(where, found, sample_period, like)
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
        done, counts = segmented(series, period, found, length, cut)
        if not done:
            expected = f"an experiment by {cut['cut']}"
            raise RecordingError(where, expected, listed_counts(counts) or "none")
        notes.append(f"cut by {cut['cut']}")
        notes += [listed_counts(counts)] if counts else []
        return done
    return of_equal_length(where, series, notes, found, period, size)


def _period(where: str, found: float, wanted: float | None, like: FileLayout | None) -> float:
    """[s] of the experiments; of one rate are files whose clocks differ by what a grid forgives."""
    if wanted is not None or like is None:
        return found if wanted is None else wanted
    if abs(found - like.period) > GRID_TOLERANCE * like.period:
        expected = f"samples {like.period:g} s apart, as in {like.file} (or --sample-period)"
        raise RecordingError(where, expected, f"{found:g} s")
    return like.period
