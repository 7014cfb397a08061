"""What the core needs of a computer: versions, compiled kernels, disk, clock, memory, limits."""

from __future__ import annotations

import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from importlib import metadata
from pathlib import Path

from ldt_core.base.sentences import counted
from ldt_core.doctor.check import Finding, Probe, ok, problem, warning

MIB = 1024**2
GIB = 1024**3
EXPERIMENT_BYTES = 60_000  # of a recorded experiment of 2000 samples, which takes 50 000 to 55 000
MIN_DISK = 50 * MIB  # the default run of 200 experiments takes 11 MB
LOW_DISK = GIB  # 18 000 experiments; less may not do for a long run
TEST_BLOCK = b"\0" * MIB  # what is written to see whether it can be
MIN_MEMORY = GIB  # the nodes of one machine take about 0.6 GB together
MIN_OPEN_FILES = 256  # descriptors; a node takes about 40, its libraries included
CLOCK_WATCH_TIME = 0.6  # s, short enough for a person who waits
MAX_CLOCK_JUMP = 0.01  # s; a clock that is slewed moves by 0.5 ms in a second at most
MAX_CLOCK_READ_TIME = 0.001  # s; a reading that took longer was interrupted and says nothing
EARLIEST_DATE = 1735689600.0  # s since the epoch, 2025: LDT is younger
KERNELS_TIMEOUT = 10.0  # s; all probes together have 12
#: Loads every compiled function of the plant, which numba caches nowhere where it may not write.
LOAD_KERNELS = "import ldt_core.physics.integrate"
REQUIREMENT = re.compile(r"([A-Za-z0-9._-]+)\s*>=\s*([0-9.]+)$")


def probes(bag: str = "") -> list[Probe]:
    """All probes of the core.

    Args:
        bag: folder of the recording that a run would get; "" for the one it would choose.
    """
    return [
        Probe("Python", python),
        Probe("libraries", libraries),
        Probe("kernels", kernels),
        Probe("recordings", partial(recordings, bag)),
        Probe("temporary files", temporary),
        Probe("clock", clock),
        Probe("memory", memory),
        Probe("limits", limits),
    ]


def python() -> list[Finding]:
    """The interpreter; an older one than 3.11 cannot get here."""
    version = ".".join(map(str, sys.version_info[:3]))
    return [ok("Python", f"{version} at {sys.executable}")]


def libraries() -> list[Finding]:
    """LDT's own version, and of the libraries it names."""
    try:
        own = metadata.version("ldt")
        required = metadata.requires("ldt") or []
    except metadata.PackageNotFoundError:
        return [problem("libraries", "LDT is not installed", "run pip install in its folder")]
    wrong, shown = [], []
    for entry in required:
        match = REQUIREMENT.match(entry)
        if match is None:  # an extra's
            continue
        name, least = match.groups()
        try:
            there = metadata.version(name)
        except metadata.PackageNotFoundError:
            wrong.append(f"{name} is missing")
            continue
        if _numbers(there) < _numbers(least):
            wrong.append(f"{name} {there} is older than {least}")
        if name in ("numpy", "numba", "scipy", "rosbags"):
            shown.append(f"{name} {there}")
    if wrong:
        remedy = f"{sys.executable} -m pip install --upgrade ldt"
        return [problem("libraries", f"ldt {own}; {', '.join(wrong)}", remedy)]
    return [ok("libraries", f"ldt {own}, {', '.join(shown)}")]


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(n) for n in re.findall(r"\d+", version)[:3])


def kernels() -> list[Finding]:
    """Whether numba loads our compiled functions, and may keep what it has compiled."""
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-c", LOAD_KERNELS],
            capture_output=True,
            text=True,
            timeout=KERNELS_TIMEOUT,
            check=False,
        )
    except subprocess.TimeoutExpired:
        slow = f"not loaded within {KERNELS_TIMEOUT:g} s"
        return [warning("kernels", slow, "try again when the machine is less busy")]
    if done.returncode:
        words = (done.stderr.strip() or "no output").splitlines()[-1]
        remedy = "set NUMBA_CACHE_DIR to a folder that can be written, or reinstall numba"
        return [problem("kernels", f"cannot be loaded: {words}", remedy)]
    return [ok("kernels", "numba loads them and can keep them compiled")]


