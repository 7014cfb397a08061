"""The groups robustness and alarms: scores, aims, detector to beat, counts, and what is kept."""

from __future__ import annotations

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
from fake_robust_run import COUNT, made

from ldt_core.checks import check_detector
from ldt_core.lab.study.claims.robust_aims import robust_aims
from ldt_core.lab.study.engine import conduct as conduct_study
from ldt_core.lab.study.robustness import conduct
from ldt_core.lab.study.robustness.alarm_trials import (
    EVERY,
    AlarmCount,
    AlarmTask,
    count_alarms,
    lorden,
)
from ldt_core.lab.study.robustness.conduct import robust_tasks
from ldt_core.lab.study.robustness.robust_run import (
    SETUPS,
    RobustRun,
    score_run,
)
from ldt_core.lab.study.robustness.straw_man import StrawMan
from ldt_core.lab.study.robustness.streams import STREAMS
from ldt_core.lab.study.study import Evidence, Study
from ldt_core.lab.study.study_page import write_study_page
from ldt_core.lab.study.study_plan import StudyPlan
from ldt_core.lab.study.study_tables import write_tables


@pytest.fixture(scope="module")
def white() -> AlarmCount:
    """Alarms under white noise, of 5000 experiments."""
    return count_alarms(AlarmTask(0, law="white"))


@pytest.fixture(scope="module")
def large() -> AlarmCount:
    """When a large change is found."""
    return count_alarms(AlarmTask(0, size=2.0))


def test_the_figures_of_a_run_are_what_they_say():
    """By hand: 12.6 of 100 are left, 8 after the first experiment, at one adaptation a change."""
    score = score_run(made())
    assert score.left == pytest.approx((5 + 19 * 0.4) / 100)
    assert score.learned == pytest.approx(0.08)
    assert (score.over_late, score.late_left) == pytest.approx((1.0, score.left))
    assert (score.adaptations, score.changes, score.per_change, score.late_changes) == (1, 1, 1, 0)
    assert (score.said_changed, score.said_inadequate, score.gross_holds) == (1, 0, 0)
    assert score.worst_ten == pytest.approx((5 + 9 * 0.4) / 50)


def test_an_error_of_ten_times_the_noise_under_holds_is_counted():
    """In the state "holds" alone."""
    wrong = [2.0] * COUNT
    assert score_run(made(rms_error=wrong)).gross_holds == COUNT - 1
    assert score_run(made(rms_error=wrong, state=["inadequate"] * COUNT)).gross_holds == 0


def test_a_change_that_shows_is_met_late_without_an_adaptation_in_its_experiment():
    """One that does not show is not."""
    slow = ["kept", "adapted"] + ["kept"] * (COUNT - 2)
    assert score_run(made(action=slow)).late_changes == 1
    assert score_run(made(action=slow, late=[0.4] * COUNT)).late_changes == 0


def test_the_aims_pass_what_is_good_and_miss_what_is_not():
    """Each of them, by a run that is wrong in one way."""
    good = robust_aims([made()])
    assert all(v.passed for v in good)
    assert [v.stream for v in good] == ["off_5mm", "", "", ""]
    worse = made(max_error=[5.0] + [6.0] * (COUNT - 1), rms_error=[2.0] * COUNT)
    assert not any(v.passed for v in robust_aims([worse])[:3])
    busy = made(action=["adapted"] * COUNT)
    assert [v.passed for v in robust_aims([busy])] == [True, True, True, False]
    quiet = made("quiet", changes=[], action=["kept"] * COUNT, max_error=[5.0] * COUNT)
    assert [v.passed for v in robust_aims([quiet]) if v.stream == "quiet"] == [True]
    restless = replace(quiet, action=["adapted"] * COUNT)
    assert [v.passed for v in robust_aims([restless]) if v.stream == "quiet"] == [False]


def test_other_setups_have_no_aims():
    """The paper's configurations stand beside."""
    assert robust_aims([made(setup="paper, hybrid")]) == []


