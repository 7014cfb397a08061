"""Tuning: the budget is kept, the known answer found, and what cannot be known is said."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fake_tuning import NOISE, STEPS, Level, recording

from ldt_core.base.errors import BadInput, OptionError, RecordingError
from ldt_core.base.settings import resolve
from ldt_core.detectors.adequacy import Adequacy
from ldt_core.detectors.lddm import LDDM
from ldt_core.detectors.threshold import Threshold
from ldt_core.detectors.window import Window
from ldt_core.lab.tuning import in_control
from ldt_core.lab.tuning import tune as tune_module
from ldt_core.lab.tuning.candidates import NEVER, DetectorSetting, first_round, second_round
from ldt_core.lab.tuning.choice import Budget, choose, pareto
from ldt_core.lab.tuning.in_control import (
    FalseAlarms,
    chosen,
    control,
    false_alarm_rate,
    judged,
    limit_of,
    most,
    parse_ranges,
    row,
)
from ldt_core.lab.tuning.trial import Tried
from ldt_core.lab.tuning.tune import tune
from ldt_core.lab.tuning.tune_files import (
    FILE,
    TABLE,
    choice_sentence,
    settings,
    tuning_record,
    why,
    write_results,
)
from ldt_core.machine.machine_file import load_machine
from ldt_core.twin.loop import Twin

pytestmark = pytest.mark.slow

FAKE = Path(__file__).with_name("fake_tuning.py")
MACHINE = load_machine("dc_motor")
#: Learning as in the paper: what the known answers below take for granted.
SETTINGS = resolve({"model": f"{FAKE}:Level", "gate": "none", "data": "warning-set"})


@pytest.fixture(autouse=True)
def short_streams(monkeypatch, request):
    """Streams as short as they may be, where no rate of false alarms is looked at."""
    if {"tmp_path", "folder"} & set(request.fixturenames):
        monkeypatch.setattr(in_control, "STREAMS", 5)
        monkeypatch.setattr(in_control, "LENGTH", 20)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Of several tests: what one of them has tried is not tried again by the next."""
    return tmp_path_factory.mktemp("tuned")


def tuned(tmp_path, budget, experiments=None, **how):
    how = {"jobs": 1, "values": 4, "in_control": "1:20", **how}
    experiments = recording() if experiments is None else experiments
    return tune(MACHINE, SETTINGS, experiments, budget, tmp_path / "out", **how)


def made(detector="threshold", value=1.0, errors=(1.0,) * 10, adaptations=0):
    """What came of a setting, by hand."""
    action = ("adapted",) * adaptations + ("kept",) * (len(errors) - adaptations)
    level = tuple(1 if a == "adapted" else -1 for a in action)
    setting = DetectorSetting(detector, "threshold", value) if detector != "never" else NEVER
    return Tried(setting, tuple(errors), level, action, None, 0.0)


# ---- the known answer


def test_the_threshold_between_noise_and_drift_is_found(folder):
    """Four steps of 1 rad/s in noise of 0.1: four adaptations, one at each step, at the floor."""
    found = tuned(folder, Budget(adaptations=4), detectors=("threshold", "window"))
    best = found.choice.chosen
    assert best.setting.detector == "threshold"
    assert 0.3 < best.setting.value < 1.3
    adapted = [n for n, a in zip(found.numbers, best.action, strict=True) if a == "adapted"]
    assert adapted == list(STEPS)
    noise = np.mean([e for n, e in zip(found.numbers, best.max_error, strict=True) if n <= 20])
    assert best.mme == pytest.approx(noise + len(STEPS) / 60, rel=0.1)


def test_every_detector_keeps_the_budget_it_is_chosen_for(folder):
    """With fewer adaptations than drifts the error is larger, and the budget kept all the same."""
    errors = []
    for most_adaptations in (1, 2, 4, 60):
        found = tuned(folder, Budget(adaptations=most_adaptations))
        assert found.choice.chosen.adaptations <= most_adaptations
        errors.append(found.choice.chosen.mme)
    assert errors[0] > errors[1] > errors[2] * 1.2
    assert errors[3] == pytest.approx(errors[2], rel=0.02)


