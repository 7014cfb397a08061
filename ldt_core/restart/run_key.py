"""Going on with a run that ended before its time: by which settings, and whether it is the same.

A recording says by which parameters it was made, and under which key: the machine, the physics, the
user's own parts, the versions. Another machine or another part is refused. Another version goes on,
and says so: it reads all that is recorded, and may compute what follows otherwise.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import msgs_config
from ldt_core.base.code_version import code_version
from ldt_core.base.digest import file_digest, json_digest
from ldt_core.base.errors import BadInput, RecordingError
from ldt_core.base.printable import as_argument, one_line
from ldt_core.base.settings import as_options
from ldt_core.detectors import DETECTORS
from ldt_core.effects import EFFECTS
from ldt_core.machine.machine_file import Machine
from ldt_core.models import MODELS
from ldt_core.recording.bag import Bag, read_bag
from ldt_core.recording.messages import quoted
from ldt_core.recording.metadata import METADATA
from ldt_core.recording.run_settings import CHANGEABLE, LEFT_OUT, SECURE
from ldt_core.recording.writer import KEY

#: Digits of the digests of the machine file and of those of own parts.
DIGEST_DIGITS = 12
MACHINE = "machine"  # name of a key's digest of the machine, and of the parameter that names it
CONTENT = "machine file"  # name of what the machine's digest is of, to name what differs
LDT, CODE = "ldt", "code"  # of `code_version`
OWN_FILE = "file "  # how a key's names of those begin
#: Parameters that may name a user's own part, as file.py:NAME.
PARTS = ("model", "detector", "cause", "effect")
SHOWN = 3  # numbers of a machine file that a sentence names
#: Folder of a fleet's first recording.
FIRST_MACHINE = "machine_1"


def key_text(machine: Machine, settings: Mapping[str, Any]) -> str:
    """The key of a run, as its recording holds it, in JSON.

    Args:
        settings: parameters of the run, those at least that name parts.
    """
    key = {MACHINE: _digest(machine), "physics": machine.physics, **code_version()}
    key[CONTENT] = json.dumps(machine.as_dict(), sort_keys=True)
    files = own_files(machine, settings).items()
    return json.dumps(key | {f"{OWN_FILE}{name}": digest for name, digest in files})


def _digest(machine: Machine) -> str:
    return json_digest(machine.as_dict())[:DIGEST_DIGITS]


def own_files(machine: Machine, settings: Mapping[str, Any]) -> dict[str, str]:
    """Files of the user's own parts, with a digest of what is in them now ("none" of none)."""
    found = {}
    named = [settings[name] for name in PARTS if name in settings]
    for value in [machine.physics, machine.own_effects, *named]:
        for text in value if isinstance(value, list | tuple) else [value]:
            name, is_file, _ = text.partition(".py:") if isinstance(text, str) else ("", "", "")
            if is_file:
                path = Path(f"{name}.py")
                found[str(path)] = file_digest(path)[:DIGEST_DIGITS] if path.is_file() else "none"
    return found


def check_key(bag: Bag, machine: Machine, settings: Mapping[str, Any] | None = None) -> list[str]:
    """Refuse a recording that was made under another key, but for the versions in it.

    Whoever updates LDT goes on with what the recording holds; only the same versions give the
    same numbers.

    Args:
        settings: as of `key_text`; None where the user's own parts do nothing.

    Returns:
        A sentence that says which versions are others, and which recorded parameters there are no
        more; nothing where all is the same.

    Raises:
        RecordingError: says what differs.
    """
    own = json.loads(key_text(machine, settings or {}))
    recorded = _recorded_key(bag)
    if not recorded:
        raise RecordingError(bag.path, "a recording of a run, with its key", "none")
    changed: list[str] = []
    for name in sorted({*own, *recorded} - {CONTENT}, key=lambda n: (n != LDT, n)):
        if settings is None and name.startswith(OWN_FILE):
            continue
        was, now = recorded.get(name, "none"), own.get(name, "none")
        if was == now:
            continue
        if name in code_version():
            if name == CODE and changed:
                continue  # another version has other code
            changed.append(f"{name} {quoted(now)}, was {quoted(was)}")
            continue
        if name == MACHINE:
            check_machine(bag, machine)
        expected = f"{quoted(was)}, under which the run began"
        raise RecordingError(f"{bag.path}, {name}", expected, quoted(now))
    gone = sorted({*bag.settings()} - {*msgs_config.parameters()})
    changed += [f"no parameter {quoted(name)} any more" for name in gone]
    if not changed:
        return []
    what = "; ".join(changed)
    return [f"{bag.path} began with another version, which may give other numbers: {what}"]


def check_machine(bag: Bag, machine: Machine) -> None:
    """Refuse a recording of a run that began with another machine file, or before an edit of it.

    Raises:
        RecordingError: names the recording, and what can be done.
    """
    recorded = _recorded_key(bag)
    if recorded.get(MACHINE, "") in ("", _digest(machine)):
        return
    if CONTENT not in recorded:  # as of 0.2.0, whose digests are others
        expected = (
            "a run of a later version of LDT, since 0.2.0 recorded its machine file otherwise"
        )
        anew = f"ldt run --play {as_argument(str(bag.path))} begins anew on it"
        raise RecordingError(bag.path, expected, f"one of that version ({anew})")
    expected = "the machine file as it was, under which the run began"
    differ = _differences(recorded.get(CONTENT, ""), machine)
    more = [f"{len(differ) - SHOWN} more"] if len(differ) > SHOWN else []
    shown = "; ".join([*differ[:SHOWN], *more])
    what = f"one in which {shown}" if differ else "another or an edited one"
    got = f"{what} (take that one, or begin a new recording)"
    raise RecordingError(f"{bag.path}, {MACHINE}", expected, got)


