"""Claims about a run that goes on after its counter of experiments began anew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ldt_core.base.errors import RecordingError
from ldt_core.base.experiment import Experiment
from ldt_core.base.settings import resolve
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import Machine, load_machine
from ldt_core.python_api.recorded_experiments import read
from ldt_core.recording.bag import read_bag
from ldt_core.recording.health import inspect
from ldt_core.recording.writer import BagWriter
from ldt_core.restart import recorded_run
from ldt_core.restart.recorded_run import END, RecordedRun, complete_steps
from ldt_core.runs import offline
from ldt_core.twin.loop import Twin

ROTOR = load_machine("rotor")
SHORT = Machine(**{**vars(ROTOR), "duration": 0.4})
GIVEN = resolve(
    {"model": "linear", "order": 1, "detector": "threshold", "threshold": 0.5, "gate": "none"}
)
#: Numbers of experiments, one a second, and the starts of those whose clock went back, too.
COUNTERS = {
    "begins anew": [*range(1, 13), *range(1, 13)],
    "begins anew twice": [*range(1, 9), *range(1, 7), *range(1, 9)],
    "jumps and comes back": [1, 2, 3, 4, 500_000, 5, 6, 7, 8, 9, 10, 11],
    "a number out of nowhere": [1, 2, 2**53 - 1, 3, 4, 2**53 - 1, 5, 6, 7],
    "begins with one": [2**53 - 1, 1, 2, 3, 4, 5, 6],
    "repeats": [1, 2, 2, 3, 3, 3, 4, 1, 2, 3, 4, 5, 5, 6],
}


def experiments(numbers: list[int], starts: list[float] | None = None) -> list[Experiment]:
    """Of a worn rotor, with these numbers."""
    plant = Plant.from_settings(SHORT, resolve({"seed": 3, "degradation": "abrupt"}))
    made = []
    for index, number in enumerate(numbers):
        start = 1e9 + (index if starts is None else starts[index])
        made.append(replace(plant.experiment(index + 1), number=number, start=start))
    return made


def steps(folder) -> list[str]:
    """All that a recording says of its steps, in their order."""
    found = []
    for step in complete_steps(read_bag(folder), SHORT):
        parts = [step.experiment.start, step.prediction.speed.tolist(), step.signal]
        found.append(repr([step.number, *parts, step.adaptation, step.model]))
    return found


def figures(summary) -> dict[str, object]:
    """All of a summary but the sentences beside."""
    return {name: value for name, value in summary.as_dict().items() if name != "notes"}


def run(folder, sent, resume=False, **given):
    """Take experiments through the twin."""
    settings = {**GIVEN, **given, "resume": str(folder) if resume else ""}
    return offline.run(SHORT, settings, iter(sent), folder)


@pytest.mark.slow
@pytest.mark.parametrize("every", [0, 4])
@pytest.mark.parametrize("name", COUNTERS)
def test_wherever_it_was_interrupted_the_numbers_are_the_same(name, every, tmp_path):
    """With checkpoints and without; what was refused is refused again, and counted."""
    sent = experiments(COUNTERS[name])
    whole = run(tmp_path / "whole", sent, checkpoint_every=every)
    wanted = steps(tmp_path / "whole")
    assert len(wanted) == whole.experiments
    for end in range(2, len(sent), 5):
        folder = tmp_path / str(end)
        run(folder, sent[:end], checkpoint_every=every)
        again = run(folder, sent, resume=True, checkpoint_every=every)
        assert steps(folder) == wanted
        assert figures(again) == figures(whole)
        assert [n for n, _ in again.recorded] == [n for n, _ in again.answered]


def test_a_clock_that_goes_back_with_the_counter_does_not_mislead_it(tmp_path):
    """Three are refused then."""
    starts = [*range(1000, 1010), *range(10)]
    sent = experiments([*range(1, 11), *range(1, 11)], [float(s) for s in starts])
    whole = run(tmp_path / "whole", sent, checkpoint_every=3)
    assert whole.rejected == 3
    for end in (5, 12, 18):
        run(tmp_path / str(end), sent[:end], checkpoint_every=3)
        assert figures(run(tmp_path / str(end), sent, resume=True)) == figures(whole)
        assert steps(tmp_path / str(end)) == steps(tmp_path / "whole")


def test_whoever_reads_a_run_gets_each_step_with_what_was_said_of_it(tmp_path):
    """As the graph records it, what was refused too; that has no step, whatever its number had.

    The counter restarts twice, the first time with its clock behind.
    """
    numbers = [*range(1, 8), *range(1, 8), *range(1, 8)]
    starts = [1e9 + n + 5000 * (0, -1, 1)[i // 7] for i, n in enumerate(numbers)]
    sent = experiments(numbers, starts)
    twin, made = Twin.from_settings(SHORT, GIVEN), []
    with BagWriter(tmp_path / "run", "rotor") as writer:
        for one in sent:
            steps_of_it = list(twin.steps([one]))
            for step in steps_of_it:
                offline.write_step(writer, step)
            if not steps_of_it:
                writer.write("experiment", one, one.end)
            made += steps_of_it
    assert len(made) == 17
    found = read(tmp_path / "run")
    for step, truth in zip(found.steps, made, strict=True):
        assert (step.number, step.experiment.start) == (truth.number, truth.experiment.start)
        assert step.prediction.speed.tobytes() == truth.prediction.speed.tobytes()
        assert step.original is not None
        assert step.original.start == truth.experiment.start
        assert (repr(step.signal), step.adaptation) == (repr(truth.signal), truth.adaptation)
    table = found.to_frame()
    assert (len(table), table["signal"].notna().sum()) == (21, 17)
    assert inspect(read_bag(tmp_path / "run")).experiments == 21


def test_a_run_that_goes_on_with_other_experiments_says_so(tmp_path):
    """It would repeat what it has learned from already."""
    sent = experiments(list(range(1, 6)))
    run(tmp_path / "run", sent)
    with pytest.raises(RecordingError, match=r"expected experiment 5, with which .*run ends"):
        run(tmp_path / "run", [replace(e, start=e.start + 0.5) for e in sent], resume=True)


def test_the_end_of_a_long_recording_is_found_whatever_its_numbers(tmp_path, monkeypatch):
    """From the end on backwards, also where the same numbers stand twice."""
    monkeypatch.setattr(recorded_run, "TAIL", 4096)
    monkeypatch.setattr(recorded_run, "WINDOW", 5)
    monkeypatch.setattr(recorded_run, "MARGIN", 15)
    rest = np.zeros(3)
    numbers = [*range(1, 41), *range(1, 41), *range(1, 31)]
    sent = [Experiment(n, 1e9 + i, 0.01, rest, rest) for i, n in enumerate(numbers)]
    twin = Twin.from_settings(SHORT, resolve({"model": "physics"}))
    with BagWriter(tmp_path / "run", "rotor", split_size=0.05) as writer:
        for step in twin.steps(sent):
            offline.write_step(writer, step)
            writer.flush()  # a chunk of its own, as of a machine that takes its time
    recorded = RecordedRun(tmp_path / "run", "", SHORT)
    whole = [(s.number, s.experiment.start) for s in recorded.steps()]
    assert len(whole) == len(numbers) - 2
    for around in ((END,), (25,), (25, 30), (40,)):
        found = [(s.number, s.experiment.start) for s in recorded.steps(*around)]
        assert found == whole[-len(found) :]
        assert len(found) < len(whole)
        last = max(i for i, (n, _) in enumerate(whole) if around == (END,) or n == min(around))
        assert len(whole) - len(found) <= last - 5
