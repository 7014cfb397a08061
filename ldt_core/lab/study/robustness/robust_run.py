"""One run of a twin on a stream whose truth is known, and what is measured of it."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np

from ldt_core.base.experiment import rms
from ldt_core.detectors.base import Detector
from ldt_core.lab.study.robustness.known_stream import KnownStream
from ldt_core.lab.study.robustness.paper_trials import PAPER_TRIALS
from ldt_core.lab.study.robustness.straw_man import StrawMan
from ldt_core.lab.study.robustness.streams import STREAMS
from ldt_core.lab.study.study_plan import PAPER, TABLE
from ldt_core.machine.machine_file import Machine
from ldt_core.twin.loop import Twin

DEFAULT = "default"
STRAW_MAN = "straw man"
#: In place of a setup: what a trial of the paper's hybrid changes stands in `PAPER_TRIALS`.
TRIAL = "trial"
#: Name → the settings of a twin, where they differ from the defaults.
SETUPS: dict[str, dict[str, Any]] = {
    DEFAULT: {},
    "paper, hybrid": {"model": "hybrid", "detector": "threshold", **PAPER, **TABLE["threshold"]},
    "paper, linear": {"model": "linear", "detector": "threshold", **PAPER, **TABLE["threshold"]},
    STRAW_MAN: {"model": "diagnosed"},
}
#: Times the noise: a larger error of an experiment, and nobody may say that the model holds.
GROSS = 10.0
#: Experiments over which the twin is compared with the original.
WATCHED = 10
#: A change shows where *late* errs so many times as much as *known*.
SHOWS = 2.0


@dataclass(frozen=True)
class RobustTask:
    """A run to make.

    Args:
        stream: name in `STREAMS`, or in `PAPER_TRIALS`.
        setup: name in `SETUPS`, or `TRIAL`.
        seed: of the stream.
        experiments: of the stream.
    """

    stream: str
    setup: str
    seed: int
    experiments: int

    @property
    def key(self) -> str:
        """Name of the result."""
        words = (self.stream, self.setup.replace(", ", "-").replace(" ", "-"))
        return "_".join((*words, str(self.seed), str(self.experiments)))


@dataclass(frozen=True)
class RobustRun:
    """What came of one run; rows have one entry an experiment.

    Attributes:
        task: what was run.
        noise: standard deviation on the measured speed [rad/s].
        changes: numbers of the experiments in which the machine is another than before.
        max_error, original, known, late: largest errors of the twin, of the original model and of
            the references [rad/s].
        rms_error: root mean square error of the twin [rad/s].
        level: of the signal, 1, 0 or -1.
        state: what the detector knows; "" where it does not say.
        action: of the adaptor.
        seconds: of processor time in the loop.
        step_seconds: wall time of each turn of the loop [s].
    """

    task: RobustTask
    noise: float
    changes: list[int]
    max_error: list[float]
    original: list[float]
    known: list[float]
    late: list[float]
    rms_error: list[float]
    level: list[int]
    state: list[str]
    action: list[str]
    seconds: float
    step_seconds: list[float]

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, task: RobustTask, plain: Mapping[str, Any]) -> RobustRun:
        """The run of a task that `to_dict` gave.

        Raises:
            ValueError, KeyError, TypeError: it did not.
        """
        names = [f.name for f in fields(cls) if f.name != "task"]
        found = cls(task, **{name: plain[name] for name in names})
        if len(found.max_error) != task.experiments or dict(plain["task"]) != asdict(task):
            raise ValueError("another task's run")
        return found


@dataclass(frozen=True)
class RobustScore:
    """The figures of one run; None where one is undefined.

    Attributes:
        left: the twin's mean maximum error over the original's.
        over_late: the same over the reference late.
        late_left: late's mean maximum error over the original's.
        learned: left without the first experiment.
        adaptations: new models that came into force.
        changes: of the machine.
        per_change: adaptations over changes.
        late_changes: changes that show, after whose first experiment no new model came into force.
        gross_holds: experiments whose root mean square error is above ten times the noise while
            the state is "holds".
        positives: positive signals.
        said_changed, said_inadequate, said_new_range, said_learning: experiments in that state.
        worst_ten: largest sum of the twin's errors over ten experiments, over the original's.
        seconds: of processor time.
        p99_step: 99th percentile of a turn of the loop [s].
    """

    left: float
    over_late: float
    late_left: float
    learned: float | None
    adaptations: int
    changes: int
    per_change: float | None
    late_changes: int
    gross_holds: int
    positives: int
    said_changed: int
    said_inadequate: int
    said_new_range: int
    said_learning: int
    worst_ten: float
    seconds: float
    p99_step: float


def score_run(run: RobustRun) -> RobustScore:
    """The figures of a run."""
    own, original = np.array(run.max_error), np.array(run.original)
    late, known = np.array(run.late), np.array(run.known)
    adapted = {i for i, action in enumerate(run.action, start=1) if action == "adapted"}
    shown = [n for n in run.changes if late[n - 1] > SHOWS * known[n - 1]]
    width = min(WATCHED, own.size)
    sums = [np.convolve(row, np.ones(width), "valid") for row in (own, original)]
    gross = np.array(run.rms_error) > GROSS * run.noise
    holds = np.array([state == "holds" for state in run.state])
    changes = len(run.changes)
    return RobustScore(
        left=float(own.mean() / original.mean()),
        over_late=float(own.mean() / late.mean()),
        late_left=float(late.mean() / original.mean()),
        learned=float(own[1:].mean() / original[1:].mean()) if own.size > 1 else None,
        adaptations=len(adapted),
        changes=changes,
        per_change=len(adapted) / changes if changes else None,
        late_changes=sum(n not in adapted for n in shown),
        gross_holds=int(np.sum(gross & holds)),
        positives=run.level.count(1),
        said_changed=run.state.count("changed"),
        said_inadequate=run.state.count("inadequate"),
        said_new_range=run.state.count("new_range"),
        said_learning=run.state.count("learning"),
        worst_ten=float(np.max(sums[0] / sums[1])),
        seconds=run.seconds,
        p99_step=float(np.percentile(run.step_seconds, 99)),
    )


def run_robust(task: RobustTask) -> RobustRun:
    """Take a stream through a twin.

    Raises:
        LdtError: the twin cannot go on.
    """
    if task.setup == TRIAL:
        trial = PAPER_TRIALS[task.stream]
        return run_setup(task, trial.stream(task.seed, task.experiments), trial.settings, None)
    given = STREAMS[task.stream](task.seed, task.experiments)
    detector = StrawMan() if task.setup == STRAW_MAN else None
    return run_setup(task, given, _settings_of(task.setup, given.machine), detector)


def _settings_of(setup: str, machine: Machine) -> dict[str, Any]:
    """The settings of a twin for a machine.

    The straw man's model is told the cause that the machine's file names for its wear.
    """
    settings = dict(SETUPS[setup])
    if setup == STRAW_MAN:
        settings["cause"] = machine.simulation["degradation"]["effect"]
    return settings


def run_setup(
    task: RobustTask, given: KnownStream, settings: Mapping[str, Any], detector: Detector | None
) -> RobustRun:
    """Take a stream through a twin of these settings.

    Args:
        task: under whose name.
        given: the stream.
        settings: of the twin, where they differ from the defaults.
        detector: in place of the one in the settings.

    Raises:
        LdtError: the twin cannot go on.
    """
    rest = {k: v for k, v in settings.items() if k != "detector"}
    twin = Twin(given.machine, detector=detector or settings.get("detector"), **rest)
    steps, walls = [], []
    begin = time.process_time()
    for experiment in given.experiments:
        before = time.perf_counter()
        steps.append(twin.step(experiment))
        walls.append(round(time.perf_counter() - before, 6))
    seconds = time.process_time() - begin
    references = given.references
    return RobustRun(
        task=task,
        noise=given.noise,
        changes=given.changes,
        max_error=[s.signal.max_error for s in steps],
        original=[s.original.max_error(s.experiment) for s in steps],
        known=list(references.known),
        late=list(references.late),
        rms_error=[rms(s.prediction.residual(s.experiment)) for s in steps],
        level=[int(s.signal.level) for s in steps],
        state=[s.signal.state for s in steps],
        action=[str(s.adaptation.action) for s in steps],
        seconds=round(seconds, 3),
        step_seconds=walls,
    )
