"""Processes that crash or hang: killed, started again, and given up when it keeps happening."""

from __future__ import annotations

import math
import signal
import statistics
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from ldt_core.base.errors import BadInput, LdtError
from ldt_core.recording.node_status import READY
from ldt_core.restart.run_key import own_files
from ldt_core.runs.fleet_members import SOURCES
from ldt_ros.graph.machine_run import HostProcess, MachineRun, write_parameters
from ldt_ros.graph.monitor import Monitor
from ldt_ros.graph.supervisor import Child, NodeFailure, Supervisor, last_line

#: Longest time between two looks that counts [s]; beyond that this process has slept itself.
MAX_LOOK_INTERVAL = 0.5
#: Times as silent as the others' median, above which it is the process and not a busy computer.
OUTLIER_RATIO = 3.0
#: Times as silent as is taken for hung, above which it is whatever the others do.
CERTAIN_RATIO = 10.0
STARTUP = 60.0  # s in which a process must have told something of itself
STARTUP_EACH = 3.0  # s more for each machine; a core needs 1.5 s for one and is not alone


class Silence:
    """How long each process of a graph has told nothing."""

    def __init__(self) -> None:
        self._of: dict[str, tuple[int, float]] = {}  # process → statements, time since the last [s]
        self._looked_at = time.monotonic()

    def look(self, told: Mapping[str, int]) -> None:
        """Note how often each process that runs has told something so far."""
        now = time.monotonic()
        passed, self._looked_at = min(now - self._looked_at, MAX_LOOK_INTERVAL), now
        for name, count in told.items():
            before, silence = self._of.get(name, (0, 0.0))
            self._of[name] = count, (silence + passed if count == before else 0.0)

    def told(self, name: str) -> int:
        """How often a process had told something when it was looked at last."""
        return self._of.get(name, (0, 0.0))[0]

    def hung(self, name: str, after: float) -> bool:
        """Whether a process is to be taken for hung.

        Where all are silent, the machine has more to do than it can, and to start one of them again
        would make it worse.
        """
        others = [silence for n, (_, silence) in self._of.items() if n != name]
        usual = statistics.median(others) if others else 0.0
        return self._of[name][1] > max(after, min(OUTLIER_RATIO * usual, CERTAIN_RATIO * after))

    def forgive(self, name: str) -> None:
        """Begin anew with a process that ends."""
        self._of[name] = self.told(name), 0.0


@dataclass
class Crashes:
    """Of one process.

    Attributes:
        count: of all.
        in_a_row: of those without an experiment dealt with in between.
        hung: of those that were killed since nothing came of them any more.
        told: how often it had told something of itself before the last one.
        hang: why it is killed, "" where it was not.
    """

    count: int = 0
    in_a_row: int = 0
    hung: int = 0
    told: int = 0
    hang: str = ""
    _step: int = -1

    def add(self, step: int) -> None:
        """One more, after the experiment of this number was dealt with."""
        self.count += 1
        self.in_a_row = self.in_a_row + 1 if step == self._step else 1
        self._step = step


