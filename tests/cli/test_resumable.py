"""What is said of work that is interrupted: what is kept, if anything is."""

from __future__ import annotations

import sys

import click
import numpy as np
import pytest

from ldt_core.base.settings import resolve
from ldt_core.cli import invoke, ldt
from ldt_core.cli.progress import ResumableProgress
from ldt_core.machine import Plant
from ldt_core.recording.bag import read_bag
from ldt_core.restart.run_key import command_to_resume


@pytest.mark.parametrize(
    ("done", "said"),
    [
        (0, ""),
        (3, " after 3 of 12 results, which are kept in out; go on with: ldt study --seeds 2"),
    ],
)
def test_what_is_kept_is_said_if_anything_is(done, said, capsys):
    """Before the first result the folder may not even be there."""

    @click.command("study")
    @click.option("--seeds")
    def study(seeds):
        with ResumableProgress("study", "results", "out") as progress:
            progress.show(done, 12)
            raise KeyboardInterrupt

    assert invoke(study, ["--seeds", "2"]) == 130
    assert capsys.readouterr().err == f"\nldt: interrupted{said}\n"


def test_the_command_that_goes_on_repeats_what_a_recording_may_not_name():
    """A file, code, and when things happen; the rest is recorded."""
    given = {"machine": "my press.yaml", "model": "linear", "seed": 3, "rate": "40", "bag": "run"}
    asked = command_to_resume(resolve(given), "my run")
    assert asked == "ldt run --resume 'my run' --machine 'my press.yaml' --rate 40"


@pytest.mark.parametrize("start", ["rest", "continue"])
def test_experiments_that_are_recorded_are_not_simulated_again(start, tmp_path, monkeypatch):
    """Of a hundred thousand, that took 15 s; the result is that of a run that went through."""
    monkeypatch.chdir(tmp_path)
    simulated: list[int] = []
    plant, until = Plant.experiment, [3]

    def experiment(self, number):
        if number > until[0]:
            raise KeyboardInterrupt
        simulated.append(number)
        return plant(self, number)

    monkeypatch.setattr(Plant, "experiment", experiment)
    given = ["run", "--experiments", "5", "--model", "physics", "--start-time", "1e9"]
    given += ["--start", start]
    assert invoke(ldt, [*given, "--out", "broken"]) == 130
    until[0] = 5
    simulated.clear()
    assert invoke(ldt, ["run", "--resume", "broken"]) == 0
    assert simulated == [4, 5]
    assert invoke(ldt, [*given, "--out", "whole"]) == 0
    for name in ("experiment", "prediction", "signal", "adaptation"):
        assert as_text("broken", name) == as_text("whole", name)
    assert invoke(ldt, ["run", "--resume", "whole"]) == 0  # nothing is left to do


def as_text(folder, name):
    """Records of a topic, in full."""
    with np.printoptions(threshold=sys.maxsize, floatmode="unique"):
        return [repr(record) for record in read_bag(folder).records(name)]