def test_a_stated_rate_of_false_alarms_is_kept(folder):
    """Chosen for one in 200, the detector is all but silent in control and finds the steps."""
    found = tuned(folder, Budget(every=200))
    best = found.choice.chosen
    assert sum(v == 1 for v in best.level[:20]) == 0
    assert {i for i, v in enumerate(best.level, start=1) if v == 1} >= set(STEPS)
    quiet = recording(steps=(), count=1000, seed=7)
    settings_ = {**SETTINGS, **best.setting.settings}
    false = sum(s.signal.level == 1 for s in Twin.from_settings(MACHINE, settings_).steps(quiet))
    assert false <= 12  # 5 are allowed; more than 12 has a chance of 0.2 %


def test_the_same_call_gives_the_same_result(tmp_path, monkeypatch):
    """Whatever the number of processes."""
    few = {"values": 2, "detectors": ("threshold",)}
    monkeypatch.undo()  # which another process would not see
    one = tuned(tmp_path / "one", Budget(adaptations=4), **few)
    two = tuned(tmp_path / "two", Budget(adaptations=4), **few, jobs=2)

    def plain(found):
        return [{**row_, "seconds": 0} for row_ in tuning_record(found)["tried"]], choice_sentence(
            found
        )

    assert plain(one) == plain(two)


def test_it_goes_on_where_it_was_interrupted(tmp_path, monkeypatch):
    """What was tried is not tried again; another recording is."""
    first = tuned(tmp_path, Budget(adaptations=4), values=3, detectors=("window",))

    def never_again(task):
        raise AssertionError("tried again")

    monkeypatch.setattr(tune_module, "try_setting", never_again)
    again = tuned(tmp_path, Budget(adaptations=4), values=3, detectors=("window",))
    assert choice_sentence(again) == choice_sentence(first)
    with pytest.raises(AssertionError, match="tried again"):
        tuned(tmp_path, Budget(adaptations=4), recording(seed=1), values=3, detectors=("window",))


# ---- the choice


def test_equal_errors_are_decided_by_fewer_adaptations():
    busy = made(value=1.0, errors=(1.0,) * 10, adaptations=5)
    calm = made(value=2.0, errors=(1.005,) * 10, adaptations=2)
    worse = made(value=3.0, errors=(1.2,) * 10, adaptations=1)
    assert choose([busy, calm, worse], Budget(adaptations=9)).chosen is calm


def test_without_a_setting_that_keeps_the_budget_the_nearest_is_named():
    far, near = made(value=1.0, adaptations=8), made(value=2.0, adaptations=4)
    choice = choose([made("never"), far, near], Budget(adaptations=3))
    assert choice.chosen is None
    assert choice.nearest is near


def test_no_learning_is_no_choice():
    """It keeps every budget, and is what others are compared with."""
    silent = made("never", errors=(0.5,) * 10)
    choice = choose([silent, made(adaptations=1)], Budget(adaptations=3))
    assert choice.chosen.setting != NEVER


def test_the_flattery_of_choosing_is_taken_out():
    """Twenty settings that differ by luck alone: the best seems good, by parts it is as any."""
    rng = np.random.default_rng(3)
    chosen_errors, checked = [], []
    for _ in range(60):
        drawn = rng.exponential(size=(20, 50))
        lucky = [made(value=v, errors=row_) for v, row_ in enumerate(drawn.tolist(), start=1)]
        choice = choose(lucky, Budget(adaptations=1))
        chosen_errors.append(choice.chosen.mme)
        checked.append(choice.checked)
    assert np.mean(chosen_errors) < 0.8
    assert np.mean(checked) == pytest.approx(1.0, abs=0.08)


def test_a_choice_beyond_doubt_is_the_same_by_parts():
    lucky = [made(value=v, errors=(1.0 + v / 100,) * 50) for v in range(1, 21)]
    clear = made(value=30.0, errors=(0.1,) * 50)
    sure = choose([*lucky, clear], Budget(adaptations=1))
    assert sure.chosen == clear
    assert sure.checked == pytest.approx(0.1)


