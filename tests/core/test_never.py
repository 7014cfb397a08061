"""The detector of a twin that does not learn."""

from ldt_core.detectors.never import Never


def test_nothing_moves_it():
    """However large the error, the answer is negative."""
    detector = Never()
    for worst in (0.0, 1.0, 1e300):
        detector.update([worst])
        assert (detector.signal, detector.drift_detected, detector.warning_detected) == (
            -1,
            False,
            False,
        )
    assert not detector.warns
