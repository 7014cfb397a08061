"""Which runs make up a study."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from study_results import made_up

from ldt_core.lab.study.baselines import baseline_cases, periodic, random
from ldt_core.lab.study.facts import stream_key
from ldt_core.lab.study.study_plan import OTHER_DRIFTS, THRESHOLDS, StudyPlan, at_threshold


def in_group(plan: StudyPlan, group: str):
    return [p.case for p in plan.runs() if group in p.groups]


def test_the_papers_table_has_each_model_under_each_detector_on_each_seed():
    """Two models, three detectors, to the letter: no gate, the warning set alone."""
    cases = in_group(StudyPlan(seeds=20), "paper")
    count = Counter((c.model, c.detector) for c in cases)
    assert set(count) == {
        (m, d) for m in ("linear", "hybrid") for d in ("threshold", "lddm", "window")
    }
    assert set(count.values()) == {20}
    for case in cases:
        assert (case.resolved["gate"], case.resolved["data"]) == ("none", "warning-set")
        if case.detector == "threshold":
            assert case.resolved["warning_threshold"] == case.resolved["threshold"] / 2


def test_no_run_is_made_twice():
    """A run that serves several groups is there once."""
    runs = StudyPlan(seeds=6).runs()
    assert len({p.case.key for p in runs}) == len(runs)
    assert any(set(p.groups) == {"paper", "sweep"} for p in runs)
    assert any(set(p.groups) == {"better", "kinds"} for p in runs)


def test_all_runs_of_a_seed_meet_one_stream():
    """Apart from those with another kind of drift or start."""
    for plan in (StudyPlan(seeds=2, groups=("paper", "sweep", "better")),):
        streams = {(p.case.seed, stream_key(p.case)) for p in plan.runs()}
        assert len(streams) == 2


def test_the_sweep_covers_the_thresholds_of_the_table():
    """Eight values over the range, the table's among them, for both models and detectors."""
    cases = in_group(StudyPlan(seeds=3), "sweep")
    for detector, name in (("threshold", "threshold"), ("lddm", "error_threshold")):
        for model in ("linear", "hybrid"):
            own = [c for c in cases if (c.model, c.detector) == (model, detector)]
            assert sorted({c.resolved[name] for c in own}) == list(THRESHOLDS)
            assert len(own) == 3 * len(THRESHOLDS)
    assert at_threshold("threshold", 3.0)["warning_threshold"] == 1.5


def test_other_drifts_are_learned_on_fewer_seeds():
    """Every kind, and an unknown start angle for the diagnosed model."""
    cases = in_group(StudyPlan(seeds=20), "kinds")
    kinds = {c.resolved["degradation"] for c in cases}
    assert kinds == {"", *OTHER_DRIFTS}
    assert len({c.seed for c in cases}) == 5
    assert {c.model for c in cases if c.resolved["start"] == "random"} == {"diagnosed"}


def test_each_variant_differs_from_the_table_in_one_choice():
    """So that its figure says what the choice does."""
    table = {c.model: c for c in in_group(StudyPlan(1), "paper") if c.detector == "threshold"}
    for case in in_group(StudyPlan(1), "variants"):
        base = table[case.model].resolved
        assert len([n for n, v in case.resolved.items() if v != base[n]]) == 1


def test_streams_without_drift_are_many():
    """200 of a machine as its file says. Of another one silence would be no success."""
    cases = in_group(StudyPlan(seeds=20), "control")
    assert {c.resolved["degradation"] for c in cases} == {"none"}
    assert {(c.model, c.detector, *c.resolved["effect"]) for c in cases} == {
        ("diagnosed", "adequacy")
    }
    assert len(cases) == 200


@pytest.mark.parametrize(
    ("machine", "cause"), [("rotor", "unbalance"), ("dc_motor", "coulomb_friction")]
)
def test_the_diagnosed_model_is_told_what_kind_of_wear_to_expect(machine, cause):
    """That of the machine file, and no more."""
    cases = [c for c in in_group(StudyPlan(1, machine=machine), "better") if c.model == "diagnosed"]
    assert {c.resolved["cause"] for c in cases} == {cause}


