"""The trials that look for what leaves the paper's hybrid less than ours."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from ldt_core.lab.study.robustness.conduct import trial_tasks
from ldt_core.lab.study.robustness.paper_trials import PAPER_TRIALS, PlainHybrid
from ldt_core.lab.study.robustness.robust_run import TRIAL, RobustTask, run_robust
from ldt_core.lab.study.study import Study
from ldt_core.lab.study.study_page import write_study_page
from ldt_core.lab.study.study_plan import PAPER_DRIFTS
from ldt_core.lab.study.study_tables import PAPER
from ldt_core.machine.machine_file import load_machine


def test_the_papers_rows_fit_nine_drifts_alone():
    """One number of hits has to give both precisions and the recall, printed or truncated."""

    def printed(part: int, whole: int) -> set[float]:
        return {round(part / whole, 2), part * 100 // whole / 100}

    fitting = [
        drifts
        for drifts in range(1, 45)
        for hits in range(1, drifts + 1)
        if PAPER["linear"]["recall"] in printed(hits, drifts)
        and PAPER["hybrid"]["precision"] in printed(hits, 25)
        and PAPER["linear"]["precision"] in printed(hits, 44)
    ]
    assert fitting == [9]
    assert PAPER["hybrid"]["drifts"] == PAPER_DRIFTS == 9


@pytest.mark.parametrize(("name", "drifts"), [("paper", 9), ("e_20", 9), ("drifts_12", 12)])
def test_a_trial_s_stream_has_nine_drifts_unless_it_is_about_them(name, drifts):
    """In 200 experiments."""
    stream = PAPER_TRIALS[name].stream
    values = stream.wears[0].values(stream.experiments, 1)
    assert sum(a != b for a, b in pairwise(values)) == drifts


def test_an_altered_machine_is_so_in_plant_and_twin():
    """The file's own value elsewhere."""
    given = PAPER_TRIALS["damping_10"].stream(1, 1)
    assert given.machine.parameters["R_x"] == given.plant.machine.parameters["R_x"] == 50
    assert load_machine("rotor").parameters["R_x"] == 5
    assert len(PAPER_TRIALS["length_5"].stream(1, 1).experiments[0]) == 500


@pytest.mark.slow
@pytest.mark.parametrize("name", PAPER_TRIALS)
def test_every_trial_runs(name):
    """Three experiments of it."""
    run = run_robust(RobustTask(name, TRIAL, 0, 3))
    assert len(run.max_error) == 3
    assert all(np.isfinite(run.max_error))


@pytest.mark.slow
def test_the_plain_regression_finds_a_friction_over_speed():
    """Without noise it predicts a drag that the physics lacks as the hybrid does."""
    from ldt_core.lab.study.robustness.streams import Aim, StreamKind, Wear

    wear = Wear("quadratic_drag", "c", 4e-4, kind="none")
    given = StreamKind("", (wear,), Aim(), noise=1e-3)(1, 3)
    untaught = PlainHybrid(given.machine)
    taught = untaught.fit(given.experiments[:2])
    last = given.experiments[2]
    assert taught.predict(last).max_error(last) < 0.1 * untaught.predict(last).max_error(last)


@pytest.mark.slow
def test_the_page_has_a_row_for_each_trial_and_the_papers(tmp_path):
    """Of those that were run."""
    (task,) = [t for t in trial_tasks(range(1), 3) if t.stream == "paper"]
    study = Study({"groups": ("trials",)}, (), robust=(run_robust(task),))
    page = write_study_page(study, tmp_path).read_text()
    assert "the preset “paper”, 9 drifts" in page
    assert "the paper, on its rotor" in page
    assert PAPER_TRIALS["damping_10"].about not in page
