"""A whole study: computed once, gone on with, put together."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from ldt_core.base.errors import BadInput, LdtError
from ldt_core.lab.study import engine
from ldt_core.lab.study.engine import conduct
from ldt_core.lab.study.facts import stream_key
from ldt_core.lab.study.study_plan import StudyPlan
from ldt_core.machine.machine_file import load_machine

pytestmark = pytest.mark.slow


def plan(rotor: str, **other) -> StudyPlan:
    """12 runs on two streams, and their baselines."""
    return replace(StudyPlan(2, 7, rotor, ("paper", "baseline")), **other)


@pytest.fixture(scope="module")
def whole(short_rotor, tmp_path_factory):
    """(folder, study) of a small study in two processes."""
    out = tmp_path_factory.mktemp("study") / "out"
    return out, conduct(plan(short_rotor), out, jobs=2)


def without_times(study):
    """What does not depend on how fast the machine was."""
    entries = [replace(e, result=replace(e.result, seconds=0.0)) for e in study.entries]
    return entries, study.facts


class Counted:
    """The worker's function, counting; above `most` it fails as if interrupted."""

    def __init__(self, monkeypatch, most: int = 10**9) -> None:
        self.count, self.most = 0, most
        self.work = engine.work
        monkeypatch.setattr(engine, "work", self)

    def __call__(self, task):
        if self.count >= self.most:
            raise KeyboardInterrupt
        self.count += 1
        return self.work(task)


def test_a_study_has_all_runs_and_the_truth_of_all_streams(whole):
    """Each with its groups, and baselines beside each run that adapted."""
    _, study = whole
    assert len(study.results("paper")) == 12
    for result in study.results():
        assert study.facts_of(result).seed == result.case.seed
        assert list(study.facts_of(result).truth) == result.truth
    for result in study.results("paper"):
        names = set(study.baselines(result))
        assert names == ({"never", "periodic", "random"} if result.adaptations else {"never"})
        for other in study.baselines(result).values():
            assert other.truth == result.truth
            assert other.original == result.original
    assert any(r.adaptations for r in study.results("paper"))


def test_results_are_selected_by_what_was_run(whole):
    """By group, model and detector."""
    _, study = whole
    one = study.results("paper", model="hybrid", detector="lddm")
    assert [r.case.seed for r in one] == [0, 1]
    assert len(study.results("paper", detector="threshold")) == 4
    assert next(iter(study.pairs("paper"))) == ("linear", "threshold")
    with pytest.raises(BadInput, match="did you mean"):
        study.results("papers")


def test_how_many_processes_compute_changes_nothing(whole, short_rotor, tmp_path):
    """One or two: the same to the last bit."""
    _, study = whole
    assert without_times(conduct(plan(short_rotor), tmp_path / "one", jobs=1)) == without_times(
        study
    )


def test_what_is_there_is_not_computed_again(whole, short_rotor, monkeypatch):
    """The same study, and nothing to do."""
    out, study = whole
    counted, seen = Counted(monkeypatch), []
    again = conduct(plan(short_rotor), out, jobs=1, progress=lambda *at: seen.append(at))
    assert counted.count == 0
    assert without_times(again) == without_times(study)
    assert all(done == total for done, total in seen)


def test_an_interrupted_study_goes_on(whole, short_rotor, tmp_path, monkeypatch):
    """What was finished is not run again, and the result is that of a study in one go."""
    _, study = whole
    total = len(study.entries) + len(study.facts)
    interrupted = Counted(monkeypatch, most=5)
    with pytest.raises(KeyboardInterrupt):
        conduct(plan(short_rotor), tmp_path, jobs=1)
    assert interrupted.count == 5
    assert len(list((tmp_path / "runs").iterdir())) == 4  # and the facts of their stream
    monkeypatch.undo()
    rest = Counted(monkeypatch)
    assert without_times(conduct(plan(short_rotor), tmp_path, jobs=1)) == without_times(study)
    assert rest.count == total - 5


def test_a_damaged_result_is_computed_again_and_said(whole, short_rotor, tmp_path, monkeypatch):
    """As is one of another version; the rest is used."""
    small = plan(short_rotor, seeds=1, groups=("paper",))
    first = conduct(small, tmp_path, jobs=1)
    files = sorted((tmp_path / "runs").iterdir())
    files[0].write_text(files[0].read_text()[:-40])
    record = json.loads(files[1].read_text())
    assert record["case"]["seed"] == 0  # what was run, in words for other programs
    record["origin"]["numpy"] = "0.1"
    record["content"]["max_error"] = [0.0] * 7
    files[1].write_text(json.dumps(record))
    counted = Counted(monkeypatch)
    again = conduct(small, tmp_path, jobs=1)
    assert counted.count == 2
    assert without_times(again) == without_times(first)
    assert any(files[0].name in note for note in again.notes)
    assert any("another version" in note for note in again.notes)


def test_a_failed_run_says_which(short_rotor, tmp_path, monkeypatch):
    """And what was computed before it is kept."""

    def fail(case, machine):
        if case.model == "hybrid":
            raise ZeroDivisionError("somewhere")
        return run_case(case, machine)

    run_case = engine.run_case
    monkeypatch.setattr(engine, "run_case", fail)
    small = plan(short_rotor, seeds=1, groups=("paper",))
    with pytest.raises(LdtError, match=r"hybrid model, .* detector, seed 0: ZeroDivisionError"):
        conduct(small, tmp_path, jobs=1)
    assert list((tmp_path / "runs").iterdir())


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"groups": ("baseline",)}, "paper or better"),
        ({"groups": ("papers",)}, "'papers'"),
        ({"machine": "roter"}, "rotor"),
        ({"machine": "STEADY", "groups": ("kinds",)}, "degradation"),
    ],
)
def test_a_plan_that_cannot_be_run_is_refused_at_once(short_rotor, tmp_path, change, words):
    """Before a folder is made; the steady machine has nothing that wears."""
    if change.get("machine") == "STEADY":
        data = yaml.safe_load(Path(short_rotor).read_text())
        del data["simulation"]["degradation"]
        (tmp_path / "steady.yaml").write_text(yaml.safe_dump(data))
        change = {**change, "machine": str(tmp_path / "steady.yaml")}
    with pytest.raises(BadInput, match=words):
        conduct(plan(short_rotor, **change), tmp_path / "out", jobs=1)
    assert not (tmp_path / "out").exists()


def test_a_folder_of_something_else_is_left_alone(short_rotor, tmp_path):
    """Nothing is written to it."""
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(BadInput, match=str(tmp_path)):
        conduct(plan(short_rotor), tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]
    with pytest.raises(BadInput, match="a file"):
        conduct(plan(short_rotor), tmp_path / "thesis.tex")


def test_streams_of_other_drifts_have_facts_of_their_own(short_rotor):
    """The runs of the group kinds do not share the staircase's."""
    kinds = [p.case for p in plan(short_rotor, groups=("kinds",)).runs()]
    machine = load_machine(short_rotor)
    keys = {stream_key(c) for c in kinds}
    assert len(keys) == 2 * 6  # the staircase, four other kinds, an unknown start
    assert engine.work(("facts", kinds[0], machine)).seed == kinds[0].seed
