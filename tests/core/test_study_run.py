"""One run of a study."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest

from ldt_core.base.errors import OptionError
from ldt_core.base.settings import resolve
from ldt_core.lab.study.baselines import never
from ldt_core.lab.study.engine import run_case
from ldt_core.lab.study.stream import stream
from ldt_core.lab.study.study_case import StudyCase
from ldt_core.machine import Plant
from ldt_core.machine.machine_file import load_machine
from ldt_core.runs import offline

LITERAL = {"gate": "none", "data": "warning-set"}


def case(machine: str, model: str = "hybrid", detector: str = "lddm", **more) -> StudyCase:
    return StudyCase(model, detector, 3, 10, machine, LITERAL, **more)


def test_a_stream_is_what_the_plant_makes_whatever_the_clock(short_rotor):
    """Its experiments and its truth are the plant's; the start of the run does not come in."""
    made = stream(case(short_rotor))
    settings = resolve({"experiments": 10, "seed": 3, "start_time": 5e8})
    plant = Plant.from_settings(load_machine(short_rotor), settings)
    for experiment, truth in zip(made.experiments, made.truth, strict=True):
        same = plant.experiment(experiment.number)
        assert np.array_equal(experiment.speed, same.speed)
        assert np.array_equal(experiment.voltage, same.voltage)
        assert truth == plant.truth(experiment.number)["unbalance"]["e"]
    assert made.experiments[0].start == 0.0
    assert not made.region[0].any() or made.truth[0] > 0


def test_models_and_detectors_meet_the_same_stream(short_rotor):
    """A stream is simulated once a process for all that learn on it."""
    assert stream(case(short_rotor)) is stream(case(short_rotor, "linear", "window"))
    other = replace(case(short_rotor), settings={**LITERAL, "start": "random"})
    assert stream(other) is not stream(case(short_rotor))


@pytest.mark.parametrize("detector", ["lddm", "threshold"])
def test_a_run_is_what_the_loop_gives(short_rotor, detector):
    """`ldt run` sums the same experiments up to the same figures."""
    one = case(short_rotor, detector=detector)
    result = run_case(one)
    summary = offline.run(
        load_machine(short_rotor), one.resolved, stream(one).experiments, bag=None
    ).as_dict()
    assert summary["mme"] == pytest.approx(np.mean(result.max_error), rel=1e-12)
    assert summary["mme_original"] == pytest.approx(np.mean(result.original), rel=1e-12)
    assert summary["adaptations"] == len(result.adaptations) > 0
    assert result.number == list(range(1, 11))


def test_a_script_of_alarms_is_followed(short_rotor):
    """Positive there and nowhere else; until the first the twin is the original model."""
    result = run_case(case(short_rotor, detector="periodic", alarms=(4, 8)))
    assert result.positives == result.adaptations == [4, 8]
    assert set(result.level) == {1, -1}
    assert result.max_error[:4] == pytest.approx(result.original[:4], abs=1e-3)
    assert result.max_error[4:] != pytest.approx(result.original[4:], abs=1e-3)


def test_never_is_the_run_of_the_detector_that_never_answers(short_rotor):
    """Taken from any run on the stream, without running it."""
    derived = never(run_case(case(short_rotor)))
    run = run_case(case(short_rotor, "physics", "never"))
    for rows in ("number", "truth", "max_error", "level", "action", "region_rmse"):
        assert getattr(derived, rows) == getattr(run, rows)
    assert derived.adaptations == []


def test_experiments_are_kept_for_figures(short_rotor):
    """Those asked for, with what was measured and predicted, and no others."""
    result = run_case(case(short_rotor, keep=(2, 9)))
    assert sorted(result.kept) == [2, 9]
    series, experiment = result.kept[9], stream(result.case).experiments[8]
    assert series["speed"] == pytest.approx(experiment.speed, abs=1e-4)
    error = np.abs(np.subtract(series["speed"], series["prediction"])).max()
    assert error == pytest.approx(result.max_error[8], abs=2e-4)


def test_the_region_counts_where_the_speed_is_in_it(short_rotor):
    """With the eccentricity at 0 nothing is in the region, worn the rotor gets into it."""
    result = run_case(case(short_rotor))
    for truth, inside in zip(result.truth, result.region_rmse, strict=True):
        assert truth > 0 or inside is None
    assert any(inside is not None for inside in result.region_rmse)


@pytest.mark.slow
def test_a_run_is_the_same_in_another_process(short_rotor):
    """Bit by bit."""
    result = run_case(case(short_rotor))
    program = (
        "import json, sys; from ldt_core.lab.study.study_case import StudyCase;"
        "from ldt_core.lab.study.engine import run_case;"
        f"r = run_case(StudyCase('hybrid', 'lddm', 3, 10, {short_rotor!r}, {LITERAL!r}));"
        "print(json.dumps([r.max_error, r.level, r.region_rmse]))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    expected = [result.max_error, result.level, result.region_rmse]
    assert json.loads(done.stdout) == expected


def test_an_unknown_model_is_refused(short_rotor):
    """By name."""
    with pytest.raises(OptionError, match="lineer"):
        run_case(case(short_rotor, model="lineer"))


def test_a_run_takes_no_more_time_than_passes(short_rotor):
    """And some."""
    begin = time.perf_counter()
    result = run_case(case(short_rotor))
    assert 0 < result.seconds <= time.perf_counter() - begin
