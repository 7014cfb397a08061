"""`ldt import`: CSV files or foreign bags become a recording."""

from __future__ import annotations

import itertools
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ldt_core.base.errors import BadInput, OptionError, RecordingError
from ldt_core.base.printable import as_argument, one_line
from ldt_core.base.sentences import counted, some
from ldt_core.cli.options import declared_option, json_option, out_option
from ldt_core.cli.outputs import force_option, nothing_if_refused, replacing
from ldt_core.cli.terminal import echo_result

if TYPE_CHECKING:
    from ldt_core.base.arrays import Array
    from ldt_core.base.experiment import Experiment
    from ldt_core.recording.csv_table import CsvTable

MOST_COLUMNS = 12  # of a table that are listed
ASKED = ("voltage", "speed", "time")  # of which a column each is asked for
LENGTH = 10  # s of an experiment; proposed for what gives two of them or more
SHOWN = 3  # files named in a sentence
UNIT_HELP = "with a unit if it is not SI, for example"


@click.command("import", short_help="Turn CSV files or a foreign bag into a recording.")
@click.argument("files", nargs=-1, required=True)
@out_option
@force_option
@click.option(
    "--voltage",
    metavar="FIELD[:UNIT]",
    help=f"Column or /topic.field[index] of the voltage, {UNIT_HELP} u:mV.",
)
@click.option(
    "--speed",
    metavar="FIELD[:UNIT]",
    help=f"Column or /topic.field[index] of the speed, {UNIT_HELP} n:rpm, or with "
    "the factor to rad/s, for example v:628.",
)
@click.option(
    "--position",
    metavar="FIELD:UNIT",
    help="In place of --speed, the same for the angle of the shaft: th:deg, th:rad, th:rev, or "
    "th:2048/rev for an encoder with 2048 counts in a turn. It may begin again behind a turn.",
)
@click.option("--current", metavar="FIELD[:UNIT]", help="The same for the current, if measured.")
@click.option(
    "--time",
    metavar="FIELD[:UNIT]",
    help=f"Column of the time (numbers, or dates), {UNIT_HELP} t:ms.",
)
@click.option(
    "--sample-period",
    type=float,
    metavar="S",
    help="Sample period in seconds: of the rows if there is no time, else to resample to.",
)
@click.option(
    "--length",
    type=float,
    metavar="SECONDS",
    help="Cut each file into experiments of this length; a remainder is dropped. With --cut "
    "trigger it counts from the edge, with --cut steady it is the longest.",
)
@declared_option("cut")
@declared_option("trigger_level")
@declared_option("pre_trigger")
@declared_option("steady_band")
@declared_option("steady_time")
@json_option
def command(
    files: tuple[str, ...],
    out: str,
    force: bool,
    voltage: str | None,
    speed: str | None,
    position: str | None,
    current: str | None,
    time: str | None,
    sample_period: float | None,
    length: float | None,
    as_json: bool,
    **cut: Any,
) -> None:
    """Turn FILES, CSV files (also .gz) or foreign bags, into one recording of experiments.

    Several files have the same columns. Each gives one experiment or more, in the order given.

    Example: ldt import motor.csv --voltage u --speed n:rpm --time t --length 2 --out motor
    """
    from ldt_core.base.stopping import stop_on_signals, until_stopped
    from ldt_core.machine.direction_check import MOST_SAMPLES, swapped
    from ldt_core.recording.importers import import_files, is_bag
    from ldt_core.recording.writer import BagWriter

    if voltage is None or speed is position is None:
        named = {"voltage": voltage, "speed": speed or position}
        raise _fields_missing(files, [name for name, field in named.items() if field is None])
    if time is None and sample_period is None and not is_bag(Path(files[0])):
        raise _fields_missing(files, ["time or --sample-period"])
    fields = {"voltage": voltage, "speed": speed, "position": position, "current": current}
    imports = import_files(
        files, **fields, time=time, sample_period=sample_period, length=length, cut=cut
    )
    imports = itertools.chain([next(imports)], imports)  # refused before anything is set aside
    parts: list[dict[str, Any]] = []  # of the recording, one a file
    notes: dict[str, list[str]] = {}  # → files of which they are true
    shown: list[Experiment] = []
    samples: list[int] = []
    doubted = False
    with (
        stop_on_signals() as stop,
        replacing(out, force, files),
        BagWriter(out) as writer,
        nothing_if_refused(writer),
    ):
        for file, imported in zip(files, imports, strict=True):
            made = imported.experiments
            for experiment in until_stopped(made, stop):
                writer.write("experiment", experiment, experiment.end)
            shown += made if sum(map(len, shown)) < MOST_SAMPLES else []
            samples += map(len, made)
            doubted = doubted or bool(imported.doubts)
            numbers = [made[0].number, made[-1].number]
            parts.append({"file": file, "content": imported.content, "experiments": numbers})
            for note in imported.notes:
                notes.setdefault(note, []).append(file)
            del imported, made  # before the next file needs their memory
    told = [
        note if len(true) == len(files) else f"{some(true, SHOWN)}: {note}"
        for note, true in notes.items()
    ]
    if question := swapped(shown):
        told.append(f"{question} If so, import again with --force and the other way round")
    period = shown[0].period
    record = {
        "experiments": len(samples),
        "samples": samples[0],
        "sample_period": period,
        "files": parts,
        "notes": told,
        "recording": out,
    }
    sizes = " to ".join(str(size) for size in dict.fromkeys((min(samples), max(samples))))
    machine_file = f"ldt identify {as_argument(out)} --out FILE.yaml"
    steps = [f"Next, a machine file: {machine_file}"]
    if doubted:
        again = "if a unit is another, import again with --force and the option above"
        steps = [f"Next, {again}", f"If none is, a machine file: {machine_file}"]
    if len(samples) == 1 and length is None:
        way = "import several files, or cut this one by --length"
        if samples[0] * period >= 2 * LENGTH:
            way = f"--length {LENGTH} cuts this one every {LENGTH} s"
        steps.insert(0, f"A twin learns from one experiment to the next: {way}")
    echo_result(
        as_json,
        record,
        *(one_line(_part(**part)) for part in parts),
        *map(one_line, told),
        f"{counted(len(samples), 'experiment')} of {sizes} samples at {1 / period:.6g} Hz: {out}",
        *map(one_line, steps),
        one_line(
            f"Then what it lacks: ldt diagnose {as_argument(out)} --machine FILE.yaml --out why"
        ),
    )


