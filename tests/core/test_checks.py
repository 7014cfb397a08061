"""Every detector keeps the promises of the protocol, and the suite finds one that does not."""

import json
import math
from importlib.metadata import EntryPoint

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import msgs_config
from ldt_core.base import registry
from ldt_core.base.errors import OptionError
from ldt_core.base.experiment import Level
from ldt_core.base.settings import resolve
from ldt_core.checks import check_detector
from ldt_core.checks.detector_checks import DETECTOR_CHECKS
from ldt_core.detectors import DETECTORS, build_detector
from ldt_core.detectors.base import Detector
from ldt_core.detectors.lddm import LDDM
from ldt_core.detectors.threshold import Threshold
from ldt_core.detectors.window import Window

#: Detectors that are positive at zero residual, and why.
NOT_QUIET = {
    "window": "it goes by the calendar",
    "LDDM(literal)": "the paper's inequality holds with equality at zero error",
}

USER_DETECTOR = '''
from ldt_core.detectors.base import Detector
from ldt_core.base.experiment import Level

class Median(Detector):
    """Positive when the median error is above a limit twice running."""

    name = "median"
    warns = False

    def __init__(self, limit=1.0):
        self.limit = limit
        if limit <= 0:
            raise ValueError("limit must be above 0")
        self.reset()

    def reset(self):
        super().reset()
        self.above = 0

    def judge(self, residual, deviation):
        self.above = self.above + 1 if abs(residual).mean() > self.limit else 0
        return Level.POSITIVE if self.above == 2 else Level.NEGATIVE
'''


#: All registered detectors with their defaults, and the literal LDDM.
ALL = [
    *(pytest.param(name, {}, id=name) for name in DETECTORS.names()),
    pytest.param("lddm", {"literal": True}, id="LDDM(literal)"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "arguments"), ALL)
def test_every_detector_keeps_its_promises(name, arguments, request):
    """The suite that users run on theirs."""
    if name == "river":
        pytest.importorskip("river")
    detector = DETECTORS.get(name)(**arguments)
    exempt = request.node.callspec.id in NOT_QUIET
    check_detector(detector, skip=("quiet_at_zero",) if exempt else ())
    if exempt:
        with pytest.raises(AssertionError, match="quiet_at_zero"):
            check_detector(detector)


@pytest.mark.parametrize("name", sorted(DETECTORS.builtin))
def test_defaults_are_the_declared_ones(name):
    """Constructor and parameters.yaml agree, so that a script and a command start alike."""
    if name == "river":
        pytest.importorskip("river")
    plain = DETECTORS.get(name)()
    assert build_detector(name, resolve({}, "detector")).get_params() == plain.get_params()
    declared = msgs_config.parameters("detector")
    shared = set(plain.get_params()) & set(declared)
    assert {n: declared[n]["default"] for n in shared} == {n: plain.get_params()[n] for n in shared}


def test_every_declared_argument_belongs_to_a_detector():
    """No option of the group detector is left over."""
    pytest.importorskip("river")
    taken = {n for name in DETECTORS.builtin for n in DETECTORS.get(name)().get_params()}
    assert set(msgs_config.parameters("detector")) <= taken | {"detector", "detector_argument"}


def test_every_detector_s_docstring_has_an_example():
    """It is run with all others, see `tests/test_house.py`."""
    pytest.importorskip("river")
    assert [n for n in DETECTORS.builtin if ">>>" not in (DETECTORS.get(n).__doc__ or "")] == []


@pytest.mark.slow
@given(
    st.sampled_from(["threshold", "lddm", "window", "never"]),
    st.lists(st.lists(st.floats(-4, 4), min_size=1, max_size=8), max_size=20),
    st.lists(st.lists(st.floats(-4, 4), min_size=1, max_size=8), max_size=20),
)
def test_a_restart_changes_nothing(name, before, after):
    """State through JSON text into a new object: signals, statistics and state go on equally."""
    own = DETECTORS.get(name)()
    for residual in before:
        own.update(residual)
    restored = own.clone()
    restored.restore(json.loads(json.dumps(own.state(), allow_nan=False)))
    for residual in after:
        assert (restored.signal, restored.statistics) == (own.signal, own.statistics)
        own.update(residual)
        restored.update(residual)
    assert restored.state() == own.state()