def recordings(bag: str = "") -> list[Finding]:
    """Whether a recording can be written where it would go, and how much room there is."""
    from ldt_core.recording.storage import RECORDINGS

    name = "recordings"
    target = Path(bag) if bag else RECORDINGS
    if bag and target.exists():
        return [problem(name, f"{target} exists already", "give --bag a folder that does not")]
    folder = target.absolute()
    while not folder.exists():
        folder = folder.parent
    where = "give another folder by --bag"
    if not folder.is_dir():
        return [problem(name, f"{folder} is a file, so that nothing can be put below it", where)]
    if (reason := _unwritable(folder)) is not None:
        remedy = f"make room or take the right to write there, or {where}"
        return [problem(name, f"cannot be written in {folder}: {reason}", remedy)]
    free = shutil.disk_usage(folder).free
    many = float(f"{free / EXPERIMENT_BYTES:.2g}")
    room = f"{_size(free)} free in {folder}, about {many:,.0f} experiments"
    if free < MIN_DISK:
        return [problem(name, room, f"make room, or {where}")]
    if free < LOW_DISK:
        return [warning(name, room, f"make room for long runs, or {where}")]
    return [ok(name, room)]


def temporary() -> list[Finding]:
    """Where the nodes' output goes while they run."""
    name = "temporary files"
    remedy = "set TMPDIR to a folder that can be written"
    try:
        folder = Path(tempfile.gettempdir())
    except OSError as error:
        return [problem(name, error.strerror or str(error), remedy)]
    if (reason := _unwritable(folder)) is not None:
        return [problem(name, f"cannot be written in {folder}: {reason}", remedy)]
    return [ok(name, f"{_size(shutil.disk_usage(folder).free)} free in {folder}")]


def _unwritable(folder: Path) -> str | None:
    """Why a megabyte cannot be written in a folder, None when it can."""
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(TEST_BLOCK)
            file.flush()
    except OSError as error:
        return error.strerror or str(error)
    return None


def clock(watched: float = CLOCK_WATCH_TIME, now: Callable[[], float] = time.time) -> list[Finding]:
    """Whether the wall clock goes evenly and can be right; it need not be synchronised."""
    offsets = []
    end = time.monotonic() + watched
    while (before := time.monotonic()) < end:
        wall = now()
        if (after := time.monotonic()) - before < MAX_CLOCK_READ_TIME:
            offsets.append(wall - (before + after) / 2)
        time.sleep(0.01)
    wall = now()
    set_it = "let the system set its clock (timedatectl set-ntp true), before a run and not in it"
    if wall < EARLIEST_DATE:
        date = time.strftime("%Y-%m-%d", time.gmtime(wall))
        return [warning("clock", f"it says {date}, which recordings will carry", set_it)]
    jump = max(offsets) - min(offsets) if offsets else 0.0
    if jump > MAX_CLOCK_JUMP:
        told = f"the wall clock moved by {jump:.3f} s against the steady one in {watched:g} s"
        return [warning("clock", told, set_it)]
    return [ok("clock", "steady; one machine needs no synchronisation")]


def memory(table: Path = Path("/proc/meminfo")) -> list[Finding]:
    """What the nodes can have."""
    try:
        text = table.read_text()
    except OSError:
        return [warning("memory", f"{table} cannot be read", "have 1 GB free for each machine")]
    match = re.search(r"MemAvailable:\s+(\d+) kB", text)
    free = int(match[1]) * 1024 if match else 0
    if free < MIN_MEMORY:
        remedy = "end other programs, or run the loop in one process by ldt run"
        return [warning("memory", f"{_size(free)} available", remedy)]
    return [ok("memory", f"{_size(free)} available, {counted(os.cpu_count() or 1, 'core')}")]


def limits() -> list[Finding]:
    """What the shell or the service allows a process."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    size, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
    shown = _count(soft)
    found = []
    if 0 <= soft < MIN_OPEN_FILES:
        remedy = f"ulimit -n 1024 (at most {_count(hard)} here; LimitNOFILE= in a systemd unit)"
        found.append(warning("limits", f"{shown} open files a process", remedy))
    if 0 <= size < LOW_DISK:
        told = f"files of at most {_size(size)}, where a recording ends"
        found.append(warning("limits", told, "ulimit -f unlimited"))
    return found or [ok("limits", f"{shown} open files a process")]


def _count(number: int) -> str:
    return "any number of" if number == resource.RLIM_INFINITY else str(number)


def _size(number: int) -> str:
    return f"{number / GIB:.1f} GiB" if number >= GIB else f"{number / MIB:.0f} MiB"