def test_only_the_groups_asked_for_are_run():
    """And a part of a study has the same runs as the whole, so that one completes the other."""
    whole = {p.case.key for p in StudyPlan(seeds=2).runs()}
    for group in ("paper", "variants", "sweep", "better", "control", "kinds"):
        part = StudyPlan(seeds=2, groups=(group,)).runs()
        assert {p.groups for p in part} == {(group,)}
        assert {p.case.key for p in part} < whole
    assert StudyPlan(seeds=2, groups=("baseline",)).runs() == []


def test_more_seeds_keep_the_runs_of_fewer():
    """A study can be extended."""
    few = {p.case.key for p in StudyPlan(seeds=2).runs()}
    assert few < {p.case.key for p in StudyPlan(seeds=3).runs()}


def test_figures_find_their_experiments_on_the_first_seed():
    """The paper's 92nd of 200 among them; no other seed keeps any."""
    cases = [p.case for p in StudyPlan(seeds=3).runs()]
    kept = {c.seed: set() for c in cases}
    for case in cases:
        kept[case.seed] |= set(case.keep)
    assert {1, 92, 200} <= kept[0]
    assert kept[1] == kept[2] == set()
    assert all(1 <= n <= 3 for n in StudyPlan(experiments=3).kept)


@given(st.integers(1, 300), st.data())
def test_a_baseline_has_as_many_alarms_as_it_is_asked_for(experiments, data):
    """Different experiments of the stream, in order; the periodic ones evenly."""
    count = data.draw(st.integers(0, experiments))
    for alarms in (periodic(count, experiments), random(count, experiments, seed=5)):
        assert len(set(alarms)) == len(alarms) == count
        assert list(alarms) == sorted(alarms)
        assert all(1 <= n <= experiments for n in alarms)
    even = periodic(count, experiments)
    gaps = [b - a for a, b in pairwise(even)]
    assert not gaps or max(gaps) - min(gaps) <= 1


def test_random_alarms_come_with_the_seed():
    """The same again, others on another stream."""
    assert random(20, 200, seed=1) == random(20, 200, seed=1) != random(20, 200, seed=2)


def test_a_baseline_differs_from_its_run_by_the_alarms_alone():
    """Same model, stream and way to learn, as many alarms as the run adapted."""
    run = made_up([0.0] * 30, [4, 9, 20], adapted=[4, 20], threshold=2.0, gate="none")
    for case in baseline_cases(run):
        assert len(case.alarms) == 2
        assert (case.model, case.seed, case.resolved["gate"]) == ("hybrid", 0, "none")
        assert stream_key(case) == stream_key(run.case)
    assert [c.detector for c in baseline_cases(run)] == ["periodic", "random"]
    assert baseline_cases(made_up([0.0] * 30)) == []


def test_runs_that_adapted_equally_often_share_a_baseline():
    """It is run once and stands beside both."""
    plan = StudyPlan(seeds=1, experiments=30)
    runs = [p for p in plan.runs() if p.groups[0] == "paper" and p.case.model == "hybrid"]
    results = [made_up([0.0] * 30, [5, 8], detector=p.case.detector) for p in runs]
    made = [(p, _with_case(r, p.case)) for p, r in zip(runs, results, strict=True)]
    baselines = plan.baselines(made)
    assert [b.case.detector for b in baselines] == ["periodic", "random"]
    assert all(set(b.beside) == {p.case.key for p in runs} for b in baselines)


def _with_case(result, case):
    return replace(result, case=case)


@pytest.mark.parametrize("group", ["sweep", "kinds"])
def test_only_the_table_and_what_beats_it_have_baselines(group):
    """The others are compared with those."""
    plan = StudyPlan(seeds=1, experiments=30, groups=(group, "baseline"))
    made = [(p, _with_case(made_up([0.0] * 30, [5]), p.case)) for p in plan.runs()]
    assert plan.baselines(made) == []


def test_streams_stay_together_and_long_runs_come_first():
    """So that each process simulates a stream once and none waits long for the last run."""
    order = [p.case for p in sorted(StudyPlan(seeds=3).runs(), key=lambda p: p.order)]
    assert [c.seed for c in order] == sorted(c.seed for c in order)
    first = [c for c in order if c.seed == 0]
    assert (first[0].model, first[0].detector) == ("diagnosed", "threshold")