def test_a_user_s_file_is_built_and_checked(tmp_path):
    """`path/to/file.py:Name`, with an argument that has no option of its own."""
    path = tmp_path / "median.py"
    path.write_text(USER_DETECTOR)
    settings = resolve({"detector_argument": ["limit=2.5"]}, "detector")
    detector = build_detector(f"{path}:Median", settings)
    assert detector.get_params() == {"limit": 2.5}
    check_detector(detector)
    for entry, words in {
        "limit=-1": "limit must be above 0",
        "limti=1": "did you mean 'limit'",
    }.items():
        with pytest.raises(OptionError, match=words):
            build_detector(f"{path}:Median", {"detector_argument": [entry]})
    with pytest.raises(OptionError, match="subclass of Detector"):
        build_detector(f"{path}:Level", {})


def test_a_user_s_entry_point_is_found(tmp_path, monkeypatch):
    """Group ldt.detector, by its name."""
    (tmp_path / "their_median.py").write_text(USER_DETECTOR)
    monkeypatch.syspath_prepend(str(tmp_path))
    entry = EntryPoint("median", "their_median:Median", "ldt.detector")
    monkeypatch.setattr(registry, "entry_points", lambda group: [entry])
    assert "median" in DETECTORS.names()
    check_detector(build_detector("median", resolve({}, "detector")))


@pytest.mark.parametrize(
    ("entry", "value"),
    [("1e-3", 1e-3), ("2", 2), ("true", True), ("null", None), ("word", "word"), (" 0.5", 0.5)],
)
def test_an_argument_is_read_as_a_yaml_scalar(entry, value, tmp_path):
    """Numbers as people write them, true, null, words."""
    path = tmp_path / "any.py"
    path.write_text(USER_DETECTOR.replace("if limit <= 0:", "if limit == -1:"))
    detector = build_detector(f"{path}:Median", {"detector_argument": [f"limit={entry}"]})
    assert detector.limit == value
    assert type(detector.limit) is type(value)


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ("threshold", "NAME=VALUE"),
        ("=3", "NAME=VALUE"),
        ("threshold=[1]", "a number, a word"),
        ("threshold={", "a number, a word"),
        ("threshold=!!python/object/apply:os.getcwd []", "a number, a word"),
        ("threshold=high", "threshold: expected a finite number, got 'high'"),
        ("treshold=3", "did you mean 'threshold'"),
    ],
)
def test_a_bad_argument_is_named(entry, words):
    """One sentence with the entry; nothing is evaluated."""
    with pytest.raises(OptionError) as caught:
        build_detector("threshold", {"detector_argument": [entry]})
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("detector", "arguments", "words"),
    [
        (LDDM, {"error_threshold": -1.0}, ("error_threshold", "0 to 1e+09 rad/s", "-1")),
        (LDDM, {"drift_level": math.inf}, ("drift_level", "finite", "inf")),
        (LDDM, {"drift_level": 1.0}, ("warning_level", "drift_level (1)", "2")),
        (LDDM, {"warning_level": -2.0}, ("warning_level", "0 to 1000", "-2")),
        (LDDM, {"literal": 1}, ("literal", "true or false", "1")),
        (Threshold, {"threshold": -1.0}, ("threshold", "0 to 1e+09 rad/s", "-1")),
        (Threshold, {"threshold": math.nan}, ("threshold", "finite", "nan")),
        (Threshold, {"threshold": "3"}, ("threshold", "number", "'3'")),
        (Threshold, {"threshold": True}, ("threshold", "number", "True")),
        (
            Threshold,
            {"threshold": 1.0, "warning_threshold": 2.0},
            ("warning_threshold", "(1 rad/s)", "2"),
        ),
        (Threshold, {"warning_threshold": -0.5}, ("warning_threshold", "0 to", "-0.5")),
        *((Window, {"window": w}, ("window", str(w))) for w in (0, -3, 1.5, "10", True)),
    ],
)
def test_an_argument_outside_its_range_is_named(detector, arguments, words):
    """The sentence names the argument, its range and the value."""
    with pytest.raises(OptionError) as caught:
        detector(**arguments)
    assert all(word in str(caught.value) for word in words), str(caught.value)


@pytest.mark.parametrize(
    "state",
    [
        None,
        [],
        {},
        {"signal": 0},
        {"errors": 0, "samples": 0, "p_min": None, "s_min": None, "signal": 5},
        {"errors": "0", "samples": 0, "p_min": None, "s_min": None, "signal": 0},
        {"errors": 0, "samples": 0, "p_min": "low", "s_min": None, "signal": 0},
        {"errors": 0, "samples": 0, "p_min": float("inf"), "s_min": None, "signal": 0},
        {"errors": 0, "samples": 0, "p_min": None, "s_min": None, "signal": 0, "more": 1},
    ],
)
def test_a_foreign_state_is_refused(state):
    """Missing or further keys, other types, and numbers that are not finite."""
    detector = LDDM()
    with pytest.raises(OptionError, match="state of detector lddm"):
        detector.restore(state)
    assert detector.state() == LDDM().state()


