"""`ldt info`: what is in a recording."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ldt_core.base.errors import RecordingError
from ldt_core.base.printable import as_argument, one_line, printable
from ldt_core.base.sentences import counted, numbered, plain, ranges, some
from ldt_core.cli.import_file import proposed_import
from ldt_core.cli.options import json_option, namespace_option
from ldt_core.cli.terminal import echo_result

if TYPE_CHECKING:
    from ldt_core.recording.bag import Bag
    from ldt_core.recording.health import Health
    from ldt_core.recording.storage import Storage

NO_TABLES = (".yaml", ".yml", ".json", ".html")  # a machine file, settings, a page
MOST_FILES = 5  # that are named; the command has all
MOST_LENGTHS = 3  # of experiments that are told; --json has all
MOST_JOINTS = 4  # of a topic that are listed
MOST_TOPICS = 12  # of a foreign recording that are listed; a robot has hundreds
CHANNELS = ("voltage [V]", "speed [rad/s]")
JOINTS = "sensor_msgs/msg/JointState"
NUMBERS = ("std_msgs/msg/Float64", "std_msgs/msg/Float32")


@click.command("info", short_help="What a recording, a bag or CSV files contain.")
@click.argument("recordings", nargs=-1, required=True)
@namespace_option
@json_option
def command(recordings: tuple[str, ...], namespace: str, as_json: bool) -> None:
    """Show what RECORDINGS contain: machine, experiments, channels, models, states, how each ended.

    For a foreign bag or CSV files, it lists topics or columns, and suggests the import command.

    Example: ldt info my_run
    """
    tables = [recording for recording in recordings if _is_table(recording)]
    answers = [_about(r, namespace) for r in recordings if r not in tables]
    answers += [_tables(tables)] if tables else []
    records = [record for record, _ in answers]
    lines = [line for _, told in answers for line in ("", *told)]
    echo_result(as_json, records[0] if len(recordings) == 1 else records, *lines[1:])


def _about(recording: str, namespace: str) -> tuple[dict[str, Any], list[str]]:
    """What a recording or a folder of some contains: for programs, and in lines for people."""
    from ldt_core.recording.bag import namespaces, read_bag
    from ldt_core.recording.health import inspect
    from ldt_core.recording.storage import Storage

    if several := _several(recording):
        folders = [str(file.parent) for file in several]
        return {"recording": recording, "recordings": folders}, [
            f"{recording}: {counted(len(folders), 'recording')}",
            *(f"ldt info {as_argument(one_line(folder))}" for folder in folders),
        ]
    storage = Storage(recording)
    if storage.topics and not namespaces(storage.topics):
        return _foreign(storage)
    bag = read_bag(recording, namespace)
    record, lines = _described(bag, inspect(bag))
    width = max(map(len, lines))
    return record, [f"{name:{width}}  {one_line(words)}" for name, words in lines.items()]


def _several(recording: str) -> list[Path]:
    """Of a folder that is no recording: those of the recordings in it."""
    place = Path(recording)
    return [] if (place / "metadata.yaml").exists() else sorted(place.glob("*/metadata.yaml"))


def _is_table(recording: str) -> bool:
    """Whether a file is no recording and may be a CSV file.

    Raises:
        RecordingError: what never is a table.
    """
    from ldt_core.recording.importers import is_bag
    from ldt_core.recording.storage import Storage

    place = Path(recording)
    if not place.is_file() or is_bag(place):
        return False
    try:
        Storage(recording)
    except RecordingError:
        if place.suffix in NO_TABLES:
            expected = "a recording or a table; ldt docs machine has a machine file's keys"
            raise RecordingError(recording, expected, f"a {place.suffix} file") from None
        return True
    return False


def _described(bag: Bag, health: Health) -> tuple[dict[str, Any], dict[str, str]]:
    """What is in it: for programs, and in lines for people by their names."""
    states: Counter[str] = Counter()
    levels: Counter[str] = Counter()
    last = ""
    from ldt_core.base.model_state import shown_state

    for signal in bag.records("signal"):
        state = shown_state(signal)
        states[state.brief] += 1
        levels[str(signal.level.name).lower()] += 1
        last = state.words
    actions = Counter(str(a.action) for a in bag.records("adaptation"))
    first = next(bag.records("experiment"), None)
    current = first is not None and first.current is not None
    channels = [*CHANNELS, *(["current [A]"] if current else [])] if first is not None else []
    begin, end = health.span or (0.0, 0.0)
    size, ended = sum(health.files.values()), _ended(health)
    lengths = [
        {"samples": n, "period": p, "experiments": k} for (n, p), k in health.samples.items()
    ]
    models = {kind: len(versions) for kind, versions in health.models.items()}
    detectors = sorted(health.detectors)
    record: dict[str, Any] = {
        "recording": str(health.path),
        "machine": health.machine or None,
        "experiments": health.experiments,
        "missing": [list(span) for span in health.missing],
        "lengths": lengths,
        "channels": channels,
        "begin": begin,
        "end": end,
        "models": models,
        "detectors": detectors,
        "states": dict(states),
        "signals": dict(levels),
        "adaptations": dict(actions),
        "settings": dict(health.settings),
        "ended": ended,
        "bytes": size,
        "files": len(health.files),
        "notes": [*health.notes],
    }
    lines = {"recording": str(health.path), "machine": health.machine or "not recorded"}
    lines["experiments"] = _experiments(health)
    told = [
        f"{plain(item['samples'] * item['period'], 4)} s ({item['samples']} samples at "
        f"{plain(1 / item['period'], 4)} Hz)"
        + (f" of {item['experiments']}" if len(lengths) > 1 else "")
        for item in lengths
    ]
    lines["length"] = some(told, MOST_LENGTHS)
    lines["channels"] = ", ".join(channels)
    lines["recorded"] = _when(begin, end)
    if health.judged:
        lines["models"] = _counts(models)
        lines["detector"] = ", ".join(detectors)
        lines["states"] = _counts(states)
        lines["signals"] = _counts(levels)
        lines["adaptations"] = _counts(actions)
        lines["at the end"] = last
    lines["ended"] = ended
    lines["size"] = f"{plain(size / 1e6)} MB in {counted(len(health.files), 'file')}"
    for index, note in enumerate(health.notes):
        lines["notes" if index == 0 else " " * index] = note
    page = f"ldt report {as_argument(str(health.path))} -o run.html"
    run = health.judged and (levels or not health.numbers)  # ldt predict judges nothing
    lines["next"] = page if run else _next(bag, health)
    return record, {name: words for name, words in lines.items() if words}


def _experiments(health: Health) -> str:
    if not health.numbers:
        return "none"
    told = f"{health.experiments}, numbers {ranges(health.numbers.spans, 5)}"
    if health.missing:
        told += f"; {numbered('number', health.missing, 5)} missing"
    return told


def _next(bag: Bag, health: Health) -> str:
    if not health.numbers:
        return ""
    named = as_argument(str(bag.path))
    if not health.machine:
        return f"ldt identify {named} --out FILE.yaml, or the machine's own file: ldt docs machine"
    return f"ldt diagnose {named} --out why"


def _ended(health: Health) -> str:
    """In words how the recording came to its end."""
    from ldt_core.base.settings import ENDLESS
    from ldt_core.restart.run_key import command_to_resume

    if health.writing:
        return "it is still being recorded"
    count, wanted = health.experiments, health.settings.get("experiments")
    whole = not health.notes
    if health.settings and not health.settings.get("play") and isinstance(wanted, int):
        if count >= wanted:
            return f"complete: {count} of {wanted} experiments" if whole else "damaged, see notes"
        early = f"early, after {count} of {wanted} experiments"
        told = f"stopped after {counted(count, 'experiment')}" if wanted == ENDLESS else early
        how = "up" if health.settings.get("source") else "run"
        return f"{told}; continue with {command_to_resume(health.settings, health.path, how)}"
    return "complete" if whole else "damaged or cut short, see notes; ldt doctor says what to do"


def _when(begin: float, end: float) -> str:
    import time

    from ldt_core.recording.health import NO_DATE

    if begin < NO_DATE:
        return f"without a date, over {plain(end - begin, 4)} s"
    day = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(begin))
    return f"{day}, over {plain(end - begin, 4)} s"


def _counts(counter: dict[str, int]) -> str:
    return ", ".join(f"{name} {count}" for name, count in sorted(counter.items()))


def _tables(files: Sequence[str]) -> tuple[dict[str, Any], list[str]]:
    """Columns of the first CSV file, which others have the same, and how to import these."""
    from ldt_core.recording.csv_table import CsvTable

    heads = [(t.names, t.units) for t in map(CsvTable, files)]
    alike = [file for file, head in zip(files, heads, strict=True) if head == heads[0]]
    others = [file for file in files if file not in alike]
    columns, proposed = proposed_import(alike)
    record = {"recording": files[0], "table": True, "columns": columns, "next": proposed}
    lines = [f"{files[0]} is a table with the columns {columns}"]
    record |= {"alike": alike[1:], "others": others}
    if alike[1:]:
        lines.append(f"with the same columns: {some(alike[1:], MOST_FILES)}")
    if others:
        lines.append(f"with other columns: {some(others, MOST_FILES)}")
    lines += [_what_to_fill_in(proposed), proposed]
    return record, [one_line(line) for line in lines]


def _what_to_fill_in(proposed: str) -> str:
    """What is left to say in a command that imports a table."""
    if "COLUMN" in proposed or "NUMBER" in proposed:
        return "Say which of them is the voltage, the speed, the time:"
    if ":UNIT" in proposed:
        more = ", 2048/rev" if "--position" in proposed else ""
        return f"Put a unit for each UNIT, such as V, rpm, ms{more}:"
    return "Import it so:"


def _foreign(storage: Storage) -> tuple[dict[str, Any], list[str]]:
    """Topics of a recording that is not LDT's, and how to import it."""
    counts = storage.counts()
    topics: dict[str, dict[str, Any]] = {
        topic: {"type": kind, "messages": counts[topic]}
        for topic, kind in sorted(storage.topics.items())
    }
    fields = {kind: topic for topic, kind in sorted(storage.topics.items(), reverse=True)}
    number = next((fields[kind] for kind in NUMBERS if kind in fields), "/TOPIC")
    voltage = f"{number}.data" if number != "/TOPIC" else "/TOPIC.FIELD"
    for topic, about in topics.items():
        if about["type"] == JOINTS and counts[topic]:
            about["joints"] = _joints(storage, topic)
    speed = "--speed /TOPIC.FIELD:UNIT"
    for option, field, unit in (("position", "position", ":rad"), ("speed", "velocity", "")):
        for topic, about in reversed(topics.items()):
            if has := about.get("joints", {}).get(field):
                index = 0 if len(has) == 1 else "INDEX"
                speed = f"--{option} {topic}.{field}[{index}]{unit}"
    named = as_argument(str(storage.path))
    proposed = f"ldt import {named} --voltage {voltage} {speed} --out imported"
    width = max(map(len, topics))
    listed = [
        f"{topic:{width}}  {about['type']}, {counted(counts[topic], 'message')}"
        + _elements(about.get("joints", {}))
        for topic, about in topics.items()
    ]
    more = [f"  and {len(listed) - MOST_TOPICS} more"] if len(listed) > MOST_TOPICS else []
    record = {"recording": str(storage.path), "foreign": True, "topics": topics, "next": proposed}
    return record, [
        one_line(f"{storage.path} was not recorded by LDT; its topics are"),
        *(f"  {printable(line)}" for line in listed[:MOST_TOPICS]),
        *more,
        "Say which of them is the voltage and which the speed:",
        one_line(proposed),
    ]


def _joints(storage: Storage, topic: str) -> dict[str, list[str]]:
    """Each list that the first message of joint states fills → names of its elements."""
    from ldt_core.recording.messages import deserialize

    try:
        raw = next(iter(storage.messages([topic])))
        message: Any = deserialize(raw.data, raw.kind, topic)
    except (RecordingError, StopIteration):  # the import says what is wrong with it
        return {}
    filled = {name: len(getattr(message, name)) for name in ("position", "velocity", "effort")}
    return {
        name: [str(n) for n in message.name[:count]] if len(message.name) >= count else [""] * count
        for name, count in filled.items()
        if count
    }


def _elements(joints: Mapping[str, Sequence[str]]) -> str:
    """What can be told of the lists of joint states behind their topic, or ""."""
    told = [
        ", ".join(f"{name}[{i}] {joint}".rstrip() for i, joint in enumerate(named[:MOST_JOINTS]))
        + (", ..." if len(named) > MOST_JOINTS else "")
        for name, named in joints.items()
    ]
    return f": {'; '.join(told)}" if told else ""
