"""All machines of a page. Fed by one thread and read by another; neither waits for browsers."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from ldt_core.base.errors import LdtError
from ldt_core.base.experiment import Level
from ldt_core.base.model_state import NOT_JUDGED, headline_state, shown_state, times_noise
from ldt_core.recording.node_status import HEALTH_TOPIC
from ldt_core.views.step_view import drawn_number, statistic
from ldt_core.views.watch.watched_machine import MOST_SAMPLES, WatchedMachine, shown_text

MACHINES = 100  # that are shown, as many as a graph may have
COURSE = 30  # errors in the overview, the last ones: about as many as a card has room for
#: How bad a signal and the tone of its state are, beside nodes that have fallen silent or nothing.
RANKS = {Level.POSITIVE: 4, Level.WARNING: 1, Level.NEGATIVE: 0}
TONES = {"bad": 4, "vague": 3, "open": 1, "found": 1, "good": 0}
SILENT, NOTHING = 2, -1


class Fleet:
    """What is known of every machine.

    Args:
        live: whether silence of a node is trouble, and times are of this day.
        clock: of the time that passes [s].
        world: of the time of day [s since the epoch].
    """

    def __init__(
        self,
        live: bool = True,
        clock: Callable[[], float] = time.monotonic,
        world: Callable[[], float] = time.time,
    ) -> None:
        self.live = live
        self.machines: dict[str, WatchedMachine] = {}
        #: How often anything has changed.
        self.count = 0
        #: Told of each change, by whichever thread made it; has to return at once.
        self.on_change: Callable[[], None] = lambda: None
        #: What tells how far a recording is played, None where none is.
        self.playback: Callable[[], dict[str, Any]] | None = None
        self._state = ""
        self._left_out: set[str] = set()
        self._clock, self._world = clock, world
        self._lock = threading.RLock()

    def say(self, words: str) -> None:
        """What the source is doing, for people."""
        with self._lock:
            self._state = words
            self._changed()

    def reset(self) -> None:
        """Forget all machines: what comes now begins anew."""
        with self._lock:
            self._changed()
            self.machines = {n: WatchedMachine(n, began=self.count) for n in self.machines}

    def expect(self, namespace: str, name: str = "") -> None:
        """Show a machine before anything has come of it."""
        with self._lock:
            machine = self._machine(namespace)
            if machine is not None:
                machine.name = shown_text(name) or machine.name
            self._changed()

    def feed(self, namespace: str, topic: str, record: Any) -> None:
        """A record, or a message of `/diagnostics`.

        Args:
            namespace: of the machine, "" or "/" for the root; of `/diagnostics`, which is of all
                machines, it does not count.
            topic: its last part, or `/diagnostics`.
        """
        with self._lock:
            now = self._clock()
            if topic == HEALTH_TOPIC:
                self._health(record, now)
                return
            machine = self._machine(namespace)
            if machine is None:
                return
            self.count += 1
            try:
                moment = self._world() if self.live else None
                machine.take(topic, record, self.count, now, moment)
            except LdtError as error:
                machine.misread(str(error))
            self.on_change()

    def sample(self, namespace: str, moment: float, speed: float) -> None:
        """A sample that a machine streams: its stamp [s], its speed [rad/s]."""
        with self._lock:
            machine = self._machine(namespace)
            if machine is None:
                return
            self.count += 1
            machine.sample(moment, speed, self.count)
            self.on_change()

    def misread(self, namespace: str, sentence: str) -> None:
        """A message of a machine that could not be read."""
        with self._lock:
            machine = self._machine(namespace)
            if machine is not None:
                machine.misread(sentence)
            self._changed()

    def overview(self) -> dict[str, Any]:
        """All machines, worst first, in JSON types."""
        with self._lock:
            now = self._clock()
            cards = [self._card(machine, now) for machine in self.machines.values()]
            cards.sort(key=lambda c: (-c["rank"], -(c["error"] or 0), c["key"]))
            left_out = len(self._left_out)
            return {
                "state": self._state,
                "live": self.live,
                "left": left_out,
                "playback": self.playback() if self.playback else None,
                "machines": cards,
            }

    def machine(self, key: str, since: int = 0) -> dict[str, Any] | None:
        """What has changed of a machine since a count of the fleet, in JSON types.

        Args:
            key: its namespace with a leading slash.
            since: `count` of what was told before; 0 tells all.

        Returns:
            None when there is no such machine.
        """
        with self._lock:
            machine = self.machines.get(key.strip("/"))
            if machine is None:
                return None
            now = self._clock()
            whole = since < machine.began or since == 0
            since = 0 if whole else since
            last = machine.signal
            found: dict[str, Any] = {
                "count": self.count,
                "whole": whole,
                "card": self._card(machine, now),
                "numbers": sorted(machine.steps),
                "steps": [s.row() for s in machine.steps.values() if s.changed > since],
                "events": [e for e in machine.events if e[0] > since],
                "models": {
                    str(version): {"kind": kind, "learned": learned}
                    for version, (count, kind, learned) in machine.models.items()
                    if count > since
                },
                "nodes": list(machine.nodes.rows(now, self.live)),
                "unreadable": machine.unreadable,
                "last_unreadable": machine.last_unreadable,
            }
            if machine.streamed > since:
                found["stream"] = machine.streamed_now()
            if last is not None:
                found["label"] = shown_text(statistic([last]).label)
            if machine.diagnosis_changed > since:
                d = machine.diagnosis
                found["diagnosis"] = d and {
                    "experiment": d.experiment,
                    "kind": shown_text(d.kind),
                    "sentence": shown_text(d.sentence),
                }
            return found

    def experiment(self, key: str, number: int) -> dict[str, Any] | None:
        """The samples of an experiment, thinned, in JSON types; None when they are not there."""
        with self._lock:
            machine = self.machines.get(key.strip("/"))
            step = machine.steps.get(number) if machine else None
            packed = step.samples(MOST_SAMPLES) if step else None
            if step is None or packed is None:
                return None
            about = {"number": number, "drawn": step.drawn}
            return {**about, **packed.as_dict(), "kept": packed.kept}

    def _changed(self) -> None:
        self.count += 1
        self.on_change()

    def _machine(self, namespace: str) -> WatchedMachine | None:
        """The machine of a namespace, a new one where there is room."""
        name = namespace.strip("/")
        if name not in self.machines:
            if len(self.machines) >= MACHINES:
                if len(self._left_out) < MACHINES:
                    self._left_out.add(name)
                return None
            self.machines[name] = WatchedMachine(name)
        return self.machines[name]

    def _health(self, message: Any, now: float) -> None:
        told = {status.name.strip("/").rpartition("/")[0] for status in message.status}
        for name in told & self.machines.keys():
            if self.machines[name].nodes.take(message, name, now):
                self._changed()

    def _card(self, machine: WatchedMachine, now: float) -> dict[str, Any]:
        signal, done, diagnosis = machine.signal, machine.adaptation, machine.diagnosis
        state = headline_state(signal) if signal else NOT_JUDGED
        rank = max(RANKS[signal.level], TONES[shown_state(signal).tone]) if signal else NOTHING
        silent = machine.nodes.silent(now) if self.live else []
        over = self.live and machine.nodes.over(now)
        words = state.words if signal else "no signal yet"
        trouble = [f"silent: {', '.join(silent)}"] if silent else []
        told = {} if over else machine.nodes.told  # what troubled a graph ended with it
        warned = {role: one.status.message for role, one in told.items() if one.status.warns}
        trouble += [f"{role}: {shown_text(words)}" for role, words in warned.items()]
        if machine.unreadable:
            trouble.append(f"unreadable messages: {machine.unreadable}")
        latest = [step.signal for step in list(machine.steps.values())[-COURSE:]]
        course = [(drawn_number(s.max_error), int(s.level)) for s in latest if s is not None]
        version = done.model_version if done else signal.model_version if signal else None
        return {
            "key": f"/{machine.namespace}",
            "title": machine.namespace or machine.name or machine.nodes.machine or "the machine",
            "machine": machine.name or machine.nodes.machine,
            "rank": max(rank, SILENT if silent else rank),
            "level": int(signal.level) if signal else None,
            "word": signal.level.word if signal else "no signal yet",
            "state": state.name,
            "words": f"not running; last: {words}" if over else words,
            "tone": NOT_JUDGED.tone if over else state.tone,
            "noise": times_noise(signal.adequacy) if signal else "",
            "experiment": signal.experiment if signal else None,
            "error": drawn_number(signal.max_error) if signal else None,
            "version": version,
            "action": str(done.action) if done else "",
            "diagnosis": shown_text(diagnosis.sentence) if diagnosis else "",
            "trouble": "; ".join(trouble),
            "age": None if machine.fed_at is None else round(now - machine.fed_at, 1),
            "course": course,
        }