def test_the_front_holds_what_nothing_beats():
    a = made(value=1, errors=(3.0,) * 10, adaptations=0)
    b = made(value=2, errors=(2.0,) * 10, adaptations=2)
    beaten = made(value=3, errors=(2.5,) * 10, adaptations=3)
    c = made(value=4, errors=(1.0,) * 10, adaptations=5)
    assert pareto([c, beaten, b, a]) == [a, b, c]


# ---- false alarms


def rows_of(largest):
    """Residuals with these largest errors."""
    return [(np.array([0.0, v, 0.0]), None) for v in largest]


def test_a_known_rate_lies_in_its_interval():
    """One experiment in ten has an error above 0.9."""
    found = false_alarm_rate(Threshold(0.9), rows_of(np.arange(1, 201) / 200))
    assert found.low < 0.1 < found.high
    assert found.rate == pytest.approx(0.1, abs=0.02)
    assert found.keep(5)
    assert not found.keep(20)


def test_few_experiments_show_little():
    """Twenty without an alarm: one in seven. The rest is extrapolated, and said to be."""
    rng = np.random.default_rng(0)
    rows = rows_of(np.exp(0.1 * rng.standard_normal(20)))
    limit = limit_of(rows, 1000)
    found = false_alarm_rate(Threshold(limit), rows)
    assert found.rate == 0
    assert 1 / found.high == pytest.approx(7.2, abs=0.05)
    assert found.law == pytest.approx(1e-3, rel=1e-3)
    assert found.keep(1000)
    assert not false_alarm_rate(Threshold(0.99 * limit), rows).keep(1000)
    assert most(0.0, 2995) <= 1e-3 < most(0.0, 2994)


def test_a_detector_without_a_law_is_believed_no_more_than_was_shown():
    rows = [(np.zeros(50), None)] * 20
    found = false_alarm_rate(LDDM(1.0), rows)
    assert (found.rate, found.law) == (0, None)
    assert found.keep(7)
    assert not found.keep(8)


def test_the_calendar_needs_no_experiments():
    found = false_alarm_rate(Window(10), rows_of([1.0, 2.0]))
    assert found.keep(10)
    assert not found.keep(11)


def test_the_adequacy_detector_is_taken_at_its_word_unless_it_breaks_it(monkeypatch):
    rng = np.random.default_rng(1)
    rows = [(NOISE * rng.standard_normal(50), None) for _ in range(20)]
    monkeypatch.setattr(in_control, "STREAMS", 10)
    assert false_alarm_rate(Adequacy(100), rows).keep(100)
    broken = FalseAlarms(rate=0.2, low=0.1, high=0.4, law=0.01)
    assert not broken.keep(100)


# ---- experiments in control


def test_a_stretch_in_control_ends_where_the_drift_begins():
    model = Level(MACHINE)
    rows = [row(model, e) for e in recording(steps=(31,), size=3.0)]
    found = judged(rows)
    assert set(found) <= set(range(30))
    assert len(found) >= 15


def test_a_machine_that_the_model_never_fits_has_no_stretch_in_control():
    model = Level(MACHINE)
    experiments = recording(steps=(1,), size=30.0)
    assert judged([row(model, e) for e in experiments]) == []


def test_a_model_that_has_learned_takes_the_untrained_one_s_place_where_it_is_better():
    model = Level(MACHINE)
    for size, learned in ((0.0, False), (5.0, True)):
        experiments = recording(steps=(1,), count=20, size=size)
        rows = [row(model, e) for e in experiments]
        found = control(experiments, rows, range(20), model, given=True)
        assert found.learned is learned
        assert max(np.abs(r).max() for r, _ in found.rows) < 1


@pytest.mark.parametrize("text", ["a", "5:1", "1-20", ",", "1:2:3"])
def test_bad_ranges_are_refused(text):
    with pytest.raises(OptionError, match="in-control"):
        parse_ranges(text)


@pytest.mark.parametrize("ranges", [[(1, 99)], [(0, 20)], [(3, 4)]])
def test_ranges_have_to_lie_in_the_recording_and_to_hold_enough(ranges):
    with pytest.raises(OptionError, match="in-control"):
        chosen(ranges, list(range(1, 61)))


# ---- what is tried