def _differences(recorded: str, machine: Machine) -> list[str]:
    """What a machine file says otherwise than it did, each as "R is 2.1, was 1.9"."""
    try:
        was = dict(_leaves(json.loads(recorded)))
    except (ValueError, RecursionError):
        return []
    now = dict(_leaves(json.loads(json.dumps(machine.as_dict()))))
    return [
        f"{one_line(name)} is {_told(now, name)}, was {_told(was, name)}"
        for name in now | was
        if now.get(name) != was.get(name)
    ]


def _told(values: Mapping[str, Any], name: str) -> str:
    return quoted(values[name]) if name in values else "none"


def _leaves(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """What a machine file says that is no list and no mapping, each by its place in the file."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _leaves(inner, f"{name}.{key}".lstrip("."))
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            yield from _leaves(inner, f"{name}[{index}]")
    else:
        yield name.removeprefix("parameters."), value


def _recorded_key(bag: Bag) -> dict[str, str]:
    """The key of a recording, empty where it has none."""
    try:
        return {str(name): str(value) for name, value in json.loads(bag.custom(KEY)).items()}
    except (ValueError, AttributeError, RecursionError):
        return {}


def resumed(settings: Mapping[str, Any]) -> dict[str, Any]:
    """The settings with which a run goes on: those recorded, and those it is free to change.

    Args:
        settings: all parameters; those at their defaults are as recorded.

    Returns:
        all parameters; `bag` and `resume` are the recording.

    Raises:
        RecordingError: no recording of a run.
        BadInput: a parameter that contradicts the recording, or one that names code or a file,
            which has to be given again: a recording does not say what is run.
    """
    base = Path(settings["resume"])
    if settings["bag"] and Path(settings["bag"]) != base:
        raise BadInput("bag", f"none beside resume, which records into {base}", settings["bag"])
    fleet = (base / FIRST_MACHINE).is_dir() and not (base / METADATA).exists()
    first = base / FIRST_MACHINE if fleet else base
    recorded = read_bag(first, listed=True).settings()
    if not recorded:
        there = f"one without (ldt run --play {as_argument(str(first))} lets a twin learn on it)"
        raise RecordingError(first, "a recording of a run, with its settings", there)
    if recorded.get(SECURE) and settings.get(SECURE) == "":
        raise BadInput("--secure", f"a keystore, since {first} began secured", "none")
    declared = msgs_config.parameters()
    found = dict(settings)
    for name, value in recorded.items():
        if name in (*LEFT_OUT, *CHANGEABLE) or name not in declared:
            continue
        default = declared[name]["default"]
        if name not in settings:  # `ldt run` has no graph to tell this
            if value != default:
                told = "a run that ldt run can continue (use ldt up --resume for this one)"
                raise BadInput(f"{first}, {name}", told, repr(value))
            continue
        given = settings[name]
        if name == MACHINE and given != default and not _is_plain(name, given):
            continue  # a recording may have moved; whether it is the same file, the key knows
        if given not in (default, value):
            where = f"--{name.replace('_', '-')}"
            raise BadInput(where, f"{value!r}, with which {first} began", repr(given))
        if given != value and not _is_plain(name, value):
            where = f"--{name.replace('_', '-')}"
            told = f"{quoted(str(value))} to be given again: no file is run on a recording's word"
            raise BadInput(where, told, "nothing")
        found[name] = value
    return {**found, "bag": str(base), "resume": str(base)}


def command_to_resume(
    settings: Mapping[str, Any], recording: str | Path, command: str = "run"
) -> str:
    """The command line that goes on with a run of these settings.

    Recorded settings are taken from the recording. What names code or a file, or is free to
    change, is repeated.
    """
    again = {
        name: value
        for name, value in settings.items()
        if name in (*CHANGEABLE, SECURE) or not (name in LEFT_OUT or _is_plain(name, value))
    }
    return f"ldt {command} --resume {as_argument(str(recording))} {as_options(again)}".rstrip()


def begin_of(path: str | Path, start_time: float) -> float:
    """When a simulated machine's first experiment began [s since the epoch]."""
    first = next(read_bag(path, listed=True).records("experiment"), None)
    return first.start if first is not None and first.number == 1 else start_time


def _is_plain(name: str, value: Any) -> bool:
    """Whether a recorded parameter names nothing but what comes with LDT."""
    if name == MACHINE:
        return value in msgs_config.machine_names()
    registries = {"model": MODELS, "detector": DETECTORS, "cause": EFFECTS}
    if name in registries:
        return value in (*registries[name].builtin, "auto")
    if name == "effect":
        return all(text.partition(":")[0] in EFFECTS.builtin for text in value)
    return True