@pytest.mark.parametrize(
    ("residual", "deviation", "words"),
    [
        ([], None, "row of samples"),
        ([[1.0]], None, "shape (1, 1)"),
        ([0.0, np.nan], None, "nan at sample 1"),
        ([0.0, 1.0], [1.0], "deviation"),
    ],
)
def test_a_bad_residual_is_named(residual, deviation, words):
    """`update` refuses at the door."""
    with pytest.raises(ValueError) as caught:
        Threshold().update(residual, deviation)
    assert words in str(caught.value)


class Base(Detector):
    """A detector that does right; each of the following breaks one promise."""

    name = "base"

    def __init__(self, limit=1.0):
        self.limit = limit
        self.reset()

    def reset(self):
        super().reset()
        self.count = 0

    def judge(self, residual, deviation):
        self.count += 1
        return Level.POSITIVE if abs(residual).max() > self.limit else Level.NEGATIVE


class RenamesItsArgument(Base):
    def __init__(self, limit=1.0):
        super().__init__(2 * limit)


class SharesItsState(Base):
    seen: list = []  # noqa: RUF012

    def state(self):
        return super().state() | {"seen": len(self.seen)}

    def judge(self, residual, deviation):
        self.seen.append(1)
        return super().judge(residual, deviation)


class ReturnsItself(Base):
    def update(self, residual, deviation=None):
        super().update(residual, deviation)
        return self


class WarnsAllTheSame(Base):
    warns = False

    def judge(self, residual, deviation):
        return Level.WARNING


class ThrowsDice(Base):
    def judge(self, residual, deviation):
        return Level(int(np.random.default_rng().integers(-1, 2)))


class CriesWolf(Base):
    def judge(self, residual, deviation):
        return Level.POSITIVE


class NeverForgets(Base):
    def reset(self):
        self.signal = Level.NEGATIVE
        self.count = getattr(self, "count", 0)


class HidesState(Base):
    def reset(self):
        super().reset()
        self._count = 0

    def judge(self, residual, deviation):
        self._count += 1
        return Level.POSITIVE if self._count % 5 == 0 and residual.any() else Level.NEGATIVE


class KeepsAll(Base):
    def reset(self):
        super().reset()
        self.all = []

    def judge(self, residual, deviation):
        self.all += residual.tolist()
        return super().judge(residual, deviation)


class TakesAnything(Base):
    def update(self, residual, deviation=None):
        super().update(np.nan_to_num(np.ravel(residual)) if np.size(residual) else 0.0)


class LooksAtTheLast(Base):
    order_free = True

    def judge(self, residual, deviation):
        return super().judge(residual[-1:], deviation)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("culprit", "promise"),
    [
        (RenamesItsArgument, "arguments_round_trip"),
        (SharesItsState, "clone_is_fresh_and_independent"),
        (ReturnsItself, "answers"),
        (WarnsAllTheSame, "answers"),
        (ThrowsDice, "deterministic"),
        (CriesWolf, "quiet_at_zero"),
        (NeverForgets, "starts_anew_after_a_drift"),
        (HidesState, "restart_changes_nothing"),
        (KeepsAll, "state_is_bounded_json"),
        (TakesAnything, "refuses_what_it_cannot_use"),
        (LooksAtTheLast, "order_free"),
    ],
)
def test_the_suite_finds_the_culprit(culprit, promise):
    """Each check can fail, and names itself."""
    check_detector(Base())
    with pytest.raises(AssertionError) as caught:
        check_detector(culprit())
    assert str(caught.value).endswith(f"({promise})"), str(caught.value)


def test_every_check_is_tried_above():
    """A check that nothing breaks is no check."""
    marks = test_the_suite_finds_the_culprit.pytestmark[0].args[1]
    assert {promise for _, promise in marks} == set(DETECTOR_CHECKS)


def test_an_unknown_skip_is_refused():
    """A misspelt exception would silently check nothing less."""
    with pytest.raises(OptionError, match="did you mean 'quiet_at_zero'"):
        check_detector(Threshold(), skip=("quiet_at_zer",))
