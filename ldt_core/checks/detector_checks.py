"""Generic suite for whoever writes a detector of their own."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from ldt_core.base.errors import OptionError, did_you_mean
from ldt_core.base.experiment import Level, Samples
from ldt_core.detectors.base import Detector

#: Experiments in a stream: enough for several drifts of a slow detector.
EXPERIMENTS = 120
#: Samples in each.
SAMPLES = 50
#: Experiments between two restarts.
RESTART_EVERY = 7
#: Experiments of a long run without drift.
LONG_EXPERIMENTS = 400
#: Samples in each of them.
LONG_SAMPLES = 500
#: Size of the state after it as JSON, at most: all its samples would be about 4 MB.
MOST_BYTES = 2_000_000
SEED = 20240604

Check = Callable[[Detector], None]
DETECTOR_CHECKS: dict[str, Check] = {}


def check_detector(detector: Detector, skip: tuple[str, ...] = ()) -> None:
    """Check that a detector keeps the promises of `ldt_core.detectors.base.Detector`.

    Args:
        detector: any instance; it is cloned, not changed.
        skip: names of `DETECTOR_CHECKS` that are not meant to hold for this one. Only
            `quiet_at_zero` is ever a matter of taste: a detector by the calendar cannot keep it.

    Raises:
        AssertionError: with a sentence, at the first promise that is not kept.
        OptionError: a name in `skip` that is no check.
    """
    for name in skip:
        if name not in DETECTOR_CHECKS:
            raise OptionError("skip", did_you_mean(name, DETECTOR_CHECKS), repr(name))
    for name, check in DETECTOR_CHECKS.items():
        if name not in skip:
            try:
                check(detector)
            except AssertionError as error:
                raise AssertionError(f"{detector!r}: {error} ({name})") from error


def _detector_check(check: Check) -> Check:
    DETECTOR_CHECKS[check.__name__.lstrip("_")] = check
    return check


def _stream(experiments: int = EXPERIMENTS, samples: int = SAMPLES) -> Iterator[Samples]:
    """Residuals [rad/s] that grow from nothing to large and fall back, five times over."""
    rng = np.random.default_rng(SEED)
    for i in range(experiments):
        scale = 10.0 ** (4 * (5 * i / experiments % 1) - 2)
        yield scale * rng.standard_normal(samples)


def _seen(detector: Detector) -> dict[str, Any]:
    return {"state": detector.state(), "statistics": detector.statistics}


def _run(detector: Detector, stream: Iterator[Samples]) -> list[dict[str, Any]]:
    seen = []
    for residual in stream:
        detector.update(residual)
        seen.append(_seen(detector))
    return seen


@_detector_check
def _arguments_round_trip(detector: Detector) -> None:
    """The constructor's arguments can be read back and make the same detector."""
    try:
        twin = detector.clone()
    except Exception as error:
        raise AssertionError(f"clone failed with {type(error).__name__}: {error}") from error
    assert twin.get_params() == detector.get_params(), (
        f"the clone has the arguments {twin.get_params()}, the original {detector.get_params()}; "
        "the constructor must store them under their own names"
    )
    assert repr(twin) == repr(detector), "a clone must look the same"


@_detector_check
def _clone_is_fresh_and_independent(detector: Detector) -> None:
    """A clone has seen nothing and shares nothing."""
    used = detector.clone()
    fresh = used.state()
    _run(used, _stream())
    after = used.state()
    twin = used.clone()
    assert twin.state() == fresh, "the clone of a used detector must have seen nothing"
    _run(twin, _stream(10))
    assert used.state() == after, "updating the clone changed the original"


