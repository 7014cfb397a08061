"""What a run ends with on a terminal."""

from __future__ import annotations

import pytest

from ldt_core.base.experiment import Level, Signal
from ldt_core.base.metrics import Summary
from ldt_core.cli.progress import print_summaries

SETTINGS = {"model": "physics", "detector": "lddm"}
COUNT = 1234  # experiments of each machine


def summed_up(**counts: int) -> Summary:
    """A run without a word of trouble."""
    summary = Summary()
    for number in range(1, COUNT + 1):
        level = Level.WARNING if number % 3 else Level.NEGATIVE
        summary.add_signal(Signal(number, level, "", 0, 123.456, {}, "inadequate", 20.0))
        summary.add_original(1000.0)
    vars(summary).update(counts)
    return summary


@pytest.mark.parametrize("machines", [1, 3, 4, 50])
def test_every_machine_is_readable_on_a_narrow_terminal(machines, capsys, monkeypatch):
    """No name and no figure is cut, however many there are."""
    monkeypatch.setenv("COLUMNS", "80")
    runs = [(f"machine_{n}", summed_up(rejected=770 + n), "") for n in range(machines)]
    print_summaries(runs, SETTINGS, False)
    shown = capsys.readouterr().out
    assert "…" not in shown
    sentences = {f"{name}: {summary.outcome}" for name, summary, _ in runs}  # which may wrap
    assert max(len(line) for line in shown.splitlines() if line not in sentences) <= 80
    for name, summary, _ in runs:
        wanted = {name, str(COUNT), f"{summary.mme:.3f}", str(summary.rejected), "inadequate", "12"}
        assert wanted <= set(shown.split())


def test_what_only_one_of_several_machines_has_is_shown(capsys):
    """A row that the others lack was an IndexError."""
    runs = [("press", summed_up(repeated=3), ""), ("saw", summed_up(), "")]
    print_summaries(runs, SETTINGS, False)
    (line,) = [x for x in capsys.readouterr().out.splitlines() if "repeated" in x]
    assert [part for part in line.split() if part.isdecimal()] == ["3", "0"]
