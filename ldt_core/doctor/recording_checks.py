"""What is wrong with a recording, and what was done about it, in findings."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping

from ldt_core.base.errors import BadInput, LdtError
from ldt_core.base.sentences import counted, numbered, plain, some, spans
from ldt_core.base.settings import as_options
from ldt_core.doctor.check import Finding, ok, problem, warning
from ldt_core.machine.experiment_limits import AMPLITUDE_FACTOR
from ldt_core.recording.bag import namespaces, read_bag
from ldt_core.recording.health import ANSWERS, Health, inspect
from ldt_core.recording.repair import Mended, repair
from ldt_core.recording.storage import Storage
from ldt_core.restart.learning_switch import LearningSwitch
from ldt_core.restart.rollback import unusable_versions

MAX_LISTED = 5  # stretches of numbers that a line shows
#: Remedies.
REPAIR_IT = "commands use what is there; ldt doctor --repair puts it into sound files"
RESTORE_IT = "put it back from a copy, if there is one; commands use what is there"
REPLAY_IT = "replay it by ldt replay"
MEET_FIRST = "send when the recorder listens, and give the nodes their graph (ldt docs connect)"


def mended(path: str, namespace: str) -> list[Finding]:
    """Mend a recording; the lines on what was done, and then on what there is now.

    Raises:
        BadInput, LdtError: as `ldt_core.recording.repair.repair`.
    """
    work = repair(path)
    done = [_rewritten(file) for file in work.mended]
    if work.metadata:
        done.append(ok("repair", f"metadata.yaml rewritten: {work.metadata}"))
    done += [problem("repair", sentence, RESTORE_IT) for sentence in work.unmended]
    if work.sound:
        done.append(ok("repair", "nothing to repair; left unchanged"))
    try:
        return [*done, *findings(inspect(read_bag(path, namespace)))]
    except BadInput as error:  # several machines, or nothing that could be recovered
        several = len(namespaces(Storage(path).topics)) > 1
        line = warning if several else problem
        return [*done, line("recording", str(error), "the files themselves are sound")]


def _rewritten(file: Mended) -> Finding:
    told = f"{file.file.name} rewritten, {_counted(file.recovered)} recovered"
    if file.missing:
        told += f", {_counted(file.missing)} lost"
    wrong = "; ".join(note.removeprefix(f"{file.file}: ") for note in file.notes)
    return ok("repair", f"{told}; the damaged one is kept as {file.kept.name} ({wrong})")


def _counted(messages: Mapping[str, int]) -> str:
    each = ", ".join(f"{topic} {count}" for topic, count in sorted(messages.items()) if count)
    return counted(sum(messages.values()), "message") + (f" ({each})" if each else "")


def findings(health: Health) -> list[Finding]:
    """The lines on a recording, damage first."""
    return [
        *_files(health),
        *_messages(health),
        *_experiments(health),
        *_pauses(health),
        *_answers(health),
        *_rejected(health),
        *_interrupted(health),
        *_learning(health),
        *_settings(health),
    ]


def model_findings(path: str, namespace: str) -> list[Finding]:
    """A line on each model version of a run that cannot be used; none where that cannot be told."""
    try:
        found = unusable_versions(path, namespace)
    except LdtError:  # no run, or one of a machine file or a version that are not here
        return []
    remedy = "a run that is resumed leaves it out; ldt rollback goes back to another one by hand"
    return [warning("models", why, remedy) for why in found.values()]


def _files(health: Health) -> list[Finding]:
    total = sum(health.counts.values())
    size = sum(health.files.values()) / 1e3
    shown = ", ".join(
        (
            counted(len(health.files), "file"),
            f"{size / 1e3:.1f} MB" if size >= 1e3 else f"{size:.0f} kB",
            counted(total, "message"),
        )
    )
    found = [problem("files", note, REPAIR_IT) for note in health.notes]
    if health.writing:  # its last file is not counted yet
        return found or [ok("files", f"being written now: {shown} so far")]
    if health.declared is not None:
        told = f"{shown}, metadata.yaml counts {health.declared}"
        remedy = "its recorder was killed or files were changed; ldt doctor --repair corrects it"
        found.append(warning("metadata", told, remedy))
    if found:
        return found
    first, last = health.span or (0.0, 0.0)
    began = time.strftime("%Y-%m-%d %H:%M:%S", time.gmtime(first))
    return [ok("files", f"complete: {shown}, {last - first:.0f} s from {began} UTC")]


def _messages(health: Health) -> list[Finding]:
    found = []
    for topic, (count, why) in sorted(health.unreadable.items()):
        told = f"{topic}: {count} cannot be used, the first because {why}"
        some_left = count < health.counts[topic]
        remedy = "commands leave them out, as a twin does; fix what publishes them"
        if not some_left:
            remedy = "commands refuse these messages: fix what publishes them, and record again"
        line = warning if health.judged and some_left else problem
        found.append(line("messages", told, remedy))
    return found


def _experiments(health: Health) -> list[Finding]:
    name = "experiments"
    early = health.unrecorded
    unrecorded = f"{_listed(early)} answered, and not recorded" if early else ""
    if not health.numbers:
        if early:
            return [problem(name, f"none; {unrecorded}", MEET_FIRST)]
        told = f"none; topics are {some(sorted(health.counts)) or 'none'}"
        return [problem(name, told, "make them of other topics by ldt import")]
    found = [warning(name, unrecorded, MEET_FIRST)] if early else []
    if health.missing:
        many = f"{numbered('number', health.missing, MAX_LISTED)} missing"
        remedy = "look whether the recorder had a burst, or the machine a pause, at that time"
        found.append(warning(name, many, remedy))
    for before, after in health.numbers.jumps[:MAX_LISTED]:
        remedy = "look who else sends experiments; a twin leaves out a number out of nowhere"
        found.append(warning(name, f"after number {before} comes {after}", remedy))
    if health.repeated:
        remedy = "number them on from run to run; a twin tells those of one number by their start"
        found.append(warning(name, f"{_listed(health.repeated)} recorded repeatedly", remedy))
    if health.backwards:
        told = f"{_listed(health.backwards)} start before the one before has ended"
        remedy = "the machine's clock was set in the run; set it before (ldt doctor looks at it)"
        found.append(warning(name, told, remedy))
    if health.impossible:
        why = (
            health.why_impossible or f"more than {AMPLITUDE_FACTOR:g} times the speed of the others"
        )
        told = f"{_listed(health.impossible)} cannot have been made ({why})"
        remedy = "commands leave these out; look at the sensor, its unit and the machine file"
        found.append(warning(name, told, remedy))
    if len(health.samples) > 1:
        told = f"of {len(health.samples)} lengths or sample periods"
        found.append(warning(name, told, "record one kind of experiment in one recording"))
    first, last = min(health.numbers), max(health.numbers)
    length, period = health.samples.most_common(1)[0][0]
    all_well = f"{health.experiments}, numbers {first} to {last}, {length} samples at {period:g} s"
    return found or [ok(name, all_well)]


def _pauses(health: Health) -> list[Finding]:
    if not health.pauses:
        return []
    longest = sorted(health.pauses.items(), key=lambda p: -p[1])
    shown = ", ".join(f"{plain(wait)} s before number {number}" for number, wait in longest)
    count = health.paused
    told = f"{count} longer than an experiment, " + ("" if count == 1 else "the longest ") + shown
    remedy = "look whether the machine stood still then, or what it sent was not recorded"
    return [warning("pauses", told, remedy)]


def _answers(health: Health) -> list[Finding]:
    if not (health.numbers and any(health.answered.get(topic) for topic in ANSWERS[1:])):
        return []
    lacking: dict[tuple[int, ...], list[str]] = {}
    for topic in ANSWERS:
        lacking.setdefault(tuple(health.unanswered(topic)), []).append(topic)
    found = [
        warning("answers", f"{_listed(numbers)} without {', '.join(topics)}", REPLAY_IT)
        for numbers, topics in lacking.items()
        if numbers
    ]
    return found or [ok("answers", f"every experiment has {', '.join(ANSWERS)}")]


def _rejected(health: Health) -> list[Finding]:
    nodes = [health.nodes[name] for name in sorted(health.nodes)]
    counts = [
        f"{n.name} rejected {what}: {count}" for n in nodes for what, count in n.rejected.items()
    ]
    if not counts:
        return []
    why = "; ".join(sorted({n.last_rejection for n in nodes if n.last_rejection}))
    remedy = "fix what publishes them; the nodes continued without these messages"
    return [warning("rejected", f"{', '.join(counts)} ({why})", remedy)]


def _interrupted(health: Health) -> list[Finding]:
    whys = [n.interruption for n in health.nodes.values() if n.interruption]
    remedy = "keep room on the disk, and the folder in place; what is missing is told above"
    return [warning("recorder", f"could not write for a while: {why}", remedy) for why in whys]


def _learning(health: Health) -> list[Finding]:
    if not LearningSwitch(health.path).is_off:
        return []
    remedy = "ldt learning on, with --bag where the run has ended"
    return [warning("learning", "switched off, also when the run is resumed", remedy)]


def _settings(health: Health) -> list[Finding]:
    parts = [f"machine {health.machine}" if health.machine else "machine not recorded"]
    for kind, versions in sorted(health.models.items()):
        parts.append(f"model {kind} ({counted(len(versions), 'version')})")
    if health.detectors:
        parts.append(f"detector {', '.join(sorted(health.detectors))}")
    if health.settings:
        parts.append(f"run with {as_options(health.settings) or 'all defaults'}")
    found = [ok("settings", ", ".join(parts))]
    if health.settings_trouble:
        remedy = "the rest of the recording is not concerned; read it by the LDT that made it"
        found.append(warning("settings", health.settings_trouble, remedy))
    return found


def _listed(numbers: Iterable[int]) -> str:
    return numbered("number", spans(numbers), MAX_LISTED)