@_detector_check
def _answers(detector: Detector) -> None:
    """`update` returns nothing and leaves its input; the three ways to read the answer agree."""
    own = detector.clone()
    assert own.signal is Level.NEGATIVE, "a fresh detector must be negative"
    for residual in _stream():
        before = residual.copy()
        assert own.update(residual) is None, "update must return None"  # type: ignore[func-returns-value]
        assert np.array_equal(before, residual), "update changed the residual it was given"
        assert isinstance(own.signal, Level), f"signal must be a Level, got {own.signal!r}"
        assert own.drift_detected == (int(own.signal) == 1), "drift_detected disagrees with signal"
        assert own.warning_detected == (int(own.signal) == 0), (
            "warning_detected disagrees with signal"
        )
        assert own.warns or int(own.signal) != 0, "it warned, but its class says that it cannot"
        for name, value in own.statistics.items():
            assert isinstance(value, int | float), f"statistic {name} must be a number: {value!r}"


@_detector_check
def _deterministic(detector: Detector) -> None:
    """The same stream gives the same answers."""
    first, second = _run(detector.clone(), _stream()), _run(detector.clone(), _stream())
    assert first == second, "two clones gave different answers to the same stream"


@_detector_check
def _quiet_at_zero(detector: Detector) -> None:
    """A perfect model is never found to have drifted."""
    own = detector.clone()
    for i in range(1, EXPERIMENTS + 1):
        own.update(np.zeros(SAMPLES))
        assert not own.drift_detected, f"positive at experiment {i} with all residuals zero"


@_detector_check
def _starts_anew_after_a_drift(detector: Detector) -> None:
    """After a positive the detector is as good as new."""
    own = detector.clone()
    for residual in _stream():
        drifted = own.drift_detected
        own.update(residual)
        if drifted:
            fresh = detector.clone()
            fresh.update(residual)
            assert _seen(own) == _seen(fresh), "it remembers what was before the drift it detected"
    own.reset()
    assert own.state() == detector.clone().state(), "reset must forget everything"


@_detector_check
def _restart_changes_nothing(detector: Detector) -> None:
    """A detector restored from JSON goes on as if nothing had happened."""
    stream = list(_stream())
    whole = _run(detector.clone(), iter(stream))
    own = detector.clone()
    for i, residual in enumerate(stream):
        own.update(residual)
        if i % RESTART_EVERY == 0 or own.drift_detected:
            text = json.dumps(own.state(), allow_nan=False)
            own = detector.clone()
            own.restore(json.loads(text))
        assert _seen(own) == whole[i], f"restored, it differs at experiment {i + 1}"


@_detector_check
def _state_is_bounded_json(detector: Detector) -> None:
    """The state is JSON, and does not grow for ever."""
    own = detector.clone()
    rng = np.random.default_rng(SEED)
    for _ in range(LONG_EXPERIMENTS):
        own.update(1e-3 * rng.standard_normal(LONG_SAMPLES))
    try:
        size = len(json.dumps(own.state(), allow_nan=False))
    except (TypeError, ValueError) as error:
        raise AssertionError(f"the state is not plain JSON: {error}") from error
    samples = LONG_EXPERIMENTS * LONG_SAMPLES
    assert size <= MOST_BYTES, f"after {samples} samples without a drift the state has {size} bytes"


@_detector_check
def _refuses_what_it_cannot_use(detector: Detector) -> None:
    """Samples that are not finite, and states of others, leave no trace."""
    own = detector.clone()
    before = own.state()
    for bad in ([], [np.nan], [0.0, np.inf], [[0.0]]):
        try:
            own.update(bad)
        except ValueError:
            assert own.state() == before, f"it refused the residual {bad} but has changed"
        else:
            raise AssertionError(f"it took the residual {bad}")
    for state in ({"foreign": 1.0}, {**before, "signal": 2}):
        try:
            own.restore(state)
        except OptionError:
            assert own.state() == before, f"it refused the state {state} but has changed"
        else:
            raise AssertionError(f"it took the state {state}")


@_detector_check
def _order_free(detector: Detector) -> None:
    """Where the class says so, the order of samples inside an experiment does not matter."""
    if detector.order_free:
        rng = np.random.default_rng(SEED)
        plain = _run(detector.clone(), _stream())
        mixed = _run(detector.clone(), (rng.permutation(residual) for residual in _stream()))
        assert plain == mixed, "its class says order_free, but the order of samples matters"