def _part(file: str, content: str, experiments: Sequence[int]) -> str:
    first, last = experiments
    numbers = f"experiment {first}" if first == last else f"experiments {first} to {last}"
    return f"{file}: {content}, {numbers}"


def _fields_missing(files: Sequence[str], names: Sequence[str]) -> OptionError:
    """What the first file has, and the command that imports all, as far as columns' names tell."""
    from ldt_core.recording.importers import is_bag

    where = " and ".join(f"--{name}" for name in names)
    if is_bag(Path(files[0])):
        return OptionError(where, f"its topic and field; ldt info {as_argument(files[0])}", "none")
    columns, proposed = proposed_import(files)
    return OptionError(where, f"one of the columns {columns}, as in: {proposed}", "none")


def proposed_import(files: Sequence[str]) -> tuple[str, str]:
    """(columns of the first table, the command that imports all): their names and units tell them.

    Where they do not, each column's range helps; the only one that always rises is the time.

    Raises:
        RecordingError: no table, or one without names that has a cell which is no number.
    """
    from ldt_core.base.units import propose_fields
    from ldt_core.recording.csv_table import CsvTable

    table = CsvTable(files[0])
    # A delimiter at the end of each row makes a column in which nothing is.
    named = [i for i, name in enumerate(table.names) if name or table.unnamed]
    kept, dated = named[:MOST_COLUMNS], table.dated
    columns = [repr(table.names[i]) if table.headed else table.names[i] for i in kept]
    found = propose_fields({table.names[i]: table.units[i] for i in named})
    if len(dated) == 1:
        found["time"] = table.names[dated[0]]
    ranges: list[str] = []
    if len(found.keys() & {*ASKED, "position"}) < len(ASKED):
        ranges, rising = _contents(table, kept)
        if len(rising) == 1:
            found.setdefault("time", table.names[rising[0]] + ":UNIT" * table.headed)
    clock = found.get("time", "").removesuffix(":UNIT")
    time = _times(table, clock)
    question = "" if time is None else _asked_by_steps(table, time, clock)
    if question:
        found["time"] = f"{clock}:UNIT"
    asked = {table.column(clock): question} if question else {}
    told = ranges or [asked.get(place, "") for place in kept]
    columns = [f"{c} ({t})" if t else c for c, t in zip(columns, told, strict=True)]
    unknown = "COLUMN:UNIT" if table.headed else "NUMBER:UNIT"
    wanted = [q if q != "speed" or "position" not in found else "position" for q in ASKED]
    fields = {**dict.fromkeys(wanted, unknown), **found}
    if fields["time"] == unknown and len(named) < len(ASKED):  # no column is left for it
        del fields["time"]
        fields["sample-period"] = "SECONDS"
    options = " ".join(f"--{name} {shlex.quote(field)}" for name, field in fields.items())
    if len(files) == 1 and time is not None and fields["time"] == clock and _is_long(time):
        options += f" --length {LENGTH}"
    more = ", ..." if len(named) > MOST_COLUMNS else ""
    numbered = "" if table.headed else " (by number, as no header line names them)"
    if table.unnamed:
        numbered = " (some have no name: delete the lines above the row of names)"
    sources = " ".join(map(as_argument, files))
    return (
        ", ".join(columns) + more + numbered,
        f"ldt import {sources} {options} --out imported",
    )


