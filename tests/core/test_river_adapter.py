"""River's detectors behind our protocol."""

import json
import sys

import numpy as np
import pytest

from ldt_core.base.errors import OptionError
from ldt_core.detectors import build_detector, river_adapter
from ldt_core.detectors.river_adapter import River

drift = pytest.importorskip("river.drift")


def experiments(count=60, change=30):
    """Residuals whose spread triples after `change` experiments."""
    rng = np.random.default_rng(5)
    return [rng.normal(0, 1.0 if i < change else 3.0, 40) for i in range(count)]


@pytest.mark.parametrize(
    ("detector", "theirs", "values"),
    [
        (
            River("PageHinkley", min_instances=5, threshold=5.0),
            drift.PageHinkley(min_instances=5, threshold=5.0),
            lambda r: [abs(r).max()],
        ),
        (River("ADWIN", "absolute"), drift.ADWIN(), abs),
        (River("DDM", "errors", 0.7), drift.binary.DDM(), lambda r: abs(r) > 0.7),
    ],
    ids=["PageHinkley", "ADWIN", "DDM"],
)
def test_it_finds_the_drift_where_river_does(detector, theirs, values):
    """The first positive comes with the experiment in which river's own object detects."""
    found = expected = None
    for i, residual in enumerate(experiments()):
        detector.update(residual)
        found = i if detector.drift_detected and found is None else found
        for value in values(residual):
            theirs.update(value)
            expected = i if theirs.drift_detected and expected is None else expected
    assert found == expected
    assert found is not None
    assert found >= 30, "it found a drift before there was one"


def test_a_warning_of_river_is_ours():
    """A binary detector that warns on the way to its drift warns here as well."""
    detector = River("DDM", "errors", error_threshold=2.0)
    answers = []
    rng = np.random.default_rng(1)
    for i in range(40):
        detector.update(rng.normal(0, 1.0 + 0.02 * i, 40))
        answers.append(int(detector.signal))
    assert 0 in answers[: answers.index(1)]


@pytest.mark.parametrize("most", [100, 64, 7])
def test_forgetting_old_values_survives_a_restart(monkeypatch, most):
    """Above the bound the running detector forgets, so that a restored one is the same."""
    monkeypatch.setattr(river_adapter, "MOST_VALUES", most)
    whole, parts = (River("ADWIN", "absolute", clock=1) for _ in range(2))
    for residual in experiments():
        whole.update(residual)
        parts.update(residual)
        assert len(parts.values) <= most
        restored = parts.clone()
        restored.restore(json.loads(json.dumps(parts.state())))
        parts = restored
        assert parts.state() == whole.state()
        assert parts._river.estimation == whole._river.estimation


@pytest.mark.slow
def test_detectors_that_draw_random_numbers_are_seeded():
    """KSWIN is random unless it has a seed; two runs must agree."""
    answers = []
    for _ in range(2):
        detector = River("KSWIN", "residual", alpha=0.01)
        row = []
        for residual in experiments(40, 20):
            detector.update(residual)
            row.append(int(detector.signal))
        answers.append(row)
    assert answers[0] == answers[1]
    assert 1 in answers[0]


def test_without_river_the_sentence_says_what_to_install(monkeypatch):
    """The extra is optional."""
    monkeypatch.setitem(sys.modules, "river", None)
    with pytest.raises(OptionError, match=r"pip install ldt\[river\]"):
        River()


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (["river_detector=ADWINN"], ("river_detector", "did you mean 'ADWIN'", "'ADWINN'")),
        (["input=worst"], ("input", "'max_error'", "'worst'")),
        (["river_detector=DDM"], ("DDM", "'errors'", "'max_error'")),
        (["input=errors"], ("ADWIN", "any but 'errors'", "'errors'")),
        (["delta=0.1", "dleta=2"], ("river_arguments", "delta", "dleta")),
    ],
)
def test_bad_arguments_are_named(settings, words):
    """The sentence names the argument, what there is, and the value."""
    with pytest.raises(OptionError) as caught:
        build_detector("river", {"detector_argument": settings})
    assert all(word in str(caught.value) for word in words), str(caught.value)


@pytest.mark.parametrize("values", [["a"], [None], 3, [[1.0]], [float("nan")]])
def test_a_foreign_state_is_refused(values):
    """Values that are no numbers are not fed to river."""
    detector = River()
    with pytest.raises(OptionError, match="values"):
        detector.restore({"values": values, "signal": -1})
    assert detector.state() == River().state()
