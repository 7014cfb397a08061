"""Claims about what a run says of itself while it goes on, on a pipe or in a log."""

from __future__ import annotations

import pytest

from ldt_core.base.experiment import Action, Adaptation, Level, Signal
from ldt_core.cli import progress as module
from ldt_core.cli.progress import MOST_CHANGES, RunProgress


@pytest.fixture
def clock(monkeypatch):
    """Sets the time that has passed [s]."""
    now = [0.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    return now


def show(progress, number, state="holds", action=Action.KEPT, reason=""):
    signal = Signal(number, Level.NEGATIVE, "adequacy", 0, 1.0, {}, state, 1.0)
    progress.show("press", signal, Adaptation(number, action, 3, reason))


def test_what_changes_beside_a_live_machine_is_said_at_once_with_the_date(clock, capsys):
    """Between changes there is a line an hour, and not each half minute for months."""
    with RunProgress({"press": None}, live=True) as progress:
        show(progress, 1)
        show(progress, 2, "changed")
        show(progress, 3, "changed", Action.ADAPTED, "since experiment 2: friction has grown")
        changes = capsys.readouterr().err.splitlines()
        for number in range(4, 4 + 7 * 24 * 60):  # a week
            clock[0] += 60.0
            show(progress, number)
    assert len(changes) == 2
    date, words = changes[0][:19], changes[0][20:]
    assert date[4] + date[13] == "-:"
    assert words.startswith("press: experiment 2, machine changed, max error 1 rad/s")
    assert changes[1].endswith("model 3: since experiment 2: friction has grown")
    assert 7 * 24 <= len(capsys.readouterr().err.splitlines()) < 8 * 24


def test_a_live_machine_that_changes_at_will_fills_no_log(clock, capsys):
    """What is left out is counted in the next line."""
    with RunProgress({"press": None}, live=True) as progress:
        for number in range(1, 24 * 1800 + 1):  # a day
            clock[0] += 2.0
            show(progress, number, "changed", Action.ADAPTED, "again")
    lines = capsys.readouterr().err.splitlines()
    assert MOST_CHANGES < len(lines) < 300
    assert "179 more changes in between; ldt watch shows all" in lines[-2]


def test_a_run_that_goes_on_counts_from_where_it_stopped(clock, capsys):
    """It said experiment 1 of 200 at the 151st, and how long 199 more would take."""
    with RunProgress({"press": 200}, resumed=True) as progress:
        for number in range(151, 181):
            clock[0] += 31.0
            show(progress, number)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0].startswith("press: experiment 151 of 200,")
    assert lines[-1].startswith("press: experiment 180 of 200,")
    assert lines[-1].endswith("about 10 min left")