def test_a_run_survives_its_file_and_no_other_task_takes_it():
    """Through JSON; and with the wrong task it is refused."""
    run = made()
    plain = json.loads(json.dumps(run.to_dict()))
    assert RobustRun.from_dict(run.task, plain) == run
    with pytest.raises(ValueError, match="another task"):
        RobustRun.from_dict(replace(run.task, seed=1), plain)
    count = count_alarms(AlarmTask(0, size=2.0))
    plain = json.loads(json.dumps(count.to_dict()))
    assert AlarmCount.from_dict(count.task, plain) == count


def test_every_stream_is_run_under_every_setup_with_its_own_length():
    """And no longer than asked."""
    tasks = robust_tasks(range(2), 50)
    assert len(set(tasks)) == len(tasks) == 2 * len(STREAMS) * len(SETUPS)
    assert len({t.key for t in tasks}) == len(tasks)
    assert all(t.experiments == min(50, STREAMS[t.stream].experiments) for t in tasks)


def test_the_straw_man_keeps_a_detector_s_promises():
    """Those of every detector."""
    check_detector(StrawMan())


def test_the_straw_man_waits_longer_while_learning_does_not_help():
    """1, 2, 4 experiments between two positives, and at once after one that helped."""
    detector, wave = StrawMan(), 5 * np.sin(np.linspace(0, 20, 500))
    random = np.random.default_rng(0)
    positive = []
    for number in range(1, 13):
        detector.update(wave + random.normal(size=500))
        if detector.drift_detected:
            positive.append(number)
            detector.answered(False)
    assert positive == [1, 2, 4, 7, 12]
    detector.update(random.normal(size=500))
    detector.update(wave + random.normal(size=500))
    assert detector.drift_detected


@pytest.mark.slow
def test_white_noise_gives_no_more_false_alarms_than_stated(white):
    """5000 experiments: five are stated, ten or fewer are within the interval."""
    assert white.first <= 10
    assert white.first / white.experiments <= 2 / EVERY


def test_a_large_change_is_found_at_once_and_the_bound_is_below(large):
    """A wave of twice the noise's energy: in its own experiment, by CUSUM too."""
    assert set(large.delays) == set(large.cusum) == {1}
    assert lorden(2.0, known=True) == lorden(2.0, known=False) == 1.0
    assert lorden(0.1, known=False) > lorden(0.1, known=True)


@pytest.mark.slow
def test_what_was_counted_is_not_counted_again(tmp_path, monkeypatch):
    """A second study in the same folder computes nothing, and finds the same."""
    plan = StudyPlan(seeds=1, groups=("alarms",))
    laws = [AlarmTask(0, size=2.0), AlarmTask(0, size=1.0)]
    monkeypatch.setattr(conduct, "alarm_tasks", lambda seeds: laws)
    first = conduct_study(plan, tmp_path, jobs=1)
    monkeypatch.setattr(conduct, "_work", None)
    again = conduct_study(plan, tmp_path, jobs=1)
    assert first.alarms == again.alarms
    assert [c.task for c in again.alarms] == laws


@pytest.mark.slow
def test_page_and_file_say_what_came_of_it(white, large, tmp_path):
    """Verdicts, both tables and the figure; a row for each run and one for never."""
    runs = tuple(made(setup=setup) for setup in SETUPS)
    study = Study({"groups": ("robustness", "alarms")}, (), robust=runs, alarms=(large, white))
    write_tables(tmp_path, study)
    rows = list(csv.DictReader((tmp_path / "robustness.csv").read_text().splitlines()))
    assert [r["setup"] for r in rows] == ["default", "never", *list(SETUPS)[1:]]
    assert float(rows[0]["left"]) == pytest.approx(0.126)
    assert Evidence(study).study.robust == runs
    page = write_study_page(study, tmp_path).read_text()
    assert "The default met 4 of 4 aims" in page
    assert "never found" in page
    assert "robust_streams-wide" in page