class Respawner:
    """Keeps the processes of a graph running.

    Supervisors of services (systemd, supervisord) count restarts in a time; here a process is given
    up that crashes again before the run has got any further.
    """

    def __init__(self, supervisor: Supervisor, monitors: dict[str, Monitor]) -> None:
        self.supervisor = supervisor
        self._monitors = monitors
        self._hosts: dict[str, HostProcess] = {}  # by the name of a child
        self._crashes: dict[str, Crashes] = {}
        self._silence = Silence()
        self._own_files: dict[str, str] = {}
        #: Longest time that a start may take [s].
        self.patience = STARTUP + STARTUP_EACH * len(monitors)
        #: When a process was started again last [s of the steady clock].
        self.restarted_at = -math.inf

    def start(self, host: HostProcess) -> Child:
        """Start a process, and keep it running from now on."""
        self._hosts[host.name] = host
        for run in host.runs:
            self._own_files |= own_files(run.machine, run.settings)
        return self.supervisor.start(host.name, *host.arguments)

    def look(self) -> None:
        """Kill what hangs, and start again what has crashed.

        Raises:
            LdtError: a process refused its input, ended otherwise, or crashes again and again.
        """
        self._kill_hung()
        self.revive(self.supervisor.children)

    def revive(self, children: Iterable[Child]) -> None:
        """Start again what of these has crashed.

        Raises:
            LdtError: as `look`.
        """
        for child in [c for c in children if not c.running]:
            if child.ended_well and (child.told or child.name in SOURCES):
                continue  # a source may be ended by others; its experiments are then missed
            code, told = child.returncode, last_line(child.log)
            if code == BadInput.exit_code:
                _, _, sentence = told.partition(": ")
                raise _Refused(sentence or told)
            if not child.crashed or not self._start_again(child):
                hang = self._crashes.get(child.name, Crashes()).hang
                why = hang or f"ended with code {code}: {told}"
                raise NodeFailure(f"{child.name} {why}", child.log.parent)

    def is_up(self, child: Child) -> bool:
        """Whether a process misses nothing: if one was started again, all its nodes have met.

        Who has not within the time of a start will not: somebody has ended another node.
        """
        if time.monotonic() - self.restarted_at > self.patience:
            return True
        host = self._hosts[child.name]
        told = [
            self._monitors[run.name].health.get(role)
            for run in host.runs
            for role in ([host.role] if host.role else run.settings["graph"])
        ]
        return all(t and t.process == child.pid and t.values.get(READY) == "true" for t in told)

    def note(self) -> None:
        """Note in the summaries of the machines what crashed and hung."""
        for name, crashes in self._crashes.items():
            crashed, hung = crashes.count - crashes.hung, crashes.hung
            for run in self._hosts[name].runs:
                if crashed:
                    run.summary.note(f"{name} crashed {_times(crashed)} and was started again")
                if hung:
                    run.summary.note(f"{name} hung {_times(hung)}, was killed and started again")

    def _kill_hung(self) -> None:
        """Kill whoever has told nothing of itself for too long; to begin with takes longer."""
        running = [c for c in self.supervisor.children if c.running]
        self._silence.look({c.name: self._statements(c) for c in running})
        for child in running:
            after = self._hosts[child.name].runs[0].settings["hung_after"]
            crashes = self._crashes.setdefault(child.name, Crashes())
            heard = self._silence.told(child.name) > crashes.told
            allowed = after if heard else max(after, self.patience)
            if after and self._silence.hung(child.name, allowed):
                crashes.hung += 1
                since = "any more" if heard else f"within {allowed:g} s of its start"
                crashes.hang = f"hung: it told nothing of itself {since}"
                self._silence.forgive(child.name)
                child.send(signal.SIGKILL)  # it is found dead a moment later

    def _start_again(self, child: Child) -> bool:
        """Start a crashed child once more, unless it crashes again and again; whether it was."""
        host = self._hosts[child.name]
        crashes = self._crashes.setdefault(child.name, Crashes())
        crashes.add(sum(self._monitors[run.name].last_step for run in host.runs))
        crashes.told = self._silence.told(child.name)
        if crashes.in_a_row > host.runs[0].settings["restarts"]:
            return False
        crashes.hang = ""
        self.restarted_at = time.monotonic()
        for run in host.runs:
            self._refuse_other_code(child, run)
            write_parameters(run, self.supervisor.folder, resume=str(run.bag))
        self.supervisor.restart(child)
        return True

    def _refuse_other_code(self, child: Child, run: MachineRun) -> None:
        """Refuse to go on by code that is not what the run began with."""
        for name, text in own_files(run.machine, run.settings).items():
            if text != self._own_files[name]:
                raise BadInput(
                    name,
                    f"what it was when the run began, to start the {child.name} again",
                    "other",
                )

    def _statements(self, child: Child) -> int:
        """How often the nodes of a process have told something of themselves."""
        host = self._hosts[child.name]
        told = [self._monitors[run.name].statements for run in host.runs]
        return sum(t[host.role] if host.role else t.total() for t in told)


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


class _Refused(LdtError):
    """A node refused its input; the sentence is the node's own."""

    exit_code = BadInput.exit_code