def test_the_first_round_spans_noise_to_the_largest_error():
    found = first_round(["threshold"], [0.4, 2.0, 10.0], noise=0.2, values=5)
    values = [s.value for s in found]
    assert (values[0], values[-1], len(values)) == (0.2, 10.0, 5)
    ratios = np.diff(np.log(values))
    assert np.ptp(ratios) < 0.02


def test_the_second_round_lies_around_the_best():
    tried = first_round(["threshold"], [1.0, 16.0], noise=1.0, values=5)
    fresh = second_round(DetectorSetting("threshold", "threshold", 4.0), tried)
    assert [s.value for s in fresh] == [2.52, 3.17, 5.04, 6.35]
    assert (
        second_round(
            DetectorSetting("window", "window", 2.0), [DetectorSetting("window", "window", 2.0)]
        )
        == []
    )


# ---- what is refused, and what is written


def test_bad_input_is_refused(tmp_path):
    with pytest.raises(OptionError, match="budget"):
        Budget()
    with pytest.raises(RecordingError, match="at least 10"):
        tuned(tmp_path, Budget(adaptations=4), recording(count=9), in_control="")
    with pytest.raises(OptionError, match="in-control"):
        tuned(tmp_path, Budget(every=10), recording(steps=(1,), size=30.0), in_control="")
    with pytest.raises(OptionError, match="did you mean 'lddm'"):
        tuned(tmp_path, Budget(adaptations=4), detectors=("lddn",))
    other = tmp_path / "out"
    other.mkdir()
    (other / "mine.txt").write_text("precious")
    with pytest.raises(BadInput, match="other files"):
        tuned(tmp_path, Budget(adaptations=4))


def test_without_experiments_in_control_the_rate_is_unknown(tmp_path):
    """A budget of adaptations alone does not need any."""
    far = recording(steps=(1, 30), size=30.0)
    how = {"in_control": "", "detectors": ("window",), "values": 2}
    found = tuned(tmp_path, Budget(adaptations=20), far, **how)
    assert found.control is None
    assert any("unknown" in s for s in why(found))
    assert tuning_record(found)["tried"][0]["false_alarm_rate"] is None


def test_what_it_writes_can_be_used(folder, tmp_path):
    """The settings are parameters that the twin takes; the table has a row a setting."""
    found = tuned(folder, Budget(adaptations=4, every=50))
    write_results(found, tmp_path)
    record = json.loads((tmp_path / FILE).read_text())
    assert resolve(record["settings"])["detector"] == found.choice.chosen.setting.detector
    assert record["settings"] == settings(found)
    assert record["settings"]["gate"] == "none"
    assert record["options"] in record["sentence"] or record["options"].startswith("--detector")
    with (tmp_path / TABLE).open() as file:
        table = list(csv.DictReader(file))
    assert len(table) == len(found.tried)
    assert [r["detector"] for r in table if r["chosen"] == "True"] == [
        record["settings"]["detector"]
    ]
    assert all(int(r["adaptations"]) <= 4 for r in table if r["keeps_budget"] == "True")


def test_the_reasons_name_what_was_given_up(folder):
    """A budget that costs error says how much, and every other detector its best."""
    found = tuned(folder, Budget(adaptations=2), detectors=("threshold", "window"))
    text = " ".join([choice_sentence(found), *why(found)])
    assert "at most 2 adaptations" in text
    assert "without the budget" in text
    assert "window: " in text
    assert "20 experiments (1 to 20, as given)" in text
    none = replace(found, choice=choose(found.tried, Budget(adaptations=1, every=1e9)))
    assert choice_sentence(none).startswith("none of the")
    assert "gained nothing" not in text
    still = replace(found, never=found.choice.chosen)
    assert "learning gained nothing" in " ".join(why(still))


def test_the_picture_is_drawn(folder, tmp_path):
    pytest.importorskip("matplotlib")
    from ldt_core.lab.tuning.tuning_figure import write_figure

    found = tuned(folder, Budget(adaptations=4, every=50), detectors=("threshold", "window"))
    without = replace(found, control=None, budget=Budget(adaptations=4))
    for case in (found, without, replace(found, budget=Budget(every=2))):
        for file in write_figure(case, tmp_path):
            assert file.stat().st_size > 10_000
