"""`ldt export`: a recording in the formats of other tools."""

from __future__ import annotations

from pathlib import Path

import click

from ldt_core.base.errors import OptionError
from ldt_core.base.result_files import whole
from ldt_core.base.sentences import counted, plain
from ldt_core.cli.options import json_option, namespace_option
from ldt_core.cli.outputs import check_file, force_option
from ldt_core.cli.terminal import echo_result, warn

#: Ending → what it is for.
FORMATS = {
    ".csv": "a table",
    ".parquet": "a table with types and units",
    ".rrd": "curves in Rerun",
    ".mcap": "curves in Foxglove and Lichtblick",
}


@click.command("export", short_help="A recording as CSV, Parquet, Rerun or MCAP with samples.")
@click.argument("recording")
@click.option(
    "-o",
    "--out",
    required=True,
    help="File to write; its extension selects the format: "
    + ", ".join(f"{ending} ({what})" for ending, what in FORMATS.items())
    + ".",
)
@force_option
@namespace_option
@json_option
def command(recording: str, out: str, force: bool, namespace: str, as_json: bool) -> None:
    """Write every sample of RECORDING, measured and predicted, for other tools.

    Tables have one row per sample, in SI units: experiment, time, elapsed, voltage, speed, current,
    predicted_speed and its deviation, original_speed. MCAP contains every message of the recording,
    and each sample as a message, so that the layouts can draw curves.

    Example: ldt export my_run -o my_run.parquet
    """
    from ldt_core.cli.progress import track
    from ldt_core.recording.bag import read_bag
    from ldt_core.recording.health import damage
    from ldt_core.views.export.predicted_runs import predicted_runs

    check_file(out, force, endings=tuple(FORMATS))
    file = Path(out)
    bag = read_bag(recording, namespace)
    with whole(file, file.suffix) as part:
        if file.suffix == ".mcap":
            from ldt_core.views.export.mcap_with_samples import write_mcap

            count = write_mcap(bag, part)
        else:
            runs = track(predicted_runs(bag), "exporting")
            if file.suffix == ".rrd":
                from ldt_core.views.export.rerun_file import write_rerun

                count = write_rerun(bag.machine, runs, bag.records("signal"), part)
            else:
                from ldt_core.views.export import sample_table

                csv = file.suffix == ".csv"
                count = (sample_table.write_csv if csv else sample_table.write_parquet)(runs, part)
        if bag.path.is_file() and file.exists() and bag.path.samefile(file):
            raise OptionError("--out", "another file than the recording", out)
    warn(*damage(bag))
    size = file.stat().st_size
    record = {"out": out, "samples": count, "bytes": size}
    echo_result(as_json, record, f"{counted(count, 'sample')}, {plain(size / 1e6)} MB: {out}")