def _times(table: CsvTable, field: str) -> Array | None:
    """(n,) [s] of the rows, as far as it is known what the time is; None where that is refused."""
    from ldt_core.base.units import parse_field

    try:
        found = parse_field(field, "time", table.columns)
        index = table.column(found.name)
        _, (time,) = table.read([index], timed=True, dated=index)
    except BadInput:  # of which the import speaks
        return None
    time = time * found.factor
    return time if time.size > 1 and (time[1:] > time[:-1]).all() else None


def _asked_by_steps(table: CsvTable, time: Array, field: str) -> str:
    """What the steps of times without a unit tell of it, as a question; "" if they may be in s."""
    import numpy as np

    from ldt_core.base.units import UNITS, named_unit
    from ldt_core.recording.unit_doubts import likely_unit

    index = table.column(field) if field in table.names else -1
    if index < 0 or index in table.dated:
        return ""
    if named_unit(table.units[index] or field, UNITS["time"]):
        return ""
    step = float(np.median(np.diff(time)))
    unit = likely_unit(step)
    return f"{step:.6g} from row to row: {unit}?" if unit else ""


def _is_long(time: Array) -> bool:
    """Whether a stretch without a gap is worth being cut."""
    from ldt_core.segmenter.resampling import find_period, split_at_gaps

    stretches = split_at_gaps(time, find_period(time))
    return any(time[part][-1] - time[part][0] >= 2 * LENGTH for part in stretches)


def _contents(table: CsvTable, columns: Sequence[int]) -> tuple[list[str], list[int]]:
    """(range of each of the columns, which always rise); of words beside numbers nothing.

    Raises:
        RecordingError: a cell that is no number in a table without names.
    """
    import numpy as np

    from ldt_core.recording.importers import spread

    try:
        _, read = table.read(columns)
    except RecordingError:
        if table.headed:
            return [], []
        raise
    rising = [i for i, v in zip(columns, read, strict=True) if np.all(np.diff(v) > 0)]
    return [*map(spread, read)], rising
