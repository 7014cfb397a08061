"""`ldt import`: a CSV file or a foreign bag becomes a recording."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ldt_core.base.errors import OptionError, RecordingError
from ldt_core.base.printable import as_argument, one_line
from ldt_core.base.sentences import counted
from ldt_core.cli.options import declared_option, json_option, out_option
from ldt_core.cli.outputs import force_option, replacing
from ldt_core.cli.terminal import echo_result

if TYPE_CHECKING:
    from ldt_core.recording.csv_table import CsvTable

MOST_COLUMNS = 12  # of a table that are listed
ASKED = ("voltage", "speed", "time")  # of which a column each is asked for
UNIT_HELP = "with a unit if it is not SI, for example"


@click.command("import", short_help="Turn a CSV file or a foreign bag into a recording.")
@click.argument("file")
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
    help=f"Column or /topic.field[index] of the speed, {UNIT_HELP} n:rpm.",
)
@click.option("--current", metavar="FIELD[:UNIT]", help="The same for the current, if measured.")
@click.option(
    "--time",
    metavar="FIELD[:UNIT]",
    help=f"Column of the time (a number or an ISO 8601 date), {UNIT_HELP} t:ms.",
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
    help="Cut into experiments of this length; a remainder is dropped. With --cut trigger it "
    "counts from the edge, with --cut steady it is the longest.",
)
@declared_option("cut")
@declared_option("trigger_level")
@declared_option("pre_trigger")
@declared_option("steady_band")
@declared_option("steady_time")
@json_option
def command(
    file: str,
    out: str,
    force: bool,
    voltage: str | None,
    speed: str | None,
    current: str | None,
    time: str | None,
    sample_period: float | None,
    length: float | None,
    as_json: bool,
    **cut: Any,
) -> None:
    """Turn FILE, a CSV file (also .gz) or a foreign bag, into a recording of experiments.

    Example: ldt import motor.csv --voltage u --speed n:rpm --time t --length 2 --out motor
    """
    from ldt_core.base.stopping import stop_on_signals, until_stopped
    from ldt_core.machine.direction_check import swapped
    from ldt_core.recording.importers import import_file, is_bag
    from ldt_core.recording.writer import BagWriter

    if voltage is None or speed is None:
        named = {"voltage": voltage, "speed": speed}
        raise _fields_missing(file, [name for name, field in named.items() if field is None])
    if time is None and sample_period is None and not is_bag(Path(file)):
        raise _fields_missing(file, ["time or --sample-period"])
    imported = import_file(
        file,
        voltage=voltage,
        speed=speed,
        current=current,
        time=time,
        sample_period=sample_period,
        length=length,
        cut=cut,
    )
    with stop_on_signals() as stop, replacing(out, force, [file]), BagWriter(out) as writer:
        for experiment in until_stopped(imported.experiments, stop):
            writer.write("experiment", experiment, experiment.end)
    first = imported.experiments[0]
    notes = list(imported.notes)
    if question := swapped(imported.experiments):
        notes.append(f"{question} If so, import again with --force and the other way round")
    record = {
        "experiments": len(imported.experiments),
        "samples": len(first),
        "sample_period": first.period,
        "notes": notes,
        "recording": out,
    }
    sizes = sorted({len(e) for e in imported.experiments})
    samples = " to ".join(str(size) for size in dict.fromkeys((sizes[0], sizes[-1])))
    alone = len(imported.experiments) == 1 and length is None
    machine_file = f"ldt identify {as_argument(out)} --out FILE.yaml"
    steps = [f"Next, a machine file: {machine_file}"]
    if imported.doubts:
        again = "if a unit is another, import again with --force and the option above"
        steps = [f"Next, {again}", f"If none is, a machine file: {machine_file}"]
    cut_it = "A twin learns from one experiment to the next: --length 10 cuts this one every 10 s"
    echo_result(
        as_json,
        record,
        *map(one_line, notes),
        *([cut_it] if alone else []),
        f"{counted(len(imported.experiments), 'experiment')} of {samples} samples at "
        f"{1 / first.period:.6g} Hz: {out}",
        *map(one_line, steps),
        one_line(
            f"Then what it lacks: ldt diagnose {as_argument(out)} --machine FILE.yaml --out why"
        ),
    )


def _fields_missing(file: str, names: Sequence[str]) -> OptionError:
    """What FILE has, and the command that imports it, as far as its columns' names tell."""
    from ldt_core.recording.importers import is_bag

    where = " and ".join(f"--{name}" for name in names)
    if is_bag(Path(file)):
        return OptionError(where, f"its topic and field; ldt info {as_argument(file)}", "none")
    columns, proposed = proposed_import(file)
    return OptionError(where, f"one of the columns {columns}, as in: {proposed}", "none")


def proposed_import(file: str) -> tuple[str, str]:
    """(columns of a table, the command that imports it): their names and units tell which is which.

    Where they do not, each column's range helps; the only one that always rises is the time.

    Raises:
        RecordingError: no table, or one without names that has a cell which is no number.
    """
    from ldt_core.base.units import propose_fields
    from ldt_core.recording.csv_table import CsvTable

    table = CsvTable(file)
    shown = table.names[:MOST_COLUMNS]
    columns = [repr(name) if table.headed else name for name in shown]
    found = propose_fields(dict(zip(table.names, table.units, strict=False)))
    if not found.keys() >= {*ASKED}:
        ranges, rising = _contents(table, len(shown))
        if ranges:
            columns = [f"{name} ({told})" for name, told in zip(columns, ranges, strict=True)]
        if len(rising) == 1:
            found.setdefault("time", shown[rising[0]] + ":UNIT" * table.headed)
    unknown = "COLUMN:UNIT" if table.headed else "NUMBER:UNIT"
    fields = {**dict.fromkeys(ASKED, unknown), **found}
    if fields["time"] == unknown and len(table.names) < len(ASKED):  # no column is left for it
        del fields["time"]
        fields["sample-period"] = "SECONDS"
    options = " ".join(f"--{name} {shlex.quote(field)}" for name, field in fields.items())
    more = ", ..." if len(table.names) > MOST_COLUMNS else ""
    numbered = "" if table.headed else " (by number, as no header line names them)"
    if "" in shown:
        numbered = " (some have no name: delete the lines above the row of names)"
    return (
        ", ".join(columns) + more + numbered,
        f"ldt import {as_argument(file)} {options} --length 10 --out imported",
    )


def _contents(table: CsvTable, count: int) -> tuple[list[str], list[int]]:
    """(range of each of the first columns, which always rise); of words beside numbers nothing.

    Raises:
        RecordingError: a cell that is no number in a table without names.
    """
    import numpy as np

    from ldt_core.recording.importers import spread

    try:
        _, read = table.read(range(count))
    except RecordingError:
        if table.headed:
            return [], []
        raise
    rising = [i for i, values in enumerate(read) if np.all(np.diff(values) > 0)]
    return [*map(spread, read)], rising
