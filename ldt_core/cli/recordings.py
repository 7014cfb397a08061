"""Recordings as commands read them: what is odd about one goes to standard error."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ldt_core.base.errors import ExperimentError, LdtError, RecordingError
from ldt_core.base.experiment import Experiment
from ldt_core.base.printable import as_argument
from ldt_core.base.sentences import counted, some
from ldt_core.base.settings import as_options
from ldt_core.cli.terminal import warn
from ldt_core.machine.experiment_limits import AMPLITUDE_FACTOR, outsized
from ldt_core.machine.machine_file import Machine
from ldt_core.recording.bag import read_bag
from ldt_core.recording.health import damage
from ldt_core.recording.held_samples import HeldSamples

SHOWN = 3  # experiments named in a sentence


def as_arguments(recordings: Sequence[str], only: str) -> str:
    """The arguments of a command that reads the same experiments of the same recordings."""
    return " ".join(filter(None, [*map(as_argument, recordings), as_options({"only": only})]))


def read_recordings(
    recordings: Sequence[str], namespace: str, machine: Machine | None = None, only: str = ""
) -> list[Experiment]:
    """Experiments of all recordings, each once.

    One that comes again, sample for sample, would count its noise as what the machine does, and
    could be held out beside itself.

    Args:
        recordings: folders or files; those of several are numbered on from one to the next.
        namespace: machine whose topics are meant.
        machine: what it cannot have made is left out and told; None when it is not known: then
            what is far beyond the others is.
        only: experiments of each recording, as of `Bag`.

    Raises:
        RecordingError: a recording that cannot be read, or all of them together unpack to more
            samples than such files hold.
        ExperimentError: nothing but experiments outside the machine's limits.
    """
    found: list[Experiment] = []
    seen: dict[bytes, int] = {}
    held = HeldSamples()
    for recording in recordings:
        bag, again = read_bag(recording, namespace, only=only), []
        for read in held.of(bag, machine):
            number = len(found) + 1 if len(recordings) > 1 else read.number
            first = (
                seen.setdefault(_samples(read), number)
                if (read.speed != read.speed[0]).any()
                else number
            )
            if first == number:
                found.append(read if number == read.number else replace(read, number=number))
            else:
                again.append(f"{read.number} (as experiment {first})")
        warn(*damage(bag))
        if again:
            what = counted(len(again), "experiment")
            few = some(again, SHOWN)
            warn(f"{recording}: {what} left out, whose samples came before: {few}")
    return found if machine is not None else _alike(found, recordings[0])


def _alike(found: list[Experiment], recording: str) -> list[Experiment]:
    """Without what no machine can have made that made the others."""
    odd: set[int] = set()
    for channel in ("voltage", "speed"):
        sizes = [float(np.abs(getattr(e, channel)).max()) for e in found]
        for place in (places := outsized(sizes)):
            odd.add(place)
        if places:
            numbers = some([str(found[place].number) for place in places], SHOWN)
            warn(
                f"{recording}: left out: {counted(len(places), 'experiment')} with more than "
                f"{AMPLITUDE_FACTOR:g} times the {channel} of the others: {numbers}"
            )
    return [e for place, e in enumerate(found) if place not in odd]


@contextlib.contextmanager
def naming(recordings: Sequence[str]) -> Iterator[None]:
    """Errors within that are about the recordings name them."""
    try:
        yield
    except LdtError as error:
        few = some(recordings, SHOWN)
        if isinstance(error, ExperimentError | RecordingError):
            what = error.where.removeprefix("the recording").lstrip(", ")
            if not what.startswith(tuple(recordings)):
                where = f"{few}, {what}" if what else few
                raise type(error)(where, error.expected, error.got) from None
        elif type(error) is LdtError:
            raise LdtError(f"{few}: {error}") from None
        raise


def _samples(e: Experiment) -> bytes:
    channels = (e.voltage, e.speed) if e.current is None else (e.voltage, e.speed, e.current)
    return hashlib.sha256(
        repr(e.period).encode() + b"".join(c.tobytes() for c in channels)
    ).digest()
